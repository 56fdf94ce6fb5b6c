"""What the ranks of a communicator do together, so that none waits for another one that failed."""

from __future__ import annotations

import hashlib
import logging
import pickle
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar, cast

from belt_fenicsx.backend import interrupts
from belt_fenicsx.scene.checks import SceneError, Verbatim

if TYPE_CHECKING:
    from mpi4py import MPI

T = TypeVar("T")

logger = logging.getLogger(__name__)

PATIENCE = 30.0  # seconds, after which a rank says for whom it waits
LONGEST_WAIT = 3600.0  # seconds, after which it ends all: some rank never comes, and nobody can tell the others
BETWEEN = 1e-4  # seconds between two looks whether all have come


def on_first(comm: MPI.Comm, call: Callable[[], T]) -> T:
    """What the call returns on rank 0, on all ranks; its error, too."""
    result: T | None = None
    error: BaseException | None = None
    if comm.rank == 0:
        try:
            result = call()
        except BaseException as caught:  # raised again on all ranks, which would wait for this one
            error = caught
    raise_first(comm, error)
    return comm.bcast(result, root=0)


def raise_first(comm: MPI.Comm, error: BaseException | None) -> None:
    """Raises the error of the first rank that has one, on all ranks.

    Raises:
        BaseException: The error.
    """
    for other in comm.allgather(_portable(error)):
        if other is not None:
            raise other if error is None else error


def agreed(comm: MPI.Comm, ask: Callable[[], T], told: Callable[[T], str]) -> T:
    """What the call returns, which has to be the same on all ranks, as they are to work on it together.

    Args:
        comm: The communicator.
        ask: The call; the error of one rank is raised on all.
        told: What of it has to be the same, as text.

    Raises:
        SceneError: It is not the same on all ranks; on all of them.
    """
    if comm.size == 1:
        return ask()
    result: Any = None
    text, error = "", None
    try:
        result = ask()
        text = told(result)
    except Exception as caught:  # raised again on all ranks, which would wait for this one
        error = caught
    _all_come(comm)
    raise_first(comm, error)
    digests = comm.allgather(hashlib.sha256(text.encode()).digest())
    others = [str(rank) for rank, digest in enumerate(digests) if digest != digests[0]]
    if others:
        expected = "be the same on all ranks that solve it together, as must be all other arguments"
        raise SceneError("scene", expected, Verbatim(f"others than rank 0 on rank {', '.join(others)}"))
    # Without an error, there is one.
    return cast(T, result)


def _all_come(comm: MPI.Comm) -> None:
    """Waits for all ranks, which Ctrl-C may end; says so where it takes long, and ends all where one never comes."""
    request, start, said = comm.Ibarrier(), time.monotonic(), False
    who = (
        f"rank {comm.rank} waits for others of {comm.size} ranks, which solve a fixed mesh together: all have to call "
        "`solve` with the same scene and method, or with a `comm` of their own, as MPI.COMM_SELF"
    )
    while not request.Test():
        interrupts.check()
        time.sleep(BETWEEN)
        waited = time.monotonic() - start
        if waited > PATIENCE and not said:
            said = True
            logger.warning("%s; it ends the program after %.0f s", who, LONGEST_WAIT)
        if waited > LONGEST_WAIT:
            logger.critical("%s; they did not for %.0f s, so all ranks are ended", who, LONGEST_WAIT)
            # What one rank raises, the others never learn: those that come late would wait for it in turn.
            comm.Abort(1)


def _portable(error: BaseException | None) -> BaseException | None:
    """The error itself where it can travel to other ranks, otherwise its name and text."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # pickle lets through whatever an error's own methods raise
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def start_alone() -> None:
    """Starts PETSc on this rank alone, unless it has started before; by itself it would wait for all ranks.

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
