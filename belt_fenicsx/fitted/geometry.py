"""Where the nodes are while Newton's iteration moves them: chords, and what deviates from them in each cell's frame.

Nodes in contact go along their pulley; free zones follow. What the forms need of a chord, small differences of large
numbers, is computed in C (`geometry.c`): NumPy's long doubles take ten times as long.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from belt_fenicsx.backend.native import doubles, library
from belt_fenicsx.fitted.cells import Mesh
from belt_fenicsx.fitted.dofs import local
from belt_fenicsx.fitted.elements import points
from belt_fenicsx.fitted.forms import CHORD
from belt_fenicsx.fitted.nodes import on_chords, ways
from belt_fenicsx.fitted.state import State
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.scene import Scene

# The angle of a cell's frame is a whole number of radians over this.
FRAMES = 2.0**20
DECLARATIONS = """
void measure(int cells, int stride, double *row, int chord, int length, const double *radius, const double *frame);
void shift(int cells, int nodes, int stride, double *row, int chord, const double *at, const double *way,
           const double *center);
"""


class Geometry:
    """The nodes of all cells, in the data of the forms.

    Args:
        mesh: Layout and cells.
        degree: Degree k.
        loads: Whether pulleys may move.
        data: Unknowns of each cell, and further behind them what the forms know of its chord, one cell in a row.
        chord: Where the latter begin.

    Attributes:
        chords: Each cell's left end as seen from the centre of its pulley, and the vector from there to its right end,
            in the complex plane ``(n, 2)``.
    """

    def __init__(self, mesh: Mesh, degree: int, loads: bool, data: Array, chord: int) -> None:
        at, self._mesh, self._loads = local(degree), mesh, loads
        self._library = library(Path(__file__).with_suffix(".c"), DECLARATIONS)
        # In the complex plane, a turn is a product.
        self._deviation, self.chords = (data[:, slots].view(complex) for slots in (at.r, slice(chord, chord + 4)))
        bulge = chord + CHORD.index("bulge_x")
        self._bulge, self._turn = data[:, bulge : bulge + 2], data[:, at.theta]
        self._nodes, self._touches = np.ascontiguousarray(points(degree)[0]), mesh.touches.astype(float)
        self._shape, self._still = self._nodes * (1.0 - self._nodes), np.zeros(len(data), dtype=complex)
        self._radius, self._frame = np.empty((2, len(data)))
        row = *data.shape, doubles(data), chord
        self._measured = *row, at.sigma.stop - 1, doubles(self._radius), doubles(self._frame)
        self._shifted = len(data), degree + 1, *row[1:], doubles(self._nodes)

    def load(self, scene: Scene, state: State) -> None:
        """Begins with the nodes of a state, whose values are in the data already.

        Takes the frame's angle off theta, and the parabola over the chord off r.
        """
        mesh, pulleys = self._mesh, scene.pulleys
        # On this radius runs the middle line.
        self._radius[:] = np.array([pulley.radius for pulley in pulleys])[mesh.pulley] + scene.belt.contact_offset
        self._side = np.array([pulley.turn for pulley in pulleys])[mesh.pulley]
        # The data of the forms have the way of each pulley, which is nothing where none moves.
        self._ways = ways(scene)[mesh.pulley] if self._loads else self._still
        self._cells = state.cells
        self.chords.view(float)[:] = state.chords
        # Rounded so that cells that meet at a node agree on its angle to the last bit.
        self._frame[:] = np.rint(self._turn[:, 0] * FRAMES) / FRAMES
        self._turn -= self._frame[:, None]
        bulge = self._arcs()[:, None]
        self._bulge[:], self._parabolas = bulge.view(float), bulge * self._shape
        self._deviation -= self._parabolas
        self.measure()

    def measure(self) -> None:
        """Computes what the forms need to know of the chords."""
        self._library.measure(*self._measured)

    def put_together(self, values: Array) -> Array:
        """Adds to the values of all cells what was taken off, and gives back the chords ``(n, 4)``."""
        at = local(self._nodes.size - 1)
        values[:, at.theta] += self._frame[:, None]
        values[:-1, at.theta.start + 1] = values[1:, at.theta.start]
        values[:, at.r].view(complex)[:] += self._parabolas
        return self.chords.view(float).copy()

    def _arcs(self) -> Array:
        """Bulge of the parabola over each chord that is as high as the pulley's arc, in the complex plane ``(n,)``."""
        along = self.chords[:, 1]
        length = np.abs(along)
        depth = np.sqrt(np.maximum(self._radius**2 - (length / 2) ** 2, 0.0))
        return self._touches * self._side * (length**2 / (self._radius + depth)) * (1j * along / length)

    def move(self, way: Array, moves: Array, *, bent: bool) -> None:
        """Moves the nodes; what sums lose by rounding is kept in the deviation.

        Args:
            way: Step of the nodes, in the complex plane ``(n, k + 1)``.
            moves: Step of each cell's pulley along its way ``(n, 1)``.
            bent: Whether the way of nodes on the pulley is bent to it.
        """
        # The chords are seen from where the pulleys are now.
        centers = moves[:, 0] * self._ways if self._loads else self._still
        straight = self._onto_pulleys(way) if bent else np.ascontiguousarray(way)
        self._library.shift(*self._shifted, doubles(straight.view(float)), doubles(centers.view(float)))

    def _onto_pulleys(self, straight: Array) -> Array:
        """The way of nodes, bent to the pulley where they move on it; free zones follow the ends of the others.

        A straight step leaves the circle, and stretches the belt, by the square of its length. Where a joint moves
        through a short zone, the pressure and the friction that would mend this are larger than those by which the next
        step has to place the joint.

        Args:
            straight: Step of the nodes, in the complex plane ``(n, k + 1)``.
        """
        mesh, touches = self._mesh, self._touches[:, None]
        arm = on_chords(self.chords, self._nodes) + self._parabolas + self._deviation
        distance = np.abs(arm)
        turn = np.exp(1j * (straight * arm.conj()).imag / distance**2)
        bent = touches * (arm * (turn * (self._radius[:, None] / distance) - 1.0) - straight)
        # A free zone follows its moving ends as a sheared bar does: by the square of the distance from the other one.
        place = self._cells[:, :1] + (self._cells[:, 1:] - self._cells[:, :1]) * self._nodes
        for index, part in enumerate(mesh.layout.parts):
            if not part.touches:
                free = mesh.cells(index)
                before, after = free.start - 1, free.stop % len(bent)
                start = bent[before, 1] if mesh.layout.closed or free.start else 0.0
                end = bent[after, 0] if mesh.layout.closed or after else 0.0
                bent[free] = (1.0 - place[free]) ** 2 * start + place[free] ** 2 * end
        way = straight + bent
        # Cells that meet at a node shift it alike, to the last bit.
        way[1:, 0] = way[:-1, 1]
        if mesh.layout.closed:
            way[0, 0] = way[-1, 1]
        return way
