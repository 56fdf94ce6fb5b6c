"""What knows the fields of a solution of the fitted method between points."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from belt_fenicsx.fitted.reading import fields_in
from belt_fenicsx.fitted.state import State
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.scene.units import Units
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.piecewise import Piecewise, points

# Pressure and friction are no polynomials; those of this many times the degree of the elements, and one more, are the
# same to rounding.
FINER = 2


@dataclass(frozen=True, eq=False)
class Evaluator:
    """Fields of a fitted solution at any points, by polynomials that are made when they are first asked for.

    Attributes:
        scene: The scene, in its own units.
        state: The dimensionless state.
        units: The units of the latter's scene.
    """

    scene: Scene
    state: State
    units: Units

    @functools.cached_property
    def polynomials(self) -> Piecewise:
        """The polynomials."""
        state, xi = self.state, (1.0 + points(FINER * self.state.degree + 2)) / 2.0
        cell = np.repeat(np.arange(len(state.cells)), xi.size)
        fields = fields_in(state.scene, state, cell, np.tile(xi, len(state.cells))).in_units(self.units)
        return Piecewise.through(
            fields,
            scene=self.scene,
            pulleys=tuple(part.pulley if part.touches else None for part in state.layout.parts),
            rate=state.rate * self.units.rate,
            counts=np.array(state.mesh.counts),
            edges=np.append(state.sigma[:, 0], state.sigma[-1, 1]) * self.units.length,
        )

    @property
    def arrays(self) -> dict[str, Array]:
        """What a file keeps, by name."""
        return self.polynomials.arrays

    def __call__(self, sigma: Array, before: bool) -> Fields:
        """Fields at points ``(m,)`` [m], at a joint those of the zone before it, or after it."""
        return self.polynomials(sigma, before)

    def __reduce__(self) -> tuple[Callable[..., Piecewise], tuple[Any, ...]]:
        """What travels are the polynomials."""
        return Piecewise.from_arrays, (self.scene, self.polynomials.pulleys, self.polynomials.rate, self.arrays)
