"""What the README shows does what it says."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from belt_fenicsx import Scene, load_scene, solve

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
EXAMPLE = re.search(r"```python\n(.*?)```", README, re.DOTALL)[1]
DRIVE = re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1]
COMMANDS = re.findall(r"^(?:mpirun.* )?belt-fenicsx .+", README, re.MULTILINE)
WRITTEN = {"--plot": "belt.png", "--out": "result"}


def test_example(capsys):
    names = {}
    exec(EXAMPLE, names)
    assert names["scene"] == Scene() == load_scene(ROOT / "demos" / "one_pulley.toml")
    omega, *_ = map(float, capsys.readouterr().out.split())
    assert names["solution"].omega == omega == pytest.approx(1.4807, abs=5e-5)


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
    for option, name in WRITTEN.items():
        assert f"{option} {name}" not in text or (tmp_path / name).exists()


def test_the_readme_shows_every_command():
    assert len(COMMANDS) > 6
    assert {"sweep", "check"} <= {word for text in COMMANDS for word in text.split()}
