"""Zones of the belt, its contacts with pulleys, and its free spans."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from belt_fenicsx.scene.pulley import DRIVES, FORCE, Slip
from belt_fenicsx.scene.units import Quantity, Units
from belt_fenicsx.solution.fields import same_values

POWER = Quantity(unit="W", text="power", force=1, rate=1)
# Of a contact, in the order in which they are told.
QUANTITIES: Mapping[str, Quantity] = {
    "omega": DRIVES["omega"],
    "x_up": Quantity(unit="m", text="run-up", length=1),
    "x_trans": DRIVES["x_trans"],
    "x_off": Quantity(unit="m", text="run-off", length=1),
    "torque": DRIVES["torque"],
    "wrap_angle": Quantity(unit="rad", text="wrap angle"),
}
# With what else a contact has whose value depends on units.
ALL: Mapping[str, Quantity] = {
    **QUANTITIES,
    "center": Quantity(unit="m", text="centre", length=1),
    "run_up": Quantity(unit="m", text="run-up", length=1),
    "run_off": Quantity(unit="m", text="run-off", length=1),
    "hub_force": FORCE,
    "tension_up": FORCE,
    "tension_off": FORCE,
    "sliding_loss": POWER,
    "capacity": DRIVES["torque"],
    "take_up": Quantity(unit="m", text="take-up", length=1),
}
# What else is one number of a contact, or of a span, with its unit.
OF_CONTACT: Mapping[str, str] = {
    **{name: quantity.unit for name, quantity in QUANTITIES.items()},
    "slip_angle": "rad",
    "capacity": "N m",
    "power": "W",
    "sliding_loss": "W",
    "tension_up": "N",
    "tension_off": "N",
    "tight": "N",
    "slack": "N",
    "hub_load": "N",
    "hub_angle": "rad",
    "creep": "-",
    "take_up": "m",
}
OF_SPAN: Mapping[str, str] = {
    "length": "m",
    "tension": "N",
    "speed": "m/s",
    "sag": "m",
    "frequency": "Hz",
    "angle": "rad",
}


@dataclass(frozen=True, kw_only=True)
class Zone:
    """A part of the belt with one contact state.

    Attributes:
        kind: ``"free"``, ``"stick"`` or ``"slip"``.
        slip: Sense of sliding of a slip zone, otherwise None.
        pulley: Index of the pulley that it lies on; None for a free zone.
        sigma: Ends ``(2,)`` in the material-length coordinate [m].
        x: Ends ``(2,)`` in the global coordinate [m]; on a pulley, those of the touching fibre.
    """

    kind: str
    slip: Slip | None = None
    pulley: int | None = None
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Contact:
    """The contact of the belt with one pulley. Its places are those of the touching fibre.

    Contacts are equal that have equal values.

    Attributes:
        pulley: Index of the pulley.
        omega: Angular velocity of the pulley [rad/s], positive where its surface moves with the belt.
        x_up: Run-up point [m].
        x_trans: Transition from stick to slip [m]; the run-off in pure stick, the run-up in pure slip.
        x_off: Run-off point [m].
        torque: Moment of the belt on the pulley [N m], positive where it drives it along.
        wrap_angle: Angle of the pulley between run-up and run-off [rad].
        center: Centre of the pulley ``(2,)``, where its take-up has brought it [m].
        run_up: Place x, y of the run-up ``(2,)`` [m].
        run_off: Place x, y of the run-off ``(2,)`` [m].
        angle_up: Angle of the tangent at the run-up, counted on along the belt [rad].
        angle_off: Angle of the tangent at the run-off [rad].
        slip_angle: The part of the wrap that slides before the run-off [rad].
        hub_force: Force of the belt on the pulley, with the weight of what lies on it ``(2,)`` [N].
        tension_up: Tension of the belt at the run-up, elastic, along the tangent of its middle line [N].
        tension_off: Tension at the run-off [N].
        creep: How much slower the pulley's surface is than that of the driver, the pulley that puts in most power, as a
            part of the latter [-]; NaN where no pulley puts in any.
        sliding_loss: Power that friction takes where the belt slides [W].
        capacity: Torque that the pulley transmits at most, the rest of the drive as it is [N m]; NaN if not known.
        take_up: Displacement of the pulley along its take-up [m].
        zones: The contact's zones, in the direction of travel.
    """

    pulley: int
    omega: float
    x_up: float
    x_trans: float
    x_off: float
    torque: float
    wrap_angle: float
    center: tuple[float, float]
    run_up: tuple[float, float]
    run_off: tuple[float, float]
    angle_up: float
    angle_off: float
    slip_angle: float
    hub_force: tuple[float, float]
    tension_up: float
    tension_off: float
    creep: float
    sliding_loss: float
    capacity: float
    take_up: float
    zones: tuple[Zone, ...]

    def __eq__(self, other: object) -> bool:
        return same_values(self, other) if isinstance(other, Contact) else NotImplemented

    def __hash__(self) -> int:
        return hash((self.pulley, self.omega, self.torque, self.zones))

    @property
    def power(self) -> float:
        """Power of the belt on the pulley [W], positive where it drives it."""
        return self.torque * self.omega

    @property
    def hub_load(self) -> float:
        """Size of the hub force [N]."""
        return math.hypot(*self.hub_force)

    @property
    def hub_angle(self) -> float:
        """Direction of the hub force, from the x axis [rad]."""
        return math.atan2(self.hub_force[1], self.hub_force[0])

    @property
    def tight(self) -> float:
        """The larger of the tensions at run-up and run-off [N]."""
        return max(self.tension_up, self.tension_off)

    @property
    def slack(self) -> float:
        """The smaller of the tensions at run-up and run-off [N]."""
        return min(self.tension_up, self.tension_off)

    def in_units(self, units: Units) -> Contact:
        """The contact of a dimensionless scene in the given units."""
        scaled: dict[str, Any] = {}
        for name, quantity in ALL.items():
            value, scale = getattr(self, name), quantity.scale(units)
            if scale != 1.0:
                scaled[name] = (value[0] * scale, value[1] * scale) if isinstance(value, tuple) else value * scale
        return replace(self, zones=tuple(zone.in_units(units) for zone in self.zones), **scaled)

    def __repr__(self) -> str:
        zones = ", ".join(zone.name for zone in self.zones)
        return (
            f"<Contact omega = {self.omega:.12g} rad/s, x = {self.x_up:.6g} ... {self.x_trans:.6g} ... "
            f"{self.x_off:.6g} m, torque = {self.torque:.6g} N m, wrap angle = {self.wrap_angle:.6g} rad: {zones}>"
        )


@dataclass(frozen=True, kw_only=True)
class Span:
    """A free part of the belt.

    Attributes:
        sigma: Ends ``(2,)`` in the material-length coordinate [m].
        length: Material length [m].
        tension: Elastic force along the tangent of the middle line at the start, in the middle and at the end
            ``(3,)`` [N].
        speed: Speed of the belt in the middle [m/s].
        sag: Largest distance of the fields' points from the chord [m].
        frequency: First frequency with which the span vibrates across its chord [Hz]; NaN of a belt without mass. With
            the tension T, the mass m per length, the length l and the speed v of the belt in its middle, taken for a
            string between fixed ends, it is (w^2 - v^2) / (2 l w), where w^2 = T / m: waves run at w + v and w - v.
        angle: Angle of the chord, counted on along the belt [rad].
    """

    sigma: tuple[float, float]
    length: float
    tension: tuple[float, float, float]
    speed: float
    sag: float
    frequency: float
    angle: float
