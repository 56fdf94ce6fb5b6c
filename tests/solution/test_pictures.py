"""Whole figures: each is made of each kind of scene, has units on its axes, and no text over another one."""

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import drive
from matplotlib.backends.backend_agg import FigureCanvasAgg

from belt_fenicsx import Scene, SceneError, Solution, Status, bvp, load_scene, solve, sweep
from belt_fenicsx.solution.pictures import PICTURES
from belt_fenicsx.sweeps.sweep import Sweep

pytestmark = pytest.mark.serial
DEMOS = Path(__file__).parents[2] / "demos"
SCENES = {
    "published": Scene,
    "two pulleys": lambda: load_scene(DEMOS / "two_pulleys.toml"),
    "serpentine": lambda: drive("serpentine"),
    "clamped": lambda: drive("open-S"),
}


@pytest.fixture(scope="module", params=SCENES)
def solution(request):
    return bvp.solve(SCENES[request.param]())


@pytest.mark.parametrize("which", PICTURES)
def test_pictures_are_made(which, solution):
    figure = solution.plot(which)
    figure.set_dpi(40)
    assert figure._repr_png_().startswith(b"\x89PNG")
    labels = [label for ax in figure.axes for label in (ax.get_xlabel(), ax.get_ylabel()) if label]
    assert all(label.endswith("]") for label in labels)
    assert labels or which == "polar"


def test_numbers_of_the_drive(solution):
    figure = solution.plot("drive")
    _, pulleys, spans = figure.axes
    told = [{cell.get_text().get_text() for cell in ax.tables[0].get_celld().values()} for ax in (pulleys, spans)]
    for contact in solution.contacts:
        assert {f"{contact.omega:.5g}", f"{contact.tight:.5g}", f"{contact.slack:.5g}"} <= told[0]
    for number, span in enumerate(solution.spans):
        assert {f"S{number}", f"{span.tension[1]:.5g}", f"{span.speed:.5g}"} <= told[1]


def test_texts_of_a_drive_keep_apart(solution):
    figure = solution.plot("drive")
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw(renderer)
    boxes = [text.get_window_extent(renderer) for text in figure.axes[0].texts if text.get_text()]
    assert len(boxes) >= len(solution.spans)
    assert not any(one.overlaps(other) for i, one in enumerate(boxes) for other in boxes[:i])


def test_the_belt_turns_a_pulley_as_it_passes():
    """Arrows lead with the belt: clockwise on a pulley on its right, the other way round on one on its left."""
    solution = bvp.solve(drive("open-S"))
    arrows = [text for text in solution.plot("drive").axes[0].texts if not text.get_text() and hasattr(text, "xyann")]
    turning = [
        arrow for arrow in arrows if arrow.arrowprops["arrowstyle"] == "-|>" and "connectionstyle" in arrow.arrowprops
    ]
    for contact, arrow in zip(solution.contacts, turning, strict=True):
        way = complex(*arrow.xy) - complex(*arrow.xyann)
        from_centre = (complex(*arrow.xy) + complex(*arrow.xyann)) / 2.0 - complex(*contact.center)
        clockwise = (from_centre.conjugate() * way).imag < 0.0
        assert clockwise == (solution.scene.pulleys[contact.pulley].side == "right")


def test_short_contacts_are_widened():
    solution = bvp.solve(drive("serpentine"))
    figure = solution.plot("unrolled")
    titles = [ax.get_title() for ax in figure.axes if "widened" in ax.get_title()]
    length = solution.scene.belt.length
    short = [c.pulley for c in solution.contacts if c.zones[-1].sigma[1] - c.zones[0].sigma[0] < 0.05 * length]
    assert titles == [f"pulley {index}, widened" for index in short]
    assert len(bvp.solve(Scene()).plot("unrolled").axes) == 4


def test_pressure_stands_on_its_pulley():
    solution = bvp.solve(drive("open-S"))
    for ax, contact in zip(solution.plot("polar").axes, solution.contacts, strict=True):
        angle, p = np.concatenate([line.get_xydata() for line in ax.lines]).T
        ends = [complex(*place) - complex(*contact.center) for place in (contact.run_up, contact.run_off)]
        for found, end in zip((angle[0], angle[-1]), ends, strict=True):
            assert math.remainder(found - np.angle(end), 2 * math.pi) == pytest.approx(0.0, abs=1e-6)
        assert p.min() >= 0.0 and p.max() == pytest.approx(ax.get_ylim()[1], rel=0.1)


def test_what_cannot_be_drawn():
    failed = Solution(scene=Scene(), method="made up", status=Status.NEWTON_DIVERGED)
    with pytest.raises(SceneError, match="have fields and a contact to be drawn, got 'NEWTON_DIVERGED'"):
        failed.plot()
    with pytest.raises(SceneError, match="which"):
        bvp.solve(Scene()).plot("drives")
    clear = solve(Scene(pulleys=(replace(Scene().pulleys[0], center=(0.0, -1.0)),)), method="bvp", throw=False)
    assert clear.status is Status.NO_CONTACT and clear.plot("overview") is not None
    with pytest.raises(SceneError, match="NO_CONTACT"):
        clear.plot("polar")


@pytest.fixture(scope="module")
def characteristic() -> Sweep:
    return sweep(drive("flat-belt"), over="pulleys.1.torque", values=[5.0, 15.0, 25.0, 60.0], solver=bvp.solve)


def test_creep_curves(characteristic):
    ax = characteristic.plot("pulleys.1.creep", "pulleys.1.torque").axes[0]
    (line,) = ax.lines
    creep, torque = line.get_xydata().T
    assert np.all(np.diff(creep[:3]) > 0.0) and torque[:3] == pytest.approx([5.0, 15.0, 25.0])
    # More than the belt can transmit leaves a gap.
    assert math.isnan(creep[3])
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("pulleys.1.creep [-]", "pulleys.1.torque [N m]")
    with pytest.raises(SceneError, match="`y` must be a column of numbers"):
        characteristic.plot("pulleys.1.torque", "weather")


def test_a_sweep_as_a_data_frame(characteristic, monkeypatch):
    pandas = type(sys)("pandas")
    pandas.DataFrame = lambda rows, columns: (rows, columns)
    monkeypatch.setitem(sys.modules, "pandas", pandas)
    rows, columns = characteristic.to_pandas()
    assert columns == characteristic.rows()[0] and len(rows) == 4 and rows[0][0] == 5.0
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ModuleNotFoundError, match="pip install pandas"):
        characteristic.to_pandas()


def test_a_folder_of_results(solution, tmp_path):
    solution.export(tmp_path / "out")
    assert Solution.load(tmp_path / "out" / "result.npz").contacts == solution.contacts


def test_borders_have_names_where_there_is_room():
    figure = bvp.solve(Scene()).plot("unrolled")
    (above,) = figure.axes[0].child_axes
    names = [label.get_text() for label in above.get_xticklabels()]
    assert names == ["run-up", "run-off", "slip begins"]
    banded = bvp.solve(load_scene(DEMOS / "steel_band.toml"))
    assert banded.zones[0].slip == "forward" and banded.zones[1].kind == "stick"
    (above,) = banded.plot("unrolled").axes[0].child_axes
    places = above.get_xticks()
    assert len(places) == 6 and np.diff(np.sort(places)).min() > 0.02 * banded.scene.belt.length
