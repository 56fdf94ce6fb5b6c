"""Each demo runs as a script does, asserts its number, and leaves its figures."""

import runpy
from pathlib import Path

import pytest

DEMOS = Path(__file__).parents[2] / "demos"
FIGURES = {
    "demo_one_pulley": ("contact_forces.png", "strains.png", "deformed_belt.png"),
    "demo_omega_range": ("omega_range.png",),
    "demo_characteristic": ("characteristic.png",),
    "demo_characteristic_drive": ("characteristic_drive.png",),
    "demo_two_pulleys": ("two_pulleys.png",),
}


def test_every_demo_is_listed():
    assert {path.stem for path in DEMOS.glob("demo_*.py")} == set(FIGURES)


@pytest.mark.parametrize("name", FIGURES)
def test_demo(name, capsys):
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        for figure in FIGURES[name]:
            (DEMOS / "output" / figure).unlink(missing_ok=True)
    MPI.COMM_WORLD.barrier()
    runpy.run_path(str(DEMOS / f"{name}.py"), run_name="__main__")
    MPI.COMM_WORLD.barrier()
    assert all((DEMOS / "output" / figure).stat().st_size > 10_000 for figure in FIGURES[name])
    printed = capsys.readouterr().out
    assert ("omega" in printed) == (MPI.COMM_WORLD.rank == 0)
