"""The three commands: each solves on all ranks, and gives back a report for the first one to show."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from belt_fenicsx.command.methods import check_used, solver
from belt_fenicsx.command.output import complain, progress_bar, show
from belt_fenicsx.command.process import Exit, Missing, all_ranks, exit_code, unwritten
from belt_fenicsx.scene.scene import Scene

if TYPE_CHECKING:
    from belt_fenicsx.solution.solution import Solution
    from belt_fenicsx.sweeps.sweep import Sweep

    Report = Callable[[], int]


def solve_scene(scene: Scene, args: argparse.Namespace, petsc: Sequence[str]) -> Report:
    """Solves a scene; the report shows, draws and writes the answer."""
    solution = solver(args, petsc, args.method)(scene)
    check_used(petsc, solution)

    def report() -> int:
        from belt_fenicsx.solution.report import as_text
        from belt_fenicsx.solution.summary import as_json

        show(as_json(solution, args.left_out) if args.json else as_text(solution))
        if args.plot is not None and solution.fields is None:
            complain(f"{args.plot} was not drawn: the solve left no fields to be shown.", Exit.SOLVED)
        elif args.plot is not None:
            _plot(solution, args.plot)
        if args.out is not None:
            from belt_fenicsx.solution.files import export

            export(solution, args.out)
        return exit_code(solution)

    return report


def _plot(solution: Solution, path: Path) -> None:
    """Draws the solution into a file, which appears whole or not at all."""
    import matplotlib

    matplotlib.use("agg")
    from belt_fenicsx.backend.atomic import replaced
    from belt_fenicsx.solution import pictures

    published = solution.scene.is_published or not solution.contacts
    figure = pictures.picture(solution, "overview" if published else "drive")
    with replaced(path) as partial:
        figure.savefig(partial, format=path.suffix[1:].lower())


def sweep_scenes(scene: Scene, args: argparse.Namespace, petsc: Sequence[str]) -> Report:
    """Solves the scenes of a sweep, whose rows are shown as they come, unless they go into a file."""
    from belt_fenicsx.sweeps.relay import Relay

    ranks, table, shows_rows = all_ranks(), _Table(args.over, scene, args.json), args.out is None
    rows = Relay(ranks, table.show)

    def on_solved(index: int, solution: Solution) -> None:
        check_used(petsc, solution)
        if shows_rows:
            rows.tell(index, table.row(args.values[index], solution))

    result = _sweep(scene, args, petsc, on_solved=on_solved, comm=ranks, shows_rows=shows_rows)

    def report() -> int:
        if args.out is not None:
            solved = sum(solution.success for solution in result.solutions)
            ends = {"table": str(args.out), "scenes": len(result.solutions), "solved": solved}
            show(json.dumps(ends) if args.json else f"{args.out}: {len(result.solutions)} scenes, {solved} solved")
        else:
            rows.finish(len(result.solutions))
        return max(map(exit_code, result.solutions))

    return report


def _sweep(scene: Scene, args: argparse.Namespace, petsc: Sequence[str], *, shows_rows: bool, **more: Any) -> Sweep:
    """The sweep; where it is interrupted, the error says what it leaves."""
    method = solver(args, petsc, args.method)
    from belt_fenicsx.sweeps.sweep import sweep

    asked = {"over": args.over, "values": args.values, "solver": method, "out": args.out, "keep_fields": False, **more}
    try:
        with progress_bar(args.progress, shows_rows) as progress:
            return sweep(scene, **asked, progress=progress)
    except KeyboardInterrupt as error:
        error.add_note(_what_is_kept(args))
        raise
    except BrokenPipeError:
        raise
    except OSError as error:
        # Raised on all ranks, which need not be aborted.
        raise Missing(unwritten(error)) from None


def _what_is_kept(args: argparse.Namespace) -> str:
    """What an interrupted sweep leaves."""
    if args.out is None:
        return "Finished rows are kept with --out."
    from belt_fenicsx.sweeps.parts import Parts

    parts = Parts(args.out, 0)
    rows = len(parts.read())
    return f"{rows} finished rows are kept in {parts.names()}; the same command goes on from there." if rows else ""


class _Table:
    """A sweep's table, shown row by row.

    Args:
        over: What changes from row to row.
        scene: The scene in which it does.
        as_json: Whether a row is an object.
    """

    def __init__(self, over: tuple[str, ...], scene: Scene, as_json: bool) -> None:
        self._over, self._scene, self._as_json, self._begun = over, scene, as_json, False

    def row(self, values: tuple[Any, ...], solution: Solution) -> str:
        """A row as text."""
        from belt_fenicsx.solution.files import as_csv
        from belt_fenicsx.solution.summary import row_as_json
        from belt_fenicsx.sweeps.table import quantities, row

        if self._as_json:
            return row_as_json(dict(zip(self._over, values, strict=True)), solution)
        return as_csv([row(values, solution, quantities([self._scene]))]).rstrip("\n")

    def show(self, text: str) -> None:
        """Shows a row, the first one after the header."""
        from belt_fenicsx.solution.files import as_csv
        from belt_fenicsx.sweeps.table import header, quantities

        if not self._as_json and not self._begun:
            text = as_csv([header(self._over, quantities([self._scene]))]) + text
        self._begun = True
        show(text)


def check_scene(scene: Scene, args: argparse.Namespace, petsc: Sequence[str]) -> Report:
    """Solves a scene by two methods; the report shows their certificates."""
    methods = (args.method, "fitted" if args.method == "bvp" else "bvp")
    solutions = [solver(args, petsc, method)(scene) for method in methods]
    check_used(petsc, solutions[0])

    def report() -> int:
        from belt_fenicsx.solution.report import certificates
        from belt_fenicsx.solution.summary import certificates_as_json

        show(certificates_as_json(solutions, args.left_out) if args.json else certificates(solutions))
        return max(map(exit_code, solutions))

    return report
