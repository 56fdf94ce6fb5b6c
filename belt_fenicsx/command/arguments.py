"""What the command line is asked: its commands and options, and PETSc's."""

from __future__ import annotations

import argparse
import difflib
import os
import re
from collections.abc import Sequence
from typing import Any

from belt_fenicsx.command.output import PROGRAM
from belt_fenicsx.command.process import UsageError
from belt_fenicsx.command.values import PLOT_SUFFIXES, convert
from belt_fenicsx.scene.checks import METHODS, SceneError, Verbatim

SOLVE, SWEEP, CHECK = COMMANDS = ("solve", "sweep", "check")
WITHOUT_PETSC = ("bvp", "string")
SOLVERS = ("-snes_", "-ksp_", "-pc_")  # options of PETSc's solvers, of which all here have a prefix
DESCRIPTION = """\
Steady motion of a belt in frictional contact with rotating pulleys.

  belt-fenicsx [solve] [SCENE.toml]              one scene
  belt-fenicsx sweep [SCENE.toml] --over P=V     a table of answers, as comma-separated values; mpirun shares it out
  belt-fenicsx check [SCENE.toml]                the certificates of the answers by two methods, of which one is bvp;
                                                 where there is more than one pulley below a belt without loads,
                                                 the other is string, the limit without bending"""
EPILOG = """\
PETSc options have one dash and pass through, as in -belt_snes_monitor or -log_view.

exit codes: 0 solved and admissible; 1 the result could not be made or written; 2 bad input; 3 did not converge;
4 converged, but not admissible (the result is printed and marked); 130 interrupted (Ctrl-C); 141 the reader of the
output went away; 143 terminated. A sweep or a check has the largest code of its scenes."""


def _value(metavar: str, text: str, **how: Any) -> dict[str, Any]:
    return {"metavar": metavar, "help": text, **how}


def _flag(text: str) -> dict[str, Any]:
    return {"action": "store_true", "help": text}


# What argparse is told of the options of all commands, and of those of one alone.
OPTIONS = {
    "--method": _value("METHOD", f"one of {', '.join(METHODS)}; by default, the first"),
    "--rtol": _value("R", "relative tolerance of omega (default: %(default)s)", default="1e-8"),
    "--elements": _value("N", "number of finite elements"),
    "--mesh": _value("FILE", "nodes of the method augmented-lagrangian: positions, or lines that meshio reads"),
    "--set": _value("PATH=VALUE", "replace a value, as in pulleys.0.friction=0.3", action="append", default=[]),
    "--verbose": _flag("log the course of the solve to stderr"),
    "--json": _flag("print JSON, without the arrays; of a sweep, one object in a line a scene"),
    "--help": _flag("show this text, as -h does"),
    "--version": _flag("show the versions of this program and its libraries"),
}
RANGE = """the value to change: FIRST:LAST:COUNT, or values with commas, as in pulleys.0.x_trans=-0.2:0.2:41; given
again, all combinations, of which the last value changes first"""
OWN_OPTIONS = {
    SOLVE: {
        "--plot": _value("FILE", f"draw the solution; {', '.join(PLOT_SUFFIXES)}"),
        "--out": _value("DIR", "write result, fields, scene and versions into a folder"),
    },
    SWEEP: {
        "--over": _value("PATH=VALUES", RANGE, action="append", required=True),
        "--out": _value("FILE.csv", "write the table into a file; a sweep that was stopped goes on from there"),
        "--progress": _flag("show progress even where stderr is no terminal, as under mpirun"),
    },
    CHECK: {},
}


class _Parser(argparse.ArgumentParser):
    def __init__(self, command: str) -> None:
        super().__init__(
            prog=PROGRAM if command == SOLVE else f"{PROGRAM} {command}",
            description=DESCRIPTION,
            epilog=EPILOG,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
            add_help=False,
        )
        scene = "scene file, - for stdin; without it, the published scene"
        self.add_argument("scene", nargs="?", metavar="SCENE.toml", help=scene)
        for name, how in _options(command).items():
            self.add_argument(name, **how)

    def error(self, message: str) -> Any:
        raise UsageError(f"{message}\n{self.format_usage().rstrip()}")


def _options(command: str) -> dict[str, dict[str, Any]]:
    return {**OPTIONS, **OWN_OPTIONS[command]}


def information(argv: Sequence[str]) -> str | None:
    """What ``--help`` or ``--version`` ask for, whatever else is asked."""
    if {"-h", "--help"} & {*argv}:
        return _Parser(argv[0] if argv[0] in COMMANDS else SOLVE).format_help().rstrip()
    if "--version" in argv:
        from belt_fenicsx.solution.files import versions

        return "\n".join(f"{name} {version}" for name, version in versions().items())
    return None


def parse_arguments(argv: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
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
    args = _Parser(command).parse_args(own)
    args.command = command
    _check_method(args, petsc)
    convert(args)
    return args, petsc


def split(argv: Sequence[str], command: str = SOLVE) -> tuple[list[str], list[str]]:
    """Parts PETSc's options, with their values, from the program's own.

    A PETSc option takes the next argument as its value, as PETSc does it, unless that is a scene file.
    """
    names = {name[2:] for name in _options(command)}
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


def _check_command(name: str) -> None:
    """Refuses a first argument that is no file, but nearly a command."""
    near = difflib.get_close_matches(name, COMMANDS, n=1)
    if near and not name.startswith("-") and not os.path.exists(name):
        commands = ", ".join(COMMANDS)
        raise UsageError(f"`{name}` must be a scene file that is there or one of {commands}, perhaps `{near[0]}`")


def _check_method(args: argparse.Namespace, petsc: list[str]) -> None:
    if args.method not in (None, *METHODS):
        raise SceneError("--method", f"be one of {', '.join(METHODS)}", args.method)
    if args.method in WITHOUT_PETSC:
        check_unused(args.method, args, petsc)


def check_unused(method: str, args: argparse.Namespace, petsc: Sequence[str]) -> None:
    """Refuses what a method without elements and without PETSc has no use for.

    Raises:
        SceneError: It was given.
    """
    if args.elements is not None:
        expected = f"be left out with the method {method}, which has no elements"
        raise SceneError("--elements", expected, Verbatim(args.elements))
    if petsc:
        expected = f"be left out with the method {method}, which runs without PETSc"
        raise SceneError(petsc[0], expected, Verbatim(petsc[0]))
