"""The command line: reads a scene, solves it, prints the answer. Exit codes: see ``EPILOG``.

Only here does the project print, configure logging, or look at PETSc's options. What a call does not need is not
imported: the BVP runs without FEniCS, PETSc and MPI, a wrong argument without any of the numerics.
"""

from __future__ import annotations

import argparse
import difflib
import logging
import os
import re
import sys
import traceback
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from belt_fenicsx.scene import Scene, SceneError, Verbatim
from belt_fenicsx.scene_file import load_scene, parse_assignment, with_values

if TYPE_CHECKING:
    from belt_fenicsx.solution import Solution

PROGRAM = "belt-fenicsx"
METHODS = ("fitted", "augmented-lagrangian", "bvp")
PLOT_SUFFIXES = (".pdf", ".png", ".svg")
SOLVED, FAILED, BAD_INPUT, NOT_CONVERGED, NOT_ADMISSIBLE, INTERRUPTED = 0, 1, 2, 3, 4, 130

EPILOG = """\
PETSc options have one dash and pass through, as in -belt_snes_monitor or -log_view.

exit codes: 0 solved and admissible; 1 the result could not be made or written; 2 bad input; 3 did not converge;
4 converged, but not admissible (the result is printed and marked)."""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line.

    Args:
        argv: Arguments without the program's name; those of the process by default.

    Returns:
        The exit code, the same on all ranks.
    """
    try:
        return _run(sys.argv[1:] if argv is None else list(argv))
    except (SceneError, _UsageError) as error:
        return _complain(error, BAD_INPUT)
    except _Failure as error:
        return _complain(error, FAILED)
    except KeyboardInterrupt:
        return _complain("interrupted.", INTERRUPTED)
    except Exception:
        _abort_other_ranks()
        raise


def _run(argv: list[str]) -> int:
    own, petsc = _split(argv)
    args = _parser().parse_args(own)
    scene = load_scene(args.scene) if args.scene else Scene()
    scene = with_values(scene, _assignments(args.set))
    solve = _solver(args, petsc)
    _configure_logging(args.verbose)
    solution = solve(scene)
    return _agreed(_report(solution, args) if _rank() == 0 else 0)


# What is asked


class _UsageError(Exception):
    """Arguments that do not parse."""


class _Failure(Exception):
    """Something outside of the scene and the solve that keeps the result from the user."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> Any:
        raise _UsageError(f"{message}\n{self.format_usage().rstrip()}")


