"""The command line: reads a scene, solves it, prints the answer. Arguments and exit codes: see `arguments`.

Only here does the project print, configure logging, or look at PETSc's options. What a call does not need is not
imported: the BVP runs without FEniCS, PETSc and MPI, a wrong argument without any of the numerics.
"""

from __future__ import annotations

import argparse
import contextlib
import difflib
import errno
import functools
import json
import logging
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from belt_fenicsx.backend import interrupts
from belt_fenicsx.backend.compiling import CACHE_VARIABLE, NotCompiled
from belt_fenicsx.backend.ranks import on_first
from belt_fenicsx.command.arguments import (
    CHECK,
    KNOWN_OPTIONS,
    PROGRAM,
    SOLVE,
    SWEEP,
    Missing,
    UsageError,
    information,
    parsed,
)
from belt_fenicsx.scene.checks import SceneError, Verbatim, printable
from belt_fenicsx.scene.file import left_out, parse_data, read_data, scene_from_dict, with_values
from belt_fenicsx.scene.scene import Scene

if TYPE_CHECKING:
    from mpi4py import MPI

    from belt_fenicsx.solution.solution import Solution

    Solver = Callable[..., Solution]
    Report = Callable[[], int]

RANK_VARIABLES = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK")
SOLVED, FAILED, BAD_INPUT, NOT_CONVERGED, NOT_ADMISSIBLE = 0, 1, 2, 3, 4
# As a shell names the end by SIGINT, SIGPIPE and SIGTERM.
INTERRUPTED, NO_READER, TERMINATED = 130, 141, 143


class Terminated(KeyboardInterrupt):
    """SIGTERM, which ends a solve as Ctrl-C does."""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line.

    Args:
        argv: Arguments without the program's name. Without them it is the program, with those of the process, whose
            standard streams and end it then takes care of.

    Returns:
        The exit code, the same on all ranks.
    """
    if argv is not None:
        return _ended(list(argv))
    _open_standard_streams()
    signal.signal(signal.SIGTERM, _terminate)
    code = _ended(sys.argv[1:])
    # From here on there is nothing to be kept.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    if code in (INTERRUPTED, TERMINATED):
        # Other ranks may not be at an end, for which MPI's own end would wait.
        for stream in filter(None, (sys.stdout, sys.stderr)):
            with contextlib.suppress(OSError):
                stream.flush()
        os._exit(code)
    return code


def _ended(argv: list[str]) -> int:
    """Runs the command line; what is raised becomes a complaint and an exit code."""
    try:
        return _run(argv)
    except (SceneError, UsageError) as error:
        return _complain(error, BAD_INPUT)
    except (Missing, NotCompiled) as error:
        return _complain(error, FAILED)
    except KeyboardInterrupt as error:
        return _interrupted(error)
    except BrokenPipeError:
        return NO_READER
    except Exception:  # whatever it is, the other ranks would wait for this one; it is raised again
        _abort_other_ranks()
        raise


def _open_standard_streams() -> None:
    """Opens closed standard streams on nothing, lest the next file that is opened takes their place."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


def _terminate(number: int, frame: FrameType | None) -> None:
    raise Terminated


def _run(argv: list[str]) -> int:
    text = information(argv)
    if text is not None:
        return _told(functools.partial(_shown, text)) if _rank() == 0 else SOLVED
    args, petsc = parsed(argv)
    scene = _scene(args)
    _configure_logging(args.verbose)
    report = {SOLVE: _solved, SWEEP: _swept, CHECK: _checked}[args.command](scene, args, petsc)
    return _agreed(_told(report) if _rank() == 0 else 0)


def _scene(args: argparse.Namespace) -> Scene:
    """The scene that is asked for. What its file leaves out is told, and kept in ``args.left_out``."""
    if args.scene is None:
        args.left_out = None
        return with_values(Scene(), args.set)
    data = parse_data(_standard_input(), "-") if args.scene == "-" else read_data(args.scene)
    scene = with_values(scene_from_dict(data), args.set)
    args.left_out = left_out(scene, data, [*args.set, *(args.over if args.command == SWEEP else ())])
    if args.left_out:
        values = ", ".join(f"{path} = {value}" for path, value in args.left_out.items())
        _complain(printable(f"{args.scene} leaves out what the published scene has: {values}."), SOLVED)
    return scene


def _standard_input() -> bytes:
    """What comes in at the first rank, on all ranks."""
    ranks = _ranks()
    if sys.stdin is None:
        raise SceneError("-", "be an open standard input", Verbatim("a closed one"))
    return sys.stdin.buffer.read() if ranks is None else on_first(ranks, sys.stdin.buffer.read)


