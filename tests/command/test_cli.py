"""The command line: what it refuses, what it prints, how it exits."""

import json
import logging
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib import figure
from mpi4py import MPI

from belt_fenicsx import solve
from belt_fenicsx.command import arguments, reports
from belt_fenicsx.command import main as cli
from belt_fenicsx.command.process import own_rank
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution import pictures
from belt_fenicsx.solution.certificate import Check
from belt_fenicsx.solution.contact import Contact, Zone
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stage
from belt_fenicsx.solution.status import Status

serial = pytest.mark.serial
SCENE = str(Path(__file__).parents[2] / "demos" / "one_pulley.toml")

MESH = str(Path(__file__).parents[2] / "meshes" / "graded_100.txt")
FIXED = ("--method", "augmented-lagrangian")


def command(*argv, **kwargs):
    """Runs the command line in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "belt_fenicsx", *argv], stderr=subprocess.PIPE, text=True, timeout=120, **kwargs
    )


# Arguments, and what the complaint must hold: the field, and what was expected.
BAD = [
    (["missing.toml"], "missing.toml", "readable file"),
    (["."], "`.`", "readable file"),
    ([SCENE, SCENE], "unrecognized", "usage"),
    (["--method"], "--method", "expected one argument"),
    (["--method", "magic"], "--method", "fitted, augmented-lagrangian"),
    (["--method="], "--method", "fitted, augmented-lagrangian"),
    (["--rtol", "small"], "--rtol", "number [-]"),
    (["--rtol", ""], "--rtol", "number [-]"),
    (["--rtol"], "--rtol", "expected one argument"),
    (["--elements", "many"], "--elements", "whole number"),
    (["--elements", "0"], "--elements", "whole number"),
    (["--elements", "-10"], "--elements", "whole number"),
    (["--elements", "1.5"], "--elements", "whole number"),
    (["--elements", "1" + "0" * 30], "--elements", "whole number"),
    (["--elements", "10", "--method", "bvp"], "--elements", "left out"),
    (["--mesh", MESH], "--mesh", "come with --method augmented-lagrangian"),
    (["--mesh", MESH, "--method", "bvp"], "--mesh", "come with --method augmented-lagrangian"),
    (["--mesh", MESH, *FIXED, "--elements", "10"], "--mesh", "left out with --elements"),
    (["--mesh", "missing.txt", *FIXED], "--mesh", "a file that is there"),
    (["--mesh", ".", *FIXED], "--mesh", "a file that is there"),
    (["--plot", "figure"], "--plot", ".pdf, .png, .svg"),
    (["--plot", "figure.xyz"], "--plot", ".pdf, .png, .svg"),
    (["--plot", "missing/figure.png"], "--plot", "folder that exists"),
    (["--jsn"], "--jsn", "perhaps `--json`"),
    (["--js"], "--js", "perhaps `--json`"),
    (["--quux"], "--quux", "--help"),
    (["-json"], "-json", "two dashes"),
    (["-rtol", "1e-6"], "-rtol", "two dashes"),
    (["-log_view", "--jsn"], "--jsn", "perhaps `--json`"),
    (["--json=1"], "--json", "usage"),
    (["--method", "bvp", "-belt_snes_monitor"], "-belt_snes_monitor", "without PETSc"),
    (["--set"], "--set", "expected one argument"),
    (["--set", "friction"], "--set", "PATH=VALUE"),
    (["--set", "pulleys.0.friction="], "--set", "PATH=VALUE"),
    (["--set", "pulleys.0.friction=0.3.4"], "pulleys.0.friction", "TOML value"),
    (["--set", "pulleys.0.frictoin=0.3"], "pulleys.0.frictoin", "perhaps `friction`"),
    (["--set", "pulleys.1.friction=0.3"], "pulleys.1.friction", "one of `0`"),
    (["--set", "pulleys.0.friction=-0.3"], "pulleys.0.friction", "zero or positive [-]"),
    (["--set", "belt.thickness=-0.05"], "belt.thickness", "positive [m]"),
    (["--set", "belt.youngs_modulus=nan"], "belt.youngs_modulus", "finite number [Pa]"),
    (["--set", "pulleys.0.radius=0"], "pulleys.0.radius", "positive [m]"),
    (["--set", "pulleys.0.radius=2.0", "--set", "pulleys.0.center.1=-1.9"], "pulleys.0.radius", "clamp"),
    (["--set", "pulleys.0.x_trans=0.9"], "pulleys.0.x_trans", "over the pulley"),
    (["--set", "pulleys.0.omega=1", "--set", "pulleys.0.torque=1"], "pulleys.0.torque", "only drive"),
    (["--set", "span=1", "--set", "span=2"], "span", "set once"),
    (["--set", "span.x=1"], "span.x", "single value"),
    ([SCENE, "--set", "spam=1"], "spam", "perhaps `span`"),
    (["sweep"], "--over", "required"),
    (["sweep", "--over", "pulleys.0.x_trans"], "--over", "FIRST:LAST:COUNT"),
    (["sweep", "--over", "pulleys.0.x_trans=0:1"], "--over", "FIRST:LAST:COUNT"),
    (["sweep", "--over", "pulleys.0.x_trans=0:1:x"], "--over", "FIRST:LAST:COUNT"),
    (["sweep", "--over", "pulleys.0.x_trans=0:1:1"], "--over", "COUNT from 2"),
    (["sweep", "--over", "pulleys.0.friction=0.1,["], "pulleys.0.friction", "TOML value"),
    (["sweep", *2 * ["--over", "pulleys.0.friction=0.1,0.2"]], "pulleys.0.friction", "swept over once"),
    (["sweep", "--over", "span=1,2", "--set", "span=1"], "span", "swept over once"),
    (
        ["sweep", *sum((["--over", f"{p}=1:2:101"] for p in ("span", "belt.length", "belt.width")), [])],
        "--over",
        "1030301",
    ),
    (["swep"], "swep", "perhaps `sweep`"),
    (["chek", "--rtol", "1e-6"], "chek", "perhaps `check`"),
    (["-version"], "-version", "two dashes"),
    (["-snes_monitor"], "-snes_monitor", "prefix of this program's solvers, -belt_snes_monitor"),
    (["--set", "pulleys.0.friction=0,3"], "pulleys.0.friction", "decimal points"),
    (["sweep", "--over", "pulleys.0.friction=0.1,0.2", "--out", "table"], "--out", ".csv"),
    (["sweep", "--over", "pulleys.0.friction=0.1,0.2", "--out", "missing/table.csv"], "--out", "folder that exists"),
    (["check", "--plot", "a.png"], "--plot", "known option"),
]


@serial
@pytest.mark.parametrize(("argv", "field", "expected"), BAD, ids=lambda value: " ".join(value)[:50])
def test_bad_arguments(argv, field, expected, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(reports, "solver", lambda *_: pytest.fail("solved"))
    assert cli.main(argv) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert field in captured.err
    assert expected in captured.err
    assert list(tmp_path.iterdir()) == []


@serial
@pytest.mark.parametrize("argv", [["missing.toml"], ["--rtol", "x"], ["--set", "span=-1"], ["--jsn"], ["a", "b"]])
def test_no_traceback_reaches_the_user(argv):
    result = command(*argv, stdout=subprocess.PIPE)
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr.startswith("belt-fenicsx: ")
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize("method", ["bvp", "augmented-lagrangian"])
@pytest.mark.parametrize("rtol", ["0", "-1e-8", "1", "1e-30", "nan", "inf"])
def test_tolerances_out_of_range(method, rtol, capfd):
    assert cli.main([f"--rtol={rtol}", "--method", method]) == 2
    if own_rank() == 0:
        assert "`rtol` must " in capfd.readouterr().err


def test_bad_input_is_told_once_and_ends_all_ranks(capsys):
    assert cli.main(["--rtol", "x"]) == 2
    assert bool(capsys.readouterr().err) == (own_rank() == 0)


@serial
def test_help(capsys):
    assert cli.main(["--help"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    for code in (
        "0 solved",
        "1 the result",
        "2 bad input",
        "3 did not",
        "4 converged",
        "130 int",
        "141 the",
        "143 term",
    ):
        assert code in out
    assert cli.main(["sweep", "-h", "--quux"]) == 0
    assert "--over" in capsys.readouterr().out


@serial
def test_version(capsys):
    assert cli.main(["--version"]) == 0
    assert {"python", "numpy", "scipy"} <= {line.split()[0] for line in capsys.readouterr().out.splitlines()}


@pytest.mark.parametrize(
    ("argv", "own", "petsc"),
    [
        (["a.toml", "--json"], ["a.toml", "--json"], []),
        (["-log_view", "a.toml"], ["a.toml"], ["-log_view"]),
        (["-belt_snes_rtol", "1e-9", "--json"], ["--json"], ["-belt_snes_rtol", "1e-9"]),
        (["-belt_x", "-3", "--rtol", "1e-6"], ["--rtol", "1e-6"], ["-belt_x", "-3"]),
        (["-log_view", ":log.txt", "-a", "b.toml"], ["b.toml"], ["-log_view", ":log.txt", "-a"]),
        (["--rtol", "-1"], ["--rtol", "-1"], []),
        (["-h"], ["-h"], []),
    ],
)
def test_petsc_options_are_parted(argv, own, petsc):
    assert arguments.split(argv) == (own, petsc)


# What is printed, for solutions that are made up here.


ZONE = Zone(kind="slip", slip="forward", sigma=(-0.2, 0.2), x=(-0.21, 0.21))
CONTACT = Contact(
    pulley=0, omega=1.5, x_up=-0.21, x_trans=0.0, x_off=0.21, torque=610.0, wrap_angle=0.6, center=(0.0, -0.575),
    run_up=(-0.21, 0.09), run_off=(0.21, 0.09), angle_up=0.3, angle_off=-0.3, slip_angle=0.3, hub_force=(10.0, -3e3),
    tension_up=4e3, tension_off=3e3, creep=float("nan"), sliding_loss=3.0, capacity=float("nan"),
    take_up=0.0, zones=(ZONE,),
)  # fmt: skip


@pytest.fixture
def solution():
    return Solution(
        scene=Scene(),
        method="made up",
        status=Status.SOLVED,
        contacts=(CONTACT,),
        zones=(ZONE,),
        iterations=5,
        stages=(
            Stage(name="first", why="it is needed", iterations=5, seconds=0.001),
            Stage(name="next", why="it is not"),
        ),
        measures={"penetration": 1e-12, "undefined": float("nan")},
    )


@pytest.fixture
def answer(monkeypatch):
    """Lets the command line find the given solution, without a solver."""

    def set_answer(solution):
        monkeypatch.setattr(reports, "solver", lambda *_: lambda scene: solution)

    return set_answer


VIOLATION = Check(name="positive pressure in contact", margin=-0.5, tolerance=1e-9, x=0.1)


@serial
@pytest.mark.parametrize(
    ("status", "code", "mark"),
    [
        (Status.SOLVED, 0, None),
        (Status.NOT_ADMISSIBLE, 4, "*** NOT ADMISSIBLE ***"),
        (Status.NEWTON_DIVERGED, 3, "*** NO SOLUTION ***"),
        (Status.MULTIPLIERS_DIVERGED, 3, "*** NO SOLUTION ***"),
        (Status.CONTACT_LOST, 3, "*** NO SOLUTION ***"),
        (Status.NO_CONTACT, 3, "*** NO SOLUTION ***"),
    ],
)
def test_exit_codes_and_marks(status, code, mark, solution, answer, capsys):
    answer(replace(solution, status=status, checks=(VIOLATION,) if code == 4 else ()))
    assert cli.main(["--method", "bvp"]) == code
    out = capsys.readouterr().out
    assert out.startswith(mark or "omega")
    assert status.value in out
    assert ("violated: positive pressure" in out) == (code == 4)


@serial
def test_a_failure_without_any_contact(answer, capsys):
    answer(Solution(scene=Scene(), method="made up", status=Status.CONTACT_LOST, message="The belt is clear."))
    assert cli.main(["--method", "bvp"]) == 3
    assert "The belt is clear." in capsys.readouterr().out
    assert cli.main(["--method", "bvp", "--json"]) == 3
    assert json.loads(capsys.readouterr().out)["omega"] is None


@serial
def test_text(solution, answer, capsys):
    answer(solution)
    cli.main(["--method", "bvp"])
    out = capsys.readouterr().out
    for text in ("1.5 rad/s", "610 N m", "forward slip", "it is needed", "skipped"):
        assert text in out


@serial
def test_json_is_one_object_without_nan(solution, answer, capsys):
    answer(solution)
    assert cli.main(["--method", "bvp", "--json"]) == 0
    result = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert result["omega"] == 1.5
    assert result["success"] is True
    assert result["scene"]["pulleys"][0]["radius"] == 0.7
    assert result["measures"] == {"penetration": 1e-12, "undefined": None}


@serial
def test_interrupted(monkeypatch, capsys):
    def interrupted(scene):
        raise KeyboardInterrupt

    monkeypatch.setattr(reports, "solver", lambda *_: interrupted)
    assert cli.main(["--method", "bvp"]) == 130
    assert capsys.readouterr().err == "belt-fenicsx: interrupted.\n"


@serial
@pytest.mark.parametrize("trouble", [OSError(28, "No space left on device"), KeyboardInterrupt()], ids=repr)
def test_a_plot_that_fails_leaves_the_old_file(trouble, solution, answer, monkeypatch, tmp_path):
    def half_written(self, path, **kwargs):
        Path(path).write_text("half")
        raise trouble

    target = tmp_path / "figure.png"
    target.write_text("old")
    monkeypatch.setattr(figure.Figure, "savefig", half_written)
    monkeypatch.setattr(pictures, "picture", lambda solution, which: figure.Figure())
    answer(replace(solution, fields=object.__new__(Fields)))
    assert cli.main(["--method", "bvp", "--plot", str(target)]) in (1, 130)
    assert [path.name for path in tmp_path.iterdir()] == ["figure.png"]
    assert target.read_text() == "old"


# With the solvers.


@serial
def test_the_published_scene_by_the_bvp(capsys):
    assert cli.main([SCENE, "--method", "bvp", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["omega"] == pytest.approx(1.4807092526, rel=1e-7)
    assert result["method"] == "bvp"


@serial
def test_values_are_set(capsys):
    argv = ["--method", "bvp", "--json", "--set", "pulleys.0.slip=backward", "--set", "transport_rate=2.0"]
    assert cli.main(argv) == 0
    assert json.loads(capsys.readouterr().out)["omega"] == pytest.approx(2.0 * 1.4841983140, rel=1e-7)


@serial
def test_a_transition_outside_of_the_contact_is_bad_input(capsys):
    assert cli.main(["--method", "bvp", "--set", "pulleys.0.x_trans=0.3"]) == 2
    assert "`pulleys.0.x_trans` must lie " in capsys.readouterr().err


@serial
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a full device")
def test_a_full_disk_is_told():
    with open("/dev/full", "w") as full:
        result = command("--method", "bvp", stdout=full)
    assert result.returncode == 1
    assert result.stderr == "belt-fenicsx: the result could not be written: No space left on device.\n"


@serial
@pytest.mark.parametrize("suffix", ["png", "PDF", "svg"])
def test_plot(suffix, tmp_path):
    target = tmp_path / f"figure.{suffix}"
    assert cli.main(["--method", "bvp", "--plot", str(target)]) == 0
    assert [path.name for path in tmp_path.iterdir()] == [target.name]
    assert target.stat().st_size > 1000


@serial
def test_finite_elements_in_a_process_of_their_own():
    result = command("--method", "augmented-lagrangian", "--json", stdout=subprocess.PIPE)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    assert json.loads(result.stdout)["omega"] == pytest.approx(1.4807092526, rel=1e-5)


@serial
@pytest.mark.parametrize("method", ["fitted", "augmented-lagrangian"])
def test_petsc_options_reach_petsc(method):
    options = ("-belt_snes_monitor", "-belt_snes_view", "-log_view")
    result = command("--method", method, *options, stdout=subprocess.PIPE)
    assert result.returncode == 0, result.stderr
    assert all(text in result.stdout for text in ("SNES Function norm", "SNES Object: (belt_)", "SNESSolve"))


def test_finite_elements_print_on_rank_0_and_agree_on_the_code(capfd):
    assert cli.main(["--method", "augmented-lagrangian", "--json"]) == 0
    out = capfd.readouterr().out
    assert ('"omega"' in out) == (own_rank() == 0)


def test_a_mesh_from_a_file(capfd, tmp_path):
    assert cli.main(["--mesh", MESH, *FIXED, "--json"]) == 0
    out = capfd.readouterr().out
    if own_rank() == 0:
        assert json.loads(out)["omega"] == pytest.approx(1.4807092526, rel=1e-6)
    assert cli.main(["--mesh", MESH, *FIXED, "--set", "belt.length=1.01"]) == 2
    err = capfd.readouterr().err
    if own_rank() == 0:
        assert "`mesh` must cover the belt, [-0.505, 0.505] [m], got [-0.5, 0.5]" in err


@pytest.mark.parametrize(
    ("method", "logger", "line"),
    [
        ("fitted", "fitted.newton", r"iteration 0: residual \S+, step \S+, joints -0\.2\d+ \S+ 0\.2\d+ Ls"),
        (
            "augmented-lagrangian",
            "lagrangian.loop",
            r"25 elements, update 1, Newton iterations \d+: residual \S+, step \S+, penetration \S+, "
            r"multiplier change \S+, contact from -0\.2\d+ to 0\.2\d+ Ls",
        ),
    ],
)
def test_verbose_tells_the_course_of_the_solve(method, logger, line, caplog):
    solve(Scene(), method=method)
    assert caplog.messages == []
    caplog.set_level(logging.INFO, logger="belt_fenicsx")
    solve(Scene(), method=method)
    told = [record.getMessage() for record in caplog.records if record.name == f"belt_fenicsx.{logger}"]
    assert bool(told) == (method == "fitted" or own_rank() == 0)
    assert all(re.fullmatch(line, text) for text in told[:1])


@serial
def test_sweep_is_a_table_with_units(capsys):
    assert cli.main(["sweep", "--method", "bvp", "--over", "pulleys.0.x_trans=-0.1:0.1:3"]) == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert head.startswith("pulleys.0.x_trans,omega [rad/s],x_up [m]")
    assert [row.split(",")[0] for row in rows] == ["-0.1", "0.0", "0.1"]
    assert float(rows[1].split(",")[1]) == pytest.approx(1.4807092526, rel=1e-8)


def test_sweep_over_ranks_writes_its_table_once(capfd, tmp_path):
    table = MPI.COMM_WORLD.bcast(tmp_path, root=0) / "table.csv"
    argv = ["sweep", "--method", "bvp", "--rtol", "1e-4", "--over", "pulleys.0.x_trans=-0.1:0.1:5", "--out", str(table)]
    assert cli.main(argv) == 0
    out, err = capfd.readouterr()
    assert out == (f"{table}: 5 scenes, 5 solved\n" if own_rank() == 0 else "")
    assert err == ""
    assert len(table.read_text().splitlines()) == 6


@serial
def test_progress_is_shown_where_it_is_asked_for(capfd):
    argv = ["sweep", "--method", "bvp", "--rtol", "1e-4", "--over", "pulleys.0.x_trans=-0.1,0.1", "--progress"]
    assert cli.main(argv) == 0
    assert "2/2" in capfd.readouterr().err


@serial
def test_a_table_that_cannot_be_written_is_no_crash(capfd, tmp_path):
    (tmp_path / "table.csv.part.0").mkdir()
    argv = ["sweep", "--method", "bvp", "--over", "pulleys.0.x_trans=0,0.1", "--out", str(tmp_path / "table.csv")]
    assert cli.main(argv) == 1
    assert "could not be written: Is a directory" in capfd.readouterr().err


@serial
def test_an_interrupted_sweep_exits_non_zero_and_keeps_its_rows(tmp_path):
    table = tmp_path / "table.csv"
    argv = ["sweep", "--method", "bvp", "--over", "pulleys.0.x_trans=-0.2:0.2:5000", "--out", str(table)]
    process = subprocess.Popen(
        [sys.executable, "-m", "belt_fenicsx", *argv],
        stderr=subprocess.PIPE,
        text=True,
        # A test run in the background has been told to ignore it.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    side = tmp_path / "table.csv.part.0"
    for _ in range(600):
        if side.exists() and side.stat().st_size > 10_000:
            break
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    assert "interrupted" in process.communicate(timeout=60)[1]
    assert process.returncode == 130
    assert side.stat().st_size > 10_000
    assert not table.exists()


@serial
@pytest.mark.parametrize(
    ("over", "complaint"),
    [("belt.thicknes=0.1,0.2", "perhaps `thickness`"), ("belt.thickness=0.1:-0.1:3", "positive [m], got 0.0")],
)
def test_sweep_refuses_bad_values_before_it_starts(over, complaint, capsys):
    assert cli.main(["sweep", "--method", "bvp", "--over", over]) == 2
    out, err = capsys.readouterr()
    assert complaint in err
    assert out == ""


@serial
def test_check_prints_both_certificates(capsys):
    assert cli.main(["check", "--method", "bvp"]) == 0
    out = capsys.readouterr().out
    assert out.count("Coulomb's bound in stick") == 2
    assert "bvp: Solved" in out and "fitted: Solved" in out
    (difference,) = re.findall(r"relative difference of omega (\S+)", out)
    assert 0.0 < abs(float(difference)) < 1e-7


GRID = ["sweep", "--method", "bvp", "--rtol", "1e-4"]
GRID += ["--over", "pulleys.0.friction=0.1,0.2", "--over", "pulleys.0.x_trans=-0.1:0.1:3"]


@serial
def test_several_ranges_are_a_grid(capsys):
    assert cli.main(GRID) == 0
    head, *rows = (line.split(",") for line in capsys.readouterr().out.splitlines())
    assert head[:3] == ["pulleys.0.friction", "pulleys.0.x_trans", "omega [rad/s]"]
    pairs = [("0.1", "-0.1"), ("0.1", "0.0"), ("0.1", "0.1"), ("0.2", "-0.1"), ("0.2", "0.0"), ("0.2", "0.1")]
    assert [tuple(row[:2]) for row in rows] == pairs
    assert len({row[2] for row in rows}) == 6
    assert float(rows[4][2]) == pytest.approx(1.4807092526, rel=1e-6)


@serial
def test_a_sweep_in_json_is_an_object_in_a_line(capsys, tmp_path):
    assert cli.main([*GRID, "--json"]) == 0
    rows = [json.loads(line, parse_constant=pytest.fail) for line in capsys.readouterr().out.splitlines()]
    assert rows[4]["values"] == {"pulleys.0.friction": 0.2, "pulleys.0.x_trans": 0.0}
    assert rows[4]["omega"] == pytest.approx(1.4807092526, rel=1e-6)
    assert cli.main([*GRID, "--json", "--out", str(tmp_path / "table.csv")]) == 0
    assert json.loads(capsys.readouterr().out) == {"table": str(tmp_path / "table.csv"), "scenes": 6, "solved": 6}


@serial
def test_rows_are_told_as_they_are_found(monkeypatch):
    told = []

    def solver(scene, *, initial, throw):
        told.append("solve")
        return Solution(scene=scene, method="made up", status=Status.SOLVED, contacts=(CONTACT,))

    monkeypatch.setattr(reports, "solver", lambda *_: solver)
    monkeypatch.setattr(reports, "show", told.append)
    cli.main(["sweep", "--over", "pulleys.0.x_trans=0,0.1"])
    assert [text.split(",")[0] for text in told] == ["solve", "pulleys.0.x_trans", "solve", "0.1"]
    assert "\n0," in told[1]


def test_rows_of_all_ranks_are_told_in_their_order(capfd):
    argv = ["sweep", "--method", "bvp", "--rtol", "1e-4", "--over", "pulleys.0.x_trans=-0.1:0.1:3"]
    assert cli.main(argv) == 0
    out = capfd.readouterr().out
    values = ["pulleys.0.x_trans", "-0.1", "0.0", "0.1"] if own_rank() == 0 else []
    assert [line.split(",")[0] for line in out.splitlines()] == values


@serial
def test_check_in_json(capsys):
    assert cli.main(["check", SCENE, "--json"]) == 0
    result = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert [solution["method"] for solution in result["solutions"]] == ["fitted", "bvp"]
    assert all(check["holds"] for solution in result["solutions"] for check in solution["checks"])
    assert abs(result["relative_difference_of_omega"]) < 1e-7
    assert result["left_out"] == {} and result["scene"]["span"] == 1.0


@serial
@pytest.mark.parametrize("asked", [[], ["--json"]])
def test_what_a_file_leaves_out_is_told(asked, capsys, tmp_path):
    (tmp_path / "scene.toml").write_text(Path(SCENE).read_text().replace("width = ", "# ").replace("span = ", "# "))
    assert cli.main([str(tmp_path / "scene.toml"), "--method", "bvp", "--set", "span=1.0", *asked]) == 0
    out, err = capsys.readouterr()
    assert err == f"belt-fenicsx: {tmp_path}/scene.toml leaves out what the published scene has: belt.width = 0.1.\n"
    assert not asked or json.loads(out)["left_out"] == {"belt.width": 0.1}


@serial
def test_a_scene_from_standard_input():
    text = Path(SCENE).read_text().replace("transport_rate = 1.0", "transport_rate = 2.0")
    result = command("-", "--method", "bvp", "--json", input=text, stdout=subprocess.PIPE)
    assert (result.returncode, result.stderr) == (0, "")
    assert json.loads(result.stdout)["omega"] == pytest.approx(2.0 * 1.4807092526, rel=1e-7)
    result = command("-", "--method", "bvp", input="spam = 1", stdout=subprocess.PIPE)
    assert result.returncode == 2 and "`spam` must" in result.stderr


@serial
def test_a_picture_that_cannot_be_drawn_is_told(answer, capsys, tmp_path):
    answer(Solution(scene=Scene(), method="made up", status=Status.CONTACT_LOST))
    assert cli.main(["--plot", str(tmp_path / "a.png")]) == 3
    assert f"{tmp_path}/a.png was not drawn" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@serial
@pytest.mark.parametrize("method", ["fitted", "augmented-lagrangian"])
@pytest.mark.parametrize(("name", "complaint"), [("mnitor", "perhaps `-belt_snes_monitor`"), ("max_it 50", None)])
def test_petsc_options_that_nobody_asks_for_are_named(method, name, complaint):
    result = command("--method", method, *f"-belt_snes_{name}".split(), stdout=subprocess.PIPE)
    assert result.returncode == (2 if complaint else 0)
    if complaint:
        expected = f"`-belt_snes_{name}` must be an option of the solvers of the method {method}, {complaint}"
        assert expected in result.stderr and "rad" not in result.stdout


@serial
def test_a_misspelt_option_leaves_no_rows(tmp_path):
    argv = ["sweep", "--over", "pulleys.0.x_trans=0,0.1", "--out", str(tmp_path / "table.csv"), "--rtol", "1e-4"]
    assert command(*argv, "-belt_snes_mnitor", stdout=subprocess.PIPE).returncode == 2
    assert command(*argv, stdout=subprocess.PIPE).returncode == 0
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]


@serial
@pytest.mark.parametrize("argv", [("--method", "bvp"), ("--help",), ("--version",), tuple(GRID)], ids=" ".join)
@pytest.mark.parametrize(
    ("redirected", "code", "complaint"),
    [
        (">/dev/full", 1, "belt-fenicsx: the result could not be written: No space left on device.\n"),
        (">&-", 1, "belt-fenicsx: the result could not be written: standard output is closed.\n"),
        ("| true", 141, ""),
        (">&- 2>&-", 1, ""),
    ],
)
def test_an_output_that_takes_nothing(argv, redirected, code, complaint):
    script = 'set -o pipefail; "$@" ' + redirected
    words = [sys.executable, "-m", "belt_fenicsx", *argv]
    result = subprocess.run(["bash", "-c", script, "bash", *words], stderr=subprocess.PIPE, text=True, timeout=120)
    assert (result.returncode, result.stderr) == (code, complaint)


@serial
@pytest.mark.parametrize("method", ["fitted", "augmented-lagrangian"])
def test_forms_that_cannot_be_compiled_are_a_complaint(method, tmp_path):
    (tmp_path / "file").touch()
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "file")}
    result = command("--method", method, stdout=subprocess.PIPE, env=environment)
    assert result.returncode == 1 and result.stdout == ""
    assert "could not be compiled" in result.stderr and "Traceback" not in result.stderr
