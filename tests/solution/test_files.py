"""Files: what is written comes back, and nothing is left half-written."""

import csv
import dataclasses
import io
import json
import struct
from dataclasses import replace
from types import SimpleNamespace
from zipfile import ZipFile

import meshio
import numpy as np
import pytest
from mpi4py import MPI

from belt_fenicsx import Scene, SceneError, Solution, Status, bvp, load_scene, solve
from belt_fenicsx.backend.atomic import replaced
from belt_fenicsx.command import main as cli
from belt_fenicsx.solution.files import columns, export, fields_csv, save, to_plain, write_centreline

serial = pytest.mark.serial
SCALARS = ("sigma", "theta", "D", "p", "f", "M", "v_rel", "speed", "tension")


def name_in_vtk(solution, name):
    return f"{name}[{columns(solution)[name][0].replace(' ', '.')}]"


@pytest.fixture(scope="module")
def solution():
    return bvp.solve(Scene(), rtol=1e-6)


@serial
def test_a_saved_solution_comes_back_whole(solution, tmp_path):
    solution.save(tmp_path / "result.npz")
    again = Solution.load(tmp_path / "result.npz")
    for name, values in vars(solution.fields).items():
        assert np.array_equal(values, getattr(again.fields, name)), name
    assert replace(again, fields=None) == replace(solution, fields=None)
    assert again.admissible


@serial
def test_a_failed_solution_comes_back_too(tmp_path):
    failed = Solution(scene=Scene(), method="made up", status=Status.NEWTON_DIVERGED, message="Stage `x`")
    save(failed, tmp_path / "failed.npz")
    again = Solution.load(tmp_path / "failed.npz")
    assert (again.status, again.message, again.fields) == (failed.status, failed.message, None)


@serial
def test_every_part_of_a_solution_is_kept(solution):
    """Whatever a solution gains: what compares has to come back."""
    left_aside = {"fields", "state", "evaluator"}
    assert set(to_plain(solution)) == {f.name for f in dataclasses.fields(Solution)} - left_aside


@serial
def test_a_loaded_solution_is_a_warm_start(solution, tmp_path):
    cold = solve(Scene(), method="augmented-lagrangian")
    save(cold, tmp_path / "result.npz")
    warm = solve(Scene(), method="augmented-lagrangian", initial=Solution.load(tmp_path / "result.npz"))
    assert warm.iterations < cold.iterations / 3
    assert warm.omega == pytest.approx(cold.omega, rel=1e-9)


@serial
@pytest.mark.parametrize("content", [None, b"", b"not a file of arrays", b"PK\x03\x04"])
def test_a_file_that_is_none_of_ours(content, tmp_path):
    path = tmp_path / "other.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SceneError, match="`path` must name a file that `save` wrote"):
        Solution.load(path)


@serial
def test_another_ending_is_refused(solution, tmp_path):
    with pytest.raises(SceneError, match="`path` must end in .npz"):
        save(solution, tmp_path / "result.dat")


@serial
def test_csv_has_units_and_reads_back(solution):
    head, *rows = csv.reader(io.StringIO(fields_csv(solution)))
    table = dict(zip(head, np.array(rows, dtype=float).T, strict=True))
    assert np.array_equal(table["p [N/m]"], solution.fields.p)
    assert np.array_equal(table["Q1 [N]"], solution.fields.Q[:, 0])
    assert np.array_equal(table["y [m]"], solution.fields.y)


@serial
@pytest.mark.parametrize("suffix", ["vtu", "vtk"])
def test_centreline_reads_back(suffix, solution, tmp_path):
    path = tmp_path / f"belt.{suffix}"
    write_centreline(solution, path)
    mesh = meshio.read(path)
    assert np.array_equal(mesh.points[:, :2], solution.fields.r)
    for name in SCALARS:
        assert np.array_equal(np.ravel(mesh.point_data[name_in_vtk(solution, name)]), getattr(solution.fields, name))
    assert np.array_equal(np.ravel(mesh.point_data["Q1[N]"]), solution.fields.Q[:, 0])
    assert len(mesh.cells_dict["line"]) == len(solution.fields.sigma) - 1


