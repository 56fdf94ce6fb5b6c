"""Belts: what they are made of, and the stiffnesses that follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from belt_fenicsx.scene.checks import SceneError, number, positive, store
from belt_fenicsx.scene.units import Quantity

STIFFNESSES: Mapping[str, Quantity] = {
    "bending_stiffness": Quantity(unit="N m^2", text="bending stiffness", length=2, force=1),
    "extensional_stiffness": Quantity(unit="N", text="extensional stiffness", force=1),
    "shear_stiffness": Quantity(unit="N", text="shear stiffness", force=1),
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
        store(
            self,
            length=positive("length", self.length, "m"),
            youngs_modulus=positive("youngs_modulus", self.youngs_modulus, "Pa"),
            poisson_ratio=nu,
            thickness=positive("thickness", self.thickness, "m"),
            width=positive("width", self.width, "m"),
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
        store(self, length=positive("length", self.length, "m"), **_checked_stiffnesses(self))


def _checked_stiffnesses(belt: Belt | StiffnessBelt) -> dict[str, float]:
    return {name: positive(name, getattr(belt, name), quantity.unit) for name, quantity in STIFFNESSES.items()}
