"""Meshes of unequal cells: read, checked, mapped, and better where they are finer at the layers."""

import functools
import importlib.util
from pathlib import Path

import meshio
import numpy as np
import pytest
from mpi4py import MPI

import belt_fenicsx
from belt_fenicsx import Belt, Scene, SceneError, solve
from belt_fenicsx.backend import compat
from belt_fenicsx.lagrangian.mesh import unit_cells
from belt_fenicsx.lagrangian.nodes import map_slopes, node_positions

solve_fixed = functools.partial(belt_fenicsx.solve, method="augmented-lagrangian")

OMEGA = 1.4807092526223
MESHES = Path(__file__).parents[2] / "meshes"


@pytest.fixture(scope="module")
def make():
    spec = importlib.util.spec_from_file_location("make", MESHES / "make.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def error(**mesh):
    return abs(solve_fixed(Scene(), **mesh).omega / OMEGA - 1.0)


def test_files_are_what_their_script_makes(make):
    for name, positions in (("uniform_100", make.uniform(100)), ("graded_100", make.graded(100))):
        for suffix in (".txt", ".msh"):
            assert node_positions(MESHES / f"{name}{suffix}", length=1.0) == pytest.approx(positions, abs=1e-15)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("suffix", "options"), [(".xdmf", {"data_format": "XML"}), (".vtu", {}), (".msh", {"file_format": "gmsh"})]
)
def test_formats_of_other_tools(make, suffix, options, tmp_path, capfd):
    positions = make.graded(30)
    # In the order in which mesh generators number them: the ends first.
    order = np.append([0, 30], np.arange(1, 30))
    number = np.argsort(order)
    points = np.column_stack([positions[order], np.zeros((31, 2))])
    cells = [("line", np.column_stack([number[:-1], number[1:]]))]
    path = tmp_path / f"mesh{suffix}"
    meshio.Mesh(points, cells).write(path, **options)
    capfd.readouterr()
    assert node_positions(path, length=1.0) == pytest.approx(positions, abs=1e-15)
    assert capfd.readouterr().out == ""


def test_equal_cells_are_the_methods_own(make):
    own = solve_fixed(Scene(), elements=60)
    assert solve_fixed(Scene(), mesh=make.uniform(60)).omega == pytest.approx(own.omega, rel=1e-12)


def test_a_strongly_graded_mesh_converges_and_is_better_than_equal_cells(make):
    counts = np.array([60, 200, 800])
    errors = [error(mesh=make.graded(int(count))) for count in counts]
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] > 1.0
    for count in (100, 200, 400):
        assert error(mesh=make.graded(count)) < error(elements=count) / 4, count


