"""Functions in C, for what would be many small calls in Python: compiled once, as forms are, and kept beside them."""

from __future__ import annotations

import functools
import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from belt_fenicsx.backend.compiling import cached, compiling

if TYPE_CHECKING:
    from belt_fenicsx.layout.arrays import Array

COMPILER_FLAGS = ["-O3", "-g0"]


@functools.cache
def library(source: Path, declarations: str) -> Any:
    """The functions of a C file, once in a process.

    Args:
        source: The C file.
        declarations: Those of its functions that are called.

    Raises:
        NotCompiled: The compiler or the folder fails.
    """
    name, code = f"_{source.stem}", source.read_text()

    def compile_into(folder: Path) -> Any:
        path = next(folder.glob(f"{name}*.so"), None)
        if path is None:
            from cffi import FFI

            ffi = FFI()
            ffi.cdef(declarations)
            ffi.set_source(name, code, extra_compile_args=COMPILER_FLAGS)
            path = Path(ffi.compile(tmpdir=str(folder)))
        specification = importlib.util.spec_from_file_location(name, path)
        assert specification is not None and specification.loader is not None, "a library can be loaded"
        module = importlib.util.module_from_spec(specification)
        specification.loader.exec_module(module)
        return module

    with compiling():
        return cached([*COMPILER_FLAGS, declarations, code], compile_into).lib


@functools.cache
def interface() -> Any:
    """CFFI's interface to arrays, whatever the library."""
    from cffi import FFI

    return FFI()


def doubles(values: Array) -> Any:
    """An array of floating-point numbers as functions take it; what they write is in the array."""
    return interface().from_buffer("double[]", values)


def integers(values: Array) -> Any:
    """A copy of an array of integers as functions take it."""
    return interface().from_buffer("int32_t[]", np.ascontiguousarray(values, dtype=np.int32))
