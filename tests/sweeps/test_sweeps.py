"""Sweeps: warm starts along the way, cold starts where they fail, rows for scenes without an answer; over ranks."""

import csv
import io
import itertools
import json

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

from belt_fenicsx import Pulley, Scene, SceneError, Status, bvp, solve, sweep
from belt_fenicsx.sweeps import parts as sweep_parts
from belt_fenicsx.sweeps.ranks import shares

PLACES = (-0.1, 0.0, 0.1)
MANY = tuple(np.linspace(-0.1, 0.1, 9))


@pytest.fixture
def comm():
    return MPI.COMM_WORLD


@pytest.fixture
def shared(comm, tmp_path):
    """One path of a table for all ranks."""
    return comm.bcast(tmp_path, root=0) / "table.csv"


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


def test_several_values_at_once():
    paths, values = ("pulleys.0.friction", "pulleys.0.x_trans"), tuple(itertools.product((0.2, 0.3), (0.0, 0.1)))
    table = sweep(Scene(), over=list(paths), values=values, solver=quick)
    pulleys = [solution.scene.pulleys[0] for solution in table.solutions]
    assert [(pulley.friction, pulley.x_trans) for pulley in pulleys] == list(values)
    head, *rows = csv.reader(io.StringIO(table.csv()))
    assert tuple(head[:2]) == paths == table.over
    assert [tuple(map(float, row[:2])) for row in rows] == list(values)
    assert repr(table).startswith("<Sweep of 4 scenes over pulleys.0.friction, pulleys.0.x_trans = (0.2, 0.0) ... ")


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
        (Scene(), ("span", "pulleys.0.friction"), ((1.0, 0.1), (1.0,)), "values"),
        (Scene(), ("span", "pulleys.0.friction"), (1.0, 0.1), "values"),
    ],
)
def test_bad_arguments(scenes, over, values, field):
    with pytest.raises(SceneError, match=f"`{field}`"):
        sweep(scenes, over=over, values=values, solver=bvp.solve)


def test_progress_is_told():
    told = []
    sweep(Scene(), over="pulleys.0.x_trans", values=PLACES[:2], solver=bvp.solve, on_solved=lambda i, s: told.append(i))
    assert told == [0, 1]
    told = []
    sweep(Scene(), over="pulleys.0.x_trans", values=PLACES[:2], solver=quick, progress=lambda *n: told.append(n))
    assert told == [(1, 2), (2, 2), (2, 2)]


def quick(scene, *, initial=None, throw=True, rtol=1e-4):
    return bvp.solve(scene, rtol=rtol, initial=initial, throw=throw)


def over_ranks(comm, solver=quick, **arguments):
    return sweep(Scene(), over="pulleys.0.x_trans", values=MANY, solver=solver, comm=comm, **arguments)


@pytest.mark.parametrize(("count", "ranks"), [(0, 2), (1, 3), (3, 2), (2000, 2), (2000, 7)])
def test_chunks_cover_all_scenes_and_the_last_are_short(count, ranks):
    chunks = shares(count, ranks)
    assert list(itertools.chain(*chunks)) == list(range(count))
    assert [len(chunk) for chunk in chunks] == sorted((len(chunk) for chunk in chunks), reverse=True)
    assert all(len(chunk) == 1 for chunk in chunks[-ranks:])


def test_ranks_give_the_same_answers_in_the_order_asked_for(comm):
    together, alone = over_ranks(comm), over_ranks(None)
    for name in ("omega", "x_up", "x_trans", "torque"):
        assert together[name] == pytest.approx(alone[name], rel=1e-4, abs=1e-6)
    assert together.values == alone.values
    assert [solution.scene for solution in together.solutions] == [solution.scene for solution in alone.solutions]
    assert len(set(comm.allgather(together.csv()))) == 1
    assert all(solution.fields is not None for solution in together.solutions)


def test_each_scene_is_solved_once(comm):
    mine = []
    over_ranks(comm, on_solved=lambda index, solution: mine.append(index))
    assert sorted(itertools.chain(*comm.allgather(mine))) == list(range(len(MANY)))


def test_finite_elements_solve_each_scene_on_one_rank(comm):
    options = {"method": "augmented-lagrangian", "elements": 50}
    together, alone = over_ranks(comm, solve, **options), over_ranks(None, solve, **options)
    assert together["omega"] == pytest.approx(alone["omega"], rel=1e-8)


def test_answers_of_other_ranks_know_their_fields_between_points(comm):
    result = over_ranks(comm, solve)
    assert [solution.evaluate(0.0).p[0] > 0.0 for solution in result.solutions] == [True] * len(MANY)


def test_fewer_scenes_than_ranks(comm):
    assert sweep([Scene()], solver=quick, comm=comm)["omega"] == pytest.approx([1.4807092526], rel=1e-4)
    assert sweep([], solver=quick, comm=comm).solutions == ()


def test_an_error_on_one_rank_is_raised_on_all(comm):
    def solver(scene, *, initial, throw):
        if scene.pulleys[0].x_trans == MANY[0]:
            raise ZeroDivisionError("on one rank")
        return quick(scene, initial=initial)

    with pytest.raises(ZeroDivisionError, match="on one rank"):
        over_ranks(comm, solver)


