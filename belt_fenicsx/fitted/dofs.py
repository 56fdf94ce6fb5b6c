"""Degrees of freedom of the fitted method: those of one cell, and which unknowns of the whole belt they are.

The map sigma(eta) is no unknown of its own: a cell's sigma stands for the borders at both ends of its zone.

All of a cell's pressures and frictions are too many to be eliminated with it, as there is one more Gauss point than
inner nodes; so those of the middle Gauss point are shared, as those of the cell's ends are.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass

import numpy as np

from belt_fenicsx.fitted.cells import Mesh
from belt_fenicsx.layout.arrays import Array

# Degree from which positions, angles and tractions of a cell in stick are eliminated one after another: about where it
# begins to pay, and where the friction of a thin steel band needs it to be as accurate as its estimate says.
APART = 8
NODE = 3  # unknowns at a node: x, y and theta


@dataclass(frozen=True)
class Local:
    """A cell's dofs by field, in the order of the mixed element of degree k.

    Attributes:
        r: Those of x and y at each node, in turns ``(2 k + 2,)``.
        theta: ``(k + 1,)``.
        p: ``(k,)``.
        f: ``(k,)``.
        sigma: ``(2,)``.
        D: ``(1,)``.
    """

    r: slice
    theta: slice
    p: slice
    f: slice
    sigma: slice
    D: slice

    @functools.cached_property
    def nodal(self) -> Array:
        """x, y and theta of the left, the right and the inner nodes ``(k + 1, NODE)``."""
        number = np.arange(self.theta.stop)
        return np.column_stack([number[self.r].reshape(-1, 2), number[self.theta]])

    def tractions(self, friction: bool) -> Array:
        """p, and f where there is friction, at the Gauss points ``(1 or 2, k)``."""
        number = np.arange(self.f.stop)
        return np.array([number[self.p], number[self.f]][: 1 + friction])

    @property
    def scalars(self) -> Array:
        """The borders of the zone, and the stretch in stick ``(3,)``."""
        return np.arange(self.sigma.start, self.D.stop)


@functools.cache
def local(degree: int) -> Local:
    """A cell's dofs."""
    k = degree
    ends = itertools.accumulate([2 * (k + 1), k + 1, k, k, 2, 1], initial=0)
    return Local(*(slice(start, end) for start, end in itertools.pairwise(ends)))


def width(degree: int) -> int:
    """Number of a cell's dofs."""
    return 5 * degree + 6


@dataclass(frozen=True, eq=False)
class Pattern:
    """How the dofs of a cell are eliminated.

    Attributes:
        blocks: Equations and unknowns that are eliminated with a cell, as many of each, in an order in which the
            unknowns of a block are not in the equations of the blocks before it.
        shared: The other dofs, equations and unknowns alike ``(u,)``.
    """

    blocks: tuple[tuple[Array, Array], ...]
    shared: Array

    @functools.cached_property
    def equations(self) -> Array:
        """Equations that are eliminated ``(h,)``."""
        return np.concatenate([equations for equations, _ in self.blocks])

    @functools.cached_property
    def unknowns(self) -> Array:
        """Unknowns that are eliminated ``(h,)``."""
        return np.concatenate([unknowns for _, unknowns in self.blocks])


@dataclass(frozen=True)
class Table:
    """Numbers of the unknowns: those that couple cells, one for all dofs that are fixed, then those inside of cells.

    An equation has its unknown's number.

    Attributes:
        numbers: Number of each cell's dofs ``(n, 5 k + 6)``.
        fixed: The number that stands for dofs that are fixed; all that couple cells are less.
        count: Number of unknowns, with this one.
        chain: What couples each cell with the next ones: its left node, its shared tractions, its right node
            ``(n, 3 + 1 or 2 + 3)``.
        scalars: What couples all cells: the inner borders of zones, and the stretch in stick.
        patterns: Groups of cells, and how their dofs are eliminated; each cell is in one of them.
    """

    numbers: Array
    fixed: int
    count: int
    chain: Array
    scalars: Array
    patterns: tuple[tuple[Array, Pattern], ...]


def table(mesh: Mesh, degree: int, friction: bool) -> Table:
    """The table of a mesh with elements of one degree.

    Args:
        mesh: Zones and cells.
        degree: Degree k.
        friction: Whether the friction traction is an unknown.
    """
    at, n = local(degree), mesh.zone.size
    left, right = at.nodal[:2]
    middle, contact = at.tractions(friction)[:, degree // 2], np.flatnonzero(mesh.touches)
    ends = itertools.accumulate([NODE * (n - 1), middle.size * contact.size, mesh.ends.size, 1], initial=0)
    nodes, tractions, borders, (stretch,) = (np.arange(*pair) for pair in itertools.pairwise(ends))
    fixed = int(stretch) + 1
    numbers = np.full((n, width(degree)), fixed)
    numbers[1:, left] = numbers[:-1, right] = nodes.reshape(-1, NODE)
    numbers[np.ix_(contact, middle)] = tractions.reshape(-1, middle.size)
    numbers[:, at.sigma] = np.concatenate([[fixed], borders, [fixed]])[mesh.zone[:, None] + [0, 1]]
    numbers[:, at.D] = stretch
    count, patterns = fixed + 1, _patterns(mesh, degree, friction)
    for cells, pattern in patterns:
        shape = cells.size, pattern.unknowns.size
        numbers[np.ix_(cells, pattern.unknowns)] = count + np.arange(shape[0] * shape[1]).reshape(shape)
        count += shape[0] * shape[1]
    chain = numbers[:, np.concatenate([left, middle, right])]
    return Table(numbers, fixed, count, chain, np.append(borders, stretch), patterns)


def _patterns(mesh: Mesh, degree: int, friction: bool) -> tuple[tuple[Array, Pattern], ...]:
    """The pattern of free cells, of those in contact, and of those in stick where blocks are worth it."""
    blockwise = mesh.sticks & (friction and degree >= APART)
    groups = (np.flatnonzero(cells) for cells in (~mesh.touches, mesh.touches & ~blockwise, blockwise))
    paired = zip(groups, _kinds(degree, friction), strict=True)
    return tuple((cells, pattern) for cells, pattern in paired if cells.size)


@functools.cache
def _kinds(degree: int, friction: bool) -> tuple[Pattern, Pattern, Pattern]:
    """How a free cell is eliminated, one in contact, and one in stick in blocks."""
    at, tractions = local(degree), local(degree).tractions(friction)
    (left, right), inner = at.nodal[:2], at.nodal[2:]
    r, theta = inner[:, :2].ravel(), inner[:, 2]
    middle, others = tractions[:, degree // 2], np.delete(tractions, degree // 2, axis=1).ravel()
    free, in_contact = np.concatenate([r, theta]), np.concatenate([r, theta, others])
    shared = np.concatenate([left, right, middle, at.scalars])
    return (
        Pattern(((free, free),), np.concatenate([left, right, at.scalars])),
        Pattern(((in_contact, in_contact),), shared),
        # In stick, the pulley's conditions tell positions, these tell angles, and both tell the tractions.
        Pattern(((others, r), (theta, theta), (r, others)), shared),
    )
