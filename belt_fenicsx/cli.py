"""The command line: reads a scene, solves it, prints the answer. Arguments and exit codes: see `arguments`.

Only here does the project print, configure logging, or look at PETSc's options. What a call does not need is not
imported: the BVP runs without FEniCS, PETSc and MPI, a wrong argument without any of the numerics.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import logging
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from belt_fenicsx.arguments import CHECK, PROGRAM, SOLVE, SWEEP, Missing, UsageError, parsed
from belt_fenicsx.errors import NotCompiled
from belt_fenicsx.scene import Scene, SceneError
from belt_fenicsx.scene_file import load_scene, with_values

if TYPE_CHECKING:
    from mpi4py import MPI

    from belt_fenicsx.solution import Solution

    Solver = Callable[..., Solution]
    Report = Callable[[], int]

RANK_VARIABLES = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK")
SOLVED, FAILED, BAD_INPUT, NOT_CONVERGED, NOT_ADMISSIBLE, INTERRUPTED = 0, 1, 2, 3, 4, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line.

    Args:
        argv: Arguments without the program's name; those of the process by default.

    Returns:
        The exit code, the same on all ranks.
    """
    try:
        return _run(sys.argv[1:] if argv is None else list(argv))
    except (SceneError, UsageError) as error:
        return _complain(error, BAD_INPUT)
    except (Missing, NotCompiled) as error:
        return _complain(error, FAILED)
    except KeyboardInterrupt:
        return _complain("interrupted.", INTERRUPTED)
    except Exception:  # whatever it is, the other ranks would wait for this one; it is raised again
        _abort_other_ranks()
        raise


def _run(argv: list[str]) -> int:
    args, petsc = parsed(argv)
    scene = with_values(load_scene(args.scene) if args.scene else Scene(), args.set)
    _configure_logging(args.verbose)
    report = {SOLVE: _solved, SWEEP: _swept, CHECK: _checked}[args.command](scene, args, _solver(args, petsc))
    return _agreed(_told(report) if _rank() == 0 else 0)


# How it is solved


def _solver(args: argparse.Namespace, petsc: list[str]) -> Solver:
    """The method that was asked for, with its options; nothing is imported before it is needed."""
    options: dict[str, Any] = {"rtol": args.rtol, "throw": False}
    if args.method == "bvp":
        from belt_fenicsx import bvp

        return functools.partial(bvp.solve, **options)
    if args.method is not None:
        options["method"] = args.method
    if args.elements is not None:
        options["elements"] = args.elements
    if args.mesh is not None:
        from belt_fenicsx.node_positions import read_positions

        options["mesh"] = read_positions(args.mesh)
    if find_spec("petsc4py") is None or find_spec("dolfinx") is None:
        raise Missing(f"DOLFINx is needed, but {sys.executable} lacks it; --method bvp runs without.")
    import petsc4py

    # PETSc reads its options when it starts, which is when DOLFINx is imported. A closed pipe is for Python to notice.
    petsc4py.init([PROGRAM, "-no_signal_handler", *petsc])
    from belt_fenicsx.solver import solve

    return functools.partial(solve, **options)


def _solved(scene: Scene, args: argparse.Namespace, solver: Solver) -> Report:
    solution = solver(scene)

    def report() -> int:
        from belt_fenicsx.report import as_json, as_text

        _print(as_json(solution) if args.json else as_text(solution))
        if args.plot is not None and solution.fields is not None:
            _plot(solution, args.plot)
        if args.out is not None:
            from belt_fenicsx.files import export

            export(solution, args.out)
        return _exit_code(solution)

    return report


def _swept(scene: Scene, args: argparse.Namespace, solver: Solver) -> Report:
    from belt_fenicsx.sweeps import sweep

    asked = {"over": args.over, "values": args.values, "solver": solver, "out": args.out}
    try:
        with _progress(args.progress) as progress:
            result = sweep(scene, **asked, comm=_ranks(), keep_fields=False, progress=progress)
    except OSError as error:
        # Raised on all ranks, which need not be aborted.
        raise Missing(f"the result could not be written: {error.strerror or error}.") from None

    def report() -> int:
        if args.out is None:
            _print(result.csv().rstrip("\n"))
        else:
            solved = sum(solution.success for solution in result.solutions)
            _print(f"{args.out}: {len(result.solutions)} scenes, {solved} solved")
        return max(map(_exit_code, result.solutions))

    return report


def _checked(scene: Scene, args: argparse.Namespace, solver: Solver) -> Report:
    from belt_fenicsx import bvp

    solutions = (solver(scene), bvp.solve(scene, rtol=args.rtol, throw=False))

    def report() -> int:
        from belt_fenicsx.report import certificates

        _print(certificates(solutions))
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


def _complain(error: object, code: int) -> int:
    if _rank() == 0:
        print(f"{PROGRAM}: {error}", file=sys.stderr)
    return code


def _told(report: Report) -> int:
    """Runs a report on rank 0; raises nothing that the other ranks would wait for."""
    try:
        return report()
    except OSError as error:
        return _complain(f"the result could not be written: {error.strerror or error}.", FAILED)
    except KeyboardInterrupt:
        return _complain("interrupted.", INTERRUPTED)


@contextlib.contextmanager
def _progress(forced: bool) -> Iterator[Callable[[int, int], None] | None]:
    """What shows a sweep's progress on rank 0: one line on a terminal, nothing elsewhere unless forced."""
    if _rank() > 0 or find_spec("tqdm") is None:
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
    from belt_fenicsx.files import replaced
    from belt_fenicsx.plot import overview

    with replaced(path) as partial:
        overview(solution).savefig(partial, format=path.suffix[1:].lower())
