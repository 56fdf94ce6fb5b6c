"""Pulleys, and how they are driven."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal

from belt_fenicsx.scene.checks import SceneError, Verbatim, number, positive, shown, store
from belt_fenicsx.scene.units import Quantity, Units

Slip = Literal["forward", "backward"]
RUN_UP: Final = "run-up"
RUN_OFF: Final = "run-off"
DRIVES: Mapping[str, Quantity] = {
    "x_trans": Quantity(unit="m", text="transition", length=1),
    "omega": Quantity(unit="rad/s", text="omega", length=-1, rate=1),
    "torque": Quantity(unit="N m", text="torque", length=1, force=1),
}


@dataclass(frozen=True)
class Drive:
    """What drives a pulley.

    Attributes:
        kind: ``"x_trans"``, ``"omega"`` or ``"torque"``.
        value: Its value [m], [rad/s] or [N m]; of ``"x_trans"`` also ``"run-up"`` or ``"run-off"``.
        slip: Sense of the sliding after ``"x_trans"``; None where it follows.
    """

    kind: str
    value: float | Literal["run-up", "run-off"]
    slip: Slip | None = None

    def by(self, kind: str) -> float:
        """Its value, of a drive that is of this kind and by a number."""
        assert self.kind == kind and not isinstance(self.value, str), f"a drive by {self.kind} = {self.value}"
        return self.value

    def dimensionless(self, units: Units) -> dict[str, Any]:
        """The value in these units, as keyword of a pulley."""
        return {self.kind: self.value if isinstance(self.value, str) else self.value / DRIVES[self.kind].scale(units)}


@dataclass(frozen=True, kw_only=True)
class Pulley:
    """A rigid pulley below the belt, with Coulomb friction.

    The pulley is driven by exactly one of ``x_trans``, ``omega`` and ``torque``; without any it is the source's
    ``x_trans=0.0``.

    Attributes:
        radius: Radius R [m].
        center: Centre C = (xc, H) ``(2,)`` [m].
        friction: Friction coefficient mu [-]; zero for a frictionless pulley.
        x_trans: Place where stick ends and sliding begins, a global coordinate [m]; ``"run-off"`` where the belt
            sticks all along the contact, ``"run-up"`` where it slides all along.
        slip: Sense of the sliding after ``x_trans``: ``"forward"`` (the belt is faster) or ``"backward"``.
        omega: Angular velocity [rad/s], positive where the pulley's top moves with the belt.
        torque: Moment that the belt exerts on the pulley [N m], positive where it drives it along.
        drive: The one that is given, with its sense of sliding; follows from the others.

    Raises:
        SceneError: A value is out of its range, or more than one drive is given.
    """

    radius: float = 0.7
    center: tuple[float, float] = (0.0, -0.575)
    friction: float = 0.2
    x_trans: float | Literal["run-up", "run-off"] | None = None
    slip: Slip | None = None
    omega: float | None = None
    torque: float | None = None
    drive: Drive = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        friction = number("friction", self.friction, "-")
        if friction < 0.0:
            raise SceneError("friction", "be zero or positive [-]", self.friction)
        store(self, radius=positive("radius", self.radius, "m"), center=self._checked_center(), friction=friction)
        drive = self._checked_drive()
        store(self, drive=drive, slip=drive.slip, **{drive.kind: drive.value})

    def _checked_center(self) -> tuple[float, float]:
        center = self.center
        if isinstance(center, str | Mapping) or not hasattr(center, "__getitem__") or len(center) != 2:
            raise SceneError("center", "be a pair of finite numbers (xc, H) [m]", center)
        return number("center.0", center[0], "m"), number("center.1", center[1], "m")

    def _checked_drive(self) -> Drive:
        given = {kind: value for kind in DRIVES if (value := getattr(self, kind)) is not None}
        if len(given) > 1:
            got = Verbatim(" and ".join(f"{kind} = {shown(value)}" for kind, value in given.items()))
            raise SceneError([*given][1], "be the only drive of `x_trans`, `omega`, `torque`", got)
        ((kind, value),) = given.items() or [("x_trans", 0.0)]
        if kind != "x_trans":
            if self.slip is not None:
                raise SceneError("slip", f"be left out with `{kind}`, from which it follows", self.slip)
            return Drive(kind, number(kind, value, DRIVES[kind].unit))
        if self.slip not in (None, "forward", "backward"):
            raise SceneError("slip", 'be "forward" or "backward"', self.slip)
        return Drive(kind, self._checked_place(value), self.slip or "forward")

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

    def dimensionless(self, units: Units) -> Pulley:
        """The pulley in these units."""
        center = (self.center[0] / units.length, self.center[1] / units.length)
        return replace(self, radius=self.radius / units.length, center=center, **self.drive.dimensionless(units))
