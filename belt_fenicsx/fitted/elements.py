"""Elements of the fitted method: Lagrange polynomials through Gauss-Lobatto points, and through Gauss points."""

from __future__ import annotations

import functools
from typing import Any

import basix
import numpy as np
import ufl

from belt_fenicsx.backend import compat
from belt_fenicsx.layout.arrays import Array

LINE = basix.CellType.interval
LOBATTO, GAUSS = basix.LagrangeVariant.gll_warped, basix.LagrangeVariant.gl_warped


def lagrange(degree: int, *, size: int | None = None) -> Any:
    """Continuous element with its nodes at the Gauss-Lobatto points, scalar or with ``size`` components."""
    return _element(degree, LOBATTO, False, size)


def gauss(count: int, *, size: int | None = None) -> Any:
    """Discontinuous element with its nodes at the ``count`` Gauss points, scalar or with ``size`` components."""
    return _element(count - 1, GAUSS, True, size)


def one_sided(size: int) -> Any:
    """Discontinuous element with ``size`` components, whose nodes are the cells' ends."""
    return _element(1, LOBATTO, True, size)


def line() -> ufl.Mesh:
    """The interval on which forms are written."""
    return ufl.Mesh(compat.coordinate_element())


@functools.cache
def points(degree: int) -> tuple[Array, Array]:
    """The reference cell's nodes, left, right and inner ``(k + 1,)``, and its Gauss points ``(k,)``."""
    return _nodal(degree).points[:, 0], _traction(degree).points[:, 0]


@functools.cache
def gauss_weights(degree: int) -> Array:
    """Weights of the Gauss points ``(k,)``."""
    return np.asarray(basix.make_quadrature(LINE, 2 * degree - 1)[1])


def nodal_basis(degree: int, at: Array) -> tuple[Array, Array]:
    """Polynomials through the nodes, and their derivatives, at points ``(m,)``: two arrays ``(m, k + 1)``."""
    values, slopes = _tabulated(_nodal(degree), 1, at)
    return values, slopes


def gauss_basis(degree: int, at: Array) -> Array:
    """Polynomials through the Gauss points at points ``(m,)``: ``(m, k)``."""
    return _tabulated(_traction(degree), 0, at)[0]


def _tabulated(element: Any, order: int, at: Array) -> Array:
    """An element's polynomials and their derivatives, up to an order, at points ``(order + 1, m, dim)``."""
    # Where there is no point, Basix 0.5 ends the process.
    return element.tabulate(order, at[:, None])[..., 0] if at.size else np.empty((order + 1, 0, element.dim))


@functools.cache
def _nodal(degree: int) -> Any:
    return _basix(degree, LOBATTO, False)


@functools.cache
def _traction(degree: int) -> Any:
    return _basix(degree - 1, GAUSS, True)


def _basix(degree: int, variant: Any, discontinuous: bool) -> Any:
    family = basix.ElementFamily.P
    if compat.basix_ufl is None:
        return basix.create_element(family, LINE, degree, variant, discontinuous)
    return basix.create_element(family, LINE, degree, variant, discontinuous=discontinuous)


def _element(degree: int, variant: Any, discontinuous: bool, size: int | None) -> Any:
    family = basix.ElementFamily.P
    if compat.basix_ufl is None:
        from basix import ufl_wrapper

        scalar = ufl_wrapper.create_element(family, LINE, degree, variant, discontinuous=discontinuous)
        return scalar if size is None else ufl.VectorElement(scalar, dim=size)
    shape = None if size is None else (size,)
    return compat.basix_ufl.element(family, LINE, degree, variant, shape=shape, discontinuous=discontinuous)
