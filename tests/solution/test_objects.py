"""Solutions, sweeps and errors as Python objects: they compare, hash, show themselves, and travel between processes."""

import copy
import multiprocessing
import pickle
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from belt_fenicsx import Belt, Pulley, Scene, SceneError, Solution, SolveError, Status, bvp, solve, sweep
from belt_fenicsx.solution import plot
from belt_fenicsx.solution.fields import QUANTITIES

pytestmark = pytest.mark.serial

METHODS = {
    "fitted": solve,
    "augmented-lagrangian": lambda scene: solve(scene, method="augmented-lagrangian", elements=50),
    "bvp": lambda scene: bvp.solve(scene, rtol=1e-4),
}
FAILED = Solution(scene=Scene(), method="made up", status=Status.NEWTON_DIVERGED, message="Stage `x`")


@pytest.fixture(scope="module", params=METHODS)
def solution(request):
    return METHODS[request.param](Scene())


@pytest.fixture(scope="module")
def table():
    return sweep(Scene(), over="pulleys.0.x_trans", values=(0.0, 0.3), solver=bvp.solve, rtol=1e-4)


def travelled(value):
    return pickle.loads(pickle.dumps(value))


def test_solutions_travel(solution):
    again = travelled(solution)
    assert again == solution and hash(again) == hash(solution)
    assert np.array_equal(again.fields.p, solution.fields.p)
    assert repr(again) == repr(solution) and again._repr_html_() == solution._repr_html_()
    assert copy.deepcopy(solution) == solution


def assert_same_fields(one, other):
    """Equal but for rounding, which in matrix products depends on where the numbers are in memory."""
    for name in QUANTITIES:
        values = getattr(other, name)
        np.testing.assert_allclose(
            getattr(one, name), values, rtol=0.0, atol=1e-13 * np.abs(values).max(), err_msg=name
        )


def test_a_solution_that_travelled_knows_its_fields_between_points_and_starts_another():
    solution = solve(Scene())
    again = travelled(solution)
    assert_same_fields(again.evaluate(0.1), solution.evaluate(0.1))
    assert solve(Scene(), initial=again).omega == pytest.approx(solution.omega, rel=1e-8)
    assert bvp.solve(Scene(), initial=travelled(bvp.solve(Scene()))).success


SCENES = {
    "stick and slip": Scene(),
    "no friction": Scene(pulleys=(Pulley(friction=0.0),)),
    "torque": Scene(pulleys=(Pulley(torque=-300.0, x_trans=None),)),
    "speed": Scene(pulleys=(Pulley(omega=1.48, x_trans=None),)),
    "other units": Scene(belt=Belt(length=1.99, thickness=0.01), span=2.0, transport_rate=7.0),
}


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize("way", ["file", "pickle"])
def test_fields_between_points_come_back(scene, way, tmp_path, monkeypatch):
    solution = solve(scene)
    solution.save(tmp_path / "a.npz")
    again = Solution.load(tmp_path / "a.npz") if way == "file" else travelled(solution)
    monkeypatch.setattr("belt_fenicsx.fitted.newton.Newton.solve", lambda *_, **__: pytest.fail("solved again"))
    half, borders = scene.belt.length / 2, [zone.sigma[1] for zone in solution.zones[:-1]]
    points = np.sort([*np.linspace(-half, half, 101), *borders])
    for side in ("left", "right"):
        assert_same_fields(again.evaluate(points, side), solution.evaluate(points, side))
    again.save(tmp_path / "b.npz")
    assert_same_fields(Solution.load(tmp_path / "b.npz").evaluate(points), solution.evaluate(points))


def test_an_older_file_says_how_to_know_its_fields_between_points(tmp_path):
    solution = solve(Scene())
    replace(solution, evaluator=None).save(tmp_path / "a.npz")
    again = Solution.load(tmp_path / "a.npz")
    assert again == solution
    with pytest.raises(SceneError, match=r"solve\(solution.scene, initial=solution\)"):
        again.evaluate(0.1)
    assert solve(again.scene, initial=again).evaluate(0.1).p == pytest.approx(solution.evaluate(0.1).p, rel=1e-6)


