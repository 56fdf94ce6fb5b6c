"""PETSc's start, for which ranks wait for each other by default."""

from __future__ import annotations

import sys


def start_alone() -> None:
    """Starts PETSc on this rank alone, unless it has started before.

    All ranks have to start it in the same way, and one that solves alone cannot wait for others. What PETSc does from
    then on for all processes that it knows (``PETSC_COMM_WORLD``), such as its end, is this rank's own. A mesh that
    ranks share is none of it, as it is on a communicator of its own; nor is what petsc4py makes without a communicator.
    """
    from mpi4py import MPI

    if MPI.COMM_WORLD.size == 1 or "petsc4py.PETSc" in sys.modules:
        return
    import petsc4py

    petsc4py.init(comm=MPI.COMM_SELF)
    from petsc4py import PETSc

    PETSc.Sys.setDefaultComm(MPI.COMM_WORLD)
