"""Pulleys, and how they are driven."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from belt_fenicsx.scene.checks import SceneError, Verbatim, number, positive, shown, store
from belt_fenicsx.scene.units import Units

Slip = Literal["forward", "backward"]
DRIVES = ("x_trans", "omega", "torque")
RUN_UP, RUN_OFF = "run-up", "run-off"


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

    def __post_init__(self) -> None:
        friction = number("friction", self.friction, "-")
        if friction < 0.0:
            raise SceneError("friction", "be zero or positive [-]", self.friction)
        store(self, radius=positive("radius", self.radius, "m"), center=self._checked_center(), friction=friction)
        self._check_drive()

    def _checked_center(self) -> tuple[float, float]:
        center = self.center
        if isinstance(center, str | Mapping) or not hasattr(center, "__getitem__") or len(center) != 2:
            raise SceneError("center", "be a pair of finite numbers (xc, H) [m]", center)
        return number("center.0", center[0], "m"), number("center.1", center[1], "m")

    def _check_drive(self) -> None:
        given = [name for name in DRIVES if getattr(self, name) is not None]
        if len(given) > 1:
            got = Verbatim(" and ".join(f"{name} = {shown(getattr(self, name))}" for name in given))
            raise SceneError(given[1], "be the only drive of `x_trans`, `omega`, `torque`", got)
        if not given:
            store(self, x_trans=0.0)
        if self.x_trans is None:
            if self.slip is not None:
                raise SceneError("slip", f"be left out with `{given[0]}`, from which it follows", self.slip)
            store(
                self, **{given[0]: number(given[0], getattr(self, given[0]), {"omega": "rad/s"}.get(given[0], "N m"))}
            )
            return
        if self.slip not in (None, "forward", "backward"):
            raise SceneError("slip", 'be "forward" or "backward"', self.slip)
        store(self, slip=self.slip or "forward")
        if isinstance(self.x_trans, str):
            if self.x_trans not in (RUN_UP, RUN_OFF):
                raise SceneError("x_trans", 'be a finite number [m], "run-up" or "run-off"', self.x_trans)
            return
        x_trans = number("x_trans", self.x_trans, "m")
        if abs(x_trans - self.center[0]) >= self.radius:
            xc, radius = self.center[0], self.radius
            raise SceneError("x_trans", f"lie over the pulley, in ({xc - radius:g}, {xc + radius:g}) [m]", self.x_trans)
        store(self, x_trans=x_trans)

    @property
    def drive(self) -> str:
        """Which of ``"x_trans"``, ``"omega"``, ``"torque"`` is given."""
        if self.x_trans is not None:
            return "x_trans"
        return "omega" if self.omega is not None else "torque"

    def dimensionless(self, units: Units) -> Pulley:
        """The pulley in these units."""
        value: Any = getattr(self, self.drive)
        if not isinstance(value, str):
            torque, omega = units.of(length=1, force=1), units.of(length=-1, rate=1)
            value /= {"x_trans": units.length, "omega": omega, "torque": torque}[self.drive]
        drive: dict[str, Any] = {self.drive: value}
        center = (self.center[0] / units.length, self.center[1] / units.length)
        return replace(self, radius=self.radius / units.length, center=center, **drive)
