"""Files that were damaged on their way: one named error, or what is in them; never another exception."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from belt_fenicsx import Scene, SceneError, Solution, bvp, load_scene
from belt_fenicsx.lagrangian.nodes import node_positions
from belt_fenicsx.sweeps.parts import Parts, keys

pytestmark = pytest.mark.serial

SHARE = 0.05  # of the bits, at most, that are turned
SCENE = Path(__file__).parents[2] / "demos" / "one_pulley.toml"


def mutations(content: bytes, count: int, seed: int):
    """The content with bits turned, bytes cut off at the end, left out or doubled."""
    random, whole = np.random.default_rng(seed), np.frombuffer(content, dtype=np.uint8)
    for number in range(count):
        data, kind = whole.copy(), number % 4
        if kind == 0:
            bits = np.unpackbits(data)
            bits ^= (random.random(bits.size) < SHARE).astype(np.uint8)
            data = np.packbits(bits)
        elif kind == 1:
            # Few bits leave most of a file's structure.
            places = random.integers(data.size, size=random.integers(1, 4))
            data[places] ^= 1 << random.integers(0, 8, size=places.size).astype(np.uint8)
        elif kind == 2:
            data = data[: random.integers(data.size)]
        else:
            start, end = np.sort(random.integers(data.size, size=2))
            data = (
                np.delete(data, slice(start, end)) if random.random() < 0.5 else np.insert(data, end, data[start:end])
            )
        yield data.tobytes()


def count_of(slow: bool, fast: int) -> int:
    return 20_000 if slow else fast


SLOW = [False, pytest.param(True, marks=pytest.mark.slow)]


@pytest.fixture(scope="module")
def solution():
    return bvp.solve(Scene(), rtol=1e-4)


@pytest.mark.parametrize("slow", SLOW)
def test_results(slow, solution, tmp_path):
    solution.save(tmp_path / "whole.npz")
    path, refused = tmp_path / "damaged.npz", 0
    for content in mutations((tmp_path / "whole.npz").read_bytes(), count_of(slow, 200), 1):
        path.write_bytes(content)
        try:
            again = Solution.load(path)
        except SceneError as error:
            assert error.field == "path" and len(str(error)) < 1000
            refused += 1
        else:
            assert again == solution
    assert refused > count_of(slow, 200) / 2


@pytest.mark.parametrize("slow", SLOW)
def test_rows_of_a_sweep(slow, solution, tmp_path):
    names = keys([Scene(), Scene(span=0.9)], {})
    with Parts(tmp_path / "whole.csv", 0) as parts:
        for name in names:
            parts.keep(name, solution)
    whole = (tmp_path / "whole.csv.part.0").read_bytes()
    table = tmp_path / "table.csv"
    kept = set()
    for content in mutations(whole, count_of(slow, 200), 2):
        (tmp_path / "table.csv.part.0").write_bytes(content)
        answers = Parts(table, 0).read()
        assert answers.keys() <= {*names}
        assert all(answer.contacts == solution.contacts for answer in answers.values())
        kept.add(len(answers))
    assert kept == {0, 1, 2}


@pytest.mark.parametrize(
    "line",
    ["3", "[]", "[" * 100_000, '{"key": [], "solution": 1, "digest": 2}', '{"key": "a"}', "\0", "NaN", '{"digest": 1}'],
    ids=lambda line: line[:10],
)
def test_lines_that_are_no_answers(line, tmp_path):
    (tmp_path / "table.csv.part.0").write_text(f"{line}\n")
    assert Parts(tmp_path / "table.csv", 0).read() == {}


@pytest.mark.parametrize("slow", SLOW)
def test_scenes(slow, tmp_path):
    path, made = tmp_path / "scene.toml", 0
    for content in mutations(SCENE.read_bytes(), count_of(slow, 800), 3):
        path.write_bytes(content)
        try:
            load_scene(path)
            made += 1
        except SceneError as error:
            assert str(error).isprintable() and len(str(error)) < 1000
    assert made > 0


MESHES = {
    ".txt": lambda path, x: np.savetxt(path, x),
    ".csv": lambda path, x: np.savetxt(path, x, delimiter=",", header="x [m]", comments=""),
    ".npy": np.save,
    ".msh": lambda path, x: chain(x).write(path, file_format="gmsh"),
    ".vtu": lambda path, x: chain(x).write(path),
    ".vtk": lambda path, x: chain(x).write(path),
    ".xdmf": lambda path, x: chain(x).write(path, data_format="XML"),
}


def chain(x):
    number = np.arange(len(x))
    return meshio.Mesh(
        np.column_stack([x, np.zeros((len(x), 2))]), [("line", np.column_stack([number[:-1], number[1:]]))]
    )


@pytest.mark.parametrize("suffix", MESHES)
@pytest.mark.parametrize("slow", SLOW)
def test_meshes(slow, suffix, tmp_path):
    x = np.linspace(-0.5, 0.5, 21)
    path, damaged = tmp_path / f"whole{suffix}", tmp_path / f"damaged{suffix}"
    MESHES[suffix](path, x)
    assert node_positions(path, length=1.0) == pytest.approx(x, abs=1e-15)
    for content in mutations(path.read_bytes(), count_of(slow, 100) // (3 if slow else 1), 4):
        damaged.write_bytes(content)
        try:
            positions = node_positions(damaged, length=1.0)
        except SceneError as error:
            assert error.field == "mesh"
        else:
            assert np.all(np.diff(positions) > 0.0)
