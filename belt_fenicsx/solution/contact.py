"""Zones of the belt, and its contact with a pulley."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from belt_fenicsx.scene.pulley import DRIVES, Pulley, Slip
from belt_fenicsx.scene.units import Quantity, Units

# Of a contact, in the order in which they are told.
QUANTITIES: Mapping[str, Quantity] = {
    "omega": DRIVES["omega"],
    "x_up": Quantity(unit="m", text="run-up", length=1),
    "x_trans": DRIVES["x_trans"],
    "x_off": Quantity(unit="m", text="run-off", length=1),
    "torque": DRIVES["torque"],
    "wrap_angle": Quantity(unit="rad", text="wrap angle"),
}


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
        (start, end), (x_start, x_end), length = self.sigma, self.x, units.length
        return replace(self, sigma=(start * length, end * length), x=(x_start * length, x_end * length))


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

    @classmethod
    def from_zones(
        cls,
        zones: tuple[Zone, ...],
        pulley: Pulley,
        *,
        omega: float,
        torque: float,
        y: tuple[float, float],
        x_trans: float | None = None,
    ) -> Contact:
        """The contact that consists of zones on a pulley.

        Args:
            zones: The zones in contact, in the direction of travel.
            pulley: The pulley.
            omega: Its angular velocity [rad/s].
            torque: Moment of the belt on it [N m].
            y: Heights of the run-up and run-off point ``(2,)`` [m].
            x_trans: Transition [m]; by default the end of the first stick zone or, where nothing sticks, of the first
                slip zone behind which the belt slides the other way.
        """
        x_up, x_off = zones[0].x[0], zones[-1].x[1]
        if x_trans is None:
            stick = next((zone for zone in zones if zone.kind == "stick"), None)
            x_trans = stick.x[1] if stick else zones[0].x[len(zones) > 1]
        # Angles from the pulley's top jump at its bottom alone, which a belt between clamps does not touch.
        xc, yc = pulley.center
        up, off = math.atan2(x_up - xc, y[0] - yc), math.atan2(x_off - xc, y[1] - yc)
        return cls(
            omega=omega, x_up=x_up, x_trans=x_trans, x_off=x_off, torque=torque, wrap_angle=off - up, zones=zones
        )

    def in_units(self, units: Units) -> Contact:
        """The contact of a dimensionless scene in the given units."""
        scaled = {name: getattr(self, name) * quantity.scale(units) for name, quantity in QUANTITIES.items()}
        return replace(self, zones=tuple(zone.in_units(units) for zone in self.zones), **scaled)

    def __repr__(self) -> str:
        zones = ", ".join(zone.name for zone in self.zones)
        return (
            f"<Contact omega = {self.omega:.12g} rad/s, x = {self.x_up:.6g} ... {self.x_trans:.6g} ... "
            f"{self.x_off:.6g} m, torque = {self.torque:.6g} N m, wrap angle = {self.wrap_angle:.6g} rad: {zones}>"
        )
