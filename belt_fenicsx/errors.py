"""Errors that neither the scene nor the solve is to blame for."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

CACHE_VARIABLE = "XDG_CACHE_HOME"
LONGEST = 400  # characters of what went wrong


class NotCompiled(RuntimeError):
    """The forms could not be compiled: there is no compiler that works, or no folder to keep its results in."""


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Turns what FFCx raises for a compiler or a folder that fails into an error that says so.

    Raises:
        NotCompiled: Something of this kind was raised.
    """
    from cffi import VerificationError

    try:
        yield
    except NotCompiled:
        raise
    except (OSError, ImportError, VerificationError, RuntimeError) as error:
        # As which DOLFINx raises the others again, on several ranks.
        if isinstance(error, RuntimeError) and "compilation" not in str(error):
            raise
        problem = " ".join(f"{type(error).__name__}: {error}".split())[:LONGEST]
        place = f"compiled forms are kept where {CACHE_VARIABLE} says, in ~/.cache by default"
        raise NotCompiled(f"the forms could not be compiled ({problem}); {place}") from error
