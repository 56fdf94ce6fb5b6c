"""What the README shows does what it says."""

import dataclasses
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from belt_fenicsx import Scene, bvp, load_scene, solve
from belt_fenicsx.command import main as cli

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
IN_PYTHON, EXAMPLE = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
DRIVE = re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1]
COMMANDS = re.findall(r"^(?:mpirun.* )?belt-fenicsx .+", README, re.MULTILINE)
WRITTEN = {"--plot": ".png", "--out": "result"}
# Of a contact, besides the numbers that the table tells.
PLACES = {"pulley", "x_up", "x_trans", "x_off", "center", "run_up", "run_off", "angle_up", "angle_off"}


def test_example(capsys):
    names = {}
    exec(EXAMPLE, names)
    assert names["scene"] == Scene() == load_scene(ROOT / "demos" / "one_pulley.toml")
    omega, *_ = map(float, capsys.readouterr().out.split())
    assert names["solution"].omega == omega == pytest.approx(1.4807, abs=5e-5)


@pytest.mark.serial
def test_drive_in_python(capsys, monkeypatch, tmp_path):
    (tmp_path / "demos").symlink_to(ROOT / "demos")
    monkeypatch.chdir(tmp_path)
    exec(IN_PYTHON, {})
    tight, frequency, efficiency, safety = map(float, capsys.readouterr().out.split())
    assert (tight, frequency, efficiency) == pytest.approx((318.77, 53.62, 0.99223), rel=1e-4)
    assert safety == pytest.approx(1.34368, rel=1e-5)
    assert {path.name for path in tmp_path.glob("*.png")} == {"drive.png", "creep.png"}


@pytest.mark.serial
def test_the_table_of_a_drive_is_that_of_the_command_line(capsys, tmp_path):
    """Each number that the README shows is one that the command prints."""
    (tmp_path / "drive.toml").write_text(DRIVE)
    assert cli.main([str(tmp_path / "drive.toml")]) == 0
    printed = set(capsys.readouterr().out.split())
    shown = re.search(r"```\n(transport rate.*?)```", README, re.DOTALL)[1]
    numbers = {word for word in shown.split() if re.fullmatch(r"-?[0-9.e-]+", word) and word != "..."}
    assert len(numbers) > 30 and numbers <= printed


@pytest.mark.serial
def test_every_number_in_the_tables_is_there():
    """What the README's tables say of a solution are attributes of it, and all of its numbers are there."""
    solution = bvp.solve(Scene())
    of_all, of_contact, of_span, of_fields = (
        re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (.*?) \|", part, re.MULTILINE)))
        for part in re.search(r"## What comes out\n(.*?)\n## ", README, re.DOTALL)[1].split("| --- | --- |")[1:]
    )
    contact = solution.contacts[0]
    assert all(hasattr(solution, name) for name in of_all if name not in ("solution",))
    assert {f.name for f in dataclasses.fields(contact)} - {*of_contact} <= PLACES
    assert all(hasattr(contact, name) for name in of_contact if name != "solution")
    assert {f.name for f in dataclasses.fields(solution.spans[0])} - {*of_span} == {"sigma"}
    assert {f.name for f in dataclasses.fields(solution.fields)} - {*of_fields} == {"zone", "weight"}
    assert all(hasattr(solution.fields, name) for name in of_fields)


@pytest.mark.serial
def test_from_a_copy_to_an_own_drive(tmp_path):
    """A new user's path, but for the installation: the script that does it from a clone."""
    script = ROOT / "tests" / "package" / "first_drive.sh"
    result = subprocess.run(
        ["bash", script, ROOT, tmp_path / "new", sys.executable], capture_output=True, text=True, timeout=120
    )
    assert result.returncode == 0, result.stderr
    assert "Solved" in result.stdout and "hub load [N]" in result.stdout
    assert (tmp_path / "new" / "drive.png").stat().st_size > 10_000


def test_drive(tmp_path):
    path = tmp_path / "drive.toml"
    path.write_text(DRIVE)
    string, solution = (solve(load_scene(path), method=method) for method in ("string", "bvp"))
    assert solution.contacts[1].torque == pytest.approx(10.0, rel=1e-9)
    assert solution.transport_rate == pytest.approx(string.transport_rate, rel=2e-3)


@pytest.mark.serial
@pytest.mark.parametrize("text", [text for text in COMMANDS if not text.startswith("mpirun")])
def test_commands(text, tmp_path):
    for folder in ("demos", "meshes"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    program = [sys.executable, "-m", "belt_fenicsx"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    result = subprocess.run(
        [*program, *shlex.split(text)[1:]], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout
    for option, ending in WRITTEN.items():
        written = re.search(rf"{option} (\S*{re.escape(ending)})", text)
        assert written is None or (tmp_path / written[1]).exists()


def test_the_readme_shows_every_command():
    assert len(COMMANDS) > 6
    assert {"sweep", "check"} <= {word for text in COMMANDS for word in text.split()}