@serial
def test_a_folder_reproduces_its_result(solution, tmp_path):
    export(solution, tmp_path / "out")
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["belt.vtu", "fields.csv", "result.json", "result.npz", "scene.toml", "versions.json"]
    scene = load_scene(tmp_path / "out" / "scene.toml")
    assert scene == Scene()
    assert json.loads((tmp_path / "out" / "result.json").read_text())["omega"] == solution.omega
    assert "numpy" in json.loads((tmp_path / "out" / "versions.json").read_text())
    assert bvp.solve(scene, rtol=1e-6).omega == solution.omega


@serial
def test_a_write_that_fails_leaves_the_old_file(tmp_path):
    path = tmp_path / "result.txt"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), replaced(path) as partial:
        partial.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@serial
def test_a_link_leads_no_file_astray(tmp_path, monkeypatch):
    victim, path = tmp_path / "victim", tmp_path / "result.txt"
    victim.write_text("old")
    path.symlink_to(victim)
    with replaced(path) as partial:
        partial.write_text("new")
    assert (victim.read_text(), path.read_text(), path.is_symlink()) == ("old", "new", False)

    monkeypatch.setattr("secrets.token_hex", lambda count: "known")
    (tmp_path / ".known.txt").symlink_to(victim)
    with pytest.raises(FileExistsError), replaced(path):
        pass
    assert victim.read_text() == "old"


@serial
def test_files_are_as_readable_as_others(tmp_path):
    (tmp_path / "other").touch()
    with replaced(tmp_path / "result.txt") as partial:
        partial.write_text("new")
    assert (tmp_path / "result.txt").stat().st_mode == (tmp_path / "other").stat().st_mode


@serial
@pytest.mark.parametrize("length", [250, 300])
def test_long_names(length, tmp_path, capsys):
    path = tmp_path / ("a" * (length - 4) + ".csv")
    sweep = ["sweep", "--method", "bvp", "--over", "pulleys.0.x_trans=0,0.1", "--out", str(path)]
    for argv in (sweep, ["--method", "bvp", "--out", str(path)]):
        if length == 250 and argv[0] != "sweep":
            continue
        assert cli.main(argv) == 2
        assert "`--out` must name a file that can be made, got File name too long" in capsys.readouterr().err


@serial
@pytest.mark.parametrize(
    ("name", "change", "expected"),
    [
        ("p", lambda p: p[:-1], "fields.p"),
        ("r", lambda r: r[:, :1], "fields.r"),
        ("zone", lambda zone: zone + 4, "fields.zone"),
        ("zone", lambda zone: zone.astype(float), "fields.zone"),
        ("M", lambda M: M.astype(str), "fields.M"),
        ("p", None, "arrays"),
        ("solution", lambda text: str(text).replace('"f", ', ""), "arrays"),
        ("solution", lambda text: str(text).replace('"iterations": ', '"iterations": "3", "x": '), "solution"),
        ("solution", lambda text: str(text).replace("SOLVED", "SOVLED"), "solution"),
        ("solution", lambda text: str(text).replace("stick", 'stick", "more": "'), "solution"),
        ("solution", lambda text: "[" * 100_000, "RecursionError"),
    ],
)
def test_arrays_and_text_have_to_fit_together(name, change, expected, solution, tmp_path):
    solution.save(tmp_path / "result.npz")
    with np.load(tmp_path / "result.npz") as file:
        content = dict(file)
    content.update({name: change(content[name])} if change else {})
    if change is None:
        del content[name]
    np.savez(tmp_path / "other.npz", **content)
    with pytest.raises(SceneError, match=f"`path` must name a file that `save` wrote .*{expected}"):
        Solution.load(tmp_path / "other.npz")


