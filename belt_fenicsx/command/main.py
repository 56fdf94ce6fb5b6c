"""The command line: reads a scene, solves it, tells the answer. Its arguments: see `arguments`.

Only this subpackage prints, configures logging, or looks at PETSc's options. What a call does not need is not imported:
the BVP runs without FEniCS, PETSc and MPI, a wrong argument without any of the numerics.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import os
import signal
import sys
from collections.abc import Sequence
from types import FrameType

from belt_fenicsx.backend.compiling import NotCompiled
from belt_fenicsx.backend.ranks import on_first
from belt_fenicsx.command.arguments import CHECK, SOLVE, SWEEP, information, parse_arguments
from belt_fenicsx.command.output import complain, complain_of_interrupt, configure_logging, run_report, show
from belt_fenicsx.command.process import (
    Exit,
    Missing,
    Terminated,
    UsageError,
    abort_other_ranks,
    all_ranks,
    own_rank,
    share_code,
)
from belt_fenicsx.command.reports import check_scene, solve_scene, sweep_scenes
from belt_fenicsx.scene.checks import SceneError, Verbatim, printable
from belt_fenicsx.scene.file import left_out, parse_data, read_data, scene_from_dict, with_values
from belt_fenicsx.scene.scene import Scene


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line.

    Args:
        argv: Arguments without the program's name. Without them it is the program, with those of the process, whose
            standard streams and end it then takes care of.

    Returns:
        The exit code, the same on all ranks.
    """
    if argv is not None:
        return _exit_code_of(list(argv))
    _open_standard_streams()
    came: list[KeyboardInterrupt] = []

    def end(number: int, frame: FrameType | None) -> None:
        came.append(Terminated() if number == signal.SIGTERM else KeyboardInterrupt())
        raise came[-1]

    signal.signal(signal.SIGTERM, end)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, end)
    code = _exit_code_of(sys.argv[1:], came)
    # From here on there is nothing to be kept.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    if code in (Exit.INTERRUPTED, Exit.TERMINATED):
        # Other ranks may not be at an end, for which MPI's own end would wait.
        for stream in filter(None, (sys.stdout, sys.stderr)):
            with contextlib.suppress(OSError):
                stream.flush()
        os._exit(code)
    return code


def _exit_code_of(argv: list[str], came: Sequence[KeyboardInterrupt] = ()) -> int:
    """Runs the command line; what is raised becomes a complaint and an exit code.

    Args:
        argv: The arguments.
        came: Interrupts that have come. Compiled modules that are being imported turn them into errors of their own.
    """
    try:
        return _run(argv)
    except (SceneError, UsageError) as error:
        return complain(error, Exit.BAD_INPUT)
    except (Missing, NotCompiled) as error:
        return complain(error, Exit.FAILED)
    except KeyboardInterrupt as error:
        return complain_of_interrupt(error)
    except BrokenPipeError:
        return Exit.NO_READER
    except Exception:  # whatever it is, the other ranks would wait for this one; it is raised again
        if came:
            return complain_of_interrupt(came[-1])
        abort_other_ranks()
        raise


def _open_standard_streams() -> None:
    """Opens closed standard streams on nothing, lest the next file that is opened takes their place."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


def _run(argv: list[str]) -> int:
    text = information(argv)
    if text is not None:
        return run_report(functools.partial(show, text)) if own_rank() == 0 else Exit.SOLVED
    args, petsc = parse_arguments(argv)
    scene = _scene(args)
    configure_logging(args.verbose)
    report = {SOLVE: solve_scene, SWEEP: sweep_scenes, CHECK: check_scene}[args.command](scene, args, petsc)
    return share_code(run_report(report) if own_rank() == 0 else 0)


def _scene(args: argparse.Namespace) -> Scene:
    """The scene that is asked for. What its file leaves out is told, and kept in ``args.left_out``."""
    if args.scene is None:
        args.left_out = None
        return with_values(Scene(), args.set)
    data = parse_data(_standard_input(), "-") if args.scene == "-" else read_data(args.scene)
    scene = with_values(scene_from_dict(data), args.set)
    args.left_out = left_out(scene, data, [*args.set, *(args.over if args.command == SWEEP else ())])
    if args.left_out:
        values = ", ".join(f"{path} = {value}" for path, value in args.left_out.items())
        complain(printable(f"{args.scene} leaves out what the published scene has: {values}."), Exit.SOLVED)
    return scene


def _standard_input() -> bytes:
    """What comes in at the first rank, on all ranks."""
    ranks = all_ranks()
    if sys.stdin is None:
        raise SceneError("-", "be an open standard input", Verbatim("a closed one"))
    return sys.stdin.buffer.read() if ranks is None else on_first(ranks, sys.stdin.buffer.read)
