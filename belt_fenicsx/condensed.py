"""Linear algebra of the fitted method: a Newton step from the Jacobians of single cells.

What a cell hides from its neighbours is eliminated first, all cells of a kind at once, by dense factorisations with
pivoting. What is left couples the nodes and the few scalars, the borders and the stretch in stick. On many cells, the
node between two of them is eliminated next, all pairs at once, then that between two pairs, and so on: the cost grows
with the number of cells, not with its power. The rest is solved densely. The map sigma(eta) is no unknown of its own:
its columns are weighted into those of the borders at both ends of its zone.

All of a cell's pressures and frictions are too many to be eliminated with it, as there is one more Gauss point than
inner nodes; so those of one Gauss point are left. Of two cells, or pairs, one such point goes with the node between.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from belt_fenicsx.fields import Array
from belt_fenicsx.zones import Mesh

LONGEST = 16  # chain of cells, or pairs, that is solved densely: about where another level of pairs begins to pay


@dataclass(frozen=True)
class Local:
    """Numbers of a cell's dofs by field, in the order of the mixed element of degree k.

    Attributes:
        r: ``(k + 1, 2)``.
        theta: ``(k + 1,)``.
        p: ``(k,)``.
        f: ``(k,)``.
        sigma: ``(2,)``.
        D: ``(1,)``.
    """

    r: Array
    theta: Array
    p: Array
    f: Array
    sigma: Array
    D: Array


@functools.cache
def local(degree: int) -> Local:
    """Numbers of a cell's dofs."""
    k = degree
    ends = np.cumsum([0, 2 * (k + 1), k + 1, k, k, 2, 1])
    r, theta, p, f, sigma, D = (np.arange(start, end) for start, end in zip(ends[:-1], ends[1:], strict=True))
    return Local(r=r.reshape(-1, 2), theta=theta, p=p, f=f, sigma=sigma, D=D)


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
    """

    block: Array
    hidden: Array
    left: Array


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
        tractions = np.array([at.p, at.f] if friction else [at.p])
        inner = np.append(at.r[2:], at.theta[2:])
        left, right = (np.append(at.r[end], at.theta[end]) for end in (0, 1))
        kept, others = tractions[:, degree // 2], np.delete(tractions, degree // 2, axis=1)
        free, contact = np.flatnonzero(~mesh.touches), np.flatnonzero(mesh.touches)

        count = np.cumsum([0, 3 * (n - 1), kept.size * contact.size, mesh.ends.size, 1])
        nodal, middle, borders = (np.arange(*count[i : i + 2]) for i in range(3))
        self.held = held = int(count[-1])
        numbers = self.numbers = np.full((n, dofs), held)
        numbers[1:, left] = numbers[:-1, right] = nodal.reshape(-1, 3)
        numbers[np.ix_(contact, kept)] = middle.reshape(-1, kept.size)
        numbers[:, at.sigma] = np.concatenate([[held], borders, [held]])[mesh.zone[:, None] + [0, 1]]
        numbers[:, at.D] = held - 1
        groups, next_number, scalars = [], held + 1, np.append(at.sigma, at.D)
        for cells, hidden, tied in (
            (free, inner, np.concatenate([left, right, scalars])),
            (contact, np.append(inner, others), np.concatenate([left, right, kept, scalars])),
        ):
            shape = cells.size, hidden.size
            numbers[np.ix_(cells, hidden)] = next_number + np.arange(cells.size * hidden.size).reshape(shape)
            next_number += cells.size * hidden.size
            rows = np.append(hidden, tied)
            # A cell's residual stands behind its Jacobian.
            places = np.column_stack([rows[:, None] * dofs + rows, dofs * dofs + rows])
            block = (cells * dofs * (dofs + 1))[:, None, None] + places
            groups.append(Group(block, numbers[np.ix_(cells, hidden)], numbers[np.ix_(cells, tied)]))
        self.count = next_number
        self._sigma = slice(at.sigma[0], at.sigma[-1] + 1)
        self._scalars = np.append(borders, held - 1)
        chain = np.column_stack([numbers[:, left], numbers[:, kept], numbers[:, right], np.tile(self._scalars, (n, 1))])
        self._reduce(groups, [free, contact], chain, kept.size)

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
            groups = [Group(block, pairs[:, :hidden], chain)]
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

    def step(self, weights: Array, *, held: bool = False) -> tuple[Array, Array]:
        """Solves for the step that takes the linearised residual to zero; the cells' Jacobians are overwritten.

        Args:
            weights: Derivatives of sigma at each cell's ends with respect to the ends of its zone ``(n, 2, 2)``.
            held: Whether the borders stay where they are, whatever their conditions say.

        Returns:
            The step of each cell's dofs ``(n, 5 k + 6)``, but for sigma; and of the borders and the stretch in stick.
        """
        (jacobians, _), sigma = self.cells, self._sigma
        jacobians[:, :, sigma] = jacobians[:, :, sigma] @ weights
        entries, eliminated = self._all, []
        for level in self._levels:
            left = []
            for group in level.groups:
                block, h = entries.take(group.block), group.hidden.shape[1]
                solved = np.linalg.solve(block[:, :h, :h], block[:, :h, h:])
                left.append((block[:, h:, h:] - block[:, h:, :h] @ solved).ravel())
                eliminated.append((group, solved))
            entries = np.bincount(level.places, np.concatenate(left), level.size + 1)
            entries[level.ones] = 1.0
        size, borders = self._dense.size, self._scalars.size - 1
        matrix = entries[:-1].reshape(size, size + 1)
        if held:
            matrix[-1 - borders : -1] = np.eye(borders, size + 1, size - 1 - borders)
        unknowns = np.zeros(self.count)
        unknowns[self._dense] = np.linalg.solve(matrix[:, :-1], -matrix[:, -1])
        for group, solved in reversed(eliminated):
            left = unknowns[group.left][..., None]
            unknowns[group.hidden] = -(solved[..., :-1] @ left)[..., 0] - solved[..., -1]
            unknowns[self.held] = 0.0
        step = unknowns[self.numbers]
        step[:, sigma] = 0.0
        return step, unknowns[self._scalars]
