"""Functions in C, for what would be many small calls in Python: compiled once, as forms are, and kept beside them."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

from belt_fenicsx.backend.compiling import cached, compiling

COMPILER_FLAGS = ["-O3", "-g0"]


def library(source: Path, declarations: str) -> Any:
    """A module with the functions ``lib`` of a C file, and the interface ``ffi`` to them.

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
        return cached([*COMPILER_FLAGS, declarations, code], compile_into)
