"""Scenes as TOML files and plain dictionaries, and single values of a scene named by their path.

The names are those of `belt_fenicsx.scene`. A path joins names and indices by dots: ``pulleys.0.friction``. What is
wrong is reported as a `SceneError` that names the field by its whole path.
"""

from __future__ import annotations

import difflib
import functools
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from belt_fenicsx.scene.belt import INERTIA, STIFFNESSES, Belt, StiffnessBelt
from belt_fenicsx.scene.checks import SceneError, Verbatim
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import FITS, Scene

SECTION = ("youngs_modulus", "poisson_ratio", "thickness", "width")

# As in `radius = 0,7`.
DECIMAL_COMMA = re.compile(r"=\s*[-+]?\d+,\d+\s*(#.*)?$", re.MULTILINE)

# A value that is set takes the place of those that say the same thing in another way.
REPLACES = {
    "x_trans": ("omega", "torque", "drag", "slip_angle"),
    "omega": ("x_trans", "slip", "torque", "drag", "slip_angle"),
    "torque": ("x_trans", "slip", "omega", "slip_angle"),
    "slip_angle": ("x_trans", "omega", "torque", "drag"),
    **dict.fromkeys(STIFFNESSES, SECTION),
}
# The same, by whole paths.
REPLACES_AT = {
    "belt.length": ("elongation", "tension"),
    "elongation": ("belt.length", "tension"),
    "tension": ("belt.length", "elongation"),
    "clamps": ("span",),
    "span": ("clamps",),
}

# What is not there unless it is given.
ABSENT: Mapping[str, Any] = {
    "density": 0.0,
    **dict.fromkeys(INERTIA, 0.0),
    "contact_offset": 0.0,
    "curvature": 0.0,
    "side": "right",
    "drag": 0.0,
    "closed": False,
    "gravity": (0.0, 0.0),
}


def load_scene(path: str | PathLike[str]) -> Scene:
    """Reads a scene from a TOML file.

    Args:
        path: The file, with `[belt]`, `[[pulleys]]` and the other names of `Scene`; what is left out has its default.
            `[belt]` holds either the measures of the cross-section or the three stiffnesses.

    Raises:
        SceneError: The file cannot be read, is no TOML, or does not describe a scene.
    """
    return scene_from_dict(read_data(path))


def read_data(path: str | PathLike[str]) -> dict[str, Any]:
    """The plain data of a TOML file, for `scene_from_dict`.

    Raises:
        SceneError: The file cannot be read or is no TOML.
    """
    try:
        content = Path(path).read_bytes()
    except (OSError, ValueError) as error:
        raise SceneError(str(path), "be a readable file", Verbatim(getattr(error, "strerror", None) or error)) from None
    return parse_data(content, str(path))


def parse_data(content: bytes, name: str) -> dict[str, Any]:
    """The plain data of a TOML text, which may begin with a byte-order mark.

    Raises:
        SceneError: It is no TOML; the error names it so.
    """
    try:
        text = content.decode("utf-8-sig")
    except ValueError as error:
        raise SceneError(name, "be a text file in UTF-8", Verbatim(error)) from None
    return _parsed(text, name, "be valid TOML")


def left_out(scene: Scene, data: Mapping[str, Any], given: Iterable[str] = ()) -> dict[str, Any]:
    """What a file does not say of its scene: the defaults that were taken, by their paths.

    They are no error, since not all of them matter to every question, but whoever asks should hear of them.

    Args:
        scene: The scene.
        data: The plain data that it was made of.
        given: Paths whose values came from elsewhere.
    """
    said = {*_leaves(data), *given}
    return {path: value for path, value in _leaves(scene_to_dict(scene)).items() if not _said(path, said)}


def _leaves(data: Any, prefix: str = "") -> dict[str, Any]:
    """The single values of tables and of arrays of tables, by their paths."""
    items = data.items() if isinstance(data, Mapping) else enumerate(data)
    leaves: dict[str, Any] = {}
    for name, value in items:
        nested = isinstance(value, Mapping) or (isinstance(value, list) and any(isinstance(v, Mapping) for v in value))
        leaves |= _leaves(value, f"{prefix}{name}.") if nested else {f"{prefix}{name}": value}
    return leaves


def _said(path: str, said: set[str]) -> bool:
    """Whether a path, or one that leads to it or on from it, is among those that were said."""
    return any(path == other or path.startswith(f"{other}.") or other.startswith(f"{path}.") for other in said)


def scene_from_dict(data: Mapping[str, Any]) -> Scene:
    """Makes a scene from plain data with the names of a scene file.

    Raises:
        SceneError: An unknown name, or a value of the wrong type or out of its range.
    """
    values = dict(table(data, "scene"))
    _check_names(values, _names(Scene), "")
    if "belt" in values:
        values["belt"] = _belt(table(values["belt"], "belt"))
    if "pulleys" in values:
        if not isinstance(values["pulleys"], list | tuple):
            raise SceneError("pulleys", "be an array of tables, each under `[[pulleys]]`", values["pulleys"])
        values["pulleys"] = tuple(_pulley(pulley, f"pulleys.{i}") for i, pulley in enumerate(values["pulleys"]))
    for name in FITS:
        if name in values and "length" in data.get("belt", {}):
            raise SceneError("belt.length", f"be left out beside `{name}`, which fits it", data["belt"]["length"])
    return Scene(**values)


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """The scene as plain data, without what is not given; `scene_from_dict` makes an equal scene of it."""
    data: dict[str, Any] = _plain(scene)
    if not scene.has_span:
        del data["span"]
    if any(name in data for name in FITS):
        del data["belt"]["length"]
    return data


