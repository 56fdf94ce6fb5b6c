"""Cells of the fitted method: the parts of a layout, divided by their layers. Pure NumPy."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layers import cells_to, graded
from belt_fenicsx.layout.layout import Layout

# Length of a zone's first cell, in lengths of the layer at that end, and by which factor each further cell is longer:
# free spans are straight outside of their layers, contact is curved all along.
FIRST_FREE, GROWTH_FREE = 0.4, 3.0
FIRST_CONTACT, GROWTH_CONTACT = 1.05, 1.7
FEWEST = 3  # cells of a zone


@dataclass(frozen=True)
class Mesh:
    """Layout divided into cells.

    Attributes:
        layout: The zones.
        counts: Number of cells of each zone.
    """

    layout: Layout
    counts: tuple[int, ...]

    @functools.cached_property
    def zone(self) -> Array:
        """Zone of each cell ``(n,)``."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    @functools.cached_property
    def ends(self) -> Array:
        """Nodes at the joints between zones ``(len(counts) - 1,)``."""
        return np.cumsum(self.counts)[:-1]

    def cells(self, index: int) -> slice:
        """Cells of a zone."""
        end = sum(self.counts[: index + 1])
        return slice(end - self.counts[index], end)

    @functools.cached_property
    def touches(self) -> Array:
        """Whether each cell lies on the pulley ``(n,)``."""
        return np.array([part.touches for part in self.layout.parts])[self.zone]

    @functools.cached_property
    def sticks(self) -> Array:
        """Whether the belt sticks in each cell ``(n,)``."""
        return np.array([part.kind == "stick" for part in self.layout.parts])[self.zone]

    @functools.cached_property
    def senses(self) -> Array:
        """Sense of sliding of each cell ``(n,)``."""
        return np.array([part.sense for part in self.layout.parts])[self.zone]

    @functools.cached_property
    def pulley(self) -> Array:
        """The pulley to which each cell belongs ``(n,)``: the nearer one, of a free zone between two of them."""
        parts, result = self.layout.parts, []
        on = [part.pulley if part.touches else None for part in parts]
        for i, count in enumerate(self.counts):
            before, after = (
                on[j % len(on)] if self.layout.closed or 0 <= j < len(on) else None for j in (i - 1, i + 1)
            )
            if on[i] is not None:
                before = after = on[i]
            half = 0 if before is None else count if after is None else count // 2
            result += [before] * half + [after] * (count - half)
        return np.array(result)

    @functools.cached_property
    def firsts(self) -> Array:
        """A cell of each pulley ``(pulleys,)``."""
        return np.unique(self.pulley, return_index=True)[1]

    @functools.cached_property
    def sliding(self) -> tuple[int, ...]:
        """Pulleys along all of which the belt slides."""
        layout = self.layout
        return tuple(i for i in layout.pulleys if layout.transition(i) not in layout.on(i))

    @functools.cached_property
    def begins(self) -> Array:
        """Whether each cell is the first one of its zone ``(n,)``."""
        return np.append(True, self.zone[1:] != self.zone[:-1])

    @functools.cached_property
    def _hash(self) -> int:
        return hash((self.layout, self.counts))

    def __hash__(self) -> int:
        return self._hash


@functools.lru_cache(maxsize=64)
def distinct_points(mesh: Mesh, count: int) -> tuple[Array, Array]:
    """``count`` points in each cell, but those that two cells of a zone share only for the first of them.

    Returns:
        Which of all points they are, cell by cell, and their zones.
    """
    counted = np.ones((mesh.zone.size, count), dtype=bool)
    counted[:, 0] = mesh.begins
    return np.flatnonzero(counted), np.repeat(mesh.zone, count)[counted.ravel()]


@functools.lru_cache(maxsize=64)
def meshed(layout: Layout, counts: tuple[int, ...]) -> Mesh:
    """Layout divided into so many cells; made once in a process, with what follows from it."""
    return Mesh(layout, counts)


def divided(
    layout: Layout, ends: Sequence[float] | Array, *, bending: float, shear: float, elements: int | None = None
) -> tuple[Mesh, Array]:
    """Divides zones into cells.

    Args:
        layout: The zones.
        ends: Their ends in the material-length coordinate ``(len(layout.parts) + 1,)`` [m].
        bending: Length of the bending layers, at both ends of free zones [m].
        shear: Length of the shear layers, at both ends of zones in contact [m].
        elements: Number of cells in all; by default, as many as the layers call for.

    Returns:
        The mesh, and both ends of each cell in its zone, which goes from 0 to 1 ``(n, 2)``.
    """
    counts: list[int] = []
    nodes: list[tuple[float, float]] = []
    gradings = [
        (FIRST_CONTACT * shear / (end - start), GROWTH_CONTACT)
        if part.touches
        else (FIRST_FREE * bending / (end - start), GROWTH_FREE)
        for part, (start, end) in zip(layout.parts, itertools.pairwise(ends), strict=True)
    ]
    wanted = [2.0 * cells_to(0.5, *grading) for grading in gradings]
    share = 1.0 if elements is None else elements / sum(wanted)
    for part, grading, count in zip(layout.parts, gradings, wanted, strict=True):
        # A contact zone that is as short as a first cell is one: errors of tractions grow as cells get shorter.
        fewest = min(FEWEST, math.ceil(1.0 / grading[0])) if part.touches else FEWEST
        counts.append(max(fewest, int(count * share)))
        nodes += itertools.pairwise(graded(*grading, counts[-1]))
    return meshed(layout, tuple(counts)), np.array(nodes)
