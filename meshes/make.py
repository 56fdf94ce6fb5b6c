"""Makes the meshes of this folder: node positions as text, and the same as gmsh meshes of lines.

    python meshes/make.py

The belt of the source's scene is one metre long. The graded meshes have their smallest cells where its fields have
kinks and layers: at the clamps, where contact begins and ends, and where stick turns into slip.
"""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np

HERE = Path(__file__).parent
HALF = 0.5
CELLS = 100
# Material-length coordinates of clamps, run-up, transition and run-off in the source's scene [m].
KINKS = (-0.5, -0.2330, 0.0006, 0.2327, 0.5)
RATIO = 20.0  # of the largest cell to the smallest
WIDTH = 0.04  # over which cells grow by half of that [m]


def uniform(cells: int) -> np.ndarray:
    """Nodes of equal cells ``(cells + 1,)`` [m]."""
    return np.linspace(-HALF, HALF, cells + 1)


def graded(cells: int, ratio: float = RATIO) -> np.ndarray:
    """Nodes of cells whose sizes follow the distance from the nearest kink ``(cells + 1,)`` [m]."""
    sigma = np.linspace(-HALF, HALF, 20_001)
    distance = np.min(np.abs(sigma[:, np.newaxis] - np.array(KINKS)), axis=1)
    size = 1.0 + (ratio - 1.0) * np.minimum(1.0, distance / (2.0 * WIDTH))
    count = np.append(0.0, np.cumsum((1.0 / size[1:] + 1.0 / size[:-1]) / 2.0))
    return np.interp(np.linspace(0.0, 1.0, cells + 1), count / count[-1], sigma)


def write(name: str, positions: np.ndarray) -> None:
    """Writes a mesh as text and for gmsh."""
    np.savetxt(HERE / f"{name}.txt", positions, fmt="%.17g", header="positions of the nodes [m]")
    points = np.column_stack([positions, np.zeros((len(positions), 2))])
    cells = np.column_stack([np.arange(len(positions) - 1), np.arange(1, len(positions))])
    meshio.Mesh(points, [("line", cells)]).write(HERE / f"{name}.msh", file_format="gmsh", binary=False)


if __name__ == "__main__":
    write(f"uniform_{CELLS}", uniform(CELLS))
    write(f"graded_{CELLS}", graded(CELLS))
