"""What the command line is asked: its arguments, checked as far as no scene and no numerics are needed."""

from __future__ import annotations

import argparse
import difflib
import itertools
import math
import os
import re
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from belt_fenicsx.scene.checks import METHODS, SceneError, Verbatim
from belt_fenicsx.scene.file import parse_assignment, parse_value

PROGRAM = "belt-fenicsx"
SOLVE, SWEEP, CHECK = COMMANDS = ("solve", "sweep", "check")
PLOT_SUFFIXES = (".pdf", ".png", ".svg")
SOLVERS = ("-snes_", "-ksp_", "-pc_")  # options of PETSc's solvers, of which all here have a prefix
# Those that are asked for most, to suggest one for a name that no solver knows.
KNOWN_OPTIONS = (
    "snes_monitor", "snes_view", "snes_converged_reason", "snes_rtol", "snes_atol", "snes_stol", "snes_max_it",
    "snes_type", "snes_linesearch_type", "snes_linesearch_monitor", "snes_test_jacobian", "ksp_type", "ksp_monitor",
    "ksp_view", "ksp_rtol", "pc_type", "pc_factor_mat_solver_type", "pc_factor_mat_ordering_type",
)  # fmt: skip
POSITION_SUFFIXES = (".txt", ".csv", ".npy")  # others need meshio
SIDE_FILE = ".part.0000"  # the longest ending that a side file adds to a name
MOST_VALUES = 1_000_000

DESCRIPTION = """\
Steady motion of a belt in frictional contact with a rotating pulley.

  belt-fenicsx [solve] [SCENE.toml]              one scene
  belt-fenicsx sweep [SCENE.toml] --over P=V     a table of answers, as comma-separated values; mpirun shares it out
  belt-fenicsx check [SCENE.toml]                the certificates of the answers by two methods, of which one is bvp"""
EPILOG = """\
PETSc options have one dash and pass through, as in -belt_snes_monitor or -log_view.

exit codes: 0 solved and admissible; 1 the result could not be made or written; 2 bad input; 3 did not converge;
4 converged, but not admissible (the result is printed and marked); 130 interrupted (Ctrl-C); 141 the reader of the
output went away; 143 terminated. A sweep or a check has the largest code of its scenes."""


class UsageError(Exception):
    """Arguments that do not parse."""


class Missing(Exception):
    """Something outside of the scene and the solve that keeps the result from the user."""


def information(argv: Sequence[str]) -> str | None:
    """What ``--help`` or ``--version`` ask for, whatever else is asked."""
    if {"-h", "--help"} & {*argv}:
        return _parser(argv[0] if argv[0] in COMMANDS else SOLVE).format_help().rstrip()
    if "--version" in argv:
        from belt_fenicsx.solution.files import versions

        return "\n".join(f"{name} {version}" for name, version in versions().items())
    return None


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> Any:
        raise UsageError(f"{message}\n{self.format_usage().rstrip()}")


