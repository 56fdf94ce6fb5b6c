"""Values of the command line's arguments, checked as far as no scene and no numerics are needed."""

from __future__ import annotations

import argparse
import itertools
import math
import os
import re
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from belt_fenicsx.command.process import Missing
from belt_fenicsx.scene.checks import SceneError, Verbatim
from belt_fenicsx.scene.file import parse_assignment, parse_value

PLOT_SUFFIXES = (".pdf", ".png", ".svg")
POSITION_SUFFIXES = (".txt", ".csv", ".npy")  # others need meshio
SIDE_FILE = ".part.0000"  # the longest ending that a side file adds to a name
MOST_VALUES = 1_000_000


def convert(args: argparse.Namespace) -> None:
    """Puts values in place of the arguments' texts.

    Raises:
        SceneError: A value cannot be meant.
        Missing: Something is not installed.
    """
    args.set = _assignments(args.set)
    args.rtol = _rtol(args.rtol)
    if args.elements is not None:
        args.elements = _elements(args.elements)
    if args.mesh is not None:
        args.mesh = _mesh(Path(args.mesh), args)
    if "over" in args:
        args.over, args.values = _grid(args.over, args.set)
    if "plot" in args and args.plot is not None:
        args.plot = _plot(Path(args.plot))
    if "out" in args and args.out is not None:
        args.out = (_table if "over" in args else _out)(Path(args.out))
    if "progress" in args and args.progress and find_spec("tqdm") is None:
        raise Missing("--progress needs tqdm, which this Python lacks.")


def _assignments(texts: Sequence[str]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for path, value in map(parse_assignment, texts):
        if path in values:
            raise SceneError(path, "be set once", Verbatim(f"{values[path]!r} and {value!r}"))
        values[path] = value
    return values


def _grid(texts: Sequence[str], assigned: Mapping[str, Any]) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
    """The paths of a sweep, and all combinations of their values."""
    ranges: dict[str, list[Any]] = {}
    for path, values in map(_range, texts):
        if path in ranges or path in assigned:
            raise SceneError(path, "be set or swept over once", Verbatim("both" if path in assigned else "twice"))
        ranges[path] = values
    if (count := math.prod(map(len, ranges.values()))) > MOST_VALUES:
        raise SceneError("--over", f"lead to at most {MOST_VALUES} scenes", count)
    return tuple(ranges), list(itertools.product(*ranges.values()))


def _range(text: str) -> tuple[str, list[Any]]:
    """The path and the values of a sweep, from ``path=first:last:count`` or ``path=value,value,...``."""
    path, _, values = (part.strip() for part in text.partition("="))
    expected = "read PATH=FIRST:LAST:COUNT or PATH=VALUE,VALUE,... as in pulleys.0.x_trans=-0.2:0.2:41"
    if not path or not values:
        raise SceneError("--over", expected, text)
    if ":" not in values:
        return path, [parse_value(path, value.strip()) for value in values.split(",")]
    try:
        first, last, count = values.split(":")
        ends, number = (float(first), float(last)), int(count)
    except ValueError:
        raise SceneError("--over", expected, text) from None
    if not 2 <= number <= MOST_VALUES:
        raise SceneError("--over", f"have a COUNT from 2 to {MOST_VALUES}", number)
    last_index = number - 1
    return path, [(ends[0] * (last_index - index) + ends[1] * index) / last_index for index in range(number)]


def _rtol(text: str) -> float:
    """The tolerance; its range is the method's matter."""
    try:
        return float(text)
    except ValueError:
        raise SceneError("--rtol", "be a number [-]", text) from None


def _elements(text: str) -> int:
    if not re.fullmatch(r"[1-9][0-9]{0,8}", text):
        raise SceneError("--elements", "be a whole number above zero", text)
    return int(text)


def _mesh(path: Path, args: argparse.Namespace) -> Path:
    if args.method != "augmented-lagrangian":
        expected = "come with --method augmented-lagrangian, the only one with nodes that stay"
        raise SceneError("--mesh", expected, Verbatim(args.method or "none"))
    if args.elements is not None:
        raise SceneError("--mesh", "be left out with --elements", Verbatim(path))
    if not os.path.isfile(path):
        raise SceneError("--mesh", "name a file that is there", str(path))
    if path.suffix.lower() not in POSITION_SUFFIXES and find_spec("meshio") is None:
        raise Missing(f"--mesh needs meshio for a file {path.suffix}, which this Python lacks.")
    return path


def _file(path: Path, option: str, suffixes: Sequence[str]) -> Path:
    if path.suffix.lower() not in suffixes:
        raise SceneError(option, f"name a file ending in {', '.join(suffixes)}", str(path))
    if os.path.isdir(path) or not os.access(path.parent, os.W_OK):
        raise SceneError(option, "name a file in a folder that exists and can be written to", str(path))
    _check_name(path.with_name(f"{path.name}{SIDE_FILE}"), option)
    return path


def _check_name(path: Path, option: str) -> None:
    """Refuses a name that no file can have, before anything is computed for it."""
    try:
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:
        raise SceneError(option, "name a file that can be made", Verbatim(getattr(error, "strerror", error))) from None


def _table(path: Path) -> Path:
    return _file(path, "--out", (".csv",))


def _plot(path: Path) -> Path:
    _file(path, "--plot", PLOT_SUFFIXES)
    if find_spec("matplotlib") is None:
        raise Missing("--plot needs Matplotlib, which this Python lacks.")
    return path


def _out(path: Path) -> Path:
    _check_name(path, "--out")
    parent = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise SceneError("--out", "name a folder that can be written to", str(path))
    for package, module in (("meshio", "meshio"), ("tomli-w", "tomli_w")):
        if find_spec(module) is None:
            raise Missing(f"--out needs {package}, which this Python lacks.")
    return path
