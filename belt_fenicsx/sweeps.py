"""Many scenes, one after another: each starts from the answer before it, and from nothing where that fails."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from belt_fenicsx.scene import Scene, SceneError
from belt_fenicsx.scene_file import with_values
from belt_fenicsx.solution import Array, Solution, Stage, Status
from belt_fenicsx.solver import solve

COLUMNS = {
    "omega": "rad/s",
    "x_up": "m",
    "x_trans": "m",
    "x_off": "m",
    "torque": "N m",
    "wrap_angle": "rad",
}


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """The answers to a list of scenes.

    Attributes:
        over: Path of the value that changes from scene to scene, as in ``"pulleys.0.x_trans"``; None for a list of
            scenes.
        values: Its values ``(n,)``, or the scenes' numbers.
        solutions: One solution for each scene, failed ones too, in the order asked for.
    """

    over: str | None
    values: tuple[Any, ...]
    solutions: tuple[Solution, ...]

    @property
    def success(self) -> bool:
        """Whether every scene has an admissible answer."""
        return all(solution.success for solution in self.solutions)

    def __getitem__(self, name: str) -> Array:
        """A column ``(n,)``: a quantity of contact, ``"error_estimate"`` or ``"iterations"``.

        Quantities of contact are NaN where a scene has no answer.

        Raises:
            KeyError: There is no such column.
        """
        if name in COLUMNS:
            return np.array([_of_contact(solution, name) for solution in self.solutions])
        if name in ("error_estimate", "iterations"):
            return np.array([getattr(solution, name) for solution in self.solutions])
        raise KeyError(name)

    def csv(self) -> str:
        """The table as comma-separated values, with units in its header."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        columns = [f"{name} [{unit}]" for name, unit in COLUMNS.items()]
        writer.writerow([self.over or "scene", *columns, "error_estimate [-]", "iterations", "status"])
        for value, solution in zip(self.values, self.solutions, strict=True):
            quantities = [repr(_of_contact(solution, name)) for name in COLUMNS]
            writer.writerow(
                [value, *quantities, repr(solution.error_estimate), solution.iterations, solution.status.name]
            )
        return text.getvalue()


def _of_contact(solution: Solution, name: str) -> float:
    """A quantity of the only contact; NaN where the answer is not one to rely on."""
    return float(getattr(solution.contacts[0], name)) if solution.success else float("nan")


def sweep(
    scenes: Scene | Iterable[Scene],
    *,
    over: str | None = None,
    values: Iterable[Any] | None = None,
    solver: Callable[..., Solution] = solve,
    on_solved: Callable[[int, Solution], None] | None = None,
    **arguments: Any,
) -> Sweep:
    """Solves many scenes with warm starts along the way.

    Nothing is raised for a scene without an answer: its row says so.

    Args:
        scenes: The scenes; or one scene, of which ``over`` takes the ``values``.
        over: Path of the value to change, as in ``"pulleys.0.x_trans"``.
        values: The values it takes.
        solver: The function that solves one scene: `solve` or `bvp.solve`.
        on_solved: Called with the number of each scene and its solution.
        arguments: Further arguments of the solver, such as ``rtol`` and ``method``.

    Raises:
        SceneError: A value does not make a scene, before any scene is solved; or the arguments do not fit together.
    """
    if isinstance(scenes, Scene):
        if over is None or values is None:
            raise SceneError("over", "come with one scene and with `values`", over)
        numbers = tuple(values)
        wanted = tuple(_with_value(scenes, over, value) for value in numbers)
    else:
        if over is not None or values is not None:
            raise SceneError("over", "be left out with a list of scenes", over)
        wanted = tuple(scenes)
        numbers = tuple(range(len(wanted)))
    solutions: list[Solution] = []
    last: Solution | None = None
    for index, scene in enumerate(wanted):
        solution = _solved(scene, last, solver, arguments)
        solutions.append(solution)
        last = solution if solution.success else last
        if on_solved is not None:
            on_solved(index, solution)
    return Sweep(over=over, values=numbers, solutions=tuple(solutions))


def _with_value(scene: Scene, over: str, value: Any) -> Scene:
    return with_values(scene, {over: value.item() if isinstance(value, np.generic) else value})


def _solved(
    scene: Scene, last: Solution | None, solver: Callable[..., Solution], arguments: Mapping[str, Any]
) -> Solution:
    """Solves from the last answer, and from nothing where that gives none."""
    for initial in (last, None) if last is not None else (None,):
        try:
            solution = solver(scene, initial=initial, throw=False, **arguments)
        except SceneError as error:
            # Found only on the way, as a transition outside of the contact is: the sweep goes on.
            return _refused(scene, str(arguments.get("method", "")), error)
        if solution.success:
            return solution
    return solution


def _refused(scene: Scene, method: str, error: SceneError) -> Solution:
    stage = Stage(name="scene", why=str(error))
    return Solution(scene=scene, method=method, status=Status.REFUSED, message=str(error), stages=(stage,))
