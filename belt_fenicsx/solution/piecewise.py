"""Fields between points: in each cell of a zone, polynomials that a file can hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.checks import SceneError, Verbatim
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.fields import Fields

# Names of the arrays, and the kinds of their numbers.
ARRAYS = {"counts": "i", "edges": "f", "coefficients": "f"}
# The fields from which all others follow, by their numbers of components.
COLUMNS = {"r": 2, "theta": 1, "phi": 1, "D": 1, "kappa": 1, "p": 1, "f": 1, "v_rel": 1}
ROUNDING = 4.0 * float(np.finfo(float).eps)  # The rounding error of a coordinate, in belt lengths.


@dataclass(frozen=True, kw_only=True, eq=False)
class Piecewise:
    """Fields as sums of Chebyshev polynomials T_i, in each cell of its own: sum_i a_i T_i(xi), with xi from -1 to 1.

    Attributes:
        scene: The scene, in its own units.
        pulleys: Pulley of each zone, None of a free one.
        rate: Transport rate [m/s].
        counts: Number of cells of each zone ``(z,)``.
        edges: Where cells begin and end ``(n + 1,)`` [m].
        coefficients: The a_i of the fields of `COLUMNS` ``(m, columns, n)``.
    """

    scene: Scene
    pulleys: tuple[int | None, ...]
    rate: float
    counts: Array
    edges: Array
    coefficients: Array

    @classmethod
    def through(
        cls, fields: Fields, *, scene: Scene, pulleys: tuple[int | None, ...], rate: float, counts: Array, edges: Array
    ) -> Piecewise:
        """The polynomials through fields at the Chebyshev `points` of all cells, cell by cell."""
        size = fields.sigma.size // counts.sum()
        columns = np.column_stack([getattr(fields, name) for name in COLUMNS])
        values = columns.reshape(-1, size, columns.shape[1]).transpose(1, 2, 0)
        # Polynomials of lower degree than the number of points are orthogonal in the sum over these points.
        transform = chebyshev.chebvander(points(size), size - 1).T * (2.0 / size)
        transform[0] /= 2.0
        coefficients = np.tensordot(transform, values, axes=1)
        return cls(scene=scene, pulleys=pulleys, rate=rate, counts=counts, edges=edges, coefficients=coefficients)

    @classmethod
    def from_arrays(
        cls, scene: Scene, pulleys: tuple[int | None, ...], rate: float, arrays: Mapping[str, Array]
    ) -> Piecewise:
        """The polynomials whose `arrays` were kept in a file.

        Raises:
            SceneError: An array is missing, or has another shape or kind than it must have.
        """
        if set(arrays) != set(ARRAYS):
            raise SceneError("evaluator", f"have {', '.join(ARRAYS)}", Verbatim(", ".join(sorted(arrays))))
        cells, terms = max(arrays["edges"].size - 1, 1), max([1, *arrays["coefficients"].shape[:1]])
        shapes = (len(pulleys),), (cells + 1,), (terms, sum(COLUMNS.values()), cells)
        for (name, kind), shape in zip(ARRAYS.items(), shapes, strict=True):
            if arrays[name].shape != shape or arrays[name].dtype.kind != kind:
                found = Verbatim(f"{arrays[name].dtype} of shape {arrays[name].shape}")
                raise SceneError(f"evaluator.{name}", f"hold numbers of shape {shape}", found)
        if arrays["counts"].min() < 1 or arrays["counts"].sum() != cells:
            raise SceneError("evaluator", f"have the cells of {len(pulleys)} zones", Verbatim("others"))
        return cls(scene=scene, pulleys=pulleys, rate=rate, **arrays)

    @property
    def arrays(self) -> dict[str, Array]:
        """All arrays, by name."""
        return {name: getattr(self, name) for name in ARRAYS}

    def __call__(self, sigma: Array, before: bool) -> Fields:
        """Fields at points ``(m,)`` [m].

        Args:
            sigma: Coordinates in the belt ``(m,)`` [m].
            before: Whether a joint between zones belongs to the zone before it instead of the zone after it.
        """
        # A joint that was turned into other units and back is still that joint.
        same = (-ROUNDING if before else ROUNDING) * self.scene.belt.length
        cell = np.searchsorted(self.edges[1:-1], sigma + same, side="left" if before else "right")
        left, right = self.edges[cell], self.edges[cell + 1]
        xi = (2.0 * sigma - left - right) / (right - left)
        x, y, *others = chebyshev.chebval(xi, self.coefficients[:, :, cell], tensor=False)
        named = dict(zip([*COLUMNS][1:], others, strict=True))
        zone = np.repeat(np.arange(len(self.pulleys)), self.counts)[cell]
        return Fields.from_state(
            self.scene.belt, zone=zone, sigma=sigma, r=np.column_stack([x, y]), rate=self.rate, **named,
            offset=self._offsets[zone] if self.scene.belt.contact_offset else None,
        )  # fmt: skip

    @property
    def _offsets(self) -> Array:
        """Distance of the touching fibre from the middle line, towards -e2, of each zone ``(z,)`` [m]."""
        turns = [0.0 if index is None else self.scene.pulleys[index].turn for index in self.pulleys]
        return self.scene.belt.contact_offset * np.array(turns)


def points(size: int) -> Array:
    """So many Chebyshev points of the reference cell from -1 to 1, none of which is an end of it ``(size,)``."""
    return np.asarray(chebyshev.chebpts1(size))
