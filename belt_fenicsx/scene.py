"""The scene: a belt, its pulley and how they are driven. Pure Python, frozen, validated, in SI units.

Nothing here knows a numerical method. `Scene.dimensionless` gives the scene that all methods solve (lengths
in units of the belt's length, forces in units of its extensional stiffness, unit transport rate), so that
no answer depends on the units of the question.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from numbers import Integral, Real
from typing import Any, Literal

Slip = Literal["forward", "backward"]
DRIVES = ("x_trans", "omega", "torque")
RUN_UP, RUN_OFF = "run-up", "run-off"
FEWEST_ELEMENTS = 2  # that any method may be asked for

# Products of powers of numbers of this size stay within the range of a float.
SMALLEST, LARGEST = 1e-100, 1e100


class SceneError(ValueError):
    """A scene that cannot be meant: names the field, what was expected, and what it got.

    Attributes:
        field: Name of the field, with its path where it comes from a file (``"pulleys.0.radius"``).
        expected: What the field must be, with its unit.
        got: The value that was given.
    """

    def __init__(self, field: str, expected: str, got: object) -> None:
        self.field, self.expected, self.got = field, expected, got
        super().__init__(field, expected, got)

    def __str__(self) -> str:
        return printable(f"`{self.field}` must {self.expected}, got {shown(self.got)}.")

    def __reduce__(self) -> tuple[type[SceneError], tuple[str, str, Verbatim]]:
        # What was given may be anything, and need not travel to another process: its text does.
        return SceneError, (self.field, self.expected, Verbatim(shown(self.got)))

    def within(self, path: str) -> SceneError:
        """The same error, with the field's path in front."""
        return SceneError(f"{path}.{self.field}", self.expected, self.got)


class Verbatim(str):
    """A value whose text goes into an error as it is, without quotes."""


def shown(value: object) -> str:
    """The value as an error shows it: short, whatever it is."""
    try:
        text = value if isinstance(value, Verbatim) else repr(value)
    except ValueError:  # Python refuses to write integers of thousands of digits.
        text = "an integer of too many digits"
    return text if len(text) <= 120 else f"{text[:117]}..."


def printable(text: str) -> str:
    """The text with escapes in place of what a terminal would obey: names in files may hold anything."""
    return "".join(char if char.isprintable() or char == "\n" else ascii(char)[1:-1] for char in text)


def number(name: str, value: object, unit: str) -> float:
    """Checks that ``value`` is a finite real number and returns it as a float."""
    try:
        # The first question is the quicker one, and mostly enough.
        if isinstance(value, float):
            result = float(value)
        else:
            result = math.nan if isinstance(value, bool) or not isinstance(value, Real) else float(value)
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise SceneError(name, f"be a finite number [{unit}]", value)
    if abs(result) > LARGEST:
        raise SceneError(name, f"be at most {LARGEST:g} in size [{unit}]", value)
    return result


def positive(name: str, value: object, unit: str) -> float:
    """Checks that ``value`` is a finite number above zero and returns it as a float."""
    result = number(name, value, unit)
    if result <= 0.0:
        raise SceneError(name, f"be positive [{unit}]", value)
    if result < SMALLEST:
        raise SceneError(name, f"be at least {SMALLEST:g} [{unit}]", value)
    return result


def whole_number(name: str, value: object, least: int) -> int:
    """Checks that ``value`` is a whole number of at least ``least`` and returns it as an int."""
    if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
        raise SceneError(name, f"be a whole number of at least {least}", value)
    return int(value)


def _set(instance: object, **values: object) -> None:
    """Stores validated values in a frozen dataclass that is still being made."""
    for name, value in values.items():
        object.__setattr__(instance, name, value)


