"""Cubic Hermite interpolation along the belt, that of the fixed mesh's elements."""

from __future__ import annotations

import numpy as np

from belt_fenicsx.layout.arrays import Array


def basis(eta: Array) -> tuple[Array, Array]:
    """Functions of the values and slopes at both ends of a unit cell, and their derivatives ``(4, ...)``."""
    ends, inside = eta**2 * (3.0 - 2.0 * eta), eta * (1.0 - eta)
    functions = np.array([1.0 - ends, inside * (1.0 - eta), ends, -inside * eta])
    rates = np.array([-6.0 * inside, (1.0 - eta) * (1.0 - 3.0 * eta), 6.0 * inside, eta * (3.0 * eta - 2.0)])
    return functions, rates


def in_unit_cells(values: Array, slopes: Array, eta: Array) -> tuple[Array, Array]:
    """The interpolant and its derivative at the same places of each of a row of unit cells ``(n, m)``.

    Args:
        values: Values at the nodes ``(n + 1,)``.
        slopes: Slopes there ``(n + 1,)``.
        eta: Places in a unit cell ``(m,)``.
    """
    ends = np.column_stack([values[:-1], slopes[:-1], values[1:], slopes[1:]])
    functions, rates = basis(eta)
    return ends @ functions, ends @ rates


def interpolate(at: Array, nodes: Array, values: Array, slopes: Array) -> tuple[Array, Array]:
    """The interpolant and its derivative at some places ``(m, k)``.

    Args:
        at: The places ``(m,)``.
        nodes: Increasing nodes ``(n,)``, of which two may be the same.
        values: Values at the nodes ``(n, k)``.
        slopes: Slopes there ``(n, k)``.
    """
    cell = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, len(nodes) - 2)
    size = (nodes[cell + 1] - nodes[cell])[:, np.newaxis]
    ends = np.array([values[cell], size * slopes[cell], values[cell + 1], size * slopes[cell + 1]])
    functions, rates = basis((at[:, np.newaxis] - nodes[cell, np.newaxis]) / size)
    return (functions * ends).sum(axis=0), (rates * ends).sum(axis=0) / size
