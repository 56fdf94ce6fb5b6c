"""Linear algebra of the fitted method: a Newton step from the Jacobians of single cells.

What a cell hides from its neighbours is eliminated first, all cells of a kind at once, by dense factorisations with
pivoting. What is left couples the nodes and the few scalars, the borders and the stretch in stick. On many cells, the
node between two of them is eliminated next, all pairs at once, then that between two pairs, and so on: the cost grows
with the number of cells, not with its power. The rest is solved densely. The map sigma(eta) is no unknown of its own:
a part of the columns of each cell is added to those of the borders at both ends of its zone.

All of a cell's pressures and frictions are too many to be eliminated with it, as there is one more Gauss point than
inner nodes; so those of one Gauss point are left. Of two cells, or pairs, one such point goes with the node between.
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
LONGEST = 16  # chain of cells, or pairs, that is solved densely: about where another level of pairs begins to pay


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


@functools.cache
def local(degree: int) -> Local:
    """A cell's dofs."""
    k = degree
    ends = itertools.accumulate([2 * (k + 1), k + 1, k, k, 2, 1], initial=0)
    return Local(*(slice(start, end) for start, end in itertools.pairwise(ends)))


def width(degree: int) -> int:
    """Number of a cell's dofs."""
    return 5 * degree + 6


@dataclass(frozen=True)
class Group:
    """The c cells, or pairs, of one kind, with h dofs that are eliminated and u that are left.

    Attributes:
        block: Places, among the entries of all, of rows and columns, first those that are eliminated, and of the
            right-hand side beside them ``(c, h + u, h + u + 1)``.
        hidden: Numbers of the unknowns that are eliminated ``(c, h)``.
        left: Numbers of the unknowns that are left ``(c, u)``.
        ends: Ends of the blocks on the diagonal to the right of which all that is eliminated is zero; the last is h.
    """

    block: Array
    hidden: Array
    left: Array
    ends: tuple[int, ...]

    @functools.cached_property
    def known(self) -> Array:
        """Numbers of what those that are eliminated follow from: what is left and, the last of all, the right-hand
        side's factor ``(c, u + 1, 1)``."""
        return np.insert(self.left, self.left.shape[1], -1, axis=1)[..., None]

    def eliminated(self, block: Array) -> Array:
        """What is eliminated, but for its sign, in terms of what it follows from ``(c, h, u + 1)``.

        Args:
            block: The entries at the places of `block`.
        """
        h = self.ends[-1]
        first, *others = (slice(*ends) for ends in itertools.pairwise((0, *self.ends)))
        solved = np.linalg.solve(block[:, first, first], block[:, first, h:])
        for rows in others:
            before = slice(rows.start)
            right = block[:, rows, h:] - block[:, rows, before] @ solved
            solved = np.concatenate([solved, np.linalg.solve(block[:, rows, rows], right)], axis=1)
        return solved


@dataclass(frozen=True)
class Level:
    """What is eliminated at once.

    Attributes:
        groups: By kind.
        places: Places, among the entries of the next level, of what is left by all groups.
        size: Number of the latter.
        ones: Places there of the diagonal entries that stand for dofs that are missing.
    """

    groups: list[Group]
    places: Array
    size: int
    ones: Array


