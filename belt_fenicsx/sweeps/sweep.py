"""Many scenes, on one process or on many ranks: each starts from the answer before it, from nothing where that fails.

The scenes go to ranks in contiguous chunks (`ranks`); finished ones are kept for a restart (`parts`).
"""

from __future__ import annotations

import contextlib
import functools
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from belt_fenicsx.backend.atomic import replaced
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.file import with_values
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.fields import same_values
from belt_fenicsx.solution.files import as_csv
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stage
from belt_fenicsx.solution.status import Status
from belt_fenicsx.solver import solve
from belt_fenicsx.sweeps.parts import Parts, keys
from belt_fenicsx.sweeps.ranks import OneProcess, Ranks, ranks_of
from belt_fenicsx.sweeps.table import OF_ALL, as_html, as_line, header, number, quantities, row, unit_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpi4py import MPI
    from pandas import DataFrame


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """The answers to a list of scenes.

    Sweeps are equal that have equal values and solutions.

    Attributes:
        over: Path of the value that changes from scene to scene, as in ``"pulleys.0.x_trans"``, or a tuple of paths;
            None for a list of scenes.
        values: Its values ``(n,)``, or tuples of values, or the scenes' numbers.
        solutions: One solution for each scene, failed ones too, in the order asked for.
    """

    over: str | tuple[str, ...] | None
    values: tuple[Any, ...]
    solutions: tuple[Solution, ...]

    def __eq__(self, other: object) -> bool:
        return same_values(self, other) if isinstance(other, Sweep) else NotImplemented

    def __hash__(self) -> int:
        return hash((self.over, self.solutions))

    def __repr__(self) -> str:
        return as_line(self)

    def _repr_html_(self) -> str:
        return as_html(self)

    @property
    def success(self) -> bool:
        """Whether every scene has an admissible answer."""
        return all(solution.success for solution in self.solutions)

    def __getitem__(self, name: str) -> Array:
        """A column ``(n,)`` of the table, by its name without a unit, as in ``"omega"`` or ``"error_estimate"``.

        Quantities are NaN where a scene has no answer. Those of a pulley or span have its number, as in
        ``"pulleys.1.tight"`` and ``"spans.0.frequency"``; others are of the whole, as ``"efficiency"``. What needs
        fields, as spans do, is NaN where these were not kept.

        Raises:
            KeyError: There is no such column.
        """
        if "." not in name and name not in {**OF_ALL, **self._told}:
            raise KeyError(name)
        unit_of(name)
        return np.array([number(solution, name) for solution in self.solutions])

    @property
    def _told(self) -> dict[str, str]:
        return quantities(solution.scene for solution in self.solutions)

    def rows(self) -> list[list[Any]]:
        """The table's header, with units, and its rows."""
        told, pairs = self._told, zip(self.values, self.solutions, strict=True)
        return [header(self.over, told), *(row(value, solution, told) for value, solution in pairs)]

    def plot(self, x: str, y: str) -> Figure:
        """A figure of one column against another one, or against what changes, as ``plot("pulleys.1.creep",
        "pulleys.1.torque")``.

        Args:
            x: Name of a column, as for ``sweep[x]``, or of what changes, as in `over`.
            y: The same.

        Raises:
            SceneError: There is no such column, or it holds no numbers.
        """
        from belt_fenicsx.sweeps.curve import curve

        return curve(self, x, y)

    def to_pandas(self) -> DataFrame:
        """The table as a data frame of pandas.

        Raises:
            ModuleNotFoundError: pandas is not there.
        """
        try:
            from pandas import DataFrame
        except ModuleNotFoundError as missing:
            raise ModuleNotFoundError("`to_pandas` needs pandas: pip install pandas; or use `csv()`.") from missing
        names, *rows = self.rows()
        return DataFrame(rows, columns=names)

    def csv(self) -> str:
        """The table as comma-separated values."""
        return as_csv(self.rows())


def sweep(
    scenes: Scene | Iterable[Scene],
    *,
    over: str | Sequence[str] | None = None,
    values: Iterable[Any] | None = None,
    solver: Callable[..., Solution] = solve,
    comm: MPI.Comm | None = None,
    out: str | Path | None = None,
    keep_fields: bool = True,
    on_solved: Callable[[int, Solution], None] | None = None,
    progress: Callable[[int, int], None] | None = None,
    **arguments: Any,
) -> Sweep:
    """Solves many scenes with warm starts along the way.

    Nothing is raised for a scene without an answer: its row says so.

    Args:
        scenes: The scenes; or one scene, of which ``over`` takes the ``values``.
        over: Path of the value to change, as in ``"pulleys.0.x_trans"``, or several paths.
        values: The values it takes; of several paths tuples, as `itertools.product` makes them.
        solver: The function that solves one scene: `solve` or `bvp.solve`.
        comm: Ranks that share the scenes, each of which is then solved by one rank alone; without it no sharing.
        out: A file for the table. Until it is written, finished rows are kept beside it, and a sweep that was
            stopped goes on where it was when it is called again in the same way.
        keep_fields: Whether the solutions keep their fields, which the table does not need.
        on_solved: Called with the number of each scene and its solution, on the rank that solved it.
        progress: Called on the first rank with the numbers of scenes solved so far, by all ranks, and to be solved.
        arguments: Further arguments of the solver, such as ``rtol`` and ``method``.

    Returns:
        The answers, the same on every rank. What is private to a method stays on the rank that solved the scene, and
        answers of an earlier call have no fields.

    Raises:
        SceneError: A value does not make a scene, before any scene is solved; the arguments do not fit together; or
            beside ``out`` there are rows of another sweep.
        OSError: The table, or what is kept beside it, cannot be written; on all ranks.
    """
    over = over if isinstance(over, str | None) else tuple(over)
    numbers, wanted = _wanted(scenes, over, values)
    call = _call(solver, arguments, comm)
    ranks = ranks_of(comm)
    parts = None if out is None else Parts(Path(out), ranks.rank)
    names = [] if parts is None else keys(wanted, _asked(call))
    known = {} if parts is None else ranks.on_first(functools.partial(parts.read_those, names))
    solutions = {index: known[name] for index, name in enumerate(names) if name in known}
    missing = [index for index in range(len(wanted)) if index not in solutions]

    def show(done: int) -> None:
        if progress is not None and ranks.rank == 0:
            progress(done, len(wanted))

    def solved(index: int, solution: Solution) -> None:
        if on_solved is not None:
            on_solved(index, solution)
        if parts is not None:
            parts.keep(names[index], solution)
        show(len(wanted) - len(missing) + ranks.solved())

    solutions |= _solved_by_all(wanted, missing, call, ranks, parts, solved, keep_fields)
    show(len(solutions))
    result = Sweep(over=over, values=numbers, solutions=tuple(solutions[index] for index in range(len(wanted))))
    if parts is not None:
        ranks.on_first(functools.partial(_write, result, parts))
    return result


