"""What a solve did so far, stage by stage, and how it ends without an answer."""

from __future__ import annotations

import time
from dataclasses import dataclass

from belt_fenicsx.backend import interrupts
from belt_fenicsx.solution.status import Status


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A stage of a solve.

    Attributes:
        name: The stage.
        why: Why it ran, or why the scene did not need it.
        iterations: Newton iterations; None where the stage was skipped.
        seconds: Wall time [s].
    """

    name: str
    why: str
    iterations: int | None = None
    seconds: float = 0.0


class Stages(list[Stage]):
    """Stages of a solve that is under way, timed one after another."""

    def __init__(self) -> None:
        super().__init__()
        self._since = time.perf_counter()

    def ran(self, name: str, why: str, iterations: int = 0) -> None:
        """Adds a stage that has just ended. Where Ctrl-C was pressed in it, the solve ends here."""
        interrupts.check()
        now = time.perf_counter()
        self.append(Stage(name=name, why=why, iterations=iterations, seconds=now - self._since))
        self._since = now

    def skipped(self, name: str, why: str) -> None:
        """Adds a stage that the scene did not need."""
        self.append(Stage(name=name, why=why))

    @property
    def iterations(self) -> int:
        """Newton iterations so far."""
        return sum(stage.iterations or 0 for stage in self)


class Stopped(Exception):
    """A solve that ends without an answer.

    Attributes:
        status: How it ended.
        message: What was seen.
        final: Whether finer meshes would not tell otherwise.
    """

    def __init__(self, status: Status, message: str, *, final: bool = False) -> None:
        self.status, self.message, self.final = status, message, final
        super().__init__(status, message)

    def __str__(self) -> str:
        return f"{self.status.value} {self.message}"