def test_solutions_differ_by_what_is_in_their_fields(solution):
    fields = replace(solution.fields, p=solution.fields.p * (1.0 + 1e-12))
    assert fields != solution.fields
    assert replace(solution, fields=fields) != solution
    assert replace(solution, fields=None) != solution
    assert solution != "a solution" and solution.fields != solution.fields.p.tolist()
    assert solution in [FAILED, solution] and len({solution, travelled(solution), FAILED}) == 2
    assert len({solution.fields, travelled(solution.fields)}) == 1


def test_nan_equals_itself():
    assert np.isnan(FAILED.error_estimate)
    one, other = (replace(FAILED, error_estimate=float("nan"), measures={"a": float("nan")}) for _ in "ab")
    assert one == other != replace(other, measures={"a": 0.0})


def test_sweeps_travel_and_compare(table):
    again = travelled(table)
    assert again == table and hash(again) == hash(table)
    assert table != replace(table, values=(0.0, 0.2)) and table != 1
    assert again.csv() == table.csv()


@pytest.mark.parametrize(
    "error", [SceneError("span", "be", lambda: 1), SceneError("a", "b", {1: 2}), SolveError(FAILED)], ids=repr
)
def test_errors_travel_with_their_text(error):
    again = travelled(error)
    assert type(again) is type(error) and str(again) == str(error)


def test_answers_and_errors_come_back_from_other_processes():
    scenes = [Scene(), Scene(pulleys=(Pulley(x_trans=0.3),)), Scene(pulleys=(Pulley(center=(0.0, -0.9)),))]
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        answer, refused, failed = [pool.submit(bvp.solve, scene) for scene in scenes]
        assert answer.result().omega == pytest.approx(1.4807092526, rel=1e-8)
        with pytest.raises(SceneError, match="`pulleys.0.x_trans` must"):
            refused.result()
        with pytest.raises(SolveError, match="does not touch the pulley") as caught:
            failed.result()
    assert caught.value.solution.status is Status.NO_CONTACT


@pytest.mark.parametrize("show", [repr, str])
def test_texts_fit_a_screen(show, solution, table):
    for value in (solution, solution.fields, solution.contacts[0], table, travelled(FAILED)):
        assert len(show(value)) < 400 and "\n" not in show(value)
    assert show(table) == "<Sweep of 2 scenes over pulleys.0.x_trans = 0.0 ... 0.3: 1 SOLVED, 1 REFUSED>"
    assert show(solution.contacts[0]).endswith("rad: stick, forward slip>")
    assert show(replace(table, over=None, values=(), solutions=())) == "<Sweep of 0 scenes: >"


def test_a_long_sweep_is_short_in_a_notebook(table):
    long = replace(table, values=tuple(range(1000)), solutions=table.solutions[:1] * 1000)
    page = long._repr_html_()
    assert page.count("<tr>") == 12 and "1000 SOLVED" in page
    assert "<td>999</td>" in page and "<td>500</td>" not in page
    assert table._repr_html_().count("<tr>") == 3


def test_figures_show_themselves_without_pyplot():
    code = (
        "import sys; from belt_fenicsx import Scene, bvp, plot; figure = plot.overview(bvp.solve(Scene()))\n"
        "assert figure._repr_png_().startswith(b'\\x89PNG'); assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("name", ["p", "Q1", "y", "zone", "Gamma"])
def test_any_column_is_drawn(name, solution):
    ax = plot.field(solution, plot.Figure().subplots(), name)
    assert ax.get_ylabel().endswith("]") and len(ax.lines[0].get_ydata()) == solution.fields.sigma.size


def test_an_unknown_field_is_named(solution):
    with pytest.raises(SceneError, match="`name` must be a known name, perhaps `Gamma`, got 'gamma'"):
        plot.field(solution, plot.Figure().subplots(), "gamma")


def test_timings_add_up_stages_of_one_name():
    stages = solve(Scene()).stages
    twice = replace(FAILED, stages=stages + stages)
    assert sum(twice.timings.values()) == pytest.approx(2.0 * sum(stage.seconds for stage in stages), rel=1e-12)