def _parser() -> _Parser:
    parser = _Parser(
        prog=PROGRAM,
        description="Steady motion of a belt in frictional contact with a rotating pulley.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("scene", nargs="?", metavar="SCENE.toml", help="scene file; without it, the published scene")
    parser.add_argument("--method", metavar="METHOD", help=f"one of {', '.join(METHODS)}")
    parser.add_argument(
        "--rtol", metavar="R", default="1e-8", help="relative tolerance of omega (default: %(default)s)"
    )
    parser.add_argument("--elements", metavar="N", help="number of finite elements")
    parser.add_argument(
        "--set", metavar="PATH=VALUE", action="append", default=[], help="replace a value, as in pulleys.0.friction=0.3"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object, without the arrays")
    parser.add_argument("--plot", metavar="FILE", help=f"draw the solution; {', '.join(PLOT_SUFFIXES)}")
    parser.add_argument("--verbose", action="store_true", help="log the course of the solve to stderr")
    return parser


def _split(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """Parts PETSc's options, with their values, from the program's own.

    A PETSc option takes the next argument as its value, as PETSc does it, unless that is a scene file.
    """
    names = {name.lstrip("-") for action in _parser()._actions for name in action.option_strings}
    own: list[str] = []
    petsc: list[str] = []
    previous_takes_value = False
    for arg in argv:
        if re.match(r"-[A-Za-z]", arg) and arg != "-h":
            if arg[1:].partition("=")[0] in names:
                raise _UsageError(f"`{arg}` must have two dashes, -{arg}")
            petsc.append(arg)
            previous_takes_value = True
        elif previous_takes_value and not arg.startswith("--") and not arg.endswith(".toml"):
            petsc.append(arg)
            previous_takes_value = False
        else:
            _check_option(arg, names)
            own.append(arg)
            previous_takes_value = False
    return own, petsc


def _check_option(arg: str, names: set[str]) -> None:
    name = arg[2:].partition("=")[0]
    if arg.startswith("--") and name and name not in names:
        near = difflib.get_close_matches(name, names, n=1)
        hint = f"perhaps `--{near[0]}`" if near else f"see {PROGRAM} --help"
        raise _UsageError(f"`--{name}` must be a known option, {hint}")


def _assignments(texts: Sequence[str]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for path, value in map(parse_assignment, texts):
        if path in values:
            raise SceneError(path, "be set once", Verbatim(f"{values[path]!r} and {value!r}"))
        values[path] = value
    return values


def _solver(args: argparse.Namespace, petsc: list[str]) -> Callable[[Scene], Solution]:
    """Checks the options and gives back the method, ready to be called; nothing is imported before that call."""
    if args.method not in (None, *METHODS):
        raise SceneError("--method", f"be one of {', '.join(METHODS)}", args.method)
    options: dict[str, Any] = {"rtol": _rtol(args.rtol)}
    elements = None if args.elements is None else _elements(args.elements)
    if args.plot is not None:
        _check_plot(Path(args.plot))
    if args.method == "bvp":
        if args.elements is not None:
            raise SceneError("--elements", "be left out with the method bvp, which has no elements", elements)
        if petsc:
            raise SceneError(petsc[0], "be left out with the method bvp, which runs without PETSc", Verbatim(petsc[0]))
        return lambda scene: _solve_bvp(scene, options)
    if args.method is not None:
        options["method"] = args.method
    if elements is not None:
        options["elements"] = elements
    return lambda scene: _solve_finite_elements(scene, options, petsc)


def _rtol(text: str) -> float:
    """The tolerance; its range is the method's matter."""
    try:
        return float(text)
    except ValueError:
        raise SceneError("--rtol", "be a number [-]", text) from None


def _elements(text: str) -> int:
    if not re.fullmatch(r"[1-9][0-9]{0,8}", text):
        raise SceneError("--elements", "be a whole number above zero", text)
    return int(text)


def _check_plot(path: Path) -> None:
    if path.suffix.lower() not in PLOT_SUFFIXES:
        raise SceneError("--plot", f"name a file ending in {', '.join(PLOT_SUFFIXES)}", str(path))
    if path.is_dir() or not os.access(path.parent, os.W_OK):
        raise SceneError("--plot", "name a file in a folder that exists and can be written to", str(path))
    if find_spec("matplotlib") is None:
        raise _Failure("--plot needs Matplotlib, which this Python lacks.")


# How it is solved


def _solve_bvp(scene: Scene, options: dict[str, Any]) -> Solution:
    from belt_fenicsx.bvp import solve

    return solve(scene, **options, throw=False)


def _solve_finite_elements(scene: Scene, options: dict[str, Any], petsc: list[str]) -> Solution:
    if find_spec("petsc4py") is None or find_spec("dolfinx") is None:
        raise _Failure(f"DOLFINx is needed, but {sys.executable} lacks it; --method bvp runs without.")
    import petsc4py

    # PETSc reads its options when it starts, which is when DOLFINx is imported.
    petsc4py.init([PROGRAM, *petsc])
    from belt_fenicsx.solver import solve

    return solve(scene, **options, throw=False)


def _configure_logging(verbose: bool) -> None:
    handler = logging.StreamHandler()
    handler.setLevel(logging.INFO if verbose and _rank() == 0 else logging.WARNING)
    # The compiler of the forms reports each of its runs through the root logger.
    handler.addFilter(lambda record: record.name != "root" or record.levelno > logging.INFO)
    logging.basicConfig(handlers=[handler], format="%(name)s: %(message)s")
    logging.getLogger("belt_fenicsx").setLevel(logging.INFO if verbose else logging.WARNING)


def _rank() -> int:
    """This process's rank, from the launcher as long as MPI has not been loaded."""
    mpi = sys.modules.get("mpi4py.MPI")
    if mpi is not None:
        return int(mpi.COMM_WORLD.rank)
    return int(
        next((os.environ[name] for name in ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK") if name in os.environ), 0)
    )


def _abort_other_ranks() -> None:
    """Ends all ranks after an error on this one alone, for which the others would wait forever."""
    mpi = sys.modules.get("mpi4py.MPI")
    if mpi is not None and mpi.COMM_WORLD.size > 1:
        traceback.print_exc()
        mpi.COMM_WORLD.Abort(FAILED)


def _agreed(code: int) -> int:
    """The exit code of rank 0, on all ranks."""
    mpi = sys.modules.get("mpi4py.MPI")
    return code if mpi is None else int(mpi.COMM_WORLD.bcast(code, root=0))


# What is told


def _complain(error: object, code: int) -> int:
    if _rank() == 0:
        print(f"{PROGRAM}: {error}", file=sys.stderr)
    return code


def _report(solution: Solution, args: argparse.Namespace) -> int:
    """Prints and draws the solution; returns the exit code. Raises nothing that the other ranks would wait for."""
    from belt_fenicsx.report import as_json, as_text

    try:
        _print(as_json(solution) if args.json else as_text(solution))
        if args.plot is not None and solution.fields is not None:
            _plot(solution, Path(args.plot))
    except OSError as error:
        return _complain(f"the result could not be written: {error.strerror or error}.", FAILED)
    except KeyboardInterrupt:
        return _complain("interrupted.", INTERRUPTED)
    return _exit_code(solution)


def _exit_code(solution: Solution) -> int:
    if solution.success:
        return SOLVED
    return NOT_ADMISSIBLE if solution.status.name == "NOT_ADMISSIBLE" else NOT_CONVERGED


def _print(text: str) -> None:
    try:
        print(text, flush=True)
    except OSError:
        # At exit Python would try once more to write to the closed pipe or the full disk.
        sys.stdout = open(os.devnull, "w")
        raise


def _plot(solution: Solution, path: Path) -> None:
    """Draws the solution into a file, which appears whole or not at all."""
    import matplotlib

    matplotlib.use("agg")
    from belt_fenicsx.plot import overview

    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        overview(solution).savefig(partial, format=path.suffix[1:].lower())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
