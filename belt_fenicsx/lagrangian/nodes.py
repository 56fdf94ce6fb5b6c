"""Nodes of meshes: those of a user, which are read and checked against the belt, coarser ones, and maps to them."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.checks import SceneError, Verbatim

# A mesh has this number of cells at least.
FEWEST = 8
# The outer nodes may be so far from the belt's ends, in its length: positions are often written with few digits.
END_TOLERANCE = 1e-9


def coarsen(nodes: Array, factor: int) -> Array:
    """Nodes of fewer cells by a factor, graded alike."""
    last = len(nodes) - 1
    return np.interp(np.linspace(0.0, last, last // factor + 1), np.arange(last + 1), nodes)


def node_positions(mesh: Any, *, length: float) -> Array:
    """The material-length coordinates of a mesh's nodes, the outer ones exactly at the belt's ends.

    Args:
        mesh: Increasing positions ``(n,)`` in [-Ls/2, Ls/2] [m]; or a file of them: ``.txt`` or ``.csv`` with one in a
            line, ``.npy``, or a mesh of lines along x that meshio reads, such as ``.msh``, ``.xdmf`` and ``.vtu``.
        length: Length Ls of the belt [m].

    Returns:
        Positions ``(n,)`` [m].

    Raises:
        SceneError: The mesh cannot be read, is no mesh of this belt, or is too coarse.
    """
    positions = read_positions(Path(mesh)) if isinstance(mesh, str | PathLike) else _array(mesh)
    if len(positions) <= FEWEST:
        raise SceneError("mesh", f"have at least {FEWEST} cells", len(positions) - 1)
    steps = np.diff(positions)
    if not np.all(steps > 0.0):
        place = int(np.argmin(steps > 0.0))
        pair = Verbatim(f"{positions[place + 1]:g} after {positions[place]:g} as node {place + 1}")
        raise SceneError("mesh", "have nodes that increase [m]", pair)
    ends = np.array([-0.5, 0.5]) * length
    if not np.allclose(positions[[0, -1]], ends, rtol=0.0, atol=END_TOLERANCE * length):
        reach = Verbatim(f"[{positions[0]:.10g}, {positions[-1]:.10g}]")
        raise SceneError("mesh", f"cover the belt, [{ends[0]:g}, {ends[1]:g}] [m]", reach)
    positions[[0, -1]] = ends
    return positions


def read_positions(path: Path) -> Array:
    """Positions of nodes as a file has them ``(n,)`` [m].

    Raises:
        SceneError: The file cannot be read, or holds something else.
    """
    if not path.is_file():
        raise SceneError("mesh", "name a file that is there", str(path))
    try:
        return _array(READERS.get(path.suffix.lower(), _read_lines)(path))
    except SceneError:
        raise
    # Each format of meshio has its own ways to fail, and it ends the process for some.
    except (Exception, SystemExit) as error:
        expected = f"name a file of positions or a mesh that meshio reads ({type(error).__name__}: {error})"
        raise SceneError("mesh", expected, str(path)) from None


def map_slopes(positions: Array, *, closed: bool = False) -> Array:
    """Slopes at the nodes of a C1 map from unit cells to these.

    Harmonic means make it increase everywhere (Fritsch and Butland 1984, doi:10.1137/0905021); the outer slopes are
    extrapolated, within the bounds that keep it so. In a ring they are that of one node.
    """
    sizes = np.diff(positions)
    if closed:
        sizes = np.concatenate([sizes[-1:], sizes, sizes[:1]])
    inner = 2.0 * sizes[:-1] * sizes[1:] / (sizes[:-1] + sizes[1:])
    if closed:
        return inner
    outer, next_to_it = sizes[[0, -1]], sizes[[1, -2]]
    ends = np.clip((3.0 * outer - next_to_it) / 2.0, outer / 2.0, 2.0 * outer)
    return np.concatenate([ends[:1], inner, ends[1:]])


def _array(values: Any) -> Array:
    try:
        positions = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise SceneError("mesh", "be positions of nodes [m] or the name of a file", values) from None
    if positions.ndim != 1:
        raise SceneError("mesh", "be one row of positions [m]", Verbatim(f"shape {positions.shape}"))
    if not np.all(np.isfinite(positions)):
        raise SceneError("mesh", "have finite positions [m]", float(positions[~np.isfinite(positions)][0]))
    return positions


def _read_text(path: Path) -> Array:
    """Positions, one in a line; in a ``.csv``, the first line may be a header."""
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    rows = [line for line in lines if line.partition("#")[0].strip()]
    comma = "," if path.suffix.lower() == ".csv" else None
    if comma and rows and not re.search(r"\d", rows[0].partition(comma)[0]):
        del rows[0]
    if not rows:
        raise SceneError("mesh", "hold positions", Verbatim(f"none in {path}"))
    if "," in rows[0] and (comma is None or len(rows) > 1):
        raise SceneError("mesh", "have one position in a line, with a decimal point", rows[0])
    return np.loadtxt(rows, delimiter=comma, ndmin=1)


def _read_lines(path: Path) -> Array:
    import meshio

    # The reader of gmsh's files prints an empty line.
    with contextlib.redirect_stdout(io.StringIO()):
        mesh = meshio.read(path)
    if "line" not in mesh.cells_dict:
        raise SceneError("mesh", "have cells of the type line", Verbatim(", ".join(mesh.cells_dict) or "none"))
    numbers, cells = np.unique(mesh.cells_dict["line"], return_inverse=True)
    points = mesh.points[numbers]
    x, off = points[:, 0], np.abs(points[:, 1:]).max(initial=0.0)
    if off > END_TOLERANCE * np.ptp(x):
        raise SceneError("mesh", "lie on the x axis", Verbatim(f"y, z up to {off:g}"))
    order = np.argsort(x)
    chain = np.unique(np.sort(np.argsort(order)[cells.reshape(-1, 2)], axis=1), axis=0)
    gaps = np.setdiff1d(np.arange(len(x) - 1), chain[chain[:, 1] - chain[:, 0] == 1, 0])
    if len(gaps):
        gap = Verbatim(f"none from x = {x[order[gaps[0]]]:g} to the next node")
        raise SceneError("mesh", "be one chain of lines", gap)
    if len(chain) >= len(x):
        raise SceneError("mesh", "be one chain of lines", Verbatim(f"{len(chain)} lines between {len(x)} nodes"))
    return x[order]


# The ending of a file tells its reader; other endings are meshio's.
READERS: dict[str, Callable[[Path], Array]] = {".txt": _read_text, ".csv": _read_text, ".npy": np.load}
