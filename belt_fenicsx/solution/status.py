"""How a solve ended, and the error that says so."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from belt_fenicsx.solution.solution import Solution


class Status(enum.Enum):
    """How a solve ended; the value is the sentence for the user."""

    SOLVED = "Solved: the iteration converged and the state is admissible."
    NOT_ADMISSIBLE = "The iteration converged, but the state is not admissible."
    NEWTON_DIVERGED = "Newton's iteration did not converge."
    MULTIPLIERS_DIVERGED = "The updates of the contact multipliers did not converge."
    REFUSED = "The scene cannot be meant as it is."
    CONTACT_LOST = "The iteration lost the contact between the belt and the pulley."
    NO_CONTACT = "The straight belt does not touch the pulley: there is nothing to solve."
    ACCURACY_NOT_REACHED = "The iteration converged, but not to the accuracy that was asked for."
    CAPACITY_EXCEEDED = "The torque is beyond what friction can transmit."


# Ends after which there may be an answer from another start.
UNFINISHED = (Status.NEWTON_DIVERGED, Status.NOT_ADMISSIBLE)

# Ends of an iteration that say nothing of their reason.
BLIND = (Status.NEWTON_DIVERGED, Status.MULTIPLIERS_DIVERGED, Status.CONTACT_LOST)


class SolveError(RuntimeError):
    """A solve that gave no admissible answer; ``solution`` holds what there is.

    Attributes:
        solution: The failed solution.
    """

    def __init__(self, solution: Solution) -> None:
        self.solution = solution
        super().__init__(solution)

    def __str__(self) -> str:
        solution = self.solution
        parts = (solution.status.value, solution.message, *solution.violations, *solution.hints)
        return " ".join(part for part in parts if part)


def finish(solution: Solution, *, throw: bool) -> Solution:
    """Gives back a good solution; raises for another one, or gives it back too where ``throw`` is false.

    Raises:
        SolveError: The solution is not a success and ``throw`` is true.
    """
    if throw and not solution.success:
        raise SolveError(solution)
    return solution
