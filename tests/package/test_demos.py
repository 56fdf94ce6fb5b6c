"""Each demo runs as a script does, asserts its number, leaves its figures, and is in the gallery; and as a notebook."""

import runpy
import sys
from pathlib import Path

import pytest

DEMOS = Path(__file__).parents[2] / "demos"
FIGURES = {
    "demo_one_pulley": ("contact_forces.png", "strains.png", "deformed_belt.png"),
    "demo_omega_range": ("omega_range.png",),
    "demo_characteristic": ("characteristic.png",),
    "demo_characteristic_drive": ("characteristic_drive.png",),
    "demo_two_pulleys": ("two_pulleys.png",),
    "demo_flat_belt": ("flat_belt.png",),
    "demo_steel_band": ("steel_band.png",),
    "demo_polyamide": ("polyamide.png",),
    "demo_serpentine": ("serpentine.png",),
}
SHARED = ("demo_one_pulley", "demo_omega_range", "demo_two_pulleys")  # have a fixed mesh, which ranks share
QUICK = ("demo_steel_band",)  # as notebooks; the others are slow ones


@pytest.fixture(autouse=True)
def beside_the_demos(monkeypatch):
    monkeypatch.syspath_prepend(str(DEMOS))


def test_every_demo_is_listed():
    import gallery

    assert {path.stem for path in DEMOS.glob("demo_*.py")} == set(FIGURES)
    assert [f"demo_{name}" for name in gallery.DEMOS] == [*dict.fromkeys(f"demo_{name}" for name in gallery.DEMOS)]
    assert {f"demo_{name}" for name in gallery.DEMOS} == set(FIGURES)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in SHARED else pytest.mark.serial) for name in FIGURES]
)
def test_demo(name, capsys):
    import gallery
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        for figure in FIGURES[name]:
            (DEMOS / "output" / figure).unlink(missing_ok=True)
    MPI.COMM_WORLD.barrier()
    demo = runpy.run_path(str(DEMOS / f"{name}.py"), run_name="__main__")
    MPI.COMM_WORLD.barrier()
    assert all((DEMOS / "output" / figure).stat().st_size > 10_000 for figure in FIGURES[name])
    headline, printed = demo["headline"](), capsys.readouterr().out
    assert (headline in printed) == (MPI.COMM_WORLD.rank == 0)
    assert gallery.entry(name.removeprefix("demo_"), headline) in (DEMOS / "README.md").read_text()
    assert (DEMOS / "figures" / gallery.picture(name.removeprefix("demo_"))).stat().st_size < 150_000


@pytest.mark.serial
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else pytest.mark.slow) for name in FIGURES]
)
def test_notebook(name):
    pytest.importorskip("jupytext", reason="`run` installs it; a bare tree does without")
    pytest.importorskip("nbclient", reason="`run` installs it; a bare tree does without")
    import notebooks

    made = notebooks.executed(DEMOS / f"{name}.py")
    assert made.cells[1].cell_type == "markdown" and made.cells[1].source.startswith("# ")
    outputs = [output for cell in made.cells if cell.cell_type == "code" for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not any(output.output_type == "error" for output in outputs)


@pytest.mark.serial
@pytest.mark.parametrize("name", FIGURES)
def test_demos_read_as_notebooks(name):
    pytest.importorskip("jupytext", reason="`run` installs it; a bare tree does without")
    pytest.importorskip("nbclient", reason="`run` installs it; a bare tree does without")
    import notebooks

    made = notebooks.notebook(DEMOS / f"{name}.py")
    kinds = [cell.cell_type for cell in made.cells]
    assert kinds[:2] == ["code", "markdown"] and kinds.count("markdown") >= 2
    assert "\n".join(cell.source for cell in made.cells).count("assert ") >= 2
    assert sys.modules["notebooks"].HERE == DEMOS
