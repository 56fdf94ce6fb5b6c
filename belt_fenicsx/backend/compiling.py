"""Compiled forms on the disk: a folder for each, which appears whole or not at all.

FFCx compiles into a folder that nobody else knows, which then gets its name in one act. So nobody waits for a process
that was killed, and nobody loads what another one is still writing; two that need the same forms at the same time both
compile them. What was damaged later is noticed by its digest and compiled again, before the system's loader, which
would end the process, has seen it.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import stat
import sysconfig
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")

CACHE_VARIABLE = "XDG_CACHE_HOME"
LONGEST = 400  # characters of what went wrong
DIGEST = "sha256"
UNFINISHED = "unfinished-"
ABANDONED = 86_400.0  # seconds, after which an unfinished folder is one of a process that was killed

# FFCx redirects the output of the whole process while it compiles.
_compiling = threading.Lock()


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


def cached(key: Sequence[str], compile_into: Callable[[Path], T]) -> T:
    """What a compiler makes, or has made before, of the same.

    Args:
        key: What the result depends on.
        compile_into: Compiles into a folder, or loads what it finds compiled there.

    Raises:
        NotCompiled: The folder of all entries is not private.
        OSError: It cannot be written to.
    """
    parts = [*key, str(sysconfig.get_config_var("SOABI")), str(sysconfig.get_config_var("CFLAGS"))]
    with _compiling:
        folder = private_folder()
        entry = folder / hashlib.sha256("\0".join(parts).encode()).hexdigest()
        # Asked first: it may appear, but then it is whole.
        is_there = entry.exists()
        if _is_whole(entry):
            return compile_into(entry)
        if is_there:
            shutil.rmtree(entry)
        _remove_abandoned(folder)
        partial = Path(tempfile.mkdtemp(prefix=UNFINISHED, dir=folder))
        try:
            result = compile_into(partial)
            (partial / DIGEST).write_text(_digest(partial))
            _rename(partial, entry)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
        return result


def _rename(partial: Path, entry: Path) -> None:
    """Gives an entry its name, unless another process was faster."""
    try:
        partial.rename(entry)
    except OSError:
        if not _is_whole(entry):
            raise


def private_folder() -> Path:
    """The folder of all entries, which is made where it is not there yet.

    Raises:
        NotCompiled: Others may write to it: their code would be run.
        OSError: It cannot be made.
    """
    # An empty or relative path is as good as none, by the specification of this variable.
    base = os.environ.get(CACHE_VARIABLE, "")
    folder = Path(base if os.path.isabs(base) else os.path.expanduser("~/.cache")) / "belt_fenicsx"
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)
    status = folder.stat()
    if status.st_uid != os.geteuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise NotCompiled(
            f"the forms could not be compiled: others may write to {folder}, where compiled code is kept; "
            f"`chmod 700` makes it private, {CACHE_VARIABLE} names another place"
        )
    return folder


def _is_whole(entry: Path) -> bool:
    """Whether an entry is there and as it was made."""
    try:
        return (entry / DIGEST).read_text() == _digest(entry)
    except (OSError, ValueError):
        return False


def _digest(entry: Path) -> str:
    """Digest of the names of all files and of what is in the libraries."""
    digest = hashlib.sha256()
    for path in sorted(entry.iterdir()):
        if path.name != DIGEST:
            digest.update(f"{path.name}\0".encode())
            digest.update(path.read_bytes() if path.suffix == ".so" else b"")
    return digest.hexdigest()


def _remove_abandoned(folder: Path) -> None:
    for path in folder.glob(f"{UNFINISHED}*"):
        if time.time() - path.stat().st_mtime > ABANDONED:
            shutil.rmtree(path, ignore_errors=True)
