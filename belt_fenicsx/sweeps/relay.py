"""What ranks tell of their scenes, on the first one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mpi4py import MPI

TOLD = 18  # tag of messages to the first rank


class Relay:
    """Brings what ranks tell of their scenes to the first rank, while they go on, in the order of the scenes.

    Args:
        comm: The ranks; None for one process alone.
        show: Called on the first rank with each text.
    """

    def __init__(self, comm: MPI.Comm | None, show: Callable[[str], None]) -> None:
        self._comm, self._show = comm, show
        self._shown, self._waiting = 0, dict[int, str]()
        # What is on its way has to be kept; `finish` on the first rank receives all of it.
        self._sent: list[MPI.Request] = []

    def tell(self, index: int, text: str) -> None:
        """Tells of a scene; on the first rank, shows what has come and is next."""
        if self._comm is not None and self._comm.rank > 0:
            self._sent.append(self._comm.isend((index, text), dest=0, tag=TOLD))
            return
        while self._comm is not None and self._comm.iprobe(tag=TOLD):
            self._receive()
        self._waiting[index] = text
        self._show_next()

    def finish(self, count: int) -> None:
        """Shows what is left of the texts of ``count`` scenes; for the first rank."""
        while self._shown < count:
            self._receive()
            self._show_next()

    def _receive(self) -> None:
        assert self._comm is not None
        index, text = self._comm.recv(tag=TOLD)
        self._waiting[index] = text

    def _show_next(self) -> None:
        while self._shown in self._waiting:
            self._show(self._waiting.pop(self._shown))
            self._shown += 1
