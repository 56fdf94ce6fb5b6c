"""What fixed-mesh solves share: among threads and ranks, after an interruption, with bad options, over many meshes."""

from __future__ import annotations

import functools
import gc
import locale
import os
import subprocess
import sys
import threading
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

import belt_fenicsx
from belt_fenicsx import Belt, Pulley, Scene, SceneError
from belt_fenicsx.lagrangian.forms import Terms
from belt_fenicsx.lagrangian.problems import Problems

solve = functools.partial(belt_fenicsx.solve, method="augmented-lagrangian")

SCENES = [Scene(belt=Belt(thickness=h)) for h in np.linspace(0.03, 0.06, 16)]


def numbers(scene: Scene) -> tuple[float, float, bytes]:
    """What of an answer has to be the same to the last bit."""
    solution = solve(scene, elements=40, comm=MPI.COMM_SELF, throw=False)
    return solution.omega, solution.contacts[0].torque, solution.fields.p.tobytes()


@pytest.mark.parametrize("threads", [2, 4, 8])
def test_solves_of_several_threads_are_the_serial_ones_to_the_last_bit(threads):
    serial = [numbers(scene) for scene in SCENES]
    with ThreadPoolExecutor(threads) as pool:
        assert list(pool.map(numbers, SCENES)) == serial


@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="needs several ranks")
def test_several_ranks_solve_in_their_main_threads_only():
    with ThreadPoolExecutor(1) as pool, pytest.raises(SceneError, match="`comm` must have one rank in any thread but"):
        pool.submit(solve, Scene(), comm=MPI.COMM_WORLD).result()
    assert threading.current_thread() is threading.main_thread()


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, ArithmeticError])
def test_a_solve_that_was_interrupted_spoils_none_after_it(monkeypatch, interruption):
    before = solve(Scene(), elements=44)

    def interrupted(*_: object, **__: object) -> None:
        raise interruption

    with monkeypatch.context() as patch:
        patch.setattr("belt_fenicsx.lagrangian.newton.petsc.assemble_matrix", interrupted)
        with pytest.raises(interruption):
            solve(Scene(), elements=44)
    assert solve(Scene(), elements=44).omega == before.omega


def test_a_problem_is_kept_unless_an_error_came_between():
    kept = Problems(MPI.COMM_SELF)
    with kept.using(20, (), Terms()) as first:
        pass
    with pytest.raises(ArithmeticError), kept.using(20, (), Terms()) as again:
        assert again is first
        raise ArithmeticError
    with kept.using(20, (), Terms()) as other:
        assert other is not first


def test_problems_are_kept_up_to_a_number_of_elements():
    kept = Problems(MPI.COMM_SELF, most_elements=70)
    used = []
    for elements in (30, 40, 30, 50, 80, 30):
        with kept.using(elements, (), Terms()) as problem:
            used.append(problem)
    # 50 fits beside neither 40 nor 30, and 80 alone is too large.
    assert used[2] is used[0]
    assert used[5] is not used[0]


@pytest.mark.parametrize(("name", "value"), [("snes_rtol", "abc"), ("pc_type", "no such thing"), ("snes_max_it", "x")])
def test_options_that_petsc_does_not_take_are_named_and_leave_nothing(name, value):
    with pytest.raises(SceneError, match=f"`options.{name}` must have a value that PETSc takes, got '{value}'"):
        solve(Scene(), elements=30, options={"snes_atol": 0.0, name: value})
    assert not [key for key in PETSc.Options().getAll() if key.startswith("belt_")]
    assert solve(Scene(), elements=30).success


@pytest.mark.serial
@pytest.mark.skipif(not os.path.exists("/usr/share/i18n/locales/de_DE"), reason="needs a German locale")
def test_numbers_with_a_comma(tmp_path):
    """Where C writes and reads numbers with a comma, PETSc takes no option with a point."""
    subprocess.run(["localedef", "-i", "de_DE", "-f", "UTF-8", str(tmp_path / "de_DE.UTF-8")], check=True)
    script = (
        "import locale; from belt_fenicsx import Scene, solve\n"
        "locale.setlocale(locale.LC_ALL, 'de_DE.UTF-8')\n"
        "solve(Scene(), method='augmented-lagrangian', elements=30, options={'snes_rtol': 0.125})"
    )
    environment = {**os.environ, "LOCPATH": str(tmp_path)}
    subprocess.run([sys.executable, "-c", script], env=environment, check=True, timeout=100)
    assert locale.localeconv()["decimal_point"] == "."


def test_problems_that_are_no_longer_kept_are_freed():
    kept = Problems(MPI.COMM_WORLD, most=2)
    references = []
    for elements in range(20, 28):
        with kept.using(elements, (), Terms()) as problem:
            references.append((weakref.ref(problem), weakref.ref(problem.space.mesh)))
    del problem
    gc.collect()
    assert [reference() is not None for reference, _ in references] == [False] * 6 + [True] * 2
    assert [reference() is not None for _, reference in references] == [False] * 6 + [True] * 2


def different(argument: str) -> Callable[[], object]:
    """A solve whose argument is another on the last rank."""
    last = MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1
    arguments = {
        "friction": lambda: solve(Scene(pulleys=(Pulley(friction=0.5 if last else 0.2),)), elements=40),
        "elements": lambda: solve(Scene(), elements=50 if last else 40),
        "rtol": lambda: solve(Scene(), elements=40, rtol=1e-9 if last else 1e-8),
        "options": lambda: solve(Scene(), elements=40, options={"snes_rtol": 1e-9} if last else None),
        "wrong": lambda: solve(Scene(), elements="10" if last else 40),
    }
    return arguments[argument]


@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="needs several ranks")
@pytest.mark.parametrize("argument", ["friction", "elements", "rtol", "options", "wrong"])
def test_ranks_that_differ_in_what_they_ask_get_an_error_each(argument):
    with pytest.raises(SceneError) as caught:
        different(argument)()
    last = MPI.COMM_WORLD.size - 1
    wrong = "`elements` must be a whole number of at least 2, got '10'."
    differs = f"`scene` must be the same on all ranks that solve it together, .* rank 0 on rank {last}."
    assert caught.match(wrong if argument == "wrong" else differs)
    assert solve(Scene(), elements=40).success