def _wanted(
    scenes: Scene | Iterable[Scene], over: str | tuple[str, ...] | None, values: Iterable[Any] | None
) -> tuple[tuple[Any, ...], tuple[Scene, ...]]:
    """The values, or numbers, of the scenes, and the scenes."""
    if isinstance(scenes, Scene):
        if over is None or values is None:
            raise SceneError("over", "come with one scene and with `values`", over)
        numbers = tuple(values)
        if isinstance(over, str):
            return numbers, tuple(_with(scenes, {over: value}) for value in numbers)
        for value in numbers:
            if not isinstance(value, tuple) or len(value) != len(over):
                raise SceneError("values", f"be tuples of {len(over)}, one for each path", value)
        return numbers, tuple(_with(scenes, dict(zip(over, value, strict=True))) for value in numbers)
    if over is not None or values is not None:
        raise SceneError("over", "be left out with a list of scenes", over)
    wanted = tuple(scenes)
    return tuple(range(len(wanted))), wanted


def _with(scene: Scene, values: Mapping[str, Any]) -> Scene:
    plain = {path: value.item() if isinstance(value, np.generic) else value for path, value in values.items()}
    return with_values(scene, plain)


def _call(
    solver: Callable[..., Solution], arguments: dict[str, Any], comm: MPI.Comm | None
) -> functools.partial[Solution]:
    """The solver with its arguments; where ranks share the scenes, each solves its own alone."""
    if comm is not None and "comm" in inspect.signature(solver).parameters:
        from mpi4py import MPI

        arguments = {**arguments, "comm": MPI.COMM_SELF}
    return functools.partial(solver, throw=False, **arguments)


def _asked(call: functools.partial[Solution]) -> dict[str, Any]:
    """What an answer depends on, beside the scene."""
    arguments = {name: value for name, value in call.keywords.items() if name != "comm"}
    return {**arguments, "solver": getattr(call.func, "__module__", repr(call.func))}


def _solved_by_all(
    wanted: Sequence[Scene],
    missing: Sequence[int],
    call: functools.partial[Solution],
    ranks: OneProcess | Ranks,
    parts: Parts | None,
    solved: Callable[[int, Solution], None],
    keep_fields: bool,
) -> dict[int, Solution]:
    """Solves the missing scenes, this rank those of its chunks; an error of one rank ends the sweep on all."""
    mine: dict[int, Solution] = {}
    error: BaseException | None = None
    ranks.start()
    try:
        with parts or contextlib.nullcontext():
            for chunk in ranks.chunks(len(missing)):
                last: Solution | None = None
                for index in (missing[number] for number in chunk):
                    solution = _solved(wanted[index], last, call)
                    last = solution if solution.success else last
                    mine[index] = solution if keep_fields else _lean(solution)
                    solved(index, solution)
    except BaseException as caught:  # whatever it is, the other ranks would wait for this one; it is raised again
        ranks.stop()
        error = caught
    return ranks.gathered(mine, error)


def _solved(scene: Scene, last: Solution | None, call: functools.partial[Solution]) -> Solution:
    """Solves from the last answer, and from nothing where that gives none."""
    for initial in (last, None) if last is not None else (None,):
        try:
            solution = call(scene, initial=initial)
        except SceneError as error:
            # Found only on the way, as a transition outside of the contact is: the sweep goes on.
            return _refused(scene, call.keywords.get("method") or "", error)
        if solution.success:
            return solution
    return solution


def _refused(scene: Scene, method: str, error: SceneError) -> Solution:
    stage = Stage(name="scene", why=str(error))
    return Solution(scene=scene, method=method, status=Status.REFUSED, message=str(error), stages=(stage,))


def _lean(solution: Solution) -> Solution:
    """The solution without its fields."""
    return replace(solution, fields=None, state=None, evaluator=None)


def _write(result: Sweep, parts: Parts) -> None:
    """Writes the table, which then needs no side files."""
    with replaced(parts.table) as partial:
        partial.write_text(result.csv())
    parts.remove()