def parsed(argv: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
    """Parses the arguments.

    Args:
        argv: Arguments without the program's name.

    Returns:
        The program's own arguments, with checked and converted values, and PETSc's.

    Raises:
        UsageError: The arguments do not parse.
        SceneError: A value cannot be meant.
        Missing: Something is not installed.
    """
    named = bool(argv) and argv[0] in COMMANDS
    if argv and not named:
        _check_command(argv[0])
    command = argv[0] if named else SOLVE
    own, petsc = split(argv[1:] if named else argv, command)
    args = _parser(command).parse_args(own)
    args.command = command
    args.set = _assignments(args.set)
    _check_method(args, petsc)
    args.rtol = _rtol(args.rtol)
    args.elements = None if args.elements is None else _elements(args.elements)
    args.mesh = None if args.mesh is None else _mesh(Path(args.mesh), args)
    if command == SWEEP:
        args.over, args.values = _grid(args.over, args.set)
    if getattr(args, "plot", None) is not None:
        args.plot = _plot(Path(args.plot))
    if getattr(args, "out", None) is not None:
        args.out = (_table if command == SWEEP else _out)(Path(args.out))
    if getattr(args, "progress", False) and find_spec("tqdm") is None:
        raise Missing("--progress needs tqdm, which this Python lacks.")
    return args, petsc


def _parser(command: str) -> _Parser:
    parser = _Parser(
        prog=PROGRAM if command == SOLVE else f"{PROGRAM} {command}",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
        add_help=False,
    )
    parser.add_argument(
        "scene", nargs="?", metavar="SCENE.toml", help="scene file, - for stdin; without it, the published scene"
    )
    parser.add_argument("--method", metavar="METHOD", help=f"one of {', '.join(METHODS)}")
    parser.add_argument(
        "--rtol", metavar="R", default="1e-8", help="relative tolerance of omega (default: %(default)s)"
    )
    parser.add_argument("--elements", metavar="N", help="number of finite elements")
    parser.add_argument(
        "--mesh", metavar="FILE", help="nodes of the method augmented-lagrangian: positions, or lines that meshio reads"
    )
    parser.add_argument(
        "--set", metavar="PATH=VALUE", action="append", default=[], help="replace a value, as in pulleys.0.friction=0.3"
    )
    parser.add_argument("--verbose", action="store_true", help="log the course of the solve to stderr")
    parser.add_argument(
        "--json", action="store_true", help="print JSON, without the arrays; of a sweep, one object in a line a scene"
    )
    parser.add_argument("-h", "--help", action="store_true", help="show this text")
    parser.add_argument("--version", action="store_true", help="show the versions of this program and its libraries")
    if command == SOLVE:
        parser.add_argument("--plot", metavar="FILE", help=f"draw the solution; {', '.join(PLOT_SUFFIXES)}")
        parser.add_argument("--out", metavar="DIR", help="write result, fields, scene and versions into a folder")
    if command == SWEEP:
        parser.add_argument(
            "--over",
            metavar="PATH=VALUES",
            action="append",
            required=True,
            help="the value to change: FIRST:LAST:COUNT, or values with commas, as in pulleys.0.x_trans=-0.2:0.2:41; "
            "given again, all combinations, of which the last value changes first",
        )
        parser.add_argument(
            "--out", metavar="FILE.csv", help="write the table into a file; a sweep that was stopped goes on from there"
        )
        parser.add_argument(
            "--progress", action="store_true", help="show progress even where stderr is no terminal, as under mpirun"
        )
    return parser


def split(argv: Sequence[str], command: str = SOLVE) -> tuple[list[str], list[str]]:
    """Parts PETSc's options, with their values, from the program's own.

    A PETSc option takes the next argument as its value, as PETSc does it, unless that is a scene file.
    """
    names = {name[2:] for action in _parser(command)._actions for name in action.option_strings if name != "-h"}
    own: list[str] = []
    petsc: list[str] = []
    previous_takes_value = False
    for arg in argv:
        if re.match(r"-[A-Za-z]", arg) and arg != "-h":
            if arg[1:].partition("=")[0] in names:
                raise UsageError(f"`{arg}` must have two dashes, -{arg}")
            if arg.startswith(SOLVERS):
                raise UsageError(f"`{arg}` must have the prefix of this program's solvers, -belt_{arg[1:]}")
            petsc.append(arg)
            previous_takes_value = True
        elif previous_takes_value and not arg.startswith("--") and not arg.endswith(".toml"):
            petsc.append(arg)
            previous_takes_value = False
        else:
            _check_option(arg, names)
            own.append(arg)
            previous_takes_value = False
    return own, petsc


def _check_option(arg: str, names: set[str]) -> None:
    name = arg[2:].partition("=")[0]
    if arg.startswith("--") and name and name not in names:
        near = difflib.get_close_matches(name, names, n=1)
        hint = f"perhaps `--{near[0]}`" if near else f"see {PROGRAM} --help"
        raise UsageError(f"`--{name}` must be a known option, {hint}")


def _assignments(texts: Sequence[str]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for path, value in map(parse_assignment, texts):
        if path in values:
            raise SceneError(path, "be set once", Verbatim(f"{values[path]!r} and {value!r}"))
        values[path] = value
    return values


def _check_command(name: str) -> None:
    """Refuses a first argument that is no file, but nearly a command."""
    near = difflib.get_close_matches(name, COMMANDS, n=1)
    if near and not name.startswith("-") and not os.path.exists(name):
        commands = ", ".join(COMMANDS)
        raise UsageError(f"`{name}` must be a scene file that is there or one of {commands}, perhaps `{near[0]}`")


def _check_method(args: argparse.Namespace, petsc: list[str]) -> None:
    if args.method not in (None, *METHODS):
        raise SceneError("--method", f"be one of {', '.join(METHODS)}", args.method)
    if args.method == "bvp":
        if args.elements is not None:
            raise SceneError(
                "--elements", "be left out with the method bvp, which has no elements", Verbatim(args.elements)
            )
        if petsc:
            raise SceneError(petsc[0], "be left out with the method bvp, which runs without PETSc", Verbatim(petsc[0]))


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
