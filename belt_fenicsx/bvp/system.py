"""The collocation's equations of a problem on one mesh, and the linear system of a Newton step.

Unknowns are ordered along the belt: the values at the nodes of all parts, one after another, then the lengths of the
parts, the transport rate if it is one, and the displacements of take-ups. Each equation has a few neighbours, but for
these scalars: a sparse factorisation takes a time that is about linear in cells and pulleys.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import SuperLU, splu

from belt_fenicsx.bvp.collocation import (
    POINTS,
    WEIGHTS,
    Cells,
    at_end,
    inner,
    linearised_cells,
    stacked,
    unstacked,
)
from belt_fenicsx.bvp.equations import Free, OnPulleys, linearised
from belt_fenicsx.bvp.problem import FIRST, LAST, Condition, End, Group, Joining, Problem, slopes
from belt_fenicsx.layout.arrays import Array

SAME_ALONG = (0, 1, 2, 3)  # phi, psi, kappa and D, of two parts on one pulley.
STRAIN, FRICTION = 3, 4  # Indices of the strain, and of the integral of friction.


@dataclass(frozen=True)
class Values:
    """Unknowns of a problem on a mesh, scaled; or a step of them.

    Attributes:
        z: Unknowns at the nodes of spans and of contacts ``(n, parts of the group, m + 1)`` each.
        K: Their increments at the Gauss points ``(n, parts of the group, m, s)``.
        lengths: Lengths of the parts ``(parts,)``.
        c: Transport rate.
        moves: Displacements of take-ups ``(take-ups,)``.
    """

    z: tuple[Array, Array]
    K: tuple[Array, Array]
    lengths: Array
    c: float
    moves: Array

    def plus(self, step: Values, part: float, *, positive: bool) -> Values:
        """These values after a part of a step; with ``positive``, lengths change by a factor."""
        change = part * step.lengths
        lengths = self.lengths * np.exp(change / self.lengths) if positive else self.lengths + change
        return Values(
            (self.z[0] + part * step.z[0], self.z[1] + part * step.z[1]),
            (self.K[0] + part * step.K[0], self.K[1] + part * step.K[1]),
            lengths,
            self.c + part * step.c,
            self.moves + part * step.moves,
        )

    @property
    def size(self) -> float:
        """Root mean square of a step."""
        squares = sum(float(np.mean(z**2)) for z in self.z if z.size)
        scalars = np.array([*self.lengths, *self.moves, self.c])
        return math.sqrt(squares + float(scalars @ scalars))

    @property
    def largest(self) -> float:
        """Largest component of a step."""
        parts = [np.abs(z).max() for z in self.z if z.size]
        return float(max(*parts, np.abs(self.lengths).max(), np.abs(self.moves).max(initial=0.0), abs(self.c)))


class Residual(NamedTuple):
    """What is left of the equations: of the increments in each group, and of the others by rows."""

    increments: tuple[Array, Array]
    rows: Array


class Linear(NamedTuple):
    """Equations that are linearised at some values."""

    cells: tuple[Cells, Cells]
    lu: SuperLU


def stretched(mesh: Array, widths: Array) -> Array:
    """Lengths of the cells at their Gauss points, in parts of their part ``(parts, m, s)``."""
    h = np.diff(mesh)
    xi = (mesh[:-1, None] + h[:, None] * POINTS).ravel()
    return (slopes(widths, xi) * np.repeat(h, POINTS.size)).reshape(-1, h.size, POINTS.size)


class System:
    """The equations of a problem on a mesh.

    Args:
        problem: The problem.
        mesh: Nodes in [0, 1], shared by all parts ``(m + 1,)``.
        widths: Widths of the layers that the map of each part widens, in parts of the part ``(parts,)``.
    """

    def __init__(self, problem: Problem, mesh: Array, widths: Array) -> None:
        self.problem, self.cells, parts = problem, mesh.size - 1, len(problem.parts)
        g = stretched(mesh, widths)
        self.g = tuple(g[group.parts] for group in problem.groups)
        sizes = np.empty(parts, dtype=int)
        for group in problem.groups:
            sizes[group.parts] = group.equations.size
        self.sizes = sizes
        self.start = np.concatenate([[0], np.cumsum(sizes * mesh.size)])
        self.scalars = int(self.start[-1])
        self.of_rate = self.scalars + parts
        self.of_moves = self.of_rate + (problem.rate is None)
        self.size = self.of_moves + len(problem.take_ups)

    def residual(self, values: Values) -> Residual:
        """What is left of the equations."""
        increments, rows = [], []
        for group, z, K, g in zip(self.problem.groups, values.z, values.K, self.g, strict=True):
            F = self._rates(group, inner(z, K), values)
            increments.append(values.lengths[group.parts, None, None] * g * F - K)
            rows.append(np.moveaxis(z[..., 1:] - z[..., :-1] - K @ WEIGHTS, 0, -1).ravel())
        boundary, _, _, _ = self._boundary(values, derivatives=False)
        return Residual((increments[0], increments[1]), np.concatenate([*rows, boundary]))

    def after(self, values: Values, step: Values, part: float, *, positive: bool) -> Values:
        """Values after a part of a step.

        In a part that ends with the stretch with which it begins, what is added to this stretch goes with the length:
        its rate is what a step changes. So lengths may change their sign, and none of them ends at nothing.
        """
        moved = values.plus(step, part, positive=positive)
        for returning in self.problem.returning:
            _, at = self.problem.place[returning]
            own = STRAIN, at
            grows = step.lengths[returning] / values.lengths[returning]
            factor = moved.lengths[returning] / values.lengths[returning]
            z, dz = values.z[1][own], step.z[1][own]
            added = z - z[0] + part * (dz - dz[0] - grows * (z - z[0]))
            moved.z[1][own] = z[0] + part * dz[0] + factor * added
            K, dK = values.K[1][own], step.K[1][own]
            moved.K[1][own] = factor * (K + part * (dK - grows * K))
        return moved

    def linearised(self, values: Values) -> Linear:
        """The equations, linearised and factorised.

        Raises:
            RuntimeError: The matrix is singular.
        """
        cells: list[Cells] = []
        blocks: list[tuple[Array, Array, Array]] = []
        row = 0
        for group, z, K, g in zip(self.problem.groups, values.z, values.K, self.g, strict=True):
            F, by_z, by_c = self._linearised_rates(group, inner(z, K), values)
            by_length = g * F
            if group is self.problem.contacts:
                for part in self.problem.returning:
                    _, at = self.problem.place[part]
                    by_length[STRAIN, at] = K[STRAIN, at] / values.lengths[part]
            cell = linearised_cells(by_length, by_z, by_c, values.lengths[group.parts], g)
            cells.append(cell)
            row = self._cell_rows(group, cell, row, blocks)
        _, rows, cols, entries = self._boundary(values, derivatives=True)
        blocks.append((np.array(rows) + row, np.array(cols), np.array(entries)))
        i, j, v = (np.concatenate(column) for column in zip(*blocks, strict=True))
        assert i.max() + 1 == self.size, f"as many equations as unknowns on {[str(p) for p in self.problem.parts]}"
        matrix = csc_matrix((v, (i, j)), shape=(self.size, self.size))
        return Linear((cells[0], cells[1]), splu(matrix))

    def step(self, linear: Linear, residual: Residual) -> Values:
        """The Newton step that takes a residual away."""
        inside = [
            (cell.inverse @ stacked(missed)[..., None])[..., 0]
            for cell, missed in zip(linear.cells, residual.increments, strict=True)
        ]
        rows = -residual.rows
        row = 0
        for group, free in zip(self.problem.groups, inside, strict=True):
            count = group.parts.size * self.cells * group.equations.size
            rows[row : row + count] += at_end(free).ravel()
            row += count
        d = linear.lu.solve(rows)
        lengths = d[self.scalars : self.of_rate]
        dc = float(d[self.of_rate]) if self.problem.rate is None else 0.0
        z, K = [], []
        for group, cell, free in zip(self.problem.groups, linear.cells, inside, strict=True):
            dz = d[self._columns(group)]
            change = free + (cell.by_start @ np.moveaxis(dz[..., :-1], 0, -1)[..., None])[..., 0]
            change += cell.by_length * lengths[group.parts, None, None] + cell.by_rate * dc
            z.append(dz)
            K.append(unstacked(change))
        return Values((z[0], z[1]), (K[0], K[1]), lengths, dc, d[self.of_moves :])

    def _columns(self, group: Group) -> Array:
        """Indices of the unknowns at the nodes ``(n, parts of the group, m + 1)``."""
        n = group.equations.size
        nodes = self.start[group.parts, None] + n * np.arange(self.cells + 1)
        return np.arange(n)[:, None, None] + nodes

    def _rates(self, group: Group, z: Array, values: Values) -> Array:
        n, parts, cells, s = z.shape
        equations = group.equations
        F = equations.rate(self.problem.rod, group.unscaled(z).reshape(n, parts, -1), np.asarray(values.c))
        return group.scaled(F).reshape(z.shape)

    def _linearised_rates(self, group: Group, z: Array, values: Values) -> tuple[Array, Array, Array | None]:
        n, parts, cells, s = z.shape
        equations, rod, y = group.equations, self.problem.rod, group.unscaled(z).reshape(n, parts, -1)
        F, by_y = _by_all(lambda y, c: equations.rate(rod, y, c), y, values.c, self.problem.rate is None)
        units = group.units
        by_z = by_y[:, :n] * (units[:, None] / units)[..., None, None]
        by_c = (group.scaled(by_y[:, n])).reshape(z.shape) if self.problem.rate is None else None
        return group.scaled(F).reshape(z.shape), by_z.reshape(n, n, *z.shape[1:]), by_c

    def _cell_rows(self, group: Group, cell: Cells, row: int, blocks: list[tuple[Array, Array, Array]]) -> int:
        """Adds the rows of cells: dz_next - (1 + sum b_k K') dz - ... ; returns the next row."""
        n, parts, m = group.equations.size, group.parts.size, self.cells
        rows = row + np.arange(parts * m * n).reshape(parts, m, n)
        columns = np.moveaxis(self._columns(group), 0, -1)  # (parts, m + 1, n)
        own, nexts = columns[:, :-1], columns[:, 1:]
        by_start = -at_end(cell.by_start) - np.eye(n)
        blocks.append((rows.ravel(), nexts.ravel(), np.ones(rows.size)))
        shape = (parts, m, n, n)
        at = (np.broadcast_to(rows[..., None], shape), np.broadcast_to(own[:, :, None], shape))
        blocks.append((at[0].ravel(), at[1].ravel(), by_start.ravel()))
        of_length = np.broadcast_to((self.scalars + group.parts)[:, None, None], rows.shape)
        blocks.append((rows.ravel(), of_length.ravel(), -at_end(cell.by_length).ravel()))
        if self.problem.rate is None:
            blocks.append((rows.ravel(), np.full(rows.size, self.of_rate), -at_end(cell.by_rate).ravel()))
        return row + rows.size

    def _boundary(self, values: Values, *, derivatives: bool) -> tuple[Array, list[int], list[int], list[float]]:
        """Residual of clamps, joints, conditions and the belt's length; rows, columns and entries of its
        derivatives.
        """
        problem = self.problem
        writer = _Rows(self, values, derivatives)
        if problem.clamps is not None:
            last = len(problem.parts) - 1
            for part, end, clamp in ((0, FIRST, problem.clamps[0]), (last, LAST, problem.clamps[1])):
                for i, value in enumerate(clamp):
                    writer.difference([(part, end, i, 1.0)], -value)
        for joining in problem.joinings:
            before, after = joining.before, joining.after
            kinds = [problem.parts[part].kind == "free" for part in (before, after)]
            if any(kinds):
                writer.joined(joining)
            else:
                for i in SAME_ALONG:
                    writer.difference([(after, FIRST, i, 1.0), (before, LAST, i, -1.0)])
            if not kinds[1]:
                writer.difference([(after, FIRST, FRICTION, 1.0)])
        for condition in problem.conditions:
            writer.condition(condition)
        writer.lengths()
        return np.array(writer.missed), writer.rows, writer.columns, writer.entries


class _Rows:
    """Rows of the equations at ends of parts, written one after another."""

    def __init__(self, system: System, values: Values, derivatives: bool) -> None:
        self.system, self.values, self.derivatives = system, values, derivatives
        self.missed: list[float] = []
        self.rows: list[int] = []
        self.columns: list[int] = []
        self.entries: list[float] = []
        problem, rod, unknown = system.problem, system.problem.rod, system.problem.rate is None
        self.joins = []
        contacts = problem.moved(values.moves)
        for group, z in zip(problem.groups, values.z, strict=True):
            equations = group.equations if isinstance(group.equations, Free) else contacts
            y = group.unscaled(z[..., [FIRST, LAST]])

            def function(y: Array, c: Array, equations: Free | OnPulleys = equations) -> Array:
                return equations.joined(rod, y, c)

            if derivatives:
                state, by_y = _by_all(function, y, values.c, unknown)
            else:
                state, by_y = function(y, np.asarray(values.c)), np.empty(0)
            self.joins.append((state, by_y))

    def difference(self, terms: list[tuple[int, int, int, float]], value: float = 0.0) -> None:
        """The row of a sum of scaled unknowns: part, end, index and factor of each."""
        missed, row = value, len(self.missed)
        for part, end, i, factor in terms:
            group, at = self.system.problem.place[part]
            missed += factor * self.values.z[group is self.system.problem.contacts][i, at, end]
            self._add(row, self._column(part, end) + i, factor)
        self.missed.append(float(missed))

    def joined(self, joining: Joining) -> None:
        """The rows of what is continuous from a part to the next one, one of which is free."""
        problem, row = self.system.problem, len(self.missed)
        scale = problem.spans.units
        total, kept = np.zeros(6), np.eye(6)
        if joining.follows:
            # Of the balance of forces, that across the belt is left.
            phi = problem.contacts.unscaled(self.values.z[1])[0, problem.place[joining.after][1], FIRST]
            kept = np.vstack([kept[:4], [0.0, 0.0, 0.0, 0.0, -math.sin(phi), math.cos(phi)]])
        for part, end, sign in ((joining.after, FIRST, 1.0), (joining.before, LAST, -1.0)):
            group, at = problem.place[part]
            state, by_y = self.joins[group is problem.contacts]
            total += sign * scale * state[:, at, end]
            if self.derivatives:
                n, column = group.equations.size, self._column(part, end)
                block = kept @ (sign * scale[:, None] * by_y[:, :, at, end])
                for i in range(len(kept)):
                    for j in range(n):
                        self._add(row + i, column + j, block[i, j] / group.units[j])
                    if problem.rate is None:
                        self._add(row + i, self.system.of_rate, block[i, n])
                for k, take_up in enumerate(problem.take_ups):
                    if part in take_up.parts:
                        for i in (0, 1):
                            self._add(row + i, self.system.of_moves + k, sign * scale[i] * take_up.direction[i])
        total[2] += joining.jump
        self.missed += (kept @ total).tolist()

    def condition(self, condition: Condition) -> None:
        """The row of a condition."""
        system, values, row = self.system, self.values, len(self.missed)
        problem, z, columns, factors, cuts = system.problem, [], [], [], []
        for part, end in condition.ends:
            group, at = problem.place[part]
            n, column = group.equations.size, self._column(part, end)
            z += [*group.unscaled(values.z[group is problem.contacts][:, at, end]), values.lengths[part]]
            columns += [*range(column, column + n), system.scalars + part]
            factors += [*(1.0 / group.units), 1.0]
            cuts.append(n + 1)
        z += [values.c, *values.moves]
        columns += [None if problem.rate is not None else system.of_rate, *range(system.of_moves, system.size)]
        factors += [1.0] * (1 + values.moves.size)

        def function(v: Array) -> Array:
            *ends, scalars = np.split(v, np.cumsum(cuts))
            c, moves = scalars[0], scalars[1:]
            at_ends = [
                End(own[:-1], own[-1], problem.equations(part, moves))
                for own, (part, _) in zip(ends, condition.ends, strict=True)
            ]
            return condition.function(at_ends, c)[None]

        v = np.array(z)[:, None, None]
        if not self.derivatives:
            self.missed.append(float(function(v)[0, 0, 0]))
            return
        value, by = linearised(function, v)
        self.missed.append(float(value[0, 0, 0]))
        for column, factor, entry in zip(columns, factors, by[0, :, 0, 0], strict=True):
            if entry != 0.0 and column is not None:
                self._add(row, column, float(entry * factor))

    def lengths(self) -> None:
        """The row of the belt's length, which is one."""
        row, lengths = len(self.missed), self.values.lengths
        for i in range(lengths.size):
            self._add(row, self.system.scalars + i, 1.0)
        self.missed.append(float(lengths.sum() - 1.0))

    def _column(self, part: int, end: int) -> int:
        """Index of the first unknown at an end of a part."""
        system = self.system
        return int(system.start[part] + (0 if end == FIRST else system.sizes[part] * system.cells))

    def _add(self, row: int, column: int, entry: float) -> None:
        self.rows.append(row)
        self.columns.append(column)
        self.entries.append(entry)


def _by_all(function: Callable[[Array, Array], Array], y: Array, c: float, unknown: bool) -> tuple[Array, Array]:
    """Values and derivatives with respect to the unknowns ``(n, ...)`` and, if it is unknown, the transport rate
    last.
    """
    if not unknown:
        return linearised(lambda z: function(z, np.asarray(c)), y)
    return linearised(lambda z: function(z[:-1], z[-1]), np.concatenate([y, np.full_like(y[:1], c)]))
