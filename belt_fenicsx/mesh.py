"""Meshes of unit cells. The scene's lengths come in by the map sigma(eta) of each method, never by the mesh.

So one mesh, and all that is compiled on it, serves every scene with the same number of elements; and the
reference derivatives that are the slope dofs of Hermite elements are derivatives by eta in every cell.
"""

from __future__ import annotations

from dolfinx import mesh
from mpi4py import MPI

from belt_fenicsx.scene import SceneError


def unit_cells(elements: int, comm: MPI.Comm) -> mesh.Mesh:
    """Interval [0, ``elements``] of cells of length one.

    Raises:
        SceneError: There are not enough elements for the ranks; on all ranks, before anything collective.
    """
    if isinstance(elements, bool) or not isinstance(elements, int) or elements < max(2, comm.size):
        raise SceneError("elements", f"be a whole number of at least {max(2, comm.size)} ({comm.size} ranks)", elements)
    return mesh.create_interval(comm, elements, [0.0, float(elements)])
