"""What a solver gives back: plain data in SI units, the same on every rank, with no method in it."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.pulley import Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.scene.units import Units
from belt_fenicsx.solution.fields import Fields, same_values


class Evaluator(Protocol):
    """Fields of a solution at any points."""

    @property
    def arrays(self) -> Mapping[str, Array]:
        """What it is made from, by name."""

    def __call__(self, sigma: Array, before: bool) -> Fields:
        """Fields at points ``(m,)`` [m], at a border those of the zone before it, or after it."""


class Status(enum.Enum):
    """How a solve ended; the value is the sentence for the user."""

    SOLVED = "Solved: the iteration converged and the state is admissible."
    NOT_ADMISSIBLE = "The iteration converged, but the state is not admissible."
    NEWTON_DIVERGED = "Newton's iteration did not converge."
    MULTIPLIERS_DIVERGED = "The updates of the contact multipliers did not converge."
    REFUSED = "The scene cannot be meant as it is."
    CONTACT_LOST = "The iteration lost the contact between the belt and the pulley."
    NO_CONTACT = "The straight belt does not touch the pulley: there is nothing to solve."
    ACCURACY_NOT_REACHED = "The iteration converged, but not to the accuracy that was asked for."
    CAPACITY_EXCEEDED = "The torque is beyond what friction can transmit."


# Ends of an iteration that say nothing of their reason.
BLIND = (Status.NEWTON_DIVERGED, Status.MULTIPLIERS_DIVERGED, Status.CONTACT_LOST)


@dataclass(frozen=True, kw_only=True)
class Zone:
    """A part of the belt with one contact state.

    Attributes:
        kind: ``"free"``, ``"stick"`` or ``"slip"``.
        slip: Sense of sliding of a slip zone, otherwise None.
        sigma: Ends ``(2,)`` in the material-length coordinate [m].
        x: Ends ``(2,)`` in the global coordinate [m].
    """

    kind: str
    slip: Slip | None = None
    sigma: tuple[float, float]
    x: tuple[float, float]

    @property
    def name(self) -> str:
        """The contact state in words, as in ``"forward slip"``."""
        return f"{self.slip} slip" if self.slip else self.kind

    def in_units(self, units: Units) -> Zone:
        """The zone of a dimensionless scene in the given units."""
        length = units.length
        return Zone(
            kind=self.kind,
            slip=self.slip,
            sigma=(self.sigma[0] * length, self.sigma[1] * length),
            x=(self.x[0] * length, self.x[1] * length),
        )


@dataclass(frozen=True, kw_only=True)
class Contact:
    """The contact of the belt with one pulley.

    Attributes:
        omega: Angular velocity of the pulley [rad/s], positive where its top moves with the belt.
        x_up: Run-up point [m].
        x_trans: Transition from stick to slip [m]; the run-off in pure stick, the run-up in pure slip.
        x_off: Run-off point [m].
        torque: Moment of the belt on the pulley [N m], positive where it drives it along.
        wrap_angle: Angle of the pulley between run-up and run-off [rad].
        zones: The contact's zones, in the direction of travel.
    """

    omega: float
    x_up: float
    x_trans: float
    x_off: float
    torque: float
    wrap_angle: float
    zones: tuple[Zone, ...]

    def in_units(self, units: Units) -> Contact:
        """The contact of a dimensionless scene in the given units."""
        length = units.length
        return Contact(
            omega=self.omega * units.of(length=-1, rate=1),
            x_up=self.x_up * length,
            x_trans=self.x_trans * length,
            x_off=self.x_off * length,
            torque=self.torque * units.of(length=1, force=1),
            wrap_angle=self.wrap_angle,
            zones=tuple(zone.in_units(units) for zone in self.zones),
        )

    def __repr__(self) -> str:
        zones = ", ".join(zone.name for zone in self.zones)
        return (
            f"<Contact omega = {self.omega:.12g} rad/s, x = {self.x_up:.6g} ... {self.x_trans:.6g} ... "
            f"{self.x_off:.6g} m, torque = {self.torque:.6g} N m, wrap angle = {self.wrap_angle:.6g} rad: {zones}>"
        )


@dataclass(frozen=True, kw_only=True)
class Check:
    """One line of the certificate.

    Attributes:
        name: What must hold.
        margin: How far it holds, relative to the natural size of the checked quantity; negative where it does not.
        tolerance: The negative margin that the discretisation is allowed.
        x: Where the margin is smallest [m].
    """

    name: str
    margin: float
    tolerance: float
    x: float

    @property
    def holds(self) -> bool:
        """Whether the margin is within the tolerance; false for NaN."""
        return bool(self.margin >= -self.tolerance)

    def __str__(self) -> str:
        verdict = "holds" if self.holds else "violated"
        margin = f"margin {self.margin:.3g} at x = {self.x:.6g} m (tolerance {self.tolerance:.1g})"
        return f"{self.name}: {verdict}, {margin}"


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A stage of a solve.

    Attributes:
        name: The stage.
        why: Why it ran, or why the scene did not need it.
        iterations: Newton iterations; None where the stage was skipped.
        seconds: Wall time [s].
    """

    name: str
    why: str
    iterations: int | None = None
    seconds: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """The answer to a scene.

    Solutions are equal that have equal values, of which ``state`` and ``evaluator`` are none. A solution that is
    pickled leaves its ``state`` behind, as one that is saved does: what a warm start needs is in the fields.

    Attributes:
        scene: The scene that was asked.
        method: The method that answered.
        status: How the solve ended.
        message: The stage where it ended and what was seen there.
        hints: What is unusual about the scene, in sentences, where the iteration failed and cannot say why.
        contacts: One contact for each pulley; empty where nothing was found.
        zones: All zones of the belt, in the direction of travel.
        fields: Fields along the belt; None where the solve failed before there were any.
        checks: The certificate.
        iterations: Newton iterations in all.
        error_estimate: Estimated relative error of omega; NaN where the method has none.
        field_errors: Estimated largest error of each field, relative to the field's largest value on the belt [-];
            empty where the method has none.
        stages: The stages, those that were skipped too.
        measures: What the iteration stopped on, by name.
        state: What a warm start needs, private to the method.
        evaluator: Fields at any points in the scene's units, private to the method; None where it knows them only
            where ``fields`` are.
    """

    scene: Scene
    method: str
    status: Status
    message: str = ""
    hints: tuple[str, ...] = ()
    contacts: tuple[Contact, ...] = ()
    zones: tuple[Zone, ...] = ()
    fields: Fields | None = field(default=None, repr=False)
    checks: tuple[Check, ...] = field(default=(), repr=False)
    iterations: int = 0
    error_estimate: float = float("nan")
    field_errors: Mapping[str, float] = field(default_factory=dict)
    stages: tuple[Stage, ...] = ()
    measures: Mapping[str, float] = field(default_factory=dict)
    state: Any = field(default=None, repr=False, compare=False)
    evaluator: Evaluator | None = field(default=None, repr=False, compare=False)

    def __eq__(self, other: object) -> bool:
        return same_values(self, other) if isinstance(other, Solution) else NotImplemented

    def __hash__(self) -> int:
        return hash((self.scene, self.method, self.status, self.message, self.iterations))

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "state": None}

    @property
    def omega(self) -> float:
        """Angular velocity of the only pulley [rad/s].

        Raises:
            AttributeError: There is no contact, or more than one.
        """
        if len(self.contacts) != 1:
            raise AttributeError(f"`omega` needs exactly one contact, got {len(self.contacts)}: {self.status.value}")
        return self.contacts[0].omega

    @property
    def success(self) -> bool:
        """Whether the solve converged to an admissible state."""
        return self.status is Status.SOLVED

    @property
    def admissible(self) -> bool:
        """Whether there is a state and every check of the certificate holds."""
        return bool(self.checks) and all(check.holds for check in self.checks)

    @property
    def violations(self) -> tuple[str, ...]:
        """The checks that do not hold, as sentences."""
        return tuple(str(check) for check in self.checks if not check.holds)

    @property
    def timings(self) -> Mapping[str, float]:
        """Wall time of the stages that ran, by name; stages of one name together [s]."""
        times: dict[str, float] = {}
        for stage in self.stages:
            if stage.iterations is not None:
                times[stage.name] = times.get(stage.name, 0.0) + stage.seconds
        return times

    def in_units(self, scene: Scene, units: Units) -> Solution:
        """The answer to ``scene``, of which this is the dimensionless one but for its evaluator."""
        return replace(
            self,
            scene=scene,
            contacts=tuple(contact.in_units(units) for contact in self.contacts),
            zones=tuple(zone.in_units(units) for zone in self.zones),
            fields=self.fields and self.fields.in_units(units),
        )

    def evaluate(self, sigma: Any, side: Literal["left", "right"] = "right") -> Fields:
        """Fields at any points of the belt, with the accuracy of the method.

        Args:
            sigma: Coordinates in [-Ls/2, Ls/2] ``(m,)``, or a single one [m].
            side: The side from which fields that jump at a border between zones are taken.

        Raises:
            SceneError: A coordinate lies outside of the belt, or the solution knows no fields between points: one by
                another method than the fitted one, or one from a file that was written without what it takes.
        """
        if self.evaluator is None:
            expected = (
                "know its fields between points, as those of `solve(scene, method='fitted')` do (one from an older "
                "file or by another method becomes such a one by `solve(solution.scene, initial=solution)`)"
            )
            raise SceneError("solution", expected, self)
        if side not in ("left", "right"):
            raise SceneError("side", 'be "left" or "right"', side)
        points, half = np.atleast_1d(np.asarray(sigma, dtype=float)), self.scene.belt.length / 2
        outside = ~(np.abs(points) <= half)
        if np.any(outside):
            raise SceneError("sigma", f"lie in the belt, in [{-half:g}, {half:g}] [m]", float(points[outside][0]))
        return self.evaluator(points, side == "left")

    def __repr__(self) -> str:
        from belt_fenicsx.solution.report import as_line

        return as_line(self)

    def _repr_html_(self) -> str:
        from belt_fenicsx.solution.report import as_html

        return as_html(self)

    def save(self, path: str | Path) -> None:
        """Writes the solution into a ``.npz`` file, from which `load` makes it again."""
        from belt_fenicsx.solution.files import save

        save(self, path)

    @staticmethod
    def load(path: str | Path) -> Solution:
        """Reads a solution that `save` wrote.

        Raises:
            SceneError: The file is not there or holds something else.
        """
        from belt_fenicsx.solution.files import load

        return load(path)

    def summary(self) -> dict[str, Any]:
        """Everything but the arrays, as plain data for JSON."""
        contacts = [{f.name: getattr(c, f.name) for f in fields(c) if f.name != "zones"} for c in self.contacts]
        for plain, contact in zip(contacts, self.contacts, strict=True):
            plain["zones"] = [_zone_summary(zone) for zone in contact.zones]
        return {
            "method": self.method,
            "status": self.status.name,
            "message": self.message or self.status.value,
            "success": self.success,
            "admissible": self.admissible,
            "violations": list(self.violations),
            "hints": list(self.hints),
            "omega": self.contacts[0].omega if len(self.contacts) == 1 else None,
            "contacts": contacts,
            "zones": [_zone_summary(zone) for zone in self.zones],
            "iterations": self.iterations,
            "error_estimate": None if np.isnan(self.error_estimate) else self.error_estimate,
            "field_errors": dict(self.field_errors),
            "measures": dict(self.measures),
            "stages": [{f.name: getattr(stage, f.name) for f in fields(stage)} for stage in self.stages],
            "timings": dict(self.timings),
        }


def _zone_summary(zone: Zone) -> dict[str, Any]:
    return {"kind": zone.kind, "slip": zone.slip, "sigma": list(zone.sigma), "x": list(zone.x)}


class SolveError(RuntimeError):
    """A solve that gave no admissible answer; ``solution`` holds what there is.

    Attributes:
        solution: The failed solution.
    """

    def __init__(self, solution: Solution) -> None:
        self.solution = solution
        super().__init__(solution)

    def __str__(self) -> str:
        solution = self.solution
        parts = (solution.status.value, solution.message, *solution.violations, *solution.hints)
        return " ".join(part for part in parts if part)


def finish(solution: Solution, *, throw: bool) -> Solution:
    """Gives back a good solution; raises for another one, or gives it back too where ``throw`` is false.

    Raises:
        SolveError: The solution is not a success and ``throw`` is true.
    """
    if throw and not solution.success:
        raise SolveError(solution)
    return solution
