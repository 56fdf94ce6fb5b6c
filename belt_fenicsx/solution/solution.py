"""What a solver gives back: plain data in SI units, the same on every rank, with no method in it."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.belt import Belt
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.path import tangent_path
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.scene.units import Units
from belt_fenicsx.solution.fields import Fields, same_values
from belt_fenicsx.solution.reading import spans_of
from belt_fenicsx.solution.status import Status

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from belt_fenicsx.solution.certificate import Check
    from belt_fenicsx.solution.contact import Contact, Span, Zone
    from belt_fenicsx.solution.stages import Stage


class Evaluator(Protocol):
    """Fields of a solution at any points."""

    @property
    def arrays(self) -> Mapping[str, Array]:
        """What a file keeps of it, by name."""

    def __call__(self, sigma: Array, before: bool) -> Fields:
        """Fields at points ``(m,)`` [m], at a joint those of the zone before it, or after it."""


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
        transport_rate: Mass transport rate [m/s]; NaN where nothing was found.
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
    transport_rate: float = float("nan")
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

    @functools.cached_property
    def spans(self) -> tuple[Span, ...]:
        """The free spans, in the direction of travel; empty without fields."""
        return () if self.fields is None else spans_of(self.scene, self.zones, self.fields)

    @functools.cached_property
    def geometric_wraps(self) -> tuple[float, ...]:
        """Wrap angles of the taut string round the pulleys, where these are now, of each contact [rad]."""
        centers = {contact.pulley: contact.center for contact in self.contacts}
        if len(centers) < len(self.scene.pulleys):
            return (float("nan"),) * len(centers)
        return tuple(arc.wrap for arc in tangent_path(self.scene, [centers[i] for i in sorted(centers)]).arcs)

    @property
    def bending_stress(self) -> float:
        """Largest stress of bending at the surface, E h |kappa - curvature| / 2 [Pa].

        A band many times as wide as thick cannot narrow where it bends; its stress is larger by 1 / (1 - nu^2). It is
        NaN without fields, and of a belt whose stiffnesses alone are known.
        """
        belt = self.scene.belt
        return belt.youngs_modulus * self._surface[0] if isinstance(belt, Belt) else float("nan")

    @property
    def surface_strain(self) -> float:
        """Largest strain at the surface, |eps| + h |kappa - curvature| / 2 [-]; NaN where `bending_stress` is."""
        return self._surface[1]

    @functools.cached_property
    def _surface(self) -> tuple[float, float]:
        """Largest strains at the surface: of bending alone, and with the axial strain."""
        belt = self.scene.belt
        if self.fields is None or not isinstance(belt, Belt):
            return float("nan"), float("nan")
        bending = np.abs(self.fields.kappa - belt.curvature) * belt.thickness / 2.0
        return float(bending.max()), float((np.abs(self.fields.eps) + bending).max())

    @property
    def power(self) -> float:
        """Power that goes in at the pulleys that drive the belt [W]; NaN without contacts."""
        return -sum(min(contact.power, 0.0) for contact in self.contacts) if self.contacts else float("nan")

    @property
    def losses(self) -> float:
        """Power that friction takes where the belt slides [W]; NaN without contacts."""
        return sum(contact.sliding_loss for contact in self.contacts) if self.contacts else float("nan")

    @property
    def efficiency(self) -> float:
        """The part of the power that comes out at the pulleys that the belt drives [-].

        It is NaN where no pulley drives the belt, and between clamps, which take their share of the power.
        """
        return 1.0 - self.losses / self.power if self.scene.closed and self.power > 0.0 else float("nan")

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
            transport_rate=self.transport_rate * units.rate,
            contacts=tuple(contact.in_units(units) for contact in self.contacts),
            zones=tuple(zone.in_units(units) for zone in self.zones),
            fields=self.fields and self.fields.in_units(units),
        )

    def evaluate(self, sigma: Any, side: Literal["left", "right"] = "right") -> Fields:
        """Fields at any points of the belt, with the accuracy of the method.

        Args:
            sigma: Coordinates in [-Ls/2, Ls/2] ``(m,)``, or a single one [m].
            side: The side from which fields that jump at a joint between zones are taken.

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

        return Solution(**load(path))

    def plot(self, which: str = "drive") -> Figure:
        """A figure, which a notebook shows and `savefig` writes.

        Args:
            which: ``"drive"``, to scale with its numbers; ``"unrolled"``, pressure, friction, tension and sliding speed
                along the belt; ``"polar"``, the pressure round each pulley; or ``"overview"``, with strains.

        Raises:
            SceneError: There is no such figure, or nothing to be drawn.
        """
        from belt_fenicsx.solution.pictures import picture

        return picture(self, which)

    def export(self, folder: str | Path) -> None:
        """Writes the result, its scene, fields and versions into a folder, as ``--out`` does."""
        from belt_fenicsx.solution.files import export

        export(self, folder)

    def summary(self) -> dict[str, Any]:
        """Everything but the arrays, as plain data for JSON."""
        from belt_fenicsx.solution.summary import summary

        return summary(self)
