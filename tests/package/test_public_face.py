"""What the package shows, and what it does not load."""

import operator
import subprocess
import sys

import pytest

import belt_fenicsx
from belt_fenicsx.scene.checks import METHODS
from belt_fenicsx.solver import METHODS as TABLE

HEAVY = ("dolfinx", "petsc4py", "mpi4py", "ufl", "matplotlib", "scipy", "numpy")


def loaded_after(code: str) -> set[str]:
    """The heavy packages that a fresh Python has loaded after the code."""
    command = f"import sys\n{code}\nprint(*sorted({{name.partition('.')[0] for name in sys.modules}}))"
    result = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=True)
    return set(result.stdout.split("\n")[-2].split()) & set(HEAVY)


@pytest.mark.parametrize("name", ["Belt", "StiffnessBelt", "Pulley", "Scene", "SceneError", "load_scene"])
def test_scene_names(name):
    assert name in dir(belt_fenicsx)
    assert getattr(belt_fenicsx, name).__name__ == name


@pytest.mark.parametrize(("name", "home"), [("Solution", "solution"), ("Status", "status"), ("SolveError", "status")])
def test_solution_names(name, home):
    assert getattr(belt_fenicsx, name).__module__ == f"belt_fenicsx.solution.{home}"


def test_bvp_is_a_submodule():
    assert callable(belt_fenicsx.bvp.solve)


def test_solve_is_a_function():
    assert callable(belt_fenicsx.solve)


@pytest.mark.serial
def test_solve_stays_a_function_after_its_module_was_imported():
    code = """
import importlib, belt_fenicsx
importlib.import_module(belt_fenicsx.solve.__module__)
from belt_fenicsx import solve
assert callable(solve)
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_unknown_name():
    with pytest.raises(AttributeError, match="'belt_fenicsx' has no attribute 'solves'"):
        operator.attrgetter("solves")(belt_fenicsx)


@pytest.mark.serial
def test_import_loads_nothing_heavy():
    assert loaded_after("import belt_fenicsx") == set()


@pytest.mark.serial
def test_a_scene_loads_nothing_heavy():
    assert loaded_after("from belt_fenicsx import Scene, load_scene; load_scene('demos/one_pulley.toml')") == set()


@pytest.mark.serial
def test_a_wrong_argument_loads_nothing_heavy():
    assert loaded_after("from belt_fenicsx.command.main import main; assert main(['--rtol', 'x']) == 2") == set()


@pytest.mark.serial
def test_bvp_loads_no_fenics_and_no_mpi():
    assert loaded_after("from belt_fenicsx import Scene, bvp; bvp.solve(Scene())") == {"numpy", "scipy"}


@pytest.mark.serial
def test_command_line_with_bvp_loads_no_fenics_and_no_mpi():
    code = "from belt_fenicsx.command.main import main; assert main(['--method', 'bvp', '--json']) == 0"
    assert loaded_after(code) == {"numpy", "scipy"}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("argument", "value", "expected"),
    [
        ("initial", "a.npz", "be a Solution"),
        ("options", "abc", "be a mapping of the names of PETSc options"),
        ("options", {1: 2}, "be a mapping of the names of PETSc options"),
        ("comm", 3, "be an MPI communicator"),
        ("elements", "10", "be a whole number of at least 2"),
        ("rtol", "1e-8", "be a finite number"),
        ("method", "fem", "be one of"),
    ],
)
def test_arguments_of_another_kind(method, argument, value, expected):
    if argument not in ("method", "initial", "comm", "rtol", *TABLE[method].knows):
        expected = f"be left out with the method {method}"
    with pytest.raises(belt_fenicsx.SceneError, match=f"`{argument}` must {expected}"):
        belt_fenicsx.solve(belt_fenicsx.Scene(), **{"method": method, argument: value})


def test_each_method_has_a_row():
    assert tuple(TABLE) == METHODS


@pytest.mark.parametrize("method", METHODS)
def test_a_belt_clear_of_its_pulley_has_one_answer(method):
    scene = belt_fenicsx.Scene(pulleys=(belt_fenicsx.Pulley(center=(0.0, -0.8)),))
    solution = belt_fenicsx.solve(scene, method=method, throw=False)
    assert (solution.status.name, solution.method, solution.message) == ("NO_CONTACT", method, "")
    with pytest.raises(belt_fenicsx.SolveError, match="does not touch the pulley"):
        belt_fenicsx.solve(scene, method=method)
