"""Meshes of unit cells. The scene's lengths come in by the map sigma(eta) of each method, never by the mesh.

So one mesh, and all that is compiled on it, serves every scene with the same number of elements; and the
reference derivatives that are the slope dofs of Hermite elements are derivatives by eta in every cell.
"""

from __future__ import annotations

from dolfinx import mesh
from mpi4py import MPI

from belt_fenicsx.scene import SceneError


def check_elements(elements: int, ranks: int) -> int:
    """Checks a number of elements.

    Raises:
        SceneError: There are not enough elements for the ranks; on all ranks, before anything collective.
    """
    fewest = max(2, ranks)
    if isinstance(elements, bool) or not isinstance(elements, int) or elements < fewest:
        raise SceneError("elements", f"be a whole number of at least {fewest} ({ranks} ranks)", elements)
    return elements


def unit_cells(elements: int, comm: MPI.Comm) -> mesh.Mesh:
    """Interval [0, ``elements``] of cells of length one.

    Raises:
        SceneError: There are not enough elements for the ranks.
    """
    return mesh.create_interval(comm, check_elements(elements, comm.size), [0.0, float(elements)])
