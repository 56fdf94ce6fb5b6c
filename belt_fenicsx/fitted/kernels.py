"""Compiled forms, called cell by cell.

Where all cells are alike, a form needs neither a mesh nor functions: UFL's interval and FFCx, which turns a form into
the C function of one cell, are enough. The rest of DOLFINx is made for larger things: loading it, setting up its spaces
and calling its assemblers would take most of the time of a small solve.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import ffcx
import numpy as np
import ufl
from ffcx.codegeneration import jit

from belt_fenicsx.backend.compiling import cached, compiling
from belt_fenicsx.layout.arrays import Array

# Code as fast as that by -O2, in two thirds of its time; without the analysis of value ranges it is a third slower.
COMPILER_FLAGS = ["-O1", "-ftree-vrp", "-g0"]
UNIT_CELL = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])


class Kernel:
    """The C function of a form's cell integral.

    Args:
        form: The compiled form.
        ffi: The interface to it.
    """

    def __init__(self, form: Any, ffi: Any) -> None:
        cell_integrals = form.form_integrals if hasattr(form, "form_integrals") else form.integrals(0)
        self._tabulate, self._ffi = cell_integrals[0].tabulate_tensor_float64, ffi
        # Facets and permutations, of which a cell integral has none.
        self._others = [ffi.NULL] * (len(ffi.typeof(self._tabulate).args) - 4)

    def on(self, tensors: Array, coefficients: Array, constants: Array) -> Callable[[], None]:
        """A function that computes the integral over each cell.

        Args:
            tensors: Where it puts the results, one cell in a row.
            coefficients: Values of all coefficients, one cell in a row.
            constants: Values of the constants.
        """
        tabulate = self._tabulate
        shared = (self._pointer(constants), self._pointer(UNIT_CELL), *self._others)
        cells = [
            (self._pointer(tensor), self._pointer(values), *shared)
            for tensor, values in zip(tensors, coefficients, strict=True)
        ]

        def compute() -> None:
            tensors.fill(0.0)
            for arguments in cells:
                tabulate(*arguments)

        return compute

    def _pointer(self, values: Array) -> Any:
        return self._ffi.from_buffer("double[]", values)


def compiled(*forms: ufl.Form) -> tuple[Kernel, ...]:
    """Compiles forms together, or finds them compiled before.

    Raises:
        NotCompiled: The compiler or the folder fails.
    """

    def compile_into(folder: Path) -> tuple[Any, Any]:
        # What is in the folder is whole: there is nobody to be waited for.
        options = {"cache_dir": folder, "timeout": 1, "cffi_extra_compile_args": COMPILER_FLAGS}
        return jit.compile_forms(list(forms), **options)[:2]

    with compiling():
        key = [ffcx.__version__, *COMPILER_FLAGS, *(form.signature() for form in forms)]
        compiled_forms, module = cached(key, compile_into)
    return tuple(Kernel(form, module.ffi) for form in compiled_forms)
