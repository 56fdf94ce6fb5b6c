"""The method that is asked for, with its options; nothing is imported before it is needed."""

from __future__ import annotations

import argparse
import difflib
import functools
import os
import sys
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from belt_fenicsx.backend import interrupts
from belt_fenicsx.backend.compiling import CACHE_VARIABLE
from belt_fenicsx.command.output import PROGRAM
from belt_fenicsx.command.process import Missing, UsageError

if TYPE_CHECKING:
    from belt_fenicsx.solution.solution import Solution

    Solver = Callable[..., Solution]

# Those options of PETSc that are asked for most, to suggest one for a name that no solver knows.
KNOWN_OPTIONS = (
    "snes_monitor", "snes_view", "snes_converged_reason", "snes_rtol", "snes_atol", "snes_stol", "snes_max_it",
    "snes_type", "snes_linesearch_type", "snes_linesearch_monitor", "snes_test_jacobian", "ksp_type", "ksp_monitor",
    "ksp_view", "ksp_rtol", "pc_type", "pc_factor_mat_solver_type", "pc_factor_mat_ordering_type",
)  # fmt: skip


def solver(args: argparse.Namespace, petsc: Sequence[str], method: str | None) -> Solver:
    """The function that solves a scene.

    Args:
        args: The arguments.
        petsc: PETSc's options.
        method: The method; the default one where it is left out.

    Raises:
        Missing: The method needs what is not installed.
    """
    from belt_fenicsx.solver import METHODS, solve

    options: dict[str, Any] = {"rtol": args.rtol, "throw": False}
    if method is not None:
        options["method"] = method
    if method is not None and "options" not in METHODS[method].knows:
        return functools.partial(solve, **options)
    if args.elements is not None:
        options["elements"] = args.elements
    if args.mesh is not None:
        from belt_fenicsx.lagrangian.nodes import read_positions

        options["mesh"] = read_positions(args.mesh)
    _start_petsc(petsc)
    return functools.partial(solve, **options)


def _start_petsc(petsc: Sequence[str]) -> None:
    """Hands PETSc its options."""
    if find_spec("petsc4py") is None or find_spec("dolfinx") is None:
        raise Missing(f"DOLFINx is needed, but {sys.executable} lacks it; --method bvp runs without.")
    # DOLFINx would take an empty or relative one for a folder here, and load code from it.
    if not os.path.isabs(os.environ.get(CACHE_VARIABLE, os.sep)):
        del os.environ[CACHE_VARIABLE]
    with interrupts.defer():
        import petsc4py

        # PETSc reads its options when it starts, which is when DOLFINx is imported. A closed pipe is for Python to
        # notice.
        petsc4py.init([PROGRAM, "-no_signal_handler", *petsc])


def check_used(petsc: Sequence[str], solution: Solution) -> None:
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
