"""Linear algebra of the fitted method: a Newton step from the Jacobians of single cells.

What a cell hides from its neighbours is eliminated first, all cells of a kind at once, by dense factorisations with
pivoting. What is left couples the nodes and the few scalars of each pulley, joints and the stretch in stick. On many
cells, the node between two of them is eliminated next, all pairs at once, then that between two pairs, and so on: the
cost grows with the number of cells, not with its power. The tractions that the first of a pair leaves go with the node
between. Of several pulleys, each then hides all but its two ends, which is a belt over one pulley between clamps. The
rest is solved densely.

The arithmetic is in C (`elimination.c`): blocks have some thirty unknowns, and LAPACK, called for all of a kind at
once, took two to three times as long.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from belt_fenicsx.backend.native import doubles, integers, library
from belt_fenicsx.fitted.dofs import NODE, Pattern, Table
from belt_fenicsx.layout.arrays import Array

# A chain of up to so many cells, or pairs, is solved densely: about where another level of pairs begins to pay.
LONGEST = 16
DECLARATIONS = """
int eliminate(int members, int h, int w, const int32_t *block, const int32_t *ends, const double *entries, double *rows,
              const int32_t *places, double *next);
void substitute(int members, int h, int w, const double *rows, const int32_t *hidden, const int32_t *left,
                double *unknowns);
"""


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


@dataclass(frozen=True)
class Level:
    """What is eliminated at once.

    Attributes:
        groups: By kind.
        places: Of each group, places among the entries of the next level of what it leaves.
        size: Number of the latter.
        ones: Places there of the diagonal entries that stand for dofs that are missing.
    """

    groups: list[Group]
    places: list[Array]
    size: int
    ones: Array


class Elimination:
    """The arithmetic of one level: forth, from its entries to those of the next one, and back.

    Args:
        level: The level.
        entries: Its entries.
        unknowns: All unknowns ``(count,)``.

    Attributes:
        next: Entries of the next level, and behind them one for all that is fixed.
    """

    def __init__(self, level: Level, entries: Array, unknowns: Array) -> None:
        self.next, self._ones, self._calls = np.zeros(level.size + 1), level.ones, list[tuple[Any, Any]]()
        self._library = library(Path(__file__).with_suffix(".c"), DECLARATIONS)
        for group, places in zip(level.groups, level.places, strict=True):
            count, width = group.block.shape[:2]
            size, rows = (count, group.ends[-1], width), doubles(np.empty(group.block.shape))
            block, ends, into = integers(group.block), integers(np.array(group.ends)), integers(places)
            forth = *size, block, ends, doubles(entries), rows, into, doubles(self.next)
            back = *size, rows, integers(group.hidden), integers(group.left), doubles(unknowns)
            self._calls.append((forth, back))

    def forth(self) -> None:
        """Eliminates what is hidden.

        Raises:
            LinAlgError: The equations of a cell or a pair do not tell what is hidden in it.
        """
        self.next.fill(0.0)
        for forth, _ in self._calls:
            if self._library.eliminate(*forth):
                raise np.linalg.LinAlgError("Singular matrix")
        self.next[self._ones] = 1.0

    def back(self) -> None:
        """Computes what is hidden from what is left."""
        for _, back in self._calls:
            self._library.substitute(*back)


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
        self.table, self._unknowns = table, np.zeros(table.count)
        entries = np.empty((n, dofs * (dofs + 1)))
        self.cells = entries[:, : dofs * dofs].reshape(n, dofs, dofs), entries[:, dofs * dofs :]
        self._eliminations: list[Elimination] = []
        for level in levels(table):
            # The last of them is what is solved densely.
            dense, self._dense = level.groups[0].hidden[0], entries
            self._eliminations.append(Elimination(level, entries, self._unknowns))
            entries = self._eliminations[-1].next
        if table.loose is not None:
            row, column = np.searchsorted(dense, [table.loose, table.joints[-1]])
            self._loose, self._begin = slice(row * (dense.size + 1), (row + 1) * (dense.size + 1)), column

    def residual_norm(self) -> float:
        """Norm of the assembled residual."""
        assembled = np.bincount(self.table.numbers.ravel(), self.cells[1].ravel(), self.table.count)
        assembled[self.table.fixed] = 0.0
        return float(np.linalg.norm(assembled))

    def step(self, *, fixed_joints: bool = False) -> tuple[Array, Array]:
        """Solves for the step that takes the linearised residual to zero.

        Args:
            fixed_joints: Whether the joints stay where they are, whatever their conditions say; not in a loop.

        Returns:
            The step of each cell's dofs ``(n, m)``, and of the scalars.

        Raises:
            LinAlgError: There is none.
        """
        if fixed_joints:
            self._hold()
        *levels, last = self._eliminations
        for level in levels:
            level.forth()
        if self.table.loose is not None:
            row = self._dense[self._loose]
            row[:] = 0.0
            row[self._begin] = 1.0
        last.forth()
        for level in reversed(self._eliminations):
            level.back()
        return self._unknowns[self.table.numbers], self._unknowns[self.table.scalars]

    def _hold(self) -> None:
        """Puts in place of the joints' equations that they stay."""
        jacobians, residuals = self.cells
        sigma = self.table.sigma
        jacobians[:, sigma], residuals[:, sigma] = 0.0, 0.0
        for joint in range(sigma.start, sigma.stop):
            jacobians[:, joint, joint] = 1.0


