"""What a sweep that was stopped leaves behind: finished answers beside the table that was to be written.

Each rank appends its answers to a file of its own, ``FILE.csv.part.RANK``, one JSON object a line. An answer is found
again by its scene and by how it was asked for, whatever the number of ranks.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from belt_fenicsx.backend.petsc_options import PREFIX
from belt_fenicsx.scene.checks import SceneError, Verbatim
from belt_fenicsx.scene.file import scene_to_dict
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.files import from_plain, to_plain, versions
from belt_fenicsx.solution.solution import Solution


def keys(scenes: Sequence[Scene], arguments: Mapping[str, Any]) -> list[str]:
    """Names scenes together with the solver's arguments; equal ones have equal names.

    So do answers by equal versions of this package, with equal options from PETSc's command line.
    """
    asked = _digest([arguments, _computed_by()])
    return [_digest([scene_to_dict(scene), asked]) for scene in scenes]


def _digest(plain: Any) -> str:
    return hashlib.sha256(json.dumps(plain, sort_keys=True, default=_plain).encode()).hexdigest()


def _computed_by() -> dict[str, Any]:
    """What an answer depends on beside its scene and the arguments."""
    petsc = sys.modules.get("petsc4py.PETSc")
    options = {} if petsc is None else petsc.Options().getAll()
    own = {name: value for name, value in options.items() if name.startswith(PREFIX)}
    return {"version": versions().get("belt_fenicsx"), "options": own}


def _plain(value: Any) -> Any:
    """An argument as JSON; a long array's text would leave out most of it."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else repr(value)


class Parts:
    """The side files of a table.

    Args:
        table: The table's path.
        rank: The number of this rank's own file.
    """

    def __init__(self, table: Path, rank: int) -> None:
        self.table, self._own = table, table.with_name(f"{table.name}.part.{rank}")

    def _all(self) -> list[Path]:
        stem = f"{self.table.name}.part."
        return sorted(path for path in self.table.parent.iterdir() if path.name.startswith(stem))

    def names(self) -> str:
        """The side files that there are, as a list to read."""
        return ", ".join(map(str, self._all()))

    def read(self) -> dict[str, Solution]:
        """The answers that earlier runs left, without their fields. A line that was cut off is left out."""
        return dict(answer for path in self._all() for answer in _answers(path))

    def read_those(self, names: Collection[str]) -> dict[str, Solution]:
        """The answers that an earlier run of the same sweep left.

        Raises:
            SceneError: There are answers of another sweep, which would be lost.
        """
        answers = self.read()
        others = len(answers.keys() - set(names))
        if others:
            expected = f"name a table without rows of another sweep beside it (finish that, or remove {self.names()})"
            raise SceneError("out", expected, Verbatim(f"{others} answers to other scenes, arguments or options"))
        return answers

    def __enter__(self) -> Parts:
        self._file = open(self._own, "a", encoding="utf-8")
        # Ends a line that was cut off.
        self._file.write("\n")
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._file.close()

    def keep(self, name: str, solution: Solution) -> None:
        """Appends an answer, which a sudden end of the process then leaves in place."""
        plain = to_plain(solution)
        self._file.write(json.dumps({"key": name, "solution": plain, "digest": _digest([name, plain])}) + "\n")
        self._file.flush()

    def remove(self) -> None:
        """Removes the side files of all ranks."""
        for path in self._all():
            path.unlink()


def _answers(path: Path) -> Iterator[tuple[str, Solution]]:
    """The answers in a side file. A line that is not whole, or is not as it was written, is as good as none."""
    with open(path, encoding="utf-8", errors="replace") as lines:
        for line in lines:
            with contextlib.suppress(ValueError, KeyError, TypeError, RecursionError):
                plain = json.loads(line)
                if plain["digest"] == _digest([plain["key"], plain["solution"]]):
                    yield plain["key"], Solution(**from_plain(plain["solution"]))