@dataclass(frozen=True, kw_only=True)
class Belt:
    """A straight elastic belt of rectangular cross-section (18.1).

    Attributes:
        length: Material length Ls between the clamps [m].
        youngs_modulus: Young's modulus E [Pa].
        poisson_ratio: Poisson's ratio nu [-].
        thickness: Height h of the cross-section [m].
        width: Width w of the cross-section [m].

    Raises:
        SceneError: A value is not a finite number or out of its range.
    """

    length: float = 1.0
    youngs_modulus: float = 5e7
    poisson_ratio: float = 0.45
    thickness: float = 0.05
    width: float = 0.1

    def __post_init__(self) -> None:
        nu = number("poisson_ratio", self.poisson_ratio, "-")
        if not -1.0 < nu <= 0.5:
            raise SceneError("poisson_ratio", "lie in (-1, 0.5] [-]", self.poisson_ratio)
        _set(
            self,
            length=positive("length", self.length, "m"),
            youngs_modulus=positive("youngs_modulus", self.youngs_modulus, "Pa"),
            poisson_ratio=nu,
            thickness=positive("thickness", self.thickness, "m"),
            width=positive("width", self.width, "m"),
        )
        _check_range_of_stiffnesses(self)

    @property
    def bending_stiffness(self) -> float:
        """Bending stiffness a = E h^3 w / 12 [N m^2] (18.1)."""
        return self.youngs_modulus * self.thickness**3 * self.width / 12.0

    @property
    def extensional_stiffness(self) -> float:
        """Extensional stiffness b1 = E h w [N] (18.1)."""
        return self.youngs_modulus * self.thickness * self.width

    @property
    def shear_stiffness(self) -> float:
        """Shear stiffness b2 = E h w / (2 (1 + nu)) [N] (18.1)."""
        return self.extensional_stiffness / (2.0 * (1.0 + self.poisson_ratio))


@dataclass(frozen=True, kw_only=True)
class StiffnessBelt:
    """A straight elastic belt whose three stiffnesses are given directly.

    Attributes:
        length: Material length Ls between the clamps [m].
        bending_stiffness: a [N m^2].
        extensional_stiffness: b1 [N].
        shear_stiffness: b2 [N].

    Raises:
        SceneError: A value is not a finite number above zero.
    """

    length: float = 1.0
    bending_stiffness: float
    extensional_stiffness: float
    shear_stiffness: float

    def __post_init__(self) -> None:
        _set(
            self,
            length=positive("length", self.length, "m"),
            bending_stiffness=positive("bending_stiffness", self.bending_stiffness, "N m^2"),
            extensional_stiffness=positive("extensional_stiffness", self.extensional_stiffness, "N"),
            shear_stiffness=positive("shear_stiffness", self.shear_stiffness, "N"),
        )


