"""The scene: a belt, its pulleys and how they are driven. Pure Python, frozen, validated, in SI units.

Nothing here knows a numerical method. `Scene.dimensionless` gives the scene that all methods solve (lengths
in units of the belt's length, forces in units of its extensional stiffness, unit transport rate), so that
no answer depends on the units of the question.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field, replace
from typing import Any

from belt_fenicsx.scene.belt import FURTHER, INERTIA, STIFFNESSES, Belt, StiffnessBelt
from belt_fenicsx.scene.checks import SceneError, Verbatim, number, pair, positive, store
from belt_fenicsx.scene.consistency import check_drives, check_on_path
from belt_fenicsx.scene.path import Path, near_angle, taut_path
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.units import Quantity, Units

GRAVITY = Quantity(unit="m/s^2", text="gravity", length=-1, rate=2)
FITS = {  # what fits the belt's length
    "elongation": Quantity(unit="-", text="elongation"),
    "tension": Quantity(unit="N", text="tension", force=1),
}
Clamp = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A belt between two clamps or in a closed loop, transported over pulleys. The defaults are the source's scene.

    Between clamps, which stand at x = -span/2 and x = +span/2, y = 0, with cross-section angle zero if they are not
    given, the belt travels from the first to the last. In a loop, it passes the pulleys in their order, and from the
    last one on to the first.

    Attributes:
        belt: The belt.
        pulleys: The pulleys, in the order of travel.
        span: Distance Lx of the clamps [m]; without a meaning in a loop and beside ``clamps``.
        clamps: Places x, y [m] and angles [rad] of both clamps; None where ``span`` says it, or in a loop.
        closed: Whether the belt is a loop.
        gravity: Gravity ``(2,)`` [m/s^2].
        transport_rate: Mass transport rate c [m/s]; 1 between clamps if it is not given, to be found in a loop.
        elongation: Strain of the belt when it lies round the pulleys at rest, taut [-]; it fits the belt's length.
        tension: Force of the belt there [N]; does the same.

    Raises:
        SceneError: A value is out of its range, or the pulleys and what drives them make no sense together.
    """

    belt: Belt | StiffnessBelt = field(default_factory=Belt)
    pulleys: tuple[Pulley, ...] = field(default_factory=lambda: (Pulley(),))
    span: float = 1.0
    clamps: tuple[Clamp, Clamp] | None = None
    closed: bool = False
    gravity: tuple[float, float] = (0.0, 0.0)
    transport_rate: float | None = None
    elongation: float | None = None
    tension: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.belt, Belt | StiffnessBelt):
            raise SceneError("belt", "be a Belt or a StiffnessBelt", self.belt)
        if not isinstance(self.pulleys, tuple | list) or not all(isinstance(p, Pulley) for p in self.pulleys):
            raise SceneError("pulleys", "be a tuple of Pulley", self.pulleys)
        pulleys = tuple(self.pulleys)
        if not pulleys:
            raise SceneError("pulleys", "hold at least one pulley", Verbatim("none"))
        if not isinstance(self.closed, bool):
            raise SceneError("closed", "be true or false", self.closed)
        if not self.closed and len(pulleys) == 1 and pulleys[0].drive.kind == "none":
            pulleys = (_changed(pulleys[0], "pulleys.0", x_trans=0.0),)
        rate = 1.0 if self.transport_rate is None and not self.closed else self.transport_rate
        store(
            self,
            pulleys=pulleys,
            span=positive("span", self.span, "m"),
            clamps=self._checked_clamps(),
            gravity=pair("gravity", self.gravity, "(gx, gy)", "m/s^2"),
            transport_rate=None if rate is None else positive("transport_rate", rate, "m/s"),
        )
        for index, pulley in enumerate(self.pulleys):
            self._check_clearance(index, pulley)
        strain = self._checked_strain()
        # Nothing of what follows can be wrong in the source's scenes, which are made again and again.
        if strain is not None or not self.is_published:
            self._lay_out(strain)

    @property
    def ends(self) -> tuple[Clamp, Clamp]:
        """Places x, y [m] and angles [rad] of both clamps, of a belt between clamps."""
        assert not self.closed, "a loop has no clamps"
        return self.clamps or ((-self.span / 2, 0.0, 0.0), (self.span / 2, 0.0, 0.0))

    @property
    def has_inertia(self) -> bool:
        """Whether the belt's forces depend on the transport rate."""
        return self.belt.line_density > 0.0 or self.belt.rotary_inertia > 0.0

    @property
    def is_published(self) -> bool:
        """Whether it is of the kind that the source solves: one pulley below a belt without loads, between clamps."""
        pulley, belt = self.pulleys[0], self.belt
        loads = belt.line_density or belt.rotary_inertia or belt.contact_offset
        more = self.closed or self.clamps or len(self.pulleys) != 1 or loads
        return not (more or pulley.side == "left" or pulley.take_up or pulley.drag or pulley.slip_angle is not None)

    @property
    def static_tension(self) -> float:
        """Tension of the belt round its pulleys at rest, b1 (length of the taut path / length at rest - 1) [N].

        It is NaN where a `take_up` makes the tension, and negative where the belt is slack.

        Raises:
            SceneError: The taut belt does not touch its pulley.
        """
        if any(pulley.take_up for pulley in self.pulleys):
            return math.nan
        return self.belt.extensional_stiffness * (taut_path(self).length / self.belt.length - 1.0)

    @property
    def has_span(self) -> bool:
        """Whether `span` says where the clamps are."""
        return not self.closed and self.clamps is None

    def _checked_clamps(self) -> tuple[Clamp, Clamp] | None:
        clamps = self.clamps
        if (self.closed or clamps is not None) and self.span != 1.0:
            where = "in a loop" if self.closed else "beside `clamps`"
            raise SceneError("span", f"be left out {where}, where it has no meaning", self.span)
        if clamps is None:
            return None
        if self.closed:
            raise SceneError("clamps", "be left out in a loop", clamps)
        if not _is_list(clamps, 2) or not all(_is_list(clamp, 3) for clamp in clamps):
            raise SceneError("clamps", "be two triples (x, y, angle) [m, m, rad]", clamps)
        first, last = (
            (number(f"clamps.{i}.0", x, "m"), number(f"clamps.{i}.1", y, "m"), number(f"clamps.{i}.2", angle, "rad"))
            for i, (x, y, angle) in enumerate(clamps)
        )
        return first, last

    def _checked_strain(self) -> float | None:
        """Strain of the taut belt at rest, if it is asked for."""
        given = {name: value for name in FITS if (value := getattr(self, name)) is not None}
        for index, pulley in enumerate(self.pulleys if given else ()):
            if pulley.take_up:
                expected = f"be left out beside `pulleys.{index}.take_up`, whose force makes the tension"
                raise SceneError(next(iter(given)), expected, next(iter(given.values())))
        if len(given) > 1:
            raise SceneError("tension", "be left out beside `elongation`, from which it follows", self.tension)
        for name, value in given.items():
            store(self, **{name: positive(name, value, FITS[name].unit)})
        if self.tension is not None:
            return self.tension / self.belt.extensional_stiffness
        return self.elongation

    def _lay_out(self, strain: float | None) -> None:
        """Lays the belt over its pulleys, taut: fits its length and checks what is to be seen then."""
        published = self.is_published
        if not published:
            check_drives(self)
        path = taut_path(self)
        if strain is not None:
            store(self, belt=_changed(self.belt, "belt", length=path.length / (1.0 + strain)))
        if not published:
            check_on_path(self, path)
        if not self.closed:
            self._count_angles(path)

    def _count_angles(self, path: Path) -> None:
        """Counts the clamps' angles on along the belt, whatever full turns they were given with."""
        counted = tuple(
            (x, y, near_angle(angle, line.angle))
            for (x, y, angle), line in zip(self.ends, (path.lines[0], path.lines[-1]), strict=True)
        )
        if counted != self.ends:
            store(self, clamps=counted, span=1.0)

    def _check_clearance(self, index: int, pulley: Pulley) -> None:
        if self.closed:
            return
        for side, (x, y, _) in zip(("first", "last") if self.clamps else ("left", "right"), self.ends, strict=True):
            distance = math.dist((x, y), pulley.center) - self.belt.contact_offset
            if distance <= pulley.radius:
                raise SceneError(
                    f"pulleys.{index}.radius",
                    f"be below {distance:g} [m], the distance of the centre from the {side} clamp (a clamp inside "
                    "the pulley)",
                    pulley.radius,
                )

    def dimensionless(self) -> tuple[Scene, Units]:
        """The scene in units of the belt's length, its extensional stiffness and the transport rate.

        Where the transport rate is to be found, its unit is the surface speed of the first pulley whose speed is given.

        Returns:
            The dimensionless scene, whose belt has unit length and unit extensional stiffness, and the units that
            turn its answers into this scene's.
        """
        units = Units(length=self.belt.length, force=self.belt.extensional_stiffness, rate=self._rate_unit())
        named = {**STIFFNESSES, **INERTIA, **FURTHER}
        belt = StiffnessBelt(
            length=1.0, **{name: getattr(self.belt, name) / quantity.scale(units) for name, quantity in named.items()}
        )
        clamps = self.clamps and tuple((x / units.length, y / units.length, angle) for x, y, angle in self.clamps)
        # What was checked together stays as good as it was in any units, and need not be checked again.
        scene = self.altered(
            belt=belt,
            pulleys=tuple(pulley.dimensionless(units) for pulley in self.pulleys),
            span=positive("span", self.span / units.length, "-") if self.has_span else self.span,
            clamps=clamps,
            gravity=tuple(component / GRAVITY.scale(units) for component in self.gravity),
            transport_rate=None if self.transport_rate is None else 1.0,
            elongation=None,
            tension=None,
        )
        return scene, units

    def altered(self, **values: Any) -> Scene:
        """The scene with other values that are known to make sense together, and need not be checked."""
        scene = copy.copy(self)
        store(scene, **values)
        return scene

    def _rate_unit(self) -> float:
        if self.transport_rate is not None:
            return self.transport_rate
        return next(pulley.radius * pulley.omega for pulley in self.pulleys if pulley.omega)


def _changed(part: Any, path: str, **values: float) -> Any:
    """A part of a scene with other values; what is wrong with them is named by its path."""
    try:
        return replace(part, **values)
    except SceneError as error:
        raise error.within(path) from None


def _is_list(value: object, length: int) -> bool:
    return isinstance(value, tuple | list) and len(value) == length
