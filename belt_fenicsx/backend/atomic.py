"""Files that appear whole or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """Gives a path to write to, which takes the place of the wanted one when all is written."""
    partial = path.with_name(f".{secrets.token_hex(8)}{path.suffix}")
    # Made here, under a name that nobody knows before: what stood there already, as a link to another file might, is
    # an error.
    os.close(os.open(partial, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