@serial
@pytest.mark.parametrize(
    ("name", "change", "expected"),
    [
        ("coefficients", lambda coefficients: coefficients[:, 1:], "evaluator.coefficients"),
        ("coefficients", lambda coefficients: coefficients.astype(str), "evaluator.coefficients"),
        ("coefficients", lambda coefficients: coefficients[0, 0, 0], "evaluator.coefficients"),
        ("coefficients", lambda coefficients: coefficients[:0], "evaluator.coefficients"),
        ("counts", lambda counts: counts + 1, "evaluator"),
        ("counts", lambda counts: counts[1:], "evaluator.counts"),
        ("edges", lambda edges: edges[1:], "evaluator.coefficients"),
        ("edges", lambda edges: edges[:0], "evaluator.edges"),
        ("edges", None, "evaluator"),
    ],
)
def test_arrays_between_points_have_to_fit_together(name, change, expected, tmp_path):
    solution = solve(Scene())
    arrays = solution.evaluator.arrays
    arrays.update({name: change(arrays[name])} if change else {})
    if change is None:
        del arrays[name]
    replace(solution, evaluator=SimpleNamespace(arrays=arrays)).save(tmp_path / "other.npz")
    with pytest.raises(SceneError, match=f"`path` must name a file that `save` wrote .*`{expected}` must"):
        Solution.load(tmp_path / "other.npz")


@serial
def test_a_list_of_members_that_is_cut_off_is_no_solution_without_fields(solution, tmp_path):
    solution.save(tmp_path / "result.npz")
    content = bytearray((tmp_path / "result.npz").read_bytes())
    # The length of the comment to the first member, in the list of members, which then takes the others for it.
    content[content.index(b"PK\x01\x02") + 33] = 0x80
    (tmp_path / "result.npz").write_bytes(content)
    with pytest.raises(SceneError, match="`arrays` must be zone, weight, .* got none"):
        Solution.load(tmp_path / "result.npz")


@serial
def test_checksums_are_compared(solution, tmp_path):
    changed = dataclasses.replace(solution.fields, p=solution.fields.p * 1.001)
    solution.save(tmp_path / "one.npz")
    replace(solution, fields=changed).save(tmp_path / "other.npz")
    content, sums = (tmp_path / "other.npz").read_bytes(), []
    for name in ("one.npz", "other.npz"):
        with ZipFile(tmp_path / name) as archive:
            sums.append(struct.pack("<L", archive.getinfo("p.npy").CRC))
    assert Solution.load(tmp_path / "other.npz").fields == changed
    (tmp_path / "other.npz").write_bytes(content.replace(sums[1], sums[0]))
    with pytest.raises(
        SceneError, match="`path` must name a file that `save` wrote .*`p.npy` must be as it was written"
    ):
        Solution.load(tmp_path / "other.npz")


@serial
def test_command_line_writes_the_folder(tmp_path, capsys):
    assert cli.main(["--method", "bvp", "--out", str(tmp_path / "a" / "b")]) == 0
    assert (tmp_path / "a" / "b" / "result.npz").exists()
    (tmp_path / "file").write_text("")
    assert cli.main(["--method", "bvp", "--out", str(tmp_path / "file" / "b")]) == 2
    assert "`--out` must name a folder" in capsys.readouterr().err


def test_ranks_write_each_file_once_and_its_values_come_back(tmp_path):
    comm = MPI.COMM_WORLD
    folder = comm.bcast(tmp_path, root=0) / "out"
    assert cli.main(["--method", "augmented-lagrangian", "--elements", "60", "--out", str(folder)]) == 0
    comm.Barrier()
    fields = solve(Scene(), method="augmented-lagrangian", elements=60).fields
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["belt.vtu", "fields.csv", "result.json", "result.npz", "scene.toml", "versions.json"]

    again = Solution.load(folder / "result.npz")
    for name, values in vars(fields).items():
        assert np.array_equal(values, getattr(again.fields, name)), name
    assert fields_csv(again) == (folder / "fields.csv").read_text()
    mesh = meshio.read(folder / "belt.vtu")
    assert np.array_equal(mesh.points[:, :2], fields.r)
    assert np.array_equal(mesh.cells_dict["line"], np.arange(121)[:, np.newaxis] + (0, 1))
    assert np.all(np.diff(np.ravel(mesh.point_data["sigma[m]"])) > 0.0)
    for name in SCALARS:
        assert np.array_equal(np.ravel(mesh.point_data[name_in_vtk(again, name)]), getattr(fields, name)), name