def with_values(scene: Scene, values: Mapping[str, Any]) -> Scene:
    """The scene with some values replaced, all at once.

    A drive (``x_trans``, ``omega``, ``torque`` or ``slip_angle``) takes the place of the former one, stiffnesses take
    the place of the measures of the cross-section, and the belt's ``length``, ``elongation`` and ``tension`` that of
    each other, as do ``span`` and ``clamps``.

    Args:
        scene: The scene to start from; it stays as it is.
        values: New values by path, as in ``{"pulleys.0.friction": 0.3, "span": 0.9}``.

    Raises:
        SceneError: A path leads nowhere, or the new values do not make a scene.
    """
    data = {"gravity": [0.0, 0.0], **scene_to_dict(scene)}
    for path in values:
        parent, name = _parent(data, path)
        beside = path.removesuffix(name)
        others = [f"{beside}{other}" for other in REPLACES.get(name, ())]
        for parent, other in (_parent(data, other) for other in (*others, *REPLACES_AT.get(path, ()))):
            if isinstance(parent, dict):
                parent.pop(other, None)
    for path, value in values.items():
        parent, name = _parent(data, path)
        parent[int(name) if isinstance(parent, list) else name] = value
    return scene_from_dict(data)


def parse_assignment(text: str) -> tuple[str, Any]:
    """Splits ``path=value`` into the path and the value, which is written as in TOML; words need no quotes.

    Raises:
        SceneError: The text is no assignment.
    """
    path, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not value or not re.fullmatch(r"\w+(\.\w+)*", path):
        raise SceneError("--set", "read PATH=VALUE, as in pulleys.0.friction=0.3", text)
    return path, parse_value(path, value)


def parse_value(path: str, value: str) -> Any:
    """The value of a text that is written as in TOML; words need no quotes.

    Raises:
        SceneError: The text is no value; it names the path.
    """
    if re.fullmatch(r"[A-Za-z][A-Za-z_-]*", value) and value not in ("true", "false", "inf", "nan"):
        return value
    expected = "be set to a TOML value, as in 0.3, [0.0, -0.6] or run-off"
    assigned = _parsed(f"value = {value}", path, expected, got=value)
    if list(assigned) != ["value"]:
        raise SceneError(path, expected, value)
    return assigned["value"]


def _parsed(text: str, field: str, expected: str, got: object = None) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    # tomllib lets the limits of Python's integers and of its stack through.
    except (ValueError, RecursionError) as error:
        hint = " (numbers have decimal points)" if DECIMAL_COMMA.search(text) else ""
        raise SceneError(field, f"{expected}{hint}", Verbatim(error) if got is None else got) from None


def table(value: Any, path: str) -> Mapping[str, Any]:
    """Checks that a value of plain data is a table, and returns it."""
    if not isinstance(value, Mapping):
        raise SceneError(path, "be a table of names and values", value)
    return value


def _belt(values: Mapping[str, Any]) -> Belt | StiffnessBelt:
    _check_names(values, {**_names(Belt), **_names(StiffnessBelt)}, "belt.")
    given = [name for name in (*STIFFNESSES, *INERTIA) if name in values]
    if not given:
        return _made(Belt, values, "belt")
    for name in (*SECTION, "density"):
        if name in values:
            raise SceneError(f"belt.{name}", f"be left out beside `belt.{given[0]}`", values[name])
    for name, quantity in STIFFNESSES.items():
        if name not in values:
            raise SceneError(
                f"belt.{name}", f"be given beside `belt.{given[0]}` [{quantity.unit}]", Verbatim("nothing")
            )
    return _made(StiffnessBelt, values, "belt")


def _pulley(values: Any, path: str) -> Pulley:
    _check_names(table(values, path), _names(Pulley), f"{path}.")
    return _made(Pulley, values, path)


def _made(kind: type, values: Mapping[str, Any], path: str) -> Any:
    try:
        return kind(**values)
    except SceneError as error:
        raise error.within(path) from None


@functools.cache
def _names(kind: type) -> dict[str, None]:
    return dict.fromkeys(f.name for f in fields(kind) if f.init)


def _check_names(values: Mapping[str, Any], known: Iterable[str], prefix: str) -> None:
    for name in values:
        if name not in known:
            raise unknown_name(f"{prefix}{name}", name, known)


def unknown_name(path: str, name: object, known: Iterable[str]) -> SceneError:
    """The error for a name that is not one of the known ones; it suggests the nearest."""
    known = list(known)
    near = difflib.get_close_matches(str(name), known, n=1)
    expected = f"be a known name, perhaps `{near[0]}`" if near else f"be one of {', '.join(f'`{k}`' for k in known)}"
    return SceneError(path, expected, name)


def _parent(data: dict[str, Any], path: str) -> tuple[Any, str]:
    """The table or array that holds the value at the path, and the value's name or index in it."""
    *parts, last = path.split(".")
    here: Any = data
    for depth, part in enumerate([*parts, last]):
        if not isinstance(here, dict | list):
            raise SceneError(path, f"end at `{'.'.join(parts[:depth])}`, which is a single value", path)
        if isinstance(here, list) and part not in map(str, range(len(here))):
            raise unknown_name(path, part, map(str, range(len(here))))
        if depth < len(parts):
            if isinstance(here, dict) and part not in here:
                raise unknown_name(path, part, here)
            here = here[int(part)] if isinstance(here, list) else here[part]
    return here, last


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        given = {f.name: getattr(value, f.name) for f in fields(value) if f.init}
        return {name: _plain(item) for name, item in given.items() if item is not None and item != ABSENT.get(name)}
    return [_plain(item) for item in value] if isinstance(value, tuple) else value
