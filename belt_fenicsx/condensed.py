"""Linear algebra of the fitted method: a Newton step from the Jacobians of single cells.

What a cell hides from its neighbours is eliminated first, all cells of a kind at once, by dense factorisations with
pivoting. What is left couples the nodes and the few scalars, the borders and the stretch in stick, and is solved
densely, too. The map sigma(eta) is no unknown of its own: its columns are weighted into those of the borders at both
ends of its zone.

All of a cell's pressures and frictions are too many to be eliminated with it, as there is one more Gauss point than
inner nodes; so those of one Gauss point are left.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from belt_fenicsx.fields import Array
from belt_fenicsx.zones import Mesh


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
    """The c cells of one kind, with h dofs that are eliminated and u that are left.

    Attributes:
        block: Places, among the Jacobians and residuals of all cells, of rows and columns, first those that are
            eliminated, and of the residual beside them ``(c, h + u, h + u + 1)``.
        hidden: Numbers of the unknowns that are eliminated ``(c, h)``.
        left: Numbers of the unknowns that are left ``(c, u)``.
        places: Places of what is left in the matrix of all cells with its right-hand side ``(c * u * (u + 1),)``.
    """

    block: Array
    hidden: Array
    left: Array
    places: Array


class Condensed:
    """Newton steps on one mesh with elements of one degree.

    Unknowns are numbered: first those that are left, of the nodes, tractions, borders and the stretch in stick; then
    one number for all dofs that are held; then those that are eliminated. An equation has its unknown's number.

    Args:
        mesh: Zones and cells.
        degree: Degree k.
        friction: Whether the friction traction is an unknown.

    Attributes:
        size: Number of unknowns that are left, and the number that stands for dofs that are held.
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
        self.size = held = int(count[-1])
        numbers = self.numbers = np.full((n, dofs), held)
        numbers[1:, left] = numbers[:-1, right] = nodal.reshape(-1, 3)
        numbers[np.ix_(contact, kept)] = middle.reshape(-1, kept.size)
        numbers[:, at.sigma] = np.concatenate([[held], borders, [held]])[mesh.zone[:, None] + [0, 1]]
        numbers[:, at.D] = held - 1
        self.groups = []
        scalars, next_number = np.append(at.sigma, at.D), held + 1
        for cells, hidden, tied in (
            (free, inner, np.concatenate([left, right, scalars])),
            (contact, np.append(inner, others), np.concatenate([left, right, kept, scalars])),
        ):
            shape = cells.size, hidden.size
            numbers[np.ix_(cells, hidden)] = next_number + np.arange(cells.size * hidden.size).reshape(shape)
            next_number += cells.size * hidden.size
            self.groups.append(self._group(cells, hidden, tied, dofs))
        self.count = next_number
        self._places = np.concatenate([group.places for group in self.groups])
        self._sigma = slice(at.sigma[0], at.sigma[-1] + 1)
        self._borders = slice(borders[0], held - 1)

    def _group(self, cells: Array, hidden: Array, tied: Array, dofs: int) -> Group:
        rows = np.append(hidden, tied)
        # A cell's residual stands behind its Jacobian.
        places = np.column_stack([rows[:, None] * dofs + rows, dofs * dofs + rows])
        left = self.numbers[np.ix_(cells, tied)]
        columns = np.column_stack([left, np.full(cells.size, self.size + 1)])
        return Group(
            block=(cells * dofs * (dofs + 1))[:, None, None] + places,
            hidden=self.numbers[np.ix_(cells, hidden)],
            left=left,
            places=(left[:, :, None] * (self.size + 2) + columns[:, None, :]).ravel(),
        )

    def residual_norm(self) -> float:
        """Norm of the assembled residual."""
        assembled = np.bincount(self.numbers.ravel(), self.cells[1].ravel(), self.count)
        assembled[self.size] = 0.0
        return float(np.linalg.norm(assembled))

    def step(self, weights: Array, *, held: bool = False) -> tuple[Array, Array]:
        """Solves for the step that takes the linearised residual to zero; the cells' Jacobians are overwritten.

        Args:
            weights: Derivatives of sigma at each cell's ends with respect to the ends of its zone ``(n, 2, 2)``.
            held: Whether the borders stay where they are, whatever their conditions say.

        Returns:
            The step of each cell's dofs ``(n, 5 k + 6)``, but for sigma; and of the borders and the stretch in stick.
        """
        (jacobians, _), size, sigma = self.cells, self.size, self._sigma
        jacobians[:, :, sigma] = jacobians[:, :, sigma] @ weights
        entries, eliminated = [], []
        for group in self.groups:
            block, h = self._all.take(group.block), group.hidden.shape[1]
            solved = np.linalg.solve(block[:, :h, :h], block[:, :h, h:])
            entries.append((block[:, h:, h:] - block[:, h:, :h] @ solved).ravel())
            eliminated.append(solved)
        matrix = np.bincount(self._places, np.concatenate(entries), (size + 1) * (size + 2))
        matrix = matrix.reshape(size + 1, size + 2)[:size]
        if held:
            matrix[self._borders] = np.eye(self._borders.stop - self._borders.start, size + 2, self._borders.start)
        unknowns = np.zeros(self.count)
        unknowns[:size] = np.linalg.solve(matrix[:, :size], -matrix[:, -1])
        for group, solved in zip(self.groups, eliminated, strict=True):
            left = unknowns[group.left][..., None]
            unknowns[group.hidden] = -(solved[..., :-1] @ left)[..., 0] - solved[..., -1]
        step = unknowns[self.numbers]
        step[:, sigma] = 0.0
        return step, unknowns[self._borders.start : size]
