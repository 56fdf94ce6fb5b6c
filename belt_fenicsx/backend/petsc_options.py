"""Options of PETSc's solvers: where they come from, and which goes first."""

from __future__ import annotations

import ctypes
import math
import threading
from collections.abc import Iterable, Mapping
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from belt_fenicsx.scene.checks import SceneError

if TYPE_CHECKING:
    from petsc4py import PETSc

PREFIX = "belt_"

# The database is that of the process.
_one_at_a_time = threading.Lock()


def set_options(solver: PETSc.SNES, defaults: Mapping[str, Any], options: Mapping[str, Any] | None) -> None:
    """Options of a solver: built-in defaults < the caller's < the command line's.

    The options database is global: what was put there for this solver is taken out again.

    Raises:
        SceneError: PETSc does not take the value of one of the caller's options.
    """
    from petsc4py import PETSc

    asked = dict(options or {})
    solver.setOptionsPrefix(PREFIX)
    try:
        _set(solver, {**defaults, **asked})
    except PETSc.Error as error:
        raise _refused(solver, asked.items(), error) from None


def _set(solver: PETSc.SNES, options: Mapping[str, Any]) -> None:
    from petsc4py import PETSc

    with _one_at_a_time:
        database = PETSc.Options()
        added = [key for key in options if not database.hasName(PREFIX + key)]
        try:
            for key in added:
                database[PREFIX + key] = _text(options[key])
            solver.setFromOptions()
        finally:
            for key in added:
                database.delValue(PREFIX + key)


def _text(value: Any) -> Any:
    """A value as PETSc reads it: floats without a point, as C reads a comma for it in some languages."""
    if isinstance(value, float) and math.isfinite(value):
        sign, digits, exponent = Decimal(repr(float(value))).as_tuple()
        return f"{'-' * sign}{''.join(map(str, digits))}e{exponent}"
    return value


def _refused(solver: PETSc.SNES, options: Iterable[tuple[str, Any]], error: Exception) -> Exception:
    """The error that names the option that PETSc does not take; PETSc's own where it takes each of them."""
    from petsc4py import PETSc

    for key, value in options:
        try:
            _set(solver, {key: value})
        except PETSc.Error:
            return SceneError(f"options.{key}", "have a value that PETSc takes", value)
    return error


def unused() -> list[str]:
    """Options with our prefix for which no solver has asked so far, without the prefix."""
    from petsc4py import PETSc

    # petsc4py has no way to ask; its library leads to PETSc's.
    asked_for, library = ctypes.c_int(), ctypes.CDLL(PETSc.__file__)
    left = []
    for name in PETSc.Options(PREFIX).getAll():
        library.PetscOptionsUsed(None, f"{PREFIX}{name}".encode(), ctypes.byref(asked_for))
        if not asked_for.value:
            left.append(name)
    return left
