"""Results as files: one that is read back whole, and others that other tools read. Each appears whole or not at all."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import platform
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, fields
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import ZipFile

import numpy as np

from belt_fenicsx.backend.atomic import replaced
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.checks import SceneError, Verbatim
from belt_fenicsx.scene.file import scene_from_dict, scene_to_dict, table
from belt_fenicsx.solution.certificate import Check
from belt_fenicsx.solution.contact import Contact, Zone
from belt_fenicsx.solution.fields import DERIVED, QUANTITIES, Fields
from belt_fenicsx.solution.piecewise import Piecewise
from belt_fenicsx.solution.stages import Stage
from belt_fenicsx.solution.status import Status
from belt_fenicsx.solution.summary import as_json

if TYPE_CHECKING:
    from belt_fenicsx.solution.solution import Solution

EVALUATOR = "evaluator."  # before the names of what knows the fields between points
COMPONENTS = {"r": ("x", "y"), "Q": ("Q1", "Q2")}
# What plain data hold for the annotations of a solution's parts.
PLAIN: Mapping[str, Any] = {
    "str": str,
    "int": int,
    "float": float | int,
    "int | None": int | None,
    "Slip | None": str | None,
}
PARTS: Mapping[str, Any] = {"Zone": Zone, "Contact": Contact, "Check": Check, "Stage": Stage}
PACKAGES = ("belt_fenicsx", "numpy", "scipy", "matplotlib")
MODULES = ("dolfinx", "ufl", "petsc4py", "mpi4py")


def save(solution: Solution, path: str | Path) -> None:
    """Writes a solution into one NumPy file, from which `load` makes it again.

    What a warm start needs is in the fields; of a method's private state, what knows the fields between points is kept.

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
    arrays = _arrays(solution)
    text = json.dumps({**to_plain(solution), "arrays": [*arrays]})
    with replaced(path) as partial, open(partial, "wb") as file:
        np.savez_compressed(file, solution=text, **arrays)


def load(path: str | Path) -> dict[str, Any]:
    """Reads what `save` wrote, as arguments of a solution.

    Raises:
        SceneError: The file is not there, is damaged or holds something else.
    """
    try:
        with ZipFile(path) as archive:
            # NumPy reads no further than the end of an array, which is before its checksum is compared.
            if (damaged := archive.testzip()) is not None:
                raise SceneError(damaged, "be as it was written", Verbatim("other bytes"))
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        plain = json.loads(str(arrays.pop("solution")))
        # The list of an archive's members has no checksum: what it leaves out looks as if it had not been there.
        if arrays.keys() != set(plain["arrays"]):
            raise SceneError(
                "arrays", f"be {', '.join(plain['arrays']) or 'none'}", Verbatim(", ".join(arrays) or "none")
            )
        between = {name: arrays.pop(name) for name in [*arrays] if name.startswith(EVALUATOR)}
        arguments = from_plain(plain, _fields(arrays) if arrays else None)
        if between:
            named = {name.removeprefix(EVALUATOR): values for name, values in between.items()}
            pulleys, rate = tuple(zone.pulley for zone in arguments["zones"]), arguments["transport_rate"]
            arguments["evaluator"] = Piecewise.from_arrays(arguments["scene"], pulleys, rate, named)
        return arguments
    except Exception as error:  # damaged archives, arrays and texts fail in many ways in Python's and NumPy's readers
        why = str(error) if isinstance(error, SceneError) else f"{type(error).__name__}: {error}"
        raise SceneError("path", f"name a file that `save` wrote ({why})", str(path)) from None


def _fields(arrays: Mapping[str, Array]) -> Fields:
    """Fields from the arrays of a file.

    Raises:
        SceneError: An array is missing, is none of the fields or has another shape than theirs.
    """
    names = [f.name for f in fields(Fields)]
    if set(arrays) != set(names):
        raise SceneError("fields", f"be {', '.join(names)}", Verbatim(", ".join(sorted(arrays))))
    count = arrays["sigma"].size
    for name in names:
        shape, kind = (count, 2) if name in COMPONENTS else (count,), "i" if name == "zone" else "f"
        if arrays[name].shape != shape or arrays[name].dtype.kind != kind:
            found = Verbatim(f"{arrays[name].dtype} of shape {arrays[name].shape}")
            raise SceneError(f"fields.{name}", f"hold numbers of shape {shape}", found)
    return Fields(**arrays)


def to_plain(solution: Solution) -> dict[str, Any]:
    """The solution without its arrays, as plain data for JSON, from which `from_plain` reads it again."""
    return {
        "scene": scene_to_dict(solution.scene),
        "method": solution.method,
        "status": solution.status.name,
        "message": solution.message,
        "hints": list(solution.hints),
        "transport_rate": solution.transport_rate,
        "contacts": [asdict(contact) for contact in solution.contacts],
        "zones": [asdict(zone) for zone in solution.zones],
        "checks": [asdict(check) for check in solution.checks],
        "iterations": solution.iterations,
        "error_estimate": solution.error_estimate,
        "field_errors": dict(solution.field_errors),
        "stages": [asdict(stage) for stage in solution.stages],
        "measures": dict(solution.measures),
    }


