"""What scenes on a fixed mesh share, made once: forms, function spaces and Newton's solver cost a hundred solves."""

from __future__ import annotations

import contextlib
import functools
import threading
from collections.abc import Iterator
from typing import Any

from mpi4py import MPI

from belt_fenicsx.backend.compiling import compiling
from belt_fenicsx.lagrangian.forms import Problem, Terms
from belt_fenicsx.scene.checks import SceneError, Verbatim

Options = tuple[tuple[str, Any], ...]

# A problem holds the scene that is being solved. Python runs one thread at a time anyway.
_one_at_a_time = threading.RLock()


class Problems:
    """The problems of a communicator, of which the one whose last use is longest ago goes first.

    Each communicator has its own, lest a rank that solves something alone forgets what the others still have.

    Args:
        comm: The communicator.
        most: Number of problems that are kept.
        most_elements: Number of elements of all of them; an element takes some 5 kB.
    """

    def __init__(self, comm: MPI.Comm, most: int = 32, most_elements: int = 100_000) -> None:
        self._comm, self._most, self._most_elements = comm, most, most_elements
        self._kept: dict[tuple[int, Options, Terms], Problem] = {}

    @contextlib.contextmanager
    def using(self, elements: int, options: Options, terms: Terms) -> Iterator[Problem]:
        """A problem to work with; collective, and so is its end, where another problem may have to go.

        What an error leaves behind nobody knows, so that its problem is not kept.
        """
        key = (elements, options, terms)
        problem = self._kept.pop(key, None)
        if problem is None:
            with compiling():
                problem = Problem(elements, self._comm, dict(options), terms)
        yield problem
        self._kept[key] = problem
        while len(self._kept) > self._most or sum(key[0] for key in self._kept) > self._most_elements:
            self._kept.pop(next(iter(self._kept))).newton.destroy()


@functools.cache
def problems(comm: int) -> Problems:
    """The problems of a communicator, which is given as Fortran's number of it."""
    return Problems(MPI.Comm.f2py(comm))


@contextlib.contextmanager
def taking_turns(comm: MPI.Comm) -> Iterator[None]:
    """Lets one thread solve at a time.

    Raises:
        SceneError: Several ranks are to solve from another thread than their main one.
    """
    if comm.size > 1 and threading.current_thread() is not threading.main_thread():
        expected = "have one rank in any thread but the main one, as threads take turns in another order on each rank"
        raise SceneError("comm", expected, Verbatim(f"{comm.size} ranks"))
    with _one_at_a_time:
        yield