# How it is solved


def _solver(args: argparse.Namespace, petsc: list[str], method: str | None) -> Solver:
    """A method with its options; nothing is imported before it is needed."""
    options: dict[str, Any] = {"rtol": args.rtol, "throw": False}
    if method == "bvp":
        from belt_fenicsx import bvp

        return functools.partial(bvp.solve, **options)
    if method is not None:
        options["method"] = method
    if args.elements is not None:
        options["elements"] = args.elements
    if args.mesh is not None:
        from belt_fenicsx.lagrangian.nodes import read_positions

        options["mesh"] = read_positions(args.mesh)
    if find_spec("petsc4py") is None or find_spec("dolfinx") is None:
        raise Missing(f"DOLFINx is needed, but {sys.executable} lacks it; --method bvp runs without.")
    # DOLFINx would take an empty or relative one for a folder here, and load code from it.
    if not os.path.isabs(os.environ.get(CACHE_VARIABLE, os.sep)):
        del os.environ[CACHE_VARIABLE]
    with interrupts.held():
        import petsc4py

        # PETSc reads its options when it starts, which is when DOLFINx is imported. A closed pipe is for Python to
        # notice.
        petsc4py.init([PROGRAM, "-no_signal_handler", *petsc])
        from belt_fenicsx.solver import solve

    return functools.partial(solve, **options)


def _check_used(petsc: list[str], solution: Solution) -> None:
    """Refuses options that no solver has asked for; each knows its own alone.

    Raises:
        UsageError: There is one.
    """
    if not petsc or not solution.iterations:
        return
    from belt_fenicsx.backend.petsc_options import PREFIX, unused

    for name in unused():
        near = difflib.get_close_matches(name, KNOWN_OPTIONS, n=1)
        hint = f", perhaps `-{PREFIX}{near[0]}`" if near else ""
        raise UsageError(f"`-{PREFIX}{name}` must be an option of the solvers of the method {solution.method}{hint}")


def _shown(text: str) -> int:
    _print(text)
    return SOLVED


def _solved(scene: Scene, args: argparse.Namespace, petsc: list[str]) -> Report:
    solution = _solver(args, petsc, args.method)(scene)
    _check_used(petsc, solution)

    def report() -> int:
        from belt_fenicsx.solution.report import as_text
        from belt_fenicsx.solution.summary import as_json

        _print(as_json(solution, args.left_out) if args.json else as_text(solution))
        if args.plot is not None and solution.fields is None:
            _complain(f"{args.plot} was not drawn: the solve left no fields to be shown.", SOLVED)
        elif args.plot is not None:
            _plot(solution, args.plot)
        if args.out is not None:
            from belt_fenicsx.solution.files import export

            export(solution, args.out)
        return _exit_code(solution)

    return report


def _swept(scene: Scene, args: argparse.Namespace, petsc: list[str]) -> Report:
    solver = _solver(args, petsc, args.method)
    from belt_fenicsx.sweeps.sweep import sweep

    table = _Table(args.over, args.json)
    ranks = _ranks()
    # Rows of other ranks are known at the end.
    told_at_once = args.out is None and ranks is None

    def solved(index: int, solution: Solution) -> None:
        _check_used(petsc, solution)
        if told_at_once:
            table.tell(args.values[index], solution)

    asked = {"over": args.over, "values": args.values, "solver": solver, "out": args.out, "on_solved": solved}
    try:
        with _progress(args.progress, told_at_once) as progress:
            result = sweep(scene, **asked, comm=ranks, keep_fields=False, progress=progress)
    except KeyboardInterrupt as error:
        error.add_note(_kept(args))
        raise
    except BrokenPipeError:
        raise
    except OSError as error:
        # Raised on all ranks, which need not be aborted.
        raise Missing(_unwritten(error)) from None

    def report() -> int:
        if args.out is not None:
            solved = sum(solution.success for solution in result.solutions)
            ends = {"table": str(args.out), "scenes": len(result.solutions), "solved": solved}
            _print(json.dumps(ends) if args.json else f"{args.out}: {len(result.solutions)} scenes, {solved} solved")
        elif not told_at_once:
            for values, solution in zip(result.values, result.solutions, strict=True):
                table.tell(values, solution)
        return max(map(_exit_code, result.solutions))

    return report


