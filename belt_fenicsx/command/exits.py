"""How the program ends: its exit codes, and what leads to them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from belt_fenicsx.solution.solution import Solution

SOLVED, FAILED, BAD_INPUT, NOT_CONVERGED, NOT_ADMISSIBLE = 0, 1, 2, 3, 4
# As a shell names the end by SIGINT, SIGPIPE and SIGTERM.
INTERRUPTED, NO_READER, TERMINATED = 130, 141, 143


class UsageError(Exception):
    """Arguments that do not parse."""


class Missing(Exception):
    """Something outside of the scene and the solve that keeps the result from the user."""


class Terminated(KeyboardInterrupt):
    """SIGTERM, which ends a solve as Ctrl-C does."""


def exit_code(solution: Solution) -> int:
    """The exit code of an answer."""
    if solution.success:
        return SOLVED
    return NOT_ADMISSIBLE if solution.status.name == "NOT_ADMISSIBLE" else NOT_CONVERGED


def unwritten(error: OSError) -> str:
    """The complaint about a result that could not be written."""
    return f"the result could not be written: {error.strerror or error}."
