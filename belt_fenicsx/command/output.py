"""What the program tells: answers on the standard output, complaints, logs and progress beside it, on rank 0 alone."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import sys
from collections.abc import Callable, Iterator
from importlib.util import find_spec

from belt_fenicsx.command.process import Exit, Terminated, own_rank, unwritten

PROGRAM = "belt-fenicsx"


def show(text: str) -> int:
    """Prints a text; returns the exit code.

    Raises:
        OSError: Standard output is closed, or a full disk.
    """
    if sys.stdout is None:
        raise OSError(errno.EBADF, "standard output is closed")
    try:
        print(text, flush=True)
    except OSError:
        # At exit Python would try once more to write to the closed pipe or the full disk.
        sys.stdout = open(os.devnull, "w")
        raise
    return Exit.SOLVED


def complain(text: object, code: int) -> int:
    """Prints a complaint; returns the exit code."""
    if own_rank() == 0 and sys.stderr is not None:
        print(f"{PROGRAM}: {text}", file=sys.stderr)
    return code


def complain_of_interrupt(error: KeyboardInterrupt) -> int:
    """Says that the program was interrupted, with the error's notes; returns the exit code."""
    word, code = ("terminated", Exit.TERMINATED) if isinstance(error, Terminated) else ("interrupted", Exit.INTERRUPTED)
    return complain(" ".join([f"{word}.", *getattr(error, "__notes__", [])]).rstrip(), code)


def run_report(report: Callable[[], int]) -> int:
    """Runs a report, which returns an exit code; raises nothing that the other ranks would wait for."""
    try:
        return report()
    except BrokenPipeError:
        return Exit.NO_READER
    except OSError as error:
        return complain(unwritten(error), Exit.FAILED)
    except KeyboardInterrupt as error:
        return complain_of_interrupt(error)


def configure_logging(verbose: bool) -> None:
    """Logs the course of a solve to stderr where that is asked for, warnings anyway."""
    handler = logging.StreamHandler()
    handler.setLevel(logging.INFO if verbose and own_rank() == 0 else logging.WARNING)
    # The compiler of the forms reports each of its runs through the root logger.
    handler.addFilter(lambda record: record.name != "root" or record.levelno > logging.INFO)
    logging.basicConfig(handlers=[handler], format="%(name)s: %(message)s")
    logging.getLogger("belt_fenicsx").setLevel(logging.INFO if verbose else logging.WARNING)


@contextlib.contextmanager
def progress_bar(forced: bool, shows_rows: bool) -> Iterator[Callable[[int, int], None] | None]:
    """What shows a sweep's progress on rank 0: one line on a terminal that shows no rows, nothing elsewhere, unless
    forced."""
    rows_are_seen = shows_rows and sys.stdout is not None and sys.stdout.isatty()
    if own_rank() > 0 or find_spec("tqdm") is None or (rows_are_seen and not forced):
        yield None
        return
    from tqdm import tqdm

    with tqdm(unit="scene", disable=False if forced else None) as bar:

        def show_progress(solved: int, count: int) -> None:
            bar.total = count
            bar.update(solved - bar.n)

        yield show_progress
