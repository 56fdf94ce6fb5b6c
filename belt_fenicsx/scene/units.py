"""Units in which a scene has no dimension, and what other quantities are in them."""

from __future__ import annotations

from dataclasses import dataclass


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


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A quantity's unit, its meaning, and its powers of length, force and transport rate."""

    unit: str
    text: str
    length: int = 0
    force: int = 0
    rate: int = 0

    def scale(self, units: Units) -> float:
        """What a dimensionless one is to be multiplied by."""
        return units.of(length=self.length, force=self.force, rate=self.rate)
