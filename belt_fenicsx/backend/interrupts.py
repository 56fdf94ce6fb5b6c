"""Ctrl-C and SIGTERM where nothing breaks by them.

An exception out of a function that PETSc has called leaves PETSc's objects half-way, and the process dies of them when
it ends. So a solve holds these signals back, and is ended by them between its stages.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Deferral:
    """What takes signals as long as they are held back.

    Args:
        handlers: The handlers whose place it takes, by signals.
    """

    def __init__(self, handlers: dict[signal.Signals, Callable[..., Any]]) -> None:
        self.handlers = handlers
        self._came: signal.Signals | None = None

    def __call__(self, number: int, frame: FrameType | None) -> None:
        # Not the frame, which would keep PETSc's objects of a callback alive for longer than PETSc itself.
        self._came = signal.Signals(number)

    def deliver(self) -> None:
        """Hands a signal that came to its own handler."""
        if self._came is not None:
            number, self._came = self._came, None
            self.handlers[number](number, None)


# `signal.getsignal` takes longer than anything else between two stages of a small solve.
DEFERRAL: ContextVar[Deferral | None] = ContextVar("DEFERRAL", default=None)


@contextlib.contextmanager
def defer() -> Iterator[None]:
    """Holds signals back until its block ends, or `check` is called in it.

    Python's signals come to the main thread alone; elsewhere, and within another such block, there is nothing to do.
    Signals without a handler in Python end the process at once, and those that are ignored stay so.
    """
    if DEFERRAL.get() or threading.current_thread() is not threading.main_thread():
        yield
        return
    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    deferral = Deferral({number: handler for number, handler in handlers.items() if callable(handler)})
    token = DEFERRAL.set(deferral)
    try:
        for number in deferral.handlers:
            signal.signal(number, deferral)
        yield
    finally:
        DEFERRAL.reset(token)
        for number, handler in deferral.handlers.items():
            signal.signal(number, handler)
        deferral.deliver()


def check() -> None:
    """Lets a signal through that was held back; called where a solve can end without harm."""
    if deferral := DEFERRAL.get():
        deferral.deliver()