def test_cells_that_jump_in_size_converge():
    def jumping(cells):
        return np.unique(np.concatenate([np.linspace(-0.5, 0.1, cells // 5 + 1), np.linspace(0.1, 0.5, cells + 1)]))

    assert error(mesh=jumping(800)) < error(mesh=jumping(200)) / 4 < 1e-5


def test_lengths_are_those_of_the_scene(make):
    belt = Belt(length=40.0, thickness=2.0, width=4.0)
    pulley = Scene().pulleys[0]
    large = Scene(
        belt=belt, span=40.0, pulleys=(type(pulley)(radius=28.0, center=(0.0, -23.0), friction=0.2, x_trans=0.0),)
    )
    one, other = solve_fixed(Scene(), mesh=make.graded(80)), solve_fixed(large, mesh=40.0 * make.graded(80))
    assert other.omega == pytest.approx(one.omega / 40.0, rel=1e-9)


def test_warm_start_on_another_mesh(make):
    coarse = solve_fixed(Scene(), elements=100)
    warm = solve_fixed(Scene(), mesh=make.graded(150), initial=coarse)
    assert warm.omega == pytest.approx(solve_fixed(Scene(), mesh=make.graded(150)).omega, rel=1e-7)


def test_same_omega_on_any_number_of_ranks(make):
    together, alone = (
        solve_fixed(Scene(), mesh=make.graded(250), comm=comm) for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)
    )
    assert together.omega == pytest.approx(alone.omega, rel=1e-12)


@pytest.mark.parametrize(("ratio", "rtol"), [(20.0, 1e-11), (20.0, 1e-13), (100.0, 1e-12), (1000.0, 1e-12)])
def test_updates_end_where_rounding_begins(make, ratio, rtol):
    """Small cells have large penalties, by which a rounding error of a penetration changes the pressure."""
    loose, tight = (solve_fixed(Scene(), mesh=make.graded(250, ratio), rtol=r) for r in (1e-9, rtol))
    assert tight.omega == pytest.approx(loose.omega, rel=1e-8)
    assert tight.measures["multiplier_change"] <= max(1e3 * rtol, 10.0 * tight.measures["rounding"])


def test_the_map_increases_everywhere(make):
    from scipy.interpolate import CubicHermiteSpline

    jumps = np.append(0.0, np.cumsum([1.0, 50.0, 1.0, 1.0, 1e-3, 30.0, 1.0, 1e3]))
    eta = np.linspace(0.0, len(jumps) - 1.0, 2001)
    assert np.all(CubicHermiteSpline(np.arange(len(jumps)), jumps, map_slopes(jumps))(eta, 1) > 0.0)


GOOD = np.linspace(-0.5, 0.5, 21)
BAD = {
    "none": (np.zeros(0), "at least 8 cells"),
    "coarse": (np.linspace(-0.5, 0.5, 8), "at least 8 cells, got 7"),
    "short": (GOOD * 0.9, r"cover the belt, \[-0.5, 0.5\] \[m\], got \[-0.45, 0.45\]"),
    "doubled": (np.sort(np.append(GOOD, 0.0)), "nodes that increase .*, got 0 after 0 as node 11"),
    "reversed": (GOOD[::-1], "nodes that increase"),
    "not a number": (np.where(GOOD == 0.0, np.nan, GOOD), "finite positions .*, got nan"),
    "table": (GOOD.reshape(3, 7), r"one row of positions \[m\], got shape \(3, 7\)"),
    "words": (["left", "right"], "be positions of nodes"),
    "missing": ("missing.msh", "name a file that is there, got 'missing.msh'"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_meshes(name):
    mesh, expected = BAD[name]
    with pytest.raises(SceneError, match=f"`mesh` must .*{expected}"):
        solve(Scene(), method="augmented-lagrangian", mesh=mesh, comm=MPI.COMM_SELF)


@pytest.mark.serial
@pytest.mark.parametrize(("suffix", "content"), [(".txt", "a b\n"), (".msh", "nothing"), (".unknown", "1\n2\n")])
def test_files_that_are_no_meshes(suffix, content, tmp_path):
    path = tmp_path / f"mesh{suffix}"
    path.write_text(content)
    with pytest.raises(SceneError, match="`mesh` must name a file of positions or a mesh that meshio reads"):
        node_positions(path, length=1.0)


@pytest.mark.serial
def test_a_mesh_that_is_no_line(tmp_path):
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    meshio.Mesh(points, [("triangle", [[0, 1, 2]])]).write(tmp_path / "triangle.vtu")
    with pytest.raises(SceneError, match="cells of the type line, got triangle"):
        node_positions(tmp_path / "triangle.vtu", length=1.0)
    meshio.Mesh(points, [("line", [[0, 1], [1, 2]])]).write(tmp_path / "bent.vtu")
    with pytest.raises(SceneError, match="lie on the x axis, got y, z up to 1"):
        node_positions(tmp_path / "bent.vtu", length=1.0)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.txt", "\ufeff{}"),
        ("a.TXT", "# nodes [m]\n\n{}"),
        ("a.csv", "{}"),
        ("a.csv", "x [m]\n{}"),
        ("a.CSV", "\ufeffx\n{}"),
        ("row.csv", None),
        ("a.npy", None),
    ],
)
def test_files_of_positions(name, content, tmp_path):
    path = tmp_path / name
    if name == "a.npy":
        np.save(path, GOOD)
    elif name == "row.csv":
        path.write_text(",".join(map(repr, GOOD.tolist())))
    else:
        path.write_text(content.format("\n".join(map(repr, GOOD.tolist()))), encoding="utf-8")
    assert np.array_equal(node_positions(path, length=1.0), GOOD)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("a.txt", "0,5\n0,6\n", "have one position in a line, with a decimal point, got '0,5'"),
        ("a.csv", "0,5\n0,6\n", "have one position in a line, with a decimal point, got '0,5'"),
        ("a.txt", "", "hold positions, got none in"),
        ("a.csv", "x\n", "hold positions, got none in"),
        ("a.npy", "", "name a file of positions"),
    ],
)
def test_files_without_positions(name, content, expected, tmp_path):
    (tmp_path / name).write_text(content)
    with pytest.raises(SceneError, match=f"`mesh` must {expected}"):
        node_positions(tmp_path / name, length=1.0)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("cells", "expected"),
    [
        (np.delete(np.arange(20), 7), "one chain of lines, got none from x = -0.15 to the next node"),
        (np.append(np.arange(20), 3), None),
        ([*((i, i + 1) for i in range(20)), (3, 9)], "one chain of lines, got 21 lines between 21 nodes"),
    ],
)
def test_lines_that_are_no_chain(cells, expected, tmp_path):
    lines = [(i, i + 1) for i in cells] if np.ndim(cells) == 1 else cells
    # Off the axis by rounding, as a generator leaves it.
    points = np.column_stack([GOOD, np.full((21, 2), 1e-18)])
    meshio.Mesh(points, [("line", lines)]).write(tmp_path / "a.vtu")
    if expected is None:
        assert np.array_equal(node_positions(tmp_path / "a.vtu", length=1.0), GOOD)
        return
    with pytest.raises(SceneError, match=expected):
        node_positions(tmp_path / "a.vtu", length=1.0)


def test_a_mesh_excludes_elements_and_fitted_zones():
    with pytest.raises(SceneError, match="`elements` must be left out with a mesh"):
        solve_fixed(Scene(), mesh=GOOD, elements=20)
    with pytest.raises(SceneError, match="`mesh` must be left out with the method fitted"):
        solve(Scene(), mesh=GOOD)


@pytest.mark.parametrize("elements", [MPI.COMM_WORLD.size + 1, 1000])
def test_unit_cells_are_shared_out_in_their_order(elements):
    domain, cells = unit_cells(elements, MPI.COMM_WORLD)
    mine = compat.nodes(domain)[cells]
    nodes = np.concatenate(MPI.COMM_WORLD.allgather(mine))
    assert np.array_equal(nodes, np.column_stack([np.arange(elements), np.arange(1, elements + 1)]))
    assert domain.topology.index_map(0).size_global == elements + 1
    assert len(mine) in (elements // MPI.COMM_WORLD.size, elements // MPI.COMM_WORLD.size + 1)