def levels(table: Table) -> list[Level]:
    """What is eliminated one after another.

    Cells come first, then the nodes inside of pairs, of pairs of pairs, and so on, until the chain of each pulley is
    short; then what is inside of these chains, if there are several; then all that is left.
    """
    result: list[Level] = []
    groups = [_cell_group(cells, pattern, table.numbers) for cells, pattern in table.patterns]
    width, fixed = table.chain.shape[1], table.fixed
    chains = _chains(table)
    # Pulley of each cell, and its place in the chain.
    pulley, place = np.empty((2, len(table.numbers)), dtype=int)
    for index, cells in enumerate(table.chains):
        pulley[cells], place[cells] = index, np.arange(chains.shape[1] - cells.size, chains.shape[1])
    members = [(pulley[cells], place[cells]) for cells, _ in table.patterns]
    while chains.shape[1] > LONGEST:
        if chains.shape[1] % 2:
            chains = np.concatenate([chains[:, :1], chains], axis=1)
            chains[:, 0, NODE:width] = fixed
            members = [(on, at + 1) for on, at in members]
        half, left = chains.shape[1] // 2, chains.shape[2]
        pairs = _paired(chains.reshape(-1, left), width)
        result.append(_level(groups, [on * half + at // 2 for on, at in members], pairs, left, fixed))
        groups, members = [_group(pairs, left)], [np.divmod(np.arange(len(pairs)), half)]
        chains = pairs[:, -left:].reshape(-1, half, left)
    if len(chains) > 1:
        numbers, left = _divided(chains.reshape(len(chains), -1), table)
        result.append(_level(groups, [on for on, _ in members], numbers, left, fixed))
        groups, chains = [_group(numbers, left)], numbers[:, -left:]
    numbers = np.unique(chains)
    dense = numbers[numbers < fixed]
    parents = [np.zeros(len(group.left), dtype=int) for group in groups]
    result.append(_level(groups, parents, dense[None], dense.size, fixed))
    nothing = np.empty(0, dtype=int)
    return [*result, Level([_group(dense[None], 0)], [nothing], 0, nothing)]


def _chains(table: Table) -> Array:
    """What couples each pulley's cells: left node, tractions, right node, the pulley's scalars ``(pulleys, m, w)``.

    Where there are fewer cells than on another pulley, cells without tractions and right nodes come first.
    """
    scalars = [table.scalars_of(cells) for cells in table.chains]
    width, longest = table.chain.shape[1], max(cells.size for cells in table.chains)
    most = max(numbers.size for numbers in scalars)
    result = np.full((len(scalars), longest, width + most), table.fixed)
    for chain, cells, numbers in zip(result, table.chains, scalars, strict=True):
        chain[:, :NODE] = table.chain[cells[0], :NODE]
        chain[-cells.size :, :width] = table.chain[cells]
        chain[:, width : width + numbers.size] = numbers
    return result


def _divided(chains: Array, table: Table) -> tuple[Array, int]:
    """What is eliminated from the chain of each pulley, then what is left ``(pulleys, w)``, and how much that is."""
    each = [np.unique(chain[chain < table.fixed]) for chain in chains]
    numbers, times = np.unique(np.concatenate(each), return_counts=True)
    shared = numbers[(times > 1) | (numbers == table.loose) | (numbers == table.forced)]
    inside, outside = ([own[np.isin(own, shared, invert=invert)] for own in each] for invert in (True, False))
    hidden, left = (max(own.size for own in some) for some in (inside, outside))
    result = np.full((len(each), hidden + left), table.fixed)
    for row, own, others in zip(result, inside, outside, strict=True):
        row[: own.size], row[hidden : hidden + others.size] = own, others
    return result, left


def _level(groups: list[Group], parents: list[Array], numbers: Array, left: int, fixed: int) -> Level:
    """The groups, whose members go into ``parents`` with these numbers of unknowns; as many of them are left there."""
    blocks, hidden = _entries(numbers), numbers.shape[1] - left
    missing = np.nonzero(numbers[:, :hidden] == fixed)
    return Level(groups, _places(groups, parents, numbers, fixed), blocks.size, blocks[*missing, missing[1]])


def _group(numbers: Array, left: int) -> Group:
    """What has these unknowns, of which so many are left, as a group on the next level."""
    hidden = numbers.shape[1] - left
    return Group(_entries(numbers), numbers[:, :hidden], numbers[:, hidden:], (hidden,))


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


def _places(groups: list[Group], parents: list[Array], pairs: Array, fixed: int) -> list[Array]:
    """Of each group, places among the entries of pairs of what it leaves; of all that is fixed, behind the last one.

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
        result.append(found)
    return result
