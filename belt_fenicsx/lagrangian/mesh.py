"""Meshes of unit cells. The scene's lengths come in by the map sigma(eta) of each method, never by the mesh.

So one mesh, and all that is compiled on it, serves every scene with the same number of elements; and the
reference derivatives that are the slope dofs of Hermite elements are derivatives by eta in every cell.
"""

from __future__ import annotations

import math

import numpy as np
from dolfinx import mesh
from mpi4py import MPI

from belt_fenicsx.backend import compat
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.checks import SceneError


def unit_cells(elements: int, comm: MPI.Comm, *, closed: bool = False) -> tuple[mesh.Mesh, Array]:
    """Interval [0, ``elements``] of cells of length one, each rank with an equal part of them, in their order.

    A closed one is a ring: its last cell leads back to the first node, from n - 1 to 0. As a map of the reference cell
    it has a Jacobian of -(n - 1), which drops out of all derivatives by sigma(eta), as that of any cell does.

    DOLFINx numbers a mesh's cells level by level, from neighbour to neighbour, and looks at all cells for each level.
    A chain has as many levels as cells: a million took it 87 s. So cells that lead past some hundred others are added
    for it, and nowhere used; then it takes 2 to 5 s.

    Returns:
        The mesh, and the numbers of this rank's unit cells, from left to right.

    Raises:
        SceneError: There are not enough elements for the ranks.
    """
    # A rank of a ring has two ends, and two cells at least that others know.
    each = 2 if closed and comm.size > 1 else 1
    if elements < each * comm.size:
        raise SceneError("elements", f"be at least {each * comm.size}, {each} for each rank", elements)
    rank, most = comm.rank, comm.size - 1
    first, last = (elements * part // comm.size for part in (rank, rank + 1))
    nodes = np.arange(first, last + 1)
    # Not from the outer nodes: what ranks share, DOLFINx looks for among the nodes that only one cell has.
    stops = nodes[1 : -1 : math.isqrt(len(nodes))]
    chain, shortcuts = (np.column_stack([part[:-1], part[1:]]) for part in (nodes, stops))
    neighbours = [(0, rank - 1)] * (rank > 0) + [(len(chain) - 1, rank + 1)] * (rank < most)
    if closed:
        chain[-1, 1] %= elements
        neighbours = [(0, (rank - 1) % comm.size), (len(chain) - 1, (rank + 1) % comm.size)] * (comm.size > 1)
    x = (nodes if rank == most and not closed else nodes[:-1]).astype(float)
    domain = compat.interval_mesh(comm, np.concatenate([chain, shortcuts]), x, neighbours)
    ends = compat.nodes(domain)[: domain.topology.index_map(1).size_local]
    units = np.flatnonzero(np.isin(np.diff(ends)[:, 0], [1.0, 1.0 - elements] if closed else [1.0]))
    return domain, units[np.argsort(ends[units, 0])].astype(np.int32)