def from_plain(plain: Any, fields_: Fields | None = None) -> dict[str, Any]:
    """Arguments of a solution from plain data, with the given fields.

    Raises:
        SceneError: The data hold no solution.
    """
    plain = table(plain, "solution")
    try:
        zones = _read("tuple[Zone, ...]", plain["zones"])
        if fields_ is not None and not np.all((fields_.zone >= 0) & (fields_.zone < len(zones))):
            raise SceneError("fields.zone", f"number {len(zones)} zones", Verbatim("others"))
        return dict(
            scene=scene_from_dict(plain["scene"]),
            method=_read("str", plain["method"]),
            status=Status[_read("str", plain["status"])],
            message=_read("str", plain["message"]),
            hints=_read("tuple[str, ...]", plain["hints"]),
            transport_rate=_read("float", plain["transport_rate"]),
            contacts=_read("tuple[Contact, ...]", plain["contacts"]),
            zones=zones,
            fields=fields_,
            checks=_read("tuple[Check, ...]", plain["checks"]),
            iterations=_read("int", plain["iterations"]),
            error_estimate=_read("float", plain["error_estimate"]),
            stages=_read("tuple[Stage, ...]", plain["stages"]),
            field_errors=_numbers(plain, "field_errors"),
            measures=_numbers(plain, "measures"),
        )
    except KeyError as error:
        raise SceneError("solution", "have all that belongs to it", Verbatim(f"no {error}")) from None


def _numbers(plain: Mapping[str, Any], name: str) -> dict[str, float]:
    return {key: _read("float", value) for key, value in table(plain[name], name).items()}


def _read(kind: str, value: Any) -> Any:
    """A value of plain data as the annotation of a dataclass wants it.

    Raises:
        SceneError: It is another value.
    """
    if kind in PLAIN:
        if isinstance(value, bool) or not isinstance(value, PLAIN[kind]):
            raise SceneError("solution", f"hold a value of the kind {kind}", value)
        return value
    if kind in PARTS:
        part = table(value, kind)
        if set(part) != {f.name for f in fields(PARTS[kind])}:
            raise SceneError("solution", f"hold what makes a {kind}", Verbatim(", ".join(part) or "nothing"))
        return PARTS[kind](**{f.name: _read(str(f.type), part[f.name]) for f in fields(PARTS[kind])})
    members = kind.removeprefix("tuple[").removesuffix("]").split(", ")
    if not isinstance(value, list | tuple) or (members[-1] != "..." and len(value) != len(members)):
        raise SceneError("solution", f"hold a {kind}", value)
    return tuple(_read(members[0], item) for item in value)


def _arrays(solution: Solution) -> dict[str, Any]:
    at_points = {} if solution.fields is None else {f.name: getattr(solution.fields, f.name) for f in fields(Fields)}
    between = {} if solution.evaluator is None else solution.evaluator.arrays
    return at_points | {f"{EVALUATOR}{name}": values for name, values in between.items()}


def columns(solution: Solution) -> dict[str, tuple[str, Array]]:
    """The fields as scalar columns: name to unit and values ``(n,)``.

    Raises:
        SceneError: The solution has no fields.
    """
    if solution.fields is None:
        raise SceneError("solution", "have fields to be written", solution.status.name)
    result: dict[str, tuple[str, Array]] = {}
    for name, quantity in {**QUANTITIES, **DERIVED}.items():
        values = getattr(solution.fields, name)
        for index, component in enumerate(COMPONENTS.get(name, ())):
            result[component] = (quantity.unit, values[:, index])
        if name not in COMPONENTS:
            result[name] = (quantity.unit, values)
    result["zone"] = ("-", solution.fields.zone)
    return result


def fields_csv(solution: Solution) -> str:
    """The fields as comma-separated values, with units in the header."""
    found = columns(solution)
    header = [f"{name} [{unit}]" for name, (unit, _) in found.items()]
    return as_csv([header, *zip(*(values.tolist() for _, values in found.values()), strict=True)])


def as_csv(rows: Iterable[Sequence[Any]]) -> str:
    """Rows as comma-separated values."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def write_centreline(solution: Solution, path: str | Path) -> None:
    """Writes the deformed centreline as lines with all fields as point data, for ParaView, PyVista and meshio.

    Names have units, without blanks, which the format VTK has not: ``p[N/m]``, ``M[N.m]``.

    Args:
        solution: A solution with fields.
        path: A file whose ending tells meshio the format: ``.vtu`` or ``.vtk``.
    """
    import meshio

    values = columns(solution)
    (_, x), (_, y) = values.pop("x"), values.pop("y")
    points = np.column_stack([x, y, np.zeros_like(x)])
    lines = np.column_stack([np.arange(len(points) - 1), np.arange(1, len(points))])
    data = {f"{name}[{unit.replace(' ', '.')}]": np.ascontiguousarray(array) for name, (unit, array) in values.items()}
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
