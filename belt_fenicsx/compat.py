"""The few places where DOLFINx 0.5, 0.9 and 0.11 differ, told apart by feature, never by version number."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import basix
import numpy as np
import ufl

if TYPE_CHECKING:
    from dolfinx import fem, mesh

Array = np.ndarray

try:
    import basix.ufl as basix_ufl
except ImportError:
    import basix.ufl_wrapper as _wrapper

    basix_ufl = None


def hermite(*, size: int | None = None) -> Any:
    """Cubic Hermite element on the interval, scalar or with ``size`` components."""
    family, cell = basix.ElementFamily.Hermite, basix.CellType.interval
    if basix_ufl is None:
        scalar = _wrapper.create_element(family, cell, 3)
        return scalar if size is None else ufl.VectorElement(scalar, dim=size)
    return basix_ufl.element(family, cell, 3, shape=None if size is None else (size,))


def mixed(*elements: Any) -> Any:
    """Mixed element of the given elements."""
    return ufl.MixedElement(list(elements)) if basix_ufl is None else basix_ufl.mixed_element(list(elements))


def coordinate_element() -> Any:
    """Element of the coordinates of an interval."""
    if basix_ufl is None:
        return ufl.VectorElement("Lagrange", ufl.interval, 1)
    return basix_ufl.element("Lagrange", "interval", 1, shape=(1,))


def quadrature(degree: int) -> Any:
    """Scalar quadrature element of the default (Gauss) scheme on the interval."""
    if basix_ufl is None:
        return ufl.FiniteElement("Quadrature", ufl.interval, degree, quad_scheme="default")
    return basix_ufl.quadrature_element("interval", scheme="default", degree=degree)


def function_space(domain: mesh.Mesh, element: Any) -> Any:
    """Function space; the name's spelling changed."""
    from dolfinx import fem

    return fem.functionspace(domain, element) if hasattr(fem, "functionspace") else fem.FunctionSpace(domain, element)


def nodes(domain: mesh.Mesh) -> Array:
    """Coordinates of each cell's two nodes ``(cells, 2)``."""
    geometry = domain.geometry
    dofmap = geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap
    return geometry.x[:, 0][table(dofmap)]


def table(dofmap: Any) -> Array:
    """Dof numbers as an array with one row for each cell."""
    return np.asarray(dofmap) if isinstance(dofmap, np.ndarray) else dofmap.array.reshape(dofmap.num_nodes, -1)


def evaluate(expression: fem.Expression, domain: mesh.Mesh, cells: Array) -> Array:
    """Values of an expression, one row for each cell."""
    try:
        values = expression.eval(domain, cells)
    except TypeError:
        values = expression.eval(cells)
    return values.reshape(len(cells), -1)


def petsc_vector(function: fem.Function) -> Any:
    """The PETSc vector that shares a function's values."""
    return function.x.petsc_vec if hasattr(function.x, "petsc_vec") else function.vector
