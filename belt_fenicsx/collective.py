"""What the ranks of a communicator do together, so that none waits for another one that failed."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from mpi4py import MPI

T = TypeVar("T")


def on_first(comm: MPI.Comm, call: Callable[[], T]) -> T:
    """What the call returns on rank 0, on all ranks; its error, too."""
    result, error = None, None
    if comm.rank == 0:
        try:
            result = call()
        except Exception as caught:  # raised again on all ranks, which would wait for this one
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


def _portable(error: BaseException | None) -> BaseException | None:
    """The error itself where it can travel to other ranks, otherwise its name and text."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # pickle lets through whatever an error's own methods raise
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
