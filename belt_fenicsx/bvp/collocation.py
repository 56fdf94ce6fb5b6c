"""Collocation at Gauss points, cell by cell: what a cell tells of its ends, with the values inside of it eliminated.

With K_j the increment of the unknowns z that the rate at the j-th Gauss point of a cell stands for,

    z_j = z + sum_k a_jk K_k          K_j = L g_j F(z_j)          z_next = z + sum_k b_k K_k

where L is the length of the part and g_j the length of the cell in parts of it, times the slope of the part's map. The
values at the ends of cells are of order 2 s, those of the polynomial between of order s + 1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from belt_fenicsx.layout.arrays import Array

STAGES = 4
POINTS = (1.0 + np.polynomial.legendre.leggauss(STAGES)[0]) / 2.0
WEIGHTS = np.polynomial.legendre.leggauss(STAGES)[1] / 2.0
# Of the polynomials, and of ends of cells, less two where layers are hardly resolved.
ORDER_INSIDE, ORDER_AT_ENDS = STAGES + 1, 2 * STAGES - 2


_POWERS = np.arange(1, STAGES + 1)
# The columns are the coefficients of the integrals of the Lagrange polynomials through the Gauss points.
_COEFFICIENTS = np.linalg.inv(POINTS[:, None] ** (_POWERS - 1)) / _POWERS[:, None]


def integrals(tau: Array) -> Array:
    """Integrals from 0 to tau of the Lagrange polynomials through the Gauss points ``(..., s)`` for ``(...)``."""
    return (tau[..., None] ** _POWERS) @ _COEFFICIENTS


INSIDE = integrals(POINTS)  # The matrix a.
_OUT_OF_INSIDE = np.linalg.inv(INSIDE)


def increments(z: Array, points: Array) -> Array:
    """The increments ``(n, parts, cells, s)`` with which `inner` gives the values at the Gauss points."""
    return (points - z[..., :-1, None]) @ _OUT_OF_INSIDE.T


class Cells(NamedTuple):
    """Linearised cells: K + dK, with dK = missed + by_start dz + by_length dL + by_rate dc, stages and unknowns as one
    axis.

    Attributes:
        inverse: What turns a residual of the increments into the increments ``(parts, cells, s n, s n)``.
        by_start: Of the increments with respect to the unknowns at the start ``(parts, cells, s n, n)``.
        by_length: With respect to the length of the part ``(parts, cells, s n)``.
        by_rate: With respect to the transport rate ``(parts, cells, s n)``.
    """

    inverse: Array
    by_start: Array
    by_length: Array
    by_rate: Array


def inner(z: Array, K: Array) -> Array:
    """Values at the Gauss points ``(n, parts, cells, s)`` from those at the nodes and the increments."""
    return z[..., :-1, None] + K @ INSIDE.T


def linearised_cells(by_length: Array, by_z: Array, by_c: Array | None, lengths: Array, g: Array) -> Cells:
    """Cells from what is linearised at their Gauss points.

    Args:
        by_length: Derivatives of the increments with respect to the part's length ``(n, parts, cells, s)``.
        by_z: Derivatives of the rates ``(n, n, parts, cells, s)``.
        by_c: Those with respect to the transport rate ``(n, parts, cells, s)``, if it is unknown.
        lengths: Lengths of the parts ``(parts,)``.
        g: Lengths of the cells at the points, in parts of the part ``(parts, cells, s)``.
    """
    n, parts, cells, s = by_length.shape
    scale = lengths[:, None, None] * g
    J = np.moveaxis(by_z * scale, (0, 1), (-2, -1))  # (parts, cells, s, n, n)
    matrix = -np.einsum("pcjil,jk->pcjikl", J, INSIDE).reshape(parts, cells, s * n, s * n)
    matrix[..., range(s * n), range(s * n)] += 1.0
    inverse = np.linalg.inv(matrix)

    def solved(values: Array) -> Array:
        return (inverse @ stacked(values)[..., None])[..., 0]

    by_start = inverse @ J.reshape(parts, cells, s * n, n)
    by_rate = np.zeros((parts, cells, s * n)) if by_c is None else solved(by_c * scale)
    return Cells(inverse, by_start, solved(by_length), by_rate)


def stacked(values: Array) -> Array:
    """Values at Gauss points ``(n, parts, cells, s)`` with stages and unknowns as one axis ``(parts, cells, s n)``."""
    return np.moveaxis(values, 0, -1).reshape(*values.shape[1:3], -1)


def unstacked(values: Array) -> Array:
    """The inverse of `stacked`."""
    parts, cells, size = values.shape
    return np.moveaxis(values.reshape(parts, cells, STAGES, size // STAGES), -1, 0)


def at_end(values: Array) -> Array:
    """What increments ``(parts, cells, s n, ...)`` add up to at the end of their cells ``(parts, cells, n, ...)``."""
    parts, cells, size, *rest = values.shape
    return np.einsum("j,pcj...->pc...", WEIGHTS, values.reshape(parts, cells, STAGES, size // STAGES, *rest))
