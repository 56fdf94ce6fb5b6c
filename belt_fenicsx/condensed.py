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
        D: ``(2,)``.
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
    ends = np.cumsum([0, 2 * (k + 1), k + 1, k, k, 2, 2])
    r, theta, p, f, sigma, D = (np.arange(start, end) for start, end in zip(ends[:-1], ends[1:], strict=True))
    return Local(r=r.reshape(-1, 2), theta=theta, p=p, f=f, sigma=sigma, D=D)


@dataclass(frozen=True)
class Group:
    """The c cells of one kind, with h dofs that are eliminated, and v rows and w columns that are left.

    Attributes:
        block: Places in the cells' Jacobians of the eliminated rows and then those that are left, in the columns
            that are eliminated, then those that are left, then the residual's ``(c, h + v, h + w + 1)``.
        dofs: Eliminated dofs ``(c, h)``.
        unknowns: Number of the unknown of each column that is left ``(c, w)``.
        places: Places of the rows that are left in the matrix of all cells ``(c * v * (w + 1),)``.
    """

    block: Array
    dofs: Array
    unknowns: Array
    places: Array


class Condensed:
    """Newton steps on one mesh with elements of one degree.

    Args:
        mesh: Zones and cells.
        degree: Degree k.
        dofs: Dofs of each cell ``(n, 5 k + 7)``.
        friction: Whether the friction traction is an unknown.
    """

    def __init__(self, mesh: Mesh, degree: int, dofs: Array, friction: bool) -> None:
        at, (n, width) = local(degree), dofs.shape
        tractions = [at.p, at.f] if friction else [at.p]
        kept = degree // 2
        in_contact = np.flatnonzero(mesh.touches)
        grip = mesh.ends[mesh.zones.grip]

        nodes = 3 * (n - 1)
        fields = nodes + len(tractions) * in_contact.size
        size = fields + len(mesh.ends) + 1
        nowhere, rhs = size, size + 1
        of_node = np.full((n + 1, 3), nowhere)
        of_node[1:-1] = np.arange(nodes).reshape(-1, 3)
        of_cell = np.full((n, len(tractions)), nowhere)
        of_cell[in_contact] = np.arange(nodes, fields).reshape(-1, len(tractions))
        of_border = np.concatenate([[nowhere], np.arange(fields, size - 1), [nowhere]])
        row_of_border, row_of_grip = np.full(n + 1, nowhere), np.full(n + 1, nowhere)
        row_of_border[mesh.ends] = of_border[1:-1]
        grips = np.arange(mesh.ends[0], mesh.ends[-1] + 1) if mesh.zones.by_force else [grip]
        row_of_grip[grips] = size - 1

        self.size, self.fields = size, fields
        self.dofs = np.concatenate(
            [
                dofs[1:, np.append(at.r[0], at.theta[0])].ravel(),
                dofs[in_contact][:, [field[kept] for field in tractions]].ravel(),
                dofs[mesh.ends, at.sigma[0]],
                dofs[[grip], at.D[0]],
            ]
        )
        self.grip_dofs = dofs[grips, at.D[0]]
        self.cell_dofs, self.local = dofs, at
        self.zone = mesh.zone
        self.groups = []
        for contact in (False, True):
            cells = np.flatnonzero(mesh.touches == contact)
            hidden = [at.r[2:].ravel(), at.theta[2:]]
            left = [np.append(at.r[end], at.theta[end]) for end in (0, 1)]
            unknowns = [of_node[cells], of_node[cells + 1]]
            if contact:
                hidden += [np.delete(field, kept) for field in tractions]
                left += [[field[kept] for field in tractions]]
                unknowns += [of_cell[cells]]
            hidden, left = np.concatenate(hidden), np.concatenate(left)
            rows = np.concatenate([hidden, left, at.sigma, at.D])
            columns = np.concatenate([hidden, left, at.sigma, at.D])
            zone = mesh.zone[cells]
            scalars = [of_border[zone, None], of_border[zone + 1, None], np.full((cells.size, 1), size - 1)]
            equations = [rows_of[cells + end, None] for rows_of in (row_of_border, row_of_grip) for end in (0, 1)]
            equations, unknowns = np.hstack(unknowns + equations), np.hstack(unknowns + scalars)
            where = np.hstack([unknowns, np.full((cells.size, 1), rhs)])
            self.groups.append(
                Group(
                    block=(cells[:, None, None] * width + rows[:, None]) * width + columns,
                    dofs=dofs[cells[:, None], hidden],
                    unknowns=unknowns,
                    places=(equations[:, :, None] * (size + 2) + where[:, None, :]).ravel(),
                )
            )
        self._places = np.concatenate([group.places for group in self.groups])

    def step(self, jacobians: Array, residual: Array, weights: Array, *, held: bool = False) -> tuple[Array, Array]:
        """Solves for the step that takes the linearised residual to zero.

        Args:
            jacobians: Jacobian of each cell ``(n, 5 k + 7, 5 k + 7)``; overwritten.
            residual: Assembled residual.
            weights: Derivatives of sigma at each cell's ends with respect to the ends of its zone ``(n, 2, 2)``.
            held: Whether the borders stay where they are, whatever their conditions say.

        Returns:
            The step, in the order of the residual, and the part of it that are borders and stretch in stick.
        """
        at, size = self.local, self.size
        # The columns of sigma and of the stretch in stick become those of the two borders, of the stretch, and the
        # right-hand side.
        jacobians[:, :, at.sigma] = jacobians[:, :, at.sigma] @ weights
        jacobians[:, :, at.D[0]] += jacobians[:, :, at.D[1]]
        jacobians[:, :, at.D[1]] = residual[self.cell_dofs]
        entries, eliminated = [], []
        for group in self.groups:
            block, h = jacobians.take(group.block), group.dofs.shape[1]
            solved = np.linalg.solve(block[:, :h, :h], block[:, :h, h:])
            block[:, h:, -1] = 0.0
            entries.append((block[:, h:, h:] - block[:, h:, :h] @ solved).ravel())
            eliminated.append(solved)
        matrix = np.bincount(self._places, np.concatenate(entries), (size + 1) * (size + 2))
        matrix = matrix.reshape(size + 1, size + 2)[:size]
        left = residual[self.dofs]
        left[-1] = residual[self.grip_dofs].sum()
        if held:
            borders = slice(self.fields, size - 1)
            matrix[borders], left[borders] = np.eye(size - 1 - self.fields, size + 2, self.fields), 0.0
        unknowns = np.zeros(size + 1)
        unknowns[:size] = np.linalg.solve(matrix[:, :size], -matrix[:, -1] - left)

        step = np.zeros_like(residual)
        for group, solved in zip(self.groups, eliminated, strict=True):
            step[group.dofs] = -(solved[..., :-1] @ unknowns[group.unknowns][..., None])[..., 0] - solved[..., -1]
        step[self.dofs[: self.fields]] = unknowns[: self.fields]
        scalars = unknowns[self.fields : size]
        ends = np.concatenate([[0.0], scalars[:-1], [0.0]])
        ends = np.column_stack([ends[self.zone], ends[self.zone + 1]])
        step[self.cell_dofs[:, at.sigma]] = (weights @ ends[..., None])[..., 0]
        step[self.cell_dofs[:, at.D]] = scalars[-1]
        return step, scalars
