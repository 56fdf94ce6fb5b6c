"""The few places where DOLFINx 0.5, 0.9 and 0.11 differ, told apart by feature, never by version number."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import basix
import numpy as np
import ufl

if TYPE_CHECKING:
    from dolfinx import fem, mesh
    from mpi4py import MPI

Array = np.ndarray[Any, np.dtype[Any]]

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


def broken(degree: int, *, size: int | None = None) -> Any:
    """Lagrange element that is not continuous between intervals, scalar or with ``size`` components."""
    if basix_ufl is None:
        scalar = ufl.FiniteElement("DG", ufl.interval, degree)
        return scalar if size is None else ufl.VectorElement(scalar, dim=size)
    return basix_ufl.element("DG", "interval", degree, shape=None if size is None else (size,))


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


def interval_mesh(comm: MPI.Comm, cells: Array, x: Array, also: Sequence[tuple[int, int]]) -> mesh.Mesh:
    """Mesh of intervals, of which each stays on the rank that gives it.

    Args:
        comm: The communicator.
        cells: Numbers of the nodes of this rank's cells ``(cells, 2)``; up to four cells meet at a node.
        x: Coordinates of this rank's part of all nodes, in their order.
        also: Cells of this rank that another one is to know, too, and that one. DOLFINx 0.5 finds the nodes that ranks
            share by these alone.
    """
    from dolfinx import graph, mesh

    lists = graph.adjacencylist if hasattr(graph, "adjacencylist") else graph.create_adjacencylist
    known, others = np.array(also, dtype=int).reshape(-1, 2).T
    ranks = np.insert(np.full(len(cells), comm.rank, dtype=np.int32), known + 1, others)
    offsets = np.append(0, np.cumsum(1 + np.bincount(known, minlength=len(cells))))
    here = lists(ranks, offsets.astype(np.int32))

    def stay(*_: Any) -> Any:
        return getattr(here, "_cpp_object", here)

    cells, x, domain = cells.astype(np.int64), x.reshape(-1, 1), ufl.Mesh(coordinate_element())
    if basix_ufl is None:
        return mesh.create_mesh(comm, cells, x, domain, mesh.GhostMode.shared_facet, stay)
    parameters = inspect.signature(mesh.create_mesh).parameters
    most = {"max_facet_to_cell_links": 4} if "max_facet_to_cell_links" in parameters else {}
    return mesh.create_mesh(comm, cells=cells, x=x, e=domain, partitioner=stay, **most)


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
