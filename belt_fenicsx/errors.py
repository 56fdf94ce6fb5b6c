"""Errors that neither the scene nor the solve is to blame for."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path


class NotCompiled(RuntimeError):
    """The forms could not be compiled: there is no compiler that works, or no folder to keep its results in."""


@contextlib.contextmanager
def compiling(cache: Path | None = None) -> Iterator[None]:
    """Turns what FFCx raises for a compiler or a folder that fails into an error that says so.

    Raises:
        NotCompiled: Something of this kind was raised.
    """
    from cffi import VerificationError

    try:
        yield
    except (OSError, ImportError, VerificationError, RuntimeError) as error:
        # As which DOLFINx raises the others again, on several ranks.
        if isinstance(error, RuntimeError) and "compilation" not in str(error):
            raise
        where = f" into {cache}" if cache else ""
        problem = f"{type(error).__name__}: {error}".strip().splitlines()[0]
        raise NotCompiled(f"the forms could not be compiled{where} ({problem})") from error