def _check_range_of_stiffnesses(belt: Belt) -> None:
    """Extreme factors may leave a product that is no longer a number above zero."""
    for name, unit in (("bending_stiffness", "N m^2"), ("extensional_stiffness", "N"), ("shear_stiffness", "N")):
        positive(name, getattr(belt, name), unit)


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
        _set(self, radius=positive("radius", self.radius, "m"), center=self._checked_center(), friction=friction)
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
            _set(self, x_trans=0.0)
        if self.x_trans is None:
            if self.slip is not None:
                raise SceneError("slip", f"be left out with `{given[0]}`, from which it follows", self.slip)
            _set(self, **{given[0]: number(given[0], getattr(self, given[0]), {"omega": "rad/s"}.get(given[0], "N m"))})
            return
        if self.slip not in (None, "forward", "backward"):
            raise SceneError("slip", 'be "forward" or "backward"', self.slip)
        _set(self, slip=self.slip or "forward")
        if isinstance(self.x_trans, str):
            if self.x_trans not in (RUN_UP, RUN_OFF):
                raise SceneError("x_trans", 'be a finite number [m], "run-up" or "run-off"', self.x_trans)
            return
        x_trans = number("x_trans", self.x_trans, "m")
        if abs(x_trans - self.center[0]) >= self.radius:
            xc, radius = self.center[0], self.radius
            raise SceneError("x_trans", f"lie over the pulley, in ({xc - radius:g}, {xc + radius:g}) [m]", self.x_trans)
        _set(self, x_trans=x_trans)

    @property
    def drive(self) -> str:
        """Which of ``"x_trans"``, ``"omega"``, ``"torque"`` is given."""
        if self.x_trans is not None:
            return "x_trans"
        return "omega" if self.omega is not None else "torque"


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A belt between two clamps, transported over a pulley. The defaults are the source's scene.

    The clamps stand at x = -span/2 and x = +span/2, y = 0, with cross-section angle zero; the belt lies above the
    pulley and travels from left to right.

    Attributes:
        belt: The belt.
        pulleys: The pulleys; one, so far.
        span: Distance Lx of the clamps [m].
        transport_rate: Mass transport rate c [m/s].

    Raises:
        SceneError: A value is out of its range, or a clamp lies inside the pulley.
    """

    belt: Belt | StiffnessBelt = field(default_factory=Belt)
    pulleys: tuple[Pulley, ...] = field(default_factory=lambda: (Pulley(),))
    span: float = 1.0
    transport_rate: float = 1.0

    def __post_init__(self) -> None:
        if not isinstance(self.belt, Belt | StiffnessBelt):
            raise SceneError("belt", "be a Belt or a StiffnessBelt", self.belt)
        if not isinstance(self.pulleys, tuple | list) or not all(isinstance(p, Pulley) for p in self.pulleys):
            raise SceneError("pulleys", "be a tuple of Pulley", self.pulleys)
        if len(self.pulleys) != 1:
            raise SceneError("pulleys", "hold exactly one pulley (more are not there yet)", len(self.pulleys))
        _set(
            self,
            pulleys=tuple(self.pulleys),
            span=positive("span", self.span, "m"),
            transport_rate=positive("transport_rate", self.transport_rate, "m/s"),
        )
        for index, pulley in enumerate(self.pulleys):
            self._check_clearance(index, pulley)

    def _check_clearance(self, index: int, pulley: Pulley) -> None:
        for side, x in (("left", -self.span / 2), ("right", self.span / 2)):
            distance = math.dist((x, 0.0), pulley.center)
            if distance <= pulley.radius:
                raise SceneError(
                    f"pulleys.{index}.radius",
                    f"be below {distance:g} [m], the distance of the centre from the {side} clamp (a clamp inside "
                    "the pulley)",
                    pulley.radius,
                )

    def dimensionless(self) -> tuple[Scene, Units]:
        """The scene in units of the belt's length, its extensional stiffness and the transport rate.

        Returns:
            The dimensionless scene, whose belt has unit length and unit extensional stiffness, and the units that
            turn its answers into this scene's.
        """
        units = Units(length=self.belt.length, force=self.belt.extensional_stiffness, rate=self.transport_rate)
        belt = StiffnessBelt(
            length=1.0,
            bending_stiffness=self.belt.bending_stiffness / units.of(length=2, force=1),
            extensional_stiffness=1.0,
            shear_stiffness=self.belt.shear_stiffness / units.force,
        )
        pulleys = tuple(_dimensionless_pulley(pulley, units) for pulley in self.pulleys)
        return Scene(belt=belt, pulleys=pulleys, span=self.span / units.length, transport_rate=1.0), units


@dataclass(frozen=True, kw_only=True)
class Units:
    """Units of length [m], force [N] and transport rate [m/s] of a dimensionless scene."""

    length: float
    force: float
    rate: float

    def of(self, *, length: int = 0, force: int = 0, rate: int = 0) -> float:
        """The unit of a quantity with these powers of length, force and transport rate."""
        return self.length**length * self.force**force * self.rate**rate

    def inverse(self) -> Units:
        """The units that turn this scene's answers into the dimensionless ones."""
        return Units(length=1.0 / self.length, force=1.0 / self.force, rate=1.0 / self.rate)


def _dimensionless_pulley(pulley: Pulley, units: Units) -> Pulley:
    value: Any = getattr(pulley, pulley.drive)
    if not isinstance(value, str):
        torque, omega = units.of(length=1, force=1), units.of(length=-1, rate=1)
        value /= {"x_trans": units.length, "omega": omega, "torque": torque}[pulley.drive]
    drive: dict[str, Any] = {pulley.drive: value}
    center = (pulley.center[0] / units.length, pulley.center[1] / units.length)
    return replace(pulley, radius=pulley.radius / units.length, center=center, **drive)