class _Table:
    """A sweep's table, told row by row.

    Args:
        over: What changes from row to row.
        as_json: Whether a row is an object.
    """

    def __init__(self, over: tuple[str, ...], as_json: bool) -> None:
        self._over, self._as_json, self._begun = over, as_json, False

    def tell(self, values: tuple[Any, ...], solution: Solution) -> None:
        """Prints a row, the first one after the header."""
        from belt_fenicsx.solution.files import as_csv
        from belt_fenicsx.solution.summary import row_as_json
        from belt_fenicsx.sweeps.table import header, row

        if self._as_json:
            _print(row_as_json(dict(zip(self._over, values, strict=True)), solution))
            return
        rows = [row(values, solution)] if self._begun else [header(self._over), row(values, solution)]
        self._begun = True
        _print(as_csv(rows).rstrip("\n"))


def _kept(args: argparse.Namespace) -> str:
    """What an interrupted sweep leaves."""
    if args.out is None:
        return "Finished rows are kept with --out."
    from belt_fenicsx.sweeps.parts import Parts

    parts = Parts(args.out, 0)
    rows = len(parts.read())
    return f"{rows} finished rows are kept in {parts.names()}; the same command goes on from there." if rows else ""


def _checked(scene: Scene, args: argparse.Namespace, petsc: list[str]) -> Report:
    methods = (args.method, "fitted" if args.method == "bvp" else "bvp")
    solutions = [_solver(args, petsc, method)(scene) for method in methods]
    _check_used(petsc, solutions[0])

    def report() -> int:
        from belt_fenicsx.solution.report import certificates
        from belt_fenicsx.solution.summary import certificates_as_json

        _print(certificates_as_json(solutions, args.left_out) if args.json else certificates(solutions))
        return max(map(_exit_code, solutions))

    return report


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
    return int(_launched_as() or 0)


def _launched_as() -> str | None:
    """The rank that a launcher gave to this process; None without a launcher."""
    return next((os.environ[name] for name in RANK_VARIABLES if name in os.environ), None)


def _ranks() -> MPI.Comm | None:
    """All ranks, where a launcher has started more than one."""
    if _launched_as() is None:
        return None
    if find_spec("mpi4py") is None:
        raise Missing(f"mpi4py is needed to share a sweep out, but {sys.executable} lacks it.")
    from mpi4py import MPI

    return MPI.COMM_WORLD if MPI.COMM_WORLD.size > 1 else None


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


def _complain(text: object, code: int) -> int:
    if _rank() == 0 and sys.stderr is not None:
        print(f"{PROGRAM}: {text}", file=sys.stderr)
    return code


def _interrupted(error: KeyboardInterrupt) -> int:
    word, code = ("terminated", TERMINATED) if isinstance(error, Terminated) else ("interrupted", INTERRUPTED)
    return _complain(" ".join([f"{word}.", *getattr(error, "__notes__", [])]).rstrip(), code)


def _unwritten(error: OSError) -> str:
    return f"the result could not be written: {error.strerror or error}."


def _told(report: Report) -> int:
    """Runs a report on rank 0; raises nothing that the other ranks would wait for."""
    try:
        return report()
    except BrokenPipeError:
        return NO_READER
    except OSError as error:
        return _complain(_unwritten(error), FAILED)
    except KeyboardInterrupt as error:
        return _interrupted(error)


@contextlib.contextmanager
def _progress(forced: bool, rows_are_told: bool) -> Iterator[Callable[[int, int], None] | None]:
    """What shows a sweep's progress on rank 0: one line on a terminal that shows no rows, nothing elsewhere, unless
    forced."""
    rows_are_seen = rows_are_told and sys.stdout is not None and sys.stdout.isatty()
    if _rank() > 0 or find_spec("tqdm") is None or (rows_are_seen and not forced):
        yield None
        return
    from tqdm import tqdm

    with tqdm(unit="scene", disable=False if forced else None) as bar:

        def show(solved: int, count: int) -> None:
            bar.total = count
            bar.update(solved - bar.n)

        yield show


def _exit_code(solution: Solution) -> int:
    if solution.success:
        return SOLVED
    return NOT_ADMISSIBLE if solution.status.name == "NOT_ADMISSIBLE" else NOT_CONVERGED


def _print(text: str) -> None:
    if sys.stdout is None:
        raise OSError(errno.EBADF, "standard output is closed")
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
    from belt_fenicsx.backend.atomic import replaced
    from belt_fenicsx.solution.plot import overview

    with replaced(path) as partial:
        overview(solution).savefig(partial, format=path.suffix[1:].lower())
