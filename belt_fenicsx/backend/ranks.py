"""What the ranks of a communicator do together, so that none waits for another one that failed."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar, cast

from belt_fenicsx.scene.checks import SceneError, Verbatim

if TYPE_CHECKING:
    from mpi4py import MPI

T = TypeVar("T")


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
    result, text, error = None, "", None
    try:
        result = ask()
        text = told(result)
    except Exception as caught:  # raised again on all ranks, which would wait for this one
        error = caught
    raise_first(comm, error)
    digests = comm.allgather(hashlib.sha256(text.encode()).digest())
    others = [str(rank) for rank, digest in enumerate(digests) if digest != digests[0]]
    if others:
        expected = "be the same on all ranks that solve it together, as must be all other arguments"
        raise SceneError("scene", expected, Verbatim(f"others than rank 0 on rank {', '.join(others)}"))
    # Without an error, there is one.
    return cast(T, result)


def _portable(error: BaseException | None) -> BaseException | None:
    """The error itself where it can travel to other ranks, otherwise its name and text."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # pickle lets through whatever an error's own methods raise
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