def test_the_end_of_one_rank_is_that_of_all(comm):
    def told(index, solution):
        if index == 0:
            raise SystemExit(7)

    with pytest.raises(SystemExit, match="7"):
        over_ranks(comm, on_solved=told)


def test_an_error_that_cannot_travel_keeps_its_name(comm):
    class LocalError(Exception):
        pass

    def solver(scene, *, initial, throw):
        if scene.pulleys[0].x_trans == MANY[0]:
            raise LocalError("here")
        return quick(scene, initial=initial)

    with pytest.raises((LocalError, RuntimeError), match="here"):
        over_ranks(comm, solver)


def test_a_table_that_cannot_be_written_is_an_error_on_all(comm, tmp_path):
    with pytest.raises(OSError):
        over_ranks(comm, out=tmp_path / "missing" / "table.csv")


def test_the_table_is_written_once_and_nothing_else_stays(comm, shared):
    result = over_ranks(comm, out=shared)
    comm.Barrier()
    assert shared.read_text() == result.csv()
    assert [path.name for path in shared.parent.iterdir()] == [shared.name]


@pytest.mark.parametrize("broken", [False, True])
def test_a_sweep_that_was_stopped_goes_on_where_it_was(comm, shared, broken):
    solved = []

    def solver(scene, *, initial, throw, rtol):
        if len(solved) == 2:
            raise KeyboardInterrupt
        solved.append(scene)
        return quick(scene, initial=initial, rtol=rtol)

    with pytest.raises(KeyboardInterrupt):
        over_ranks(comm, solver, out=shared, rtol=1e-4)
    comm.Barrier()
    assert not shared.exists()
    own = shared.with_name(f"{shared.name}.part.{comm.rank}")
    kept = comm.allreduce(len(solved))
    assert comm.allreduce(sum(1 for line in own.read_text().splitlines() if line)) == kept >= 2
    if broken and comm.rank == 0:
        with open(own, "a") as file:
            file.write('{"key": "cut o')
    comm.Barrier()

    again = []
    result = over_ranks(comm, quick_again(again), out=shared, rtol=1e-4)
    assert comm.allreduce(len(again)) == len(MANY) - kept
    assert result["omega"] == pytest.approx(over_ranks(None)["omega"], rel=1e-4)
    comm.Barrier()
    assert [path.name for path in shared.parent.iterdir()] == [shared.name]


def quick_again(called):
    def solver(scene, *, initial, throw, rtol=1e-4):
        called.append(scene)
        return quick(scene, initial=initial, rtol=rtol)

    return solver


@pytest.mark.serial
def test_other_arguments_are_another_sweep(tmp_path):
    table = tmp_path / "table.csv"
    solution = quick(Scene())

    def interrupted(scene, *, initial, throw, rtol):
        if scene.pulleys[0].x_trans != MANY[0]:
            raise KeyboardInterrupt
        return solution

    with pytest.raises(KeyboardInterrupt):
        over_ranks(None, interrupted, out=table, rtol=1e-4)
    side = tmp_path / "table.csv.part.0"
    (line,) = filter(None, side.read_text().splitlines())
    assert json.loads(line)["solution"]["status"] == "SOLVED"
    with pytest.raises(SceneError, match=f"remove {side}.*got 1 answers to other"):
        over_ranks(None, quick, out=table, rtol=1e-5)
    assert side.exists()
    side.unlink()
    again = []
    over_ranks(None, quick_again(again), out=table, rtol=1e-5)
    assert len(again) == len(MANY)


@pytest.mark.serial
def test_a_sweep_may_grow(tmp_path):
    with pytest.raises(ZeroDivisionError):
        over_ranks(None, failing_at(MANY[2]), out=tmp_path / "table.csv")
    again = []
    more = (*MANY, 0.15)
    arguments = {"over": "pulleys.0.x_trans", "solver": quick_again(again), "out": tmp_path / "table.csv"}
    assert len(sweep(Scene(), values=more, **arguments).solutions) == len(more) == len(again) + 2


def failing_at(place):
    def solver(scene, *, initial, throw, rtol=1e-4):
        if scene.pulleys[0].x_trans == place:
            raise ZeroDivisionError
        return quick(scene, initial=initial)

    return solver


@pytest.mark.serial
def test_answers_are_those_of_one_version_and_of_the_same_options(monkeypatch):
    def name(**arguments):
        return sweep_parts.keys([Scene()], arguments)[0]

    assert name(rtol=1e-8) == name(rtol=1e-8) != name(rtol=1e-9)
    positions = np.linspace(-0.5, 0.5, 3001)
    other = np.where(np.arange(3001) == 1500, 1e-5, positions)
    assert name(mesh=positions) == name(mesh=positions.copy()) != name(mesh=other)

    before, options = name(), PETSc.Options()
    for option, matters in (("belt_snes_max_it", True), ("log_view_of_nobody", False)):
        options[option] = 7
        assert (name() != before) == matters
        options.delValue(option)
    assert name() == before
    monkeypatch.setattr(sweep_parts, "versions", lambda: {"belt_fenicsx": "0.0.0"})
    assert name() != before


@pytest.mark.serial
def test_solutions_without_fields():
    result = over_ranks(None, keep_fields=False)
    assert {solution.fields for solution in result.solutions} == {None}
    assert np.all(np.isfinite(result["omega"]))
