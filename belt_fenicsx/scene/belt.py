"""Belts: what they are made of, and the stiffnesses that follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from belt_fenicsx.scene.checks import SceneError, not_negative, number, positive, store
from belt_fenicsx.scene.units import Quantity

STIFFNESSES: Mapping[str, Quantity] = {
    "bending_stiffness": Quantity(unit="N m^2", text="bending stiffness", length=2, force=1),
    "extensional_stiffness": Quantity(unit="N", text="extensional stiffness", force=1),
    "shear_stiffness": Quantity(unit="N", text="shear stiffness", force=1),
}
# What multiplies the squared transport rate in the belt's forces, so that its unit is a force over that square.
INERTIA: Mapping[str, Quantity] = {
    "line_density": Quantity(unit="kg/m", text="line density", force=1, rate=-2),
    "rotary_inertia": Quantity(unit="kg m", text="rotary inertia", length=2, force=1, rate=-2),
}
# What a belt has besides, zero in the source.
FURTHER: Mapping[str, Quantity] = {
    "contact_offset": Quantity(unit="m", text="contact offset", length=1),
    "curvature": Quantity(unit="1/m", text="stress-free curvature", length=-1),
}


@dataclass(frozen=True, kw_only=True)
class Belt:
    """A straight elastic belt of rectangular cross-section (18.1).

    Attributes:
        length: Material length Ls between the clamps [m].
        youngs_modulus: Young's modulus E [Pa].
        poisson_ratio: Poisson's ratio nu [-].
        thickness: Height h of the cross-section [m].
        width: Width w of the cross-section [m].
        density: Mass per volume [kg/m^3]; zero for the source's quasi-static belt.
        contact_offset: Distance of the touching fibre from the middle line [m]: zero in the source's model, half of the
            thickness in a real belt.
        curvature: Curvature of the belt without stress [1/m]. Between clamps of given angles and in a loop, it changes
            the bending moment alone.

    Raises:
        SceneError: A value is not a finite number or out of its range.
    """

    length: float = 1.0
    youngs_modulus: float = 5e7
    poisson_ratio: float = 0.45
    thickness: float = 0.05
    width: float = 0.1
    density: float = 0.0
    contact_offset: float = 0.0
    curvature: float = 0.0

    def __post_init__(self) -> None:
        nu = number("poisson_ratio", self.poisson_ratio, "-")
        if not -1.0 < nu <= 0.5:
            raise SceneError("poisson_ratio", "lie in (-1, 0.5] [-]", self.poisson_ratio)
        store(
            self,
            length=positive("length", self.length, "m"),
            youngs_modulus=positive("youngs_modulus", self.youngs_modulus, "Pa"),
            poisson_ratio=nu,
            thickness=positive("thickness", self.thickness, "m"),
            width=positive("width", self.width, "m"),
            density=not_negative("density", self.density, "kg/m^3"),
            contact_offset=not_negative("contact_offset", self.contact_offset, "m"),
            curvature=number("curvature", self.curvature, "1/m"),
        )
        # Extreme factors may leave a product that is no longer a number above zero.
        _checked_stiffnesses(self)

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

    @property
    def line_density(self) -> float:
        """Mass per material length rho A = rho h w [kg/m]."""
        return self.density * self.thickness * self.width

    @property
    def rotary_inertia(self) -> float:
        """Rotary inertia per material length rho I = rho h^3 w / 12 [kg m]."""
        return self.density * self.thickness**3 * self.width / 12.0


@dataclass(frozen=True, kw_only=True)
class StiffnessBelt:
    """A straight elastic belt whose three stiffnesses are given directly, as is its inertia.

    Attributes:
        length: Material length Ls between the clamps [m].
        bending_stiffness: a [N m^2].
        extensional_stiffness: b1 [N].
        shear_stiffness: b2 [N].
        line_density: Mass per material length rho A [kg/m].
        rotary_inertia: rho I per material length [kg m].
        contact_offset: Distance of the touching fibre from the middle line [m].
        curvature: Curvature of the belt without stress [1/m].

    Raises:
        SceneError: A value is not a finite number, or out of its range.
    """

    length: float = 1.0
    bending_stiffness: float
    extensional_stiffness: float
    shear_stiffness: float
    line_density: float = 0.0
    rotary_inertia: float = 0.0
    contact_offset: float = 0.0
    curvature: float = 0.0

    def __post_init__(self) -> None:
        inertia = {name: not_negative(name, getattr(self, name), quantity.unit) for name, quantity in INERTIA.items()}
        store(
            self,
            length=positive("length", self.length, "m"),
            contact_offset=not_negative("contact_offset", self.contact_offset, "m"),
            curvature=number("curvature", self.curvature, "1/m"),
            **_checked_stiffnesses(self),
            **inertia,
        )


def _checked_stiffnesses(belt: Belt | StiffnessBelt) -> dict[str, float]:
    return {name: positive(name, getattr(belt, name), quantity.unit) for name, quantity in STIFFNESSES.items()}
