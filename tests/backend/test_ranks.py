"""Ranks that do not do the same: an answer or an error on each of them, never a wait for one that does not come."""

import pytest
from launched import START, on_ranks, run_on_ranks, told

from belt_fenicsx.command import main as cli

pytestmark = pytest.mark.serial


@pytest.mark.parametrize("alone", [0, 1])
def test_one_rank_alone_solves(alone):
    code = f"if rank == {alone}: tell(f'{{solve(Scene()).omega:.9f}}')"
    assert told(code) == [f"rank {alone}: 1.480709253"]


def test_after_one_rank_alone_all_share_a_mesh():
    code = """
if rank == 0: solve(Scene())
wait()
solution = solve(Scene(), **fixed | dict(elements=2000))
from petsc4py import PETSc
sharing = [stage.name for stage in solution.stages if stage.name == "sharing"]
tell(solution.status.name, f"{solution.omega:.5f}", *sharing, PETSc.Vec().createMPI(2).comm.size)
"""
    assert told(code) == ["rank 0: SOLVED 1.48071 2", "rank 1: SOLVED 1.48071 2"]


@pytest.mark.parametrize("method", ["fitted", "augmented-lagrangian"])
def test_fewer_scenes_than_ranks(method):
    code = f"tell(len(sweep([Scene()], method={method!r}, comm=MPI.COMM_WORLD).solutions))"
    assert told(code) == ["rank 0: 1", "rank 1: 1"]


@pytest.mark.parametrize(
    ("other", "name"),
    [
        ("rtol=-1.0", "rtol"),
        ("rtol=1e-7", "scene"),
        ("scene=3", "scene"),
        ("scene=Scene(pulleys=(Pulley(center=(0.0, -0.9)),))", "scene"),
        ("scene=Scene(pulleys=(Pulley(omega=1.48, x_trans=None),))", "scene"),
    ],
)
def test_other_arguments_on_one_rank_are_an_error_on_all(other, name):
    code = f"""
for odd in (0, 1):
    try:
        solve(**dict(scene=Scene()) | fixed | (dict({other}) if rank == odd else dict()))
    except SceneError as error:
        tell(error.field)
"""
    assert told(code) == [f"rank {rank}: {name}" for rank in (0, 0, 1, 1)]


@pytest.mark.parametrize("form", [[], ["--json"]])
def test_rows_of_a_sweep_are_those_of_one_process(form, capsys):
    argv = ["sweep", "--over", "pulleys.0.x_trans=-0.2,-0.1,0,0.1,0.6,0.2", "--rtol", "1e-6", *form]
    assert cli.main(argv) == 3
    alone, shared = capsys.readouterr().out.splitlines(), on_ranks("-m", "belt_fenicsx", *argv, code=3).splitlines()
    assert len(shared) == len(alone) == 6 + (not form)
    # The last digits depend on the answer from which a scene starts.
    lines = [[(line.split(",")[0], "SOLVED" in line) for line in lines] for lines in (shared, alone)]
    assert lines[0] == lines[1]


def test_rows_of_other_ranks_come_as_they_are_solved():
    code = """
from belt_fenicsx.sweeps.relay import Relay
shown = []
rows = Relay(MPI.COMM_WORLD, shown.append)
if rank == 1:
    for index in (1, 2, 4):
        rows.tell(index, f"{index}")
if rank == 0:
    MPI.COMM_WORLD.probe()
    rows.tell(0, "0")
    tell(*shown[:2])
    rows.tell(3, "3")
    rows.finish(5)
    tell(*shown)
"""
    assert told(code) == ["rank 0: 0 1", "rank 0: 0 1 2 3 4"]


def test_a_rank_says_for_whom_it_waits():
    code = """
import logging, time
from belt_fenicsx.backend import ranks as collective
collective.PATIENCE = 0.5
handler = logging.Handler()
handler.emit = lambda record: tell(record.getMessage()[:34])
logging.getLogger("belt_fenicsx").addHandler(handler)
if rank == 0: time.sleep(3)
tell(solve(Scene(), **fixed).status.name)
"""
    assert told(code) == ["rank 0: SOLVED", "rank 1: rank 1 waits for others of 2 ranks", "rank 1: SOLVED"]


def test_a_rank_that_waits_for_one_that_has_ended_ends_the_program():
    code = """
from belt_fenicsx.backend import ranks as collective
collective.PATIENCE, collective.LONGEST_WAIT = 0.2, 2.0
solve(Scene(), **fixed if rank == 0 else {})
"""
    result = run_on_ranks("-c", START + code)
    assert result.returncode == 1
    assert "rank 0 waits for others of 2 ranks" in result.stderr
    assert "they did not for 2 s, so all ranks are ended" in result.stderr
