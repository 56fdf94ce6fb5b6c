"""Pulleys, and how they are driven."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal

from belt_fenicsx.scene.checks import SceneError, Verbatim, not_negative, number, pair, positive, shown, store
from belt_fenicsx.scene.units import Quantity, Units

Slip = Literal["forward", "backward"]
Side = Literal["right", "left"]
RUN_UP: Final = "run-up"
RUN_OFF: Final = "run-off"
DRIVES: Mapping[str, Quantity] = {
    "x_trans": Quantity(unit="m", text="transition", length=1),
    "omega": Quantity(unit="rad/s", text="omega", length=-1, rate=1),
    "torque": Quantity(unit="N m", text="torque", length=1, force=1),
    "slip_angle": Quantity(unit="rad", text="slip angle"),
}
DRAG = Quantity(unit="N m s", text="drag", length=2, force=1, rate=-1)
FORCE = Quantity(unit="N", text="force", force=1)


@dataclass(frozen=True)
class Drive:
    """What drives a pulley.

    Attributes:
        kind: ``"x_trans"``, ``"omega"``, ``"torque"``, ``"slip_angle"``, or ``"none"`` where nothing does.
        value: Its value [m], [rad/s], [N m] or [rad]; of ``"x_trans"`` also ``"run-up"`` or ``"run-off"``.
        slip: Sense of the sliding after ``"x_trans"`` or in a ``"slip_angle"``; None where it follows.
        drag: What each unit of the angular velocity adds to a torque [N m s].
    """

    kind: str
    value: float | Literal["run-up", "run-off"]
    slip: Slip | None = None
    drag: float = 0.0

    @property
    def is_place(self) -> bool:
        """Whether it says where stick ends."""
        return self.kind in ("x_trans", "slip_angle")

    def by(self, kind: str) -> float:
        """Its value, of a drive that is of this kind and by a number."""
        assert self.kind == kind and not isinstance(self.value, str), f"a drive by {self.kind} = {self.value}"
        return self.value

    def dimensionless(self, units: Units) -> dict[str, Any]:
        """The value in these units, as keyword of a pulley."""
        if self.kind == "none" or isinstance(self.value, str):
            return {}
        return {self.kind: self.value / DRIVES[self.kind].scale(units), "drag": self.drag / DRAG.scale(units)}


@dataclass(frozen=True, kw_only=True)
class Pulley:
    """A rigid pulley on one side of the belt, with Coulomb friction.

    The pulley is driven by at most one of ``x_trans``, ``omega``, ``torque`` and ``slip_angle``.

    Attributes:
        radius: Radius R of the circle on which the touching fibre runs [m].
        center: Centre C = (xc, H) ``(2,)`` [m].
        friction: Friction coefficient mu [-]; zero for a frictionless pulley.
        side: Where the pulley is, as seen in the direction of travel: ``"right"`` or ``"left"``.
        x_trans: Place where stick ends and sliding begins, a global coordinate [m]; ``"run-off"`` where the belt
            sticks all along the contact, ``"run-up"`` where it slides all along.
        slip: Sense of the sliding after ``x_trans`` or in ``slip_angle``: ``"forward"`` (the belt is faster) or
            ``"backward"``.
        omega: Angular velocity [rad/s], positive where the pulley's surface moves with the belt.
        torque: Moment that the belt exerts on the pulley [N m], positive where it drives it along.
        drag: Added to ``torque`` for each unit of the angular velocity [N m s].
        slip_angle: The part of the wrap that slides before the run-off [rad].
        take_up: Direction ``(2,)`` in which the pulley is free to move [-]; None where its centre is fixed.
        force: Force with which it is pushed in this direction [N].
        drive: The one that is given, with its sense of sliding; follows from the others.

    Raises:
        SceneError: A value is out of its range, or more than one drive is given.
    """

    radius: float = 0.7
    center: tuple[float, float] = (0.0, -0.575)
    friction: float = 0.2
    side: Side = "right"
    x_trans: float | Literal["run-up", "run-off"] | None = None
    slip: Slip | None = None
    omega: float | None = None
    torque: float | None = None
    drag: float = 0.0
    slip_angle: float | None = None
    take_up: tuple[float, float] | None = None
    force: float | None = None
    drive: Drive = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        store(
            self,
            radius=positive("radius", self.radius, "m"),
            center=pair("center", self.center, "(xc, H)", "m"),
            friction=not_negative("friction", self.friction, "-"),
        )
        if self.side not in ("right", "left"):
            raise SceneError("side", 'be "right" or "left"', self.side)
        drive = self._checked_drive()
        store(self, drive=drive, slip=drive.slip, drag=drive.drag)
        if drive.kind != "none":
            store(self, **{drive.kind: drive.value})
        self._check_take_up()

    @property
    def turn(self) -> float:
        """The sign s with which the belt's tangent turns by -s D / R: +1 on the right of the belt, -1 on its left."""
        return 1.0 if self.side == "right" else -1.0

    @property
    def surface_speed(self) -> float:
        """Speed R omega of the surface of a pulley whose speed is given [m/s]."""
        return self.radius * self.drive.by("omega")

    @property
    def direction(self) -> tuple[float, float]:
        """Unit vector along the take-up; zero without one."""
        x, y = self.take_up or (0.0, 0.0)
        length = math.hypot(x, y) or 1.0
        return x / length, y / length

    def displaced(self, move: float) -> tuple[float, float]:
        """Centre with the take-up displaced [m]."""
        (x, y), (dx, dy) = self.center, self.direction
        return x + move * dx, y + move * dy

    def _check_take_up(self) -> None:
        if self.take_up is None:
            if self.force is not None:
                raise SceneError("force", "be left out without `take_up`, the direction in which it pushes", self.force)
            return
        direction = pair("take_up", self.take_up, "(dx, dy)", "-")
        if math.hypot(*direction) == 0.0:
            raise SceneError("take_up", "be a direction other than (0, 0) [-]", self.take_up)
        if self.force is None:
            raise SceneError("force", "be given beside `take_up` [N]", Verbatim("nothing"))
        store(self, take_up=direction, force=positive("force", self.force, "N"))

    def _checked_drive(self) -> Drive:
        given = {kind: value for kind in DRIVES if (value := getattr(self, kind)) is not None}
        if len(given) > 1:
            got = Verbatim(" and ".join(f"{kind} = {shown(value)}" for kind, value in given.items()))
            raise SceneError([*given][1], f"be the only drive of {', '.join(f'`{kind}`' for kind in DRIVES)}", got)
        ((kind, value),) = given.items() or [("none", 0.0)]
        drag = number("drag", self.drag, DRAG.unit)
        if drag != 0.0 and kind != "torque":
            raise SceneError("drag", "be left out without `torque`, to which it adds", self.drag)
        if kind in ("omega", "torque"):
            if self.slip is not None:
                raise SceneError("slip", f"be left out with `{kind}`, from which it follows", self.slip)
            return Drive(kind, number(kind, value, DRIVES[kind].unit), drag=drag)
        if self.slip not in (None, "forward", "backward"):
            raise SceneError("slip", 'be "forward" or "backward"', self.slip)
        if kind == "none":
            return Drive(kind, 0.0, self.slip)
        checked = self._checked_place(value) if kind == "x_trans" else not_negative(kind, value, DRIVES[kind].unit)
        return Drive(kind, checked, self.slip or "forward")

    def _checked_place(self, x_trans: Any) -> Any:
        if isinstance(x_trans, str):
            if x_trans not in (RUN_UP, RUN_OFF):
                raise SceneError("x_trans", 'be a finite number [m], "run-up" or "run-off"', x_trans)
            return x_trans
        place, xc = number("x_trans", x_trans, "m"), self.center[0]
        if abs(place - xc) >= self.radius:
            low, high = xc - self.radius, xc + self.radius
            raise SceneError("x_trans", f"lie over the pulley, in ({low:g}, {high:g}) [m]", x_trans)
        return place

    def driven(self, **drive: Any) -> Pulley:
        """The pulley with another drive, or with none."""
        nothing: dict[str, Any] = dict.fromkeys(DRIVES)
        return replace(self, **{**nothing, "slip": None, "drag": 0.0, **drive})

    def dimensionless(self, units: Units) -> Pulley:
        """The pulley in these units."""
        center = (self.center[0] / units.length, self.center[1] / units.length)
        force = self.force and self.force / FORCE.scale(units)
        changed = self.drive.dimensionless(units)
        return replace(self, radius=self.radius / units.length, center=center, force=force, **changed)
