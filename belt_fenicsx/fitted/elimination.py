"""Linear algebra of the fitted method: a Newton step from the Jacobians of single cells.

What a cell hides from its neighbours is eliminated first, all cells of a kind at once, by dense factorisations with
pivoting. What is left couples the nodes and the few scalars, the borders and the stretch in stick. On many cells, the
node between two of them is eliminated next, all pairs at once, then that between two pairs, and so on: the cost grows
with the number of cells, not with its power. The tractions that the first of a pair leaves go with the node between.
The rest is solved densely.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass

import numpy as np

from belt_fenicsx.fitted.dofs import NODE, Pattern, Table
from belt_fenicsx.layout.arrays import Array

# A chain of up to so many cells, or pairs, is solved densely: about where another level of pairs begins to pay.
LONGEST = 16


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
    """Newton steps with one table of dofs.

    Args:
        table: Numbers of the dofs, and how cells are eliminated.

    Attributes:
        table: The same.
        cells: Jacobian and residual of each cell, to be filled in ``(n, m, m)`` and ``(n, m)``.
    """

    def __init__(self, table: Table) -> None:
        n, dofs = table.numbers.shape
        self.table = table
        self._all = np.empty((n, dofs * (dofs + 1)))
        self.cells = self._all[:, : dofs * dofs].reshape(n, dofs, dofs), self._all[:, dofs * dofs :]
        self._levels, self._dense = levels(table)
        self._borders = np.searchsorted(self._dense, table.scalars[:-1])

    def residual_norm(self) -> float:
        """Norm of the assembled residual."""
        assembled = np.bincount(self.table.numbers.ravel(), self.cells[1].ravel(), self.table.count)
        assembled[self.table.fixed] = 0.0
        return float(np.linalg.norm(assembled))

    def step(self, *, held: bool = False) -> tuple[Array, Array]:
        """Solves for the step that takes the linearised residual to zero.

        Args:
            held: Whether the borders stay where they are, whatever their conditions say.

        Returns:
            The step of each cell's dofs ``(n, m)``, and of the scalars.
        """
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
        size = self._dense.size
        matrix = entries[:-1].reshape(size, size + 1)
        if held:
            matrix[self._borders] = np.eye(size, size + 1)[self._borders]
        # The right-hand side's factor stands behind all unknowns.
        unknowns = np.zeros(self.table.count + 1)
        unknowns[-1] = 1.0
        unknowns[self._dense] = np.linalg.solve(matrix[:, :-1], -matrix[:, -1])
        for group, solved in reversed(eliminated):
            unknowns[group.hidden] = -(solved @ unknowns[group.known])[..., 0]
        return unknowns[self.table.numbers], unknowns[self.table.scalars]


def levels(table: Table) -> tuple[list[Level], Array]:
    """What is eliminated one after another, and the unknowns that are left for the dense solve.

    Cells come first, then the nodes inside of pairs, of pairs of pairs, and so on, until the chain is short.
    """
    result: list[Level] = []
    groups = [_cell_group(cells, pattern, table.numbers) for cells, pattern in table.patterns]
    members = [cells for cells, _ in table.patterns]
    chain = np.column_stack([table.chain, np.tile(table.scalars, (len(table.chain), 1))])
    while len(chain) > LONGEST:
        if len(chain) % 2:
            chain = np.vstack([chain, np.append(np.full(table.chain.shape[1], table.fixed), table.scalars)])
        pairs = _paired(chain, table.chain.shape[1])
        parents = [cells // 2 for cells in members]
        hidden, blocks = pairs.shape[1] - chain.shape[1], _entries(pairs)
        missing = np.nonzero(pairs[:, :hidden] == table.fixed)
        ones = blocks[*missing, missing[1]]
        result.append(Level(groups, _places(groups, parents, pairs, table.fixed), blocks.size, ones))
        chain, members = pairs[:, hidden:], [np.arange(len(pairs))]
        groups = [Group(blocks, pairs[:, :hidden], chain, (hidden,))]
    numbers = np.unique(chain)
    dense = numbers[numbers < table.fixed]
    parents = [np.zeros(len(group.left), dtype=int) for group in groups]
    size, none = _entries(dense[None]).size, np.empty(0, dtype=int)
    result.append(Level(groups, _places(groups, parents, dense[None], table.fixed), size, none))
    return result, dense


def _cell_group(cells: Array, pattern: Pattern, numbers: Array) -> Group:
    """Cells of one pattern; their Jacobians are the entries of all, each with its residual behind it."""
    dofs = numbers.shape[1]
    rows, columns = np.append(pattern.equations, pattern.shared), np.append(pattern.unknowns, pattern.shared)
    inside = np.column_stack([rows[:, None] * dofs + columns, dofs * dofs + rows])
    ends = tuple(itertools.accumulate(unknowns.size for _, unknowns in pattern.blocks))
    hidden, left = (numbers[np.ix_(cells, unknowns)] for unknowns in (pattern.unknowns, pattern.shared))
    return Group((cells * dofs * (dofs + 1))[:, None, None] + inside, hidden, left, ends)


def _paired(chain: Array, width: int) -> Array:
    """Each two neighbours of a chain: what is eliminated from them, then what they leave, in the chain's order.

    Args:
        chain: What each cell leaves: left node, tractions, right node, scalars ``(2 m, w)``.
        width: Number of these without scalars.

    Returns:
        The first one's tractions and the node between; then the same as of each cell ``(m, width - 3 + w)``.
    """
    first, second = chain[::2], chain[1::2]
    return np.column_stack([first[:, NODE:width], first[:, :NODE], second[:, NODE:]])


def _entries(pairs: Array) -> Array:
    """Places of the entries of pairs ``(m, w)``, each with its right-hand side beside them ``(m, w, w + 1)``."""
    m, w = pairs.shape
    return np.arange(m * w * (w + 1)).reshape(m, w, w + 1)


def _places(groups: list[Group], parents: list[Array], pairs: Array, fixed: int) -> Array:
    """Places of what groups leave among the entries of pairs; of all that is fixed, behind the last of them.

    Args:
        groups: The groups.
        parents: The pair in which each of their members is.
        pairs: Numbers of the unknowns of pairs ``(m, w)``.
        fixed: The number that stands for dofs that are fixed.
    """
    (m, w), result = pairs.shape, []
    behind = m * w * (w + 1)
    for group, pair in zip(groups, parents, strict=True):
        index = np.argmax(pairs[pair][:, None, :] == group.left[:, :, None], axis=-1)
        rows, columns = (pair[:, None] * w + index) * (w + 1), np.column_stack([index, np.full(len(index), w)])
        found = rows[:, :, None] + columns[:, None, :]
        is_fixed = group.left == fixed
        found[is_fixed] = behind
        found[:, :, :-1].transpose(0, 2, 1)[is_fixed] = behind
        result.append(found.ravel())
    return np.concatenate(result)
