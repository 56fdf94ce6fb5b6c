"""Linear solves of several ranks against one dense solve."""

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

from belt_fenicsx.lagrangian.joined_lu import JoinedLU


@pytest.mark.parametrize("rows", [1, 2, 9])
def test_solves_a_band_whatever_a_ranks_part_of_it(rows):
    comm = MPI.COMM_WORLD
    size, random = rows * comm.size, np.random.default_rng(1)
    dense = np.diag(random.uniform(3.0, 4.0, size))
    dense += sum(np.diag(random.uniform(-1.0, 1.0, size - 1), side) for side in (-1, 1)) if size > 1 else 0.0
    matrix = PETSc.Mat().createAIJ([size, size], nnz=3, comm=comm)
    first, last = matrix.getOwnershipRange()
    for row in range(first, last):
        for column in np.flatnonzero(dense[row]):
            matrix[row, column] = dense[row, column]
    matrix.assemble()

    ksp = PETSc.KSP().create(comm)
    ksp.setType("preonly")
    ksp.pc.setType("python")
    ghosts = np.array([dof for dof in (first - 1, last) if 0 <= dof < size], dtype=int)
    ksp.pc.setPythonContext(JoinedLU(ghosts, "joined_"))
    b, x = matrix.createVecs()
    for scale in (1.0, 2.0):
        # The second time, with another matrix of the same kind.
        matrix.scale(scale)
        ksp.setOperators(matrix)
        b.array[:] = np.arange(first, last) + 1.0
        ksp.solve(b, x)
        expected = np.linalg.solve(scale * dense, np.arange(size) + 1.0)
        assert x.array == pytest.approx(expected[first:last], rel=1e-12)