class Condensed:
    """Newton steps on one mesh with elements of one degree.

    Unknowns are numbered: first those that couple cells, of the nodes, tractions, borders and the stretch in stick;
    then one number for all dofs that are held; then those that are eliminated with their cell. An equation has its
    unknown's number.

    Args:
        mesh: Zones and cells.
        degree: Degree k.
        friction: Whether the friction traction is an unknown.

    Attributes:
        held: The number that stands for dofs that are held.
        numbers: Number of each cell's dofs ``(n, 5 k + 6)``; for sigma, of the borders at both ends of its zone.
        cells: Jacobian and residual of each cell, to be filled in ``(n, 5 k + 6, 5 k + 6)`` and ``(n, 5 k + 6)``.
    """

    def __init__(self, mesh: Mesh, degree: int, friction: bool) -> None:
        at, n, dofs = local(degree), mesh.zone.size, width(degree)
        self._all = np.empty((n, dofs * (dofs + 1)))
        self.cells = self._all[:, : dofs * dofs].reshape(n, dofs, dofs), self._all[:, dofs * dofs :]
        number = np.arange(dofs)
        tractions = np.array([number[at.p], number[at.f]] if friction else [number[at.p]])
        r, theta = number[at.r].reshape(-1, 2), number[at.theta]
        left, right = np.column_stack([r, theta])[:2]
        r, theta = r[2:].ravel(), theta[2:]
        inner = np.append(r, theta)
        kept, others = tractions[:, degree // 2], np.delete(tractions, degree // 2, axis=1).ravel()
        free, contact = np.flatnonzero(~mesh.touches), np.flatnonzero(mesh.touches)
        steps = mesh.sticks & (friction and degree >= APART)
        apart, together = np.flatnonzero(steps), np.flatnonzero(mesh.touches & ~steps)

        count = np.cumsum([0, 3 * (n - 1), kept.size * contact.size, mesh.ends.size, 1])
        nodal, middle, borders = (np.arange(*count[i : i + 2]) for i in range(3))
        self.held = held = int(count[-1])
        numbers = self.numbers = np.full((n, dofs), held)
        numbers[1:, left] = numbers[:-1, right] = nodal.reshape(-1, 3)
        numbers[np.ix_(contact, kept)] = middle.reshape(-1, kept.size)
        numbers[:, at.sigma] = np.concatenate([[held], borders, [held]])[mesh.zone[:, None] + [0, 1]]
        numbers[:, at.D] = held - 1
        groups, next_number, scalars = [], held + 1, np.append(number[at.sigma], number[at.D])
        with_contact = np.concatenate([left, right, kept, scalars])
        for cells, blocks, tied in (
            (free, [(inner, inner)], np.concatenate([left, right, scalars])),
            (together, [(np.append(inner, others), np.append(inner, others))], with_contact),
            # In stick, the pulley's conditions tell positions, these tell angles, and both tell the tractions.
            (apart, [(others, r), (theta, theta), (r, others)], with_contact),
        ):
            equations, hidden = (np.concatenate(part) for part in zip(*blocks, strict=True))
            shape = cells.size, hidden.size
            numbers[np.ix_(cells, hidden)] = next_number + np.arange(cells.size * hidden.size).reshape(shape)
            next_number += cells.size * hidden.size
            rows, columns = np.append(equations, tied), np.append(hidden, tied)
            # A cell's residual stands behind its Jacobian.
            places = np.column_stack([rows[:, None] * dofs + columns, dofs * dofs + rows])
            block = (cells * dofs * (dofs + 1))[:, None, None] + places
            ends = tuple(itertools.accumulate(unknowns.size for _, unknowns in blocks))
            groups.append(Group(block, numbers[np.ix_(cells, hidden)], numbers[np.ix_(cells, tied)], ends))
        members = [cells for cells in (free, together, apart) if cells.size]
        groups = [group for group in groups if len(group.block)]
        self.count = next_number
        self._sigma = at.sigma
        self._scalars = np.append(borders, held - 1)
        chain = np.column_stack([numbers[:, left], numbers[:, kept], numbers[:, right], np.tile(self._scalars, (n, 1))])
        self._reduce(groups, members, chain, kept.size)

    def _reduce(self, groups: list[Group], members: list[Array], chain: Array, kept: int) -> None:
        """Finds the levels of elimination, and what is left for the dense solve.

        Args:
            groups: The cells of each kind.
            members: Where they are in the chain.
            chain: Numbers of what each cell leaves: left node, kept tractions, right node, scalars.
            kept: Number of the second.
        """
        self._levels: list[Level] = []
        while len(chain) > LONGEST:
            if len(chain) % 2:
                chain = np.vstack([chain, np.append(np.full(kept + 6, self.held), self._scalars)])
            first, second = chain[::2], chain[1::2]
            # The first's kept tractions and the node between; then what the pair leaves, in the chain's order.
            pairs = np.column_stack([first[:, 3 : kept + 6], first[:, :3], second[:, 3:]])
            hidden, (m, w) = kept + 3, pairs.shape
            block = np.arange(m * w * (w + 1)).reshape(m, w, w + 1)
            places = [self._places(group, cells // 2, pairs) for group, cells in zip(groups, members, strict=True)]
            missing = np.nonzero(pairs[:, :hidden] == self.held)
            self._levels.append(Level(groups, np.concatenate(places), block.size, block[*missing, missing[1]]))
            chain, members = pairs[:, hidden:], [np.arange(m)]
            groups = [Group(block, pairs[:, :hidden], chain, (hidden,))]
        numbers = np.unique(chain)
        self._dense = dense = numbers[numbers < self.held]
        places = [self._places(group, np.zeros(len(group.left), dtype=int), dense[None]) for group in groups]
        size = dense.size * (dense.size + 1)
        self._levels.append(Level(groups, np.concatenate(places), size, np.empty(0, dtype=int)))

    def _places(self, group: Group, parents: Array, pairs: Array) -> Array:
        """Places of what cells leave among the entries of pairs, all that is held behind the last of them."""
        m, w = pairs.shape
        index = np.argmax(pairs[parents][:, None, :] == group.left[:, :, None], axis=-1)
        columns = np.column_stack([index, np.full(len(index), w)])
        places = (parents * w * (w + 1))[:, None, None] + index[:, :, None] * (w + 1) + columns[:, None, :]
        is_held = group.left == self.held
        places[is_held] = m * w * (w + 1)
        places[:, :, :-1].transpose(0, 2, 1)[is_held] = m * w * (w + 1)
        return places.ravel()

    def residual_norm(self) -> float:
        """Norm of the assembled residual."""
        assembled = np.bincount(self.numbers.ravel(), self.cells[1].ravel(), self.count)
        assembled[self.held] = 0.0
        return float(np.linalg.norm(assembled))

    def step(self, share: Array, *, held: bool = False) -> tuple[Array, Array]:
        """Solves for the step that takes the linearised residual to zero; the cells' Jacobians are overwritten.

        Args:
            share: Part of its zone that each cell is ``(n,)``. Equations depend on sigma by its slope alone; so a
                derivative by an end of the zone is this part of that by the same end of the cell.
            held: Whether the borders stay where they are, whatever their conditions say.

        Returns:
            The step of each cell's dofs ``(n, 5 k + 6)``, but for sigma; and of the borders and the stretch in stick.
        """
        (jacobians, _), sigma = self.cells, self._sigma
        for end in (sigma.start, sigma.stop - 1):
            jacobians[:, :, end] *= share[:, None]
        entries, eliminated = self._all, []
        for level in self._levels:
            left = []
            for group in level.groups:
                block, h = entries.take(group.block), group.ends[-1]
                solved = group.eliminated(block)
                left.append((block[:, h:, h:] - block[:, h:, :h] @ solved).ravel())
                eliminated.append((group, solved))
            entries = np.bincount(level.places, np.concatenate(left), level.size + 1)
            entries[level.ones] = 1.0
        size, borders = self._dense.size, self._scalars.size - 1
        matrix = entries[:-1].reshape(size, size + 1)
        if held:
            matrix[-1 - borders : -1] = np.eye(borders, size + 1, size - 1 - borders)
        # The right-hand side's factor stands behind all unknowns.
        unknowns = np.zeros(self.count + 1)
        unknowns[-1] = 1.0
        unknowns[self._dense] = np.linalg.solve(matrix[:, :-1], -matrix[:, -1])
        for group, solved in reversed(eliminated):
            unknowns[group.hidden] = -(solved @ unknowns[group.known])[..., 0]
        step = unknowns[self.numbers]
        step[:, sigma] = 0.0
        return step, unknowns[self._scalars]
