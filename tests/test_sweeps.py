"""Sweeps: warm starts along the way, cold starts where they fail, rows for scenes without an answer."""

import csv
import io

import numpy as np
import pytest

from belt_fenicsx import Pulley, Scene, SceneError, Status, bvp, sweep

PLACES = (-0.1, 0.0, 0.1)


@pytest.fixture(scope="module")
def table():
    return sweep(Scene(), over="pulleys.0.x_trans", values=PLACES, solver=bvp.solve)


def test_columns_are_those_of_single_solves(table):
    single = [bvp.solve(Scene(pulleys=(Pulley(x_trans=place),))) for place in PLACES]
    assert table["omega"] == pytest.approx([solution.omega for solution in single], rel=1e-8)
    assert table["torque"] == pytest.approx([solution.contacts[0].torque for solution in single], rel=1e-6)
    assert np.all(table["error_estimate"] < 1e-8)
    assert table.success


def test_a_list_of_scenes_is_solved_in_its_order(table):
    scenes = [Scene(pulleys=(Pulley(x_trans=place),)) for place in reversed(PLACES)]
    assert sweep(scenes, solver=bvp.solve)["omega"] == pytest.approx(table["omega"][::-1], rel=1e-8)


def test_csv_reads_back(table):
    head, *rows = csv.reader(io.StringIO(table.csv()))
    assert head[:3] == ["pulleys.0.x_trans", "omega [rad/s]", "x_up [m]"]
    assert [float(row[1]) for row in rows] == list(table["omega"])
    assert [row[-1] for row in rows] == ["SOLVED"] * 3


def test_a_scene_without_an_answer_has_a_row_that_says_so():
    table = sweep(Scene(), over="pulleys.0.x_trans", values=(0.0, 0.3, 0.1), solver=bvp.solve)
    assert [solution.status for solution in table.solutions] == [Status.SOLVED, Status.REFUSED, Status.SOLVED]
    assert "`pulleys.0.x_trans` must" in table.solutions[1].message
    assert np.isnan(table["omega"]).tolist() == [False, True, False]
    assert not table.success


def test_a_warm_start_that_fails_is_followed_by_a_cold_one():
    starts = []

    def solver(scene, *, initial, throw, **arguments):
        starts.append(initial is not None)
        solution = bvp.solve(scene, throw=throw, **arguments)
        return solution if initial is None else Failed(solution)

    class Failed:
        success = False

        def __init__(self, solution):
            self.solution = solution

    table = sweep(Scene(), over="pulleys.0.x_trans", values=PLACES, solver=solver, rtol=1e-4)
    assert starts == [False, True, False, True, False]
    assert table.success


@pytest.mark.parametrize(
    ("scenes", "over", "values", "field"),
    [
        (Scene(), None, None, "over"),
        (Scene(), "pulleys.0.x_trans", None, "over"),
        ([Scene()], "pulleys.0.x_trans", (0.0,), "over"),
        (Scene(), "pulleys.0.frictoin", (0.1,), "pulleys.0.frictoin"),
        (Scene(), "pulleys.0.friction", (0.1, -0.1), "pulleys.0.friction"),
    ],
)
def test_bad_arguments(scenes, over, values, field):
    with pytest.raises(SceneError, match=f"`{field}`"):
        sweep(scenes, over=over, values=values, solver=bvp.solve)


def test_progress_is_told():
    told = []
    sweep(Scene(), over="pulleys.0.x_trans", values=PLACES[:2], solver=bvp.solve, on_solved=lambda i, s: told.append(i))
    assert told == [0, 1]
