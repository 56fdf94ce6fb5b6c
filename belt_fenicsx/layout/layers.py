"""Layers in which bending and shear die out, and cells that grow away from them."""

from __future__ import annotations

import math

from belt_fenicsx.scene.scene import Scene

LEAST_STRAIN = 1e-3  # a belt longer than its path is not taut; it gets the forces of this strain all the same


def bending_layer(scene: Scene, strain: float) -> float:
    """Length sqrt(a / tension) over which bending dies out in a free span [m]."""
    return math.sqrt(scene.belt.bending_stiffness / (scene.belt.extensional_stiffness * max(strain, LEAST_STRAIN)))


def shear_layer(scene: Scene, strain: float) -> float:
    """Length sqrt(a / (b2 D^2 - b1 D (D - 1))) over which shear dies out on the pulley [m]."""
    belt, D = scene.belt, 1.0 + strain
    return math.sqrt(
        belt.bending_stiffness / abs(belt.shear_stiffness * D**2 - belt.extensional_stiffness * D * strain)
    )


def graded(first: float, growth: float, count: int) -> list[float]:
    """Ends in [0, 1] of cells that grow from both sides, from about the length ``first`` ``(count + 1,)``."""
    half = cells_to(0.5, first, growth)
    steps = [2.0 * half * i / count for i in range(count // 2 + 1)]
    inner = [first * math.expm1(math.log(growth) * step) / (growth - 1.0) for step in steps]
    return inner + [1.0 - node for node in reversed(inner[: (count + 1) // 2])]


def cells_to(distance: float, first: float, growth: float) -> float:
    """Number of growing cells up to a distance, of which the first has the length ``first``."""
    return math.log1p((growth - 1.0) * distance / first) / math.log(growth)
