"""This process: how it ends, and which of those it is that a launcher started. MPI is not loaded to be asked."""

from __future__ import annotations

import enum
import os
import sys
import traceback
from importlib.util import find_spec
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mpi4py import MPI

    from belt_fenicsx.solution.solution import Solution

RANK_VARIABLES = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK")


class Exit(enum.IntEnum):
    """Exit codes."""

    SOLVED = 0
    FAILED = 1
    BAD_INPUT = 2
    NOT_CONVERGED = 3
    NOT_ADMISSIBLE = 4
    # As a shell names the end by SIGINT, SIGPIPE and SIGTERM.
    INTERRUPTED = 130
    NO_READER = 141
    TERMINATED = 143


class UsageError(Exception):
    """Arguments that do not parse."""


class Missing(Exception):
    """Something outside of the scene and the solve that keeps the result from the user."""


class Terminated(KeyboardInterrupt):
    """SIGTERM, which ends a solve as Ctrl-C does."""


def exit_code(solution: Solution) -> int:
    """The exit code of an answer."""
    if solution.success:
        return Exit.SOLVED
    return Exit.NOT_ADMISSIBLE if solution.status.name == "NOT_ADMISSIBLE" else Exit.NOT_CONVERGED


def unwritten(error: OSError) -> str:
    """The complaint about a result that could not be written."""
    return f"the result could not be written: {error.strerror or error}."


def own_rank() -> int:
    """This process's rank, from the launcher as long as MPI has not been loaded."""
    mpi = sys.modules.get("mpi4py.MPI")
    if mpi is not None:
        return int(mpi.COMM_WORLD.rank)
    return int(_launched_as() or 0)


def _launched_as() -> str | None:
    """The rank that a launcher gave to this process; None without a launcher."""
    return next((os.environ[name] for name in RANK_VARIABLES if name in os.environ), None)


def all_ranks() -> MPI.Comm | None:
    """All ranks, where a launcher has started more than one.

    Raises:
        Missing: There is a launcher, but not mpi4py.
    """
    if _launched_as() is None:
        return None
    if find_spec("mpi4py") is None:
        raise Missing(f"mpi4py is needed to share a sweep out, but {sys.executable} lacks it.")
    from mpi4py import MPI

    return MPI.COMM_WORLD if MPI.COMM_WORLD.size > 1 else None


def abort_other_ranks() -> None:
    """Ends all ranks after an error on this one alone, for which the others would wait forever."""
    mpi = sys.modules.get("mpi4py.MPI")
    if mpi is not None and mpi.COMM_WORLD.size > 1:
        traceback.print_exc()
        mpi.COMM_WORLD.Abort(Exit.FAILED)


def share_code(code: int) -> int:
    """The exit code of rank 0, on all ranks."""
    mpi = sys.modules.get("mpi4py.MPI")
    return code if mpi is None else int(mpi.COMM_WORLD.bcast(code, root=0))
