"""Options of PETSc's solvers: where they come from, and which goes first."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from petsc4py import PETSc

PREFIX = "belt_"


def set_options(solver: PETSc.SNES, defaults: Mapping[str, Any], options: Mapping[str, Any] | None) -> None:
    """Options of a solver: built-in defaults < the caller's < the command line's.

    The options database is global: what was put there for this solver is taken out again.
    """
    from petsc4py import PETSc

    database = PETSc.Options()
    wanted = {PREFIX + key: value for key, value in {**defaults, **(options or {})}.items()}
    added = [key for key in wanted if not database.hasName(key)]
    for key in added:
        database[key] = wanted[key]
    solver.setOptionsPrefix(PREFIX)
    solver.setFromOptions()
    for key in added:
        database.delValue(key)
