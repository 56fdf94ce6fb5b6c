"""Results as files: one that is read back whole, and others that other tools read. Each appears whole or not at all."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import platform
import sys
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from belt_fenicsx.fields import QUANTITIES, Array, Fields
from belt_fenicsx.report import as_json
from belt_fenicsx.scene import SceneError
from belt_fenicsx.scene_file import scene_from_dict, scene_to_dict
from belt_fenicsx.solution import Check, Contact, Solution, Stage, Status, Zone

COMPONENTS = {"r": ("x", "y"), "Q": ("Q1", "Q2")}
PACKAGES = ("belt_fenicsx", "numpy", "scipy", "matplotlib")
MODULES = ("dolfinx", "ufl", "petsc4py", "mpi4py")


@contextlib.contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """Gives a path to write to, which takes the place of the wanted one when all is written."""
    partial = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def save(solution: Solution, path: str | Path) -> None:
    """Writes a solution into one NumPy file, from which `load` makes it again.

    What a warm start needs is in the fields; a method's private state is left out.

    Args:
        solution: The solution.
        path: A file that ends in ``.npz``.

    Raises:
        SceneError: The path has another ending.
        OSError: The file cannot be written.
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise SceneError("path", "end in .npz", str(path))
    with replaced(path) as partial, open(partial, "wb") as file:
        np.savez_compressed(file, solution=json.dumps(to_plain(solution)), **_arrays(solution.fields))


def load(path: str | Path) -> Solution:
    """Reads a solution that `save` wrote.

    Raises:
        SceneError: The file is not there or holds something else.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        plain = json.loads(str(arrays.pop("solution")))
        return from_plain(plain, Fields(**arrays) if arrays else None)
    except (OSError, ValueError, KeyError, TypeError, EOFError, BadZipFile) as error:
        if isinstance(error, SceneError):
            raise
        raise SceneError(
            "path", f"name a file that `save` wrote ({type(error).__name__}: {error})", str(path)
        ) from None


def to_plain(solution: Solution) -> dict[str, Any]:
    """The solution without its arrays, as plain data for JSON; `from_plain` makes it again."""
    return {
        "scene": scene_to_dict(solution.scene),
        "method": solution.method,
        "status": solution.status.name,
        "message": solution.message,
        "contacts": [asdict(contact) for contact in solution.contacts],
        "zones": [asdict(zone) for zone in solution.zones],
        "checks": [asdict(check) for check in solution.checks],
        "iterations": solution.iterations,
        "error_estimate": solution.error_estimate,
        "field_errors": dict(solution.field_errors),
        "stages": [asdict(stage) for stage in solution.stages],
        "measures": dict(solution.measures),
    }


def from_plain(plain: Mapping[str, Any], fields_: Fields | None = None) -> Solution:
    """Makes a solution from plain data, with the given fields.

    Raises:
        SceneError: The data hold no scene.
        KeyError: Something is missing in the data.
        TypeError: Something is in the data that does not belong there.
    """
    return Solution(
        scene=scene_from_dict(plain["scene"]),
        method=plain["method"],
        status=Status[plain["status"]],
        message=plain["message"],
        contacts=tuple(_contact(contact) for contact in plain["contacts"]),
        zones=tuple(_zone(zone) for zone in plain["zones"]),
        fields=fields_,
        checks=tuple(Check(**check) for check in plain["checks"]),
        iterations=plain["iterations"],
        error_estimate=plain["error_estimate"],
        field_errors=plain["field_errors"],
        stages=tuple(Stage(**stage) for stage in plain["stages"]),
        measures=plain["measures"],
    )


def _arrays(fields_: Fields | None) -> dict[str, Array]:
    return {} if fields_ is None else {f.name: getattr(fields_, f.name) for f in fields(fields_)}


def _zone(plain: Mapping[str, Any]) -> Zone:
    return Zone(kind=plain["kind"], slip=plain["slip"], sigma=tuple(plain["sigma"]), x=tuple(plain["x"]))


def _contact(plain: Mapping[str, Any]) -> Contact:
    return Contact(**{**plain, "zones": tuple(_zone(zone) for zone in plain["zones"])})


def columns(solution: Solution) -> dict[str, tuple[str, Array]]:
    """The fields as scalar columns: name to unit and values ``(n,)``.

    Raises:
        SceneError: The solution has no fields.
    """
    if solution.fields is None:
        raise SceneError("solution", "have fields to be written", solution.status.name)
    result: dict[str, tuple[str, Array]] = {}
    for name, quantity in QUANTITIES.items():
        values = getattr(solution.fields, name)
        for index, component in enumerate(COMPONENTS.get(name, ())):
            result[component] = (quantity.unit, values[:, index])
        if name not in COMPONENTS:
            result[name] = (quantity.unit, values)
    result["zone"] = ("-", solution.fields.zone)
    return result


def fields_csv(solution: Solution) -> str:
    """The fields as comma-separated values, with units in the header."""
    table = columns(solution)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([f"{name} [{unit}]" for name, (unit, _) in table.items()])
    writer.writerows(zip(*(values.tolist() for _, values in table.values()), strict=True))
    return text.getvalue()


def write_centreline(solution: Solution, path: str | Path) -> None:
    """Writes the deformed centreline as lines with all fields as point data, for ParaView, PyVista and meshio.

    Args:
        solution: A solution with fields.
        path: A file whose ending tells meshio the format: ``.vtu`` or ``.vtk``.
    """
    import meshio

    table = columns(solution)
    points = np.column_stack([table["x"][1], table["y"][1], np.zeros_like(table["x"][1])])
    lines = np.column_stack([np.arange(len(points) - 1), np.arange(1, len(points))])
    data = {name: np.ascontiguousarray(values) for name, (_, values) in table.items() if name not in ("x", "y")}
    with replaced(Path(path)) as partial:
        meshio.Mesh(points, [("line", lines)], point_data=data).write(partial)


def export(solution: Solution, folder: str | Path) -> None:
    """Writes a solution with everything that is needed to compute it again.

    The folder gets ``result.npz``, ``result.json``, ``fields.csv``, ``belt.vtu``, ``scene.toml`` and
    ``versions.json``.

    Args:
        solution: The solution; one without fields leaves out the files of fields.
        folder: The folder, which is made where it is not there yet.
    """
    import tomli_w

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    texts = {
        "scene.toml": tomli_w.dumps(scene_to_dict(solution.scene)),
        "result.json": as_json(solution) + "\n",
        "versions.json": json.dumps(versions(), indent=2) + "\n",
    }
    if solution.fields is not None:
        texts["fields.csv"] = fields_csv(solution)
        write_centreline(solution, folder / "belt.vtu")
    for name, text in texts.items():
        with replaced(folder / name) as partial:
            partial.write_text(text)
    save(solution, folder / "result.npz")


def versions() -> dict[str, str]:
    """Versions of this package and of what computed the result."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            found[name] = version(name)
    found.update({name: sys.modules[name].__version__ for name in MODULES if name in sys.modules})
    return found
