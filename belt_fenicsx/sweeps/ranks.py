"""How the scenes of a sweep are shared out: to one process, or to the ranks of a communicator.

Each rank takes the next chunk from a counter that all share, in a window of memory at rank 0 (one-sided
communication). So all ranks solve, slow scenes hold up nobody, and a chunk's scenes can start from each other.
mpi4py.futures would do the same, with rank 0 as a master that solves nothing: on two ranks, half of the machine.
"""

from __future__ import annotations

import itertools
import pickle
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from belt_fenicsx.backend.ranks import T, on_first, raise_first

if TYPE_CHECKING:
    from mpi4py import MPI

# The two counters, and a number that the chunks' never reaches by counting.
CHUNK, SOLVED = 0, 1
STOPPED = np.iinfo(np.int32).max


def shares(count: int, ranks: int) -> list[range]:
    """Contiguous chunks of ``count`` scenes: the first are long, for the warm starts, the last short, for the balance.

    Each takes an equal share of half of what is left, so that a rank never waits long for the others' last chunks.
    """
    chunks: list[range] = []
    start = 0
    while start < count:
        end = start - (start - count) // (2 * ranks)
        chunks.append(range(start, end))
        start = end
    return chunks


def ranks_of(comm: MPI.Comm | None) -> OneProcess | Ranks:
    """Those who share the work: this process alone, or all ranks of a communicator."""
    return OneProcess() if comm is None else Ranks(comm)


class OneProcess:
    """A process that solves everything. Loads no MPI."""

    rank = 0

    def __init__(self) -> None:
        self._solved = 0

    def start(self) -> None:
        """There is nothing to set up."""

    def chunks(self, count: int) -> Iterator[Iterable[int]]:
        """The only chunk."""
        yield range(count)

    def solved(self) -> int:
        """Counts one more scene as solved; returns how many there are."""
        self._solved += 1
        return self._solved

    def stop(self) -> None:
        """Nobody else is there to be stopped."""

    def on_first(self, call: Callable[[], T]) -> T:
        """What the call returns."""
        return call()

    def gathered(self, mine: dict[int, Any], error: BaseException | None) -> dict[int, Any]:
        """Its own results, unless there was an error, which is raised."""
        if error is not None:
            raise error
        return mine


class Ranks:
    """Ranks that take chunks in turn. `start` and `gathered` are collective."""

    def __init__(self, comm: MPI.Comm) -> None:
        from mpi4py import MPI

        self._comm, self.rank = comm, comm.rank
        self._mpi = MPI

    def start(self) -> None:
        """Sets up the shared counters, which `gathered` takes down."""
        item = self._mpi.INT64_T.Get_size()
        self._window = self._mpi.Win.Allocate(2 * item if self.rank == 0 else 0, item, comm=self._comm)
        if self.rank == 0:
            np.frombuffer(self._window.tomemory(), dtype=np.int64)[:] = 0
        self._comm.Barrier()

    def _fetch(self, counter: int, value: int, op: MPI.Op) -> int:
        """Changes one of the shared counters, as one act; returns what it was before."""
        sent, before = np.array([value], dtype=np.int64), np.zeros(1, dtype=np.int64)
        self._window.Lock(0)
        self._window.Fetch_and_op(sent, before, 0, target_disp=counter, op=op)
        self._window.Unlock(0)
        return int(before[0])

    def chunks(self, count: int) -> Iterator[Iterable[int]]:
        """The chunks that fall to this rank; each ends where a rank calls `stop`."""
        chunks = shares(count, self._comm.size)
        while (index := self._fetch(CHUNK, 1, self._mpi.SUM)) < len(chunks):
            yield itertools.takewhile(lambda _: self._fetch(CHUNK, 0, self._mpi.NO_OP) < STOPPED, chunks[index])

    def solved(self) -> int:
        """Counts one more scene as solved; returns how many there are on all ranks."""
        return self._fetch(SOLVED, 1, self._mpi.SUM) + 1

    def stop(self) -> None:
        """Ends the chunks of all ranks."""
        self._fetch(CHUNK, STOPPED, self._mpi.REPLACE)

    def on_first(self, call: Callable[[], T]) -> T:
        """What the call returns on rank 0, on all ranks; its error, too."""
        return on_first(self._comm, call)

    def gathered(self, mine: dict[int, Any], error: BaseException | None) -> dict[int, Any]:
        """The results of all ranks, on each of them; or the error of the first rank that had one.

        Raises:
            BaseException: The error, on all ranks.
        """
        self._window.Free()
        raise_first(self._comm, error)
        parts = self._comm.allgather(pickle.dumps(mine))
        others = (pickle.loads(part) for rank, part in enumerate(parts) if rank != self.rank)
        return mine | {index: result for part in others for index, result in part.items()}
