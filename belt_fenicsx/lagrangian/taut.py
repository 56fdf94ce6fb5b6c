"""The taut belt at rest as functions of the material length: where it begins, what mesh it wants, what is near what."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from belt_fenicsx.lagrangian.accuracy import FEWEST
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layers import LEAST_STRAIN, bending_layer, shear_layer
from belt_fenicsx.scene.path import Arc, Line, taut_path
from belt_fenicsx.scene.scene import Scene

# Elements are equal up to so many bending layers from where the taut belt touches, since the real one does elsewhere;
# from there on they grow, to so many times the length at most.
NEAR, LARGEST, LARGEST_ON_PULLEYS = 2.0, 4.0, 2.0
# An element next to contact has at most this part of a bending layer, if their number is not given.
RESOLVED = 0.35
COUNTED = 10_000  # Points at which elements are counted.
MOST = 10_000  # More elements are for those who ask for them.


@dataclass(frozen=True)
class TautBelt:
    """The taut middle line of a dimensionless belt, uniformly stretched.

    A loop begins in the middle of its last span, where nothing happens.

    Attributes:
        pieces: Lines and arcs, in the order of travel.
        ends: Their ends in the material-length coordinate ``(len(pieces) + 1,)``, from -1/2 to 1/2.
        stretch: The stretch D.
        winding: Angle by which a loop turns; zero between clamps.
    """

    pieces: tuple[Arc | Line, ...]
    ends: Array
    stretch: float
    winding: float

    @classmethod
    def of(cls, scene: Scene) -> TautBelt:
        """That of a dimensionless scene."""
        path = taut_path(scene)
        pieces: list[Arc | Line] = []
        winding = 0.0
        if path.closed:
            for arc, line in zip(path.arcs, path.lines, strict=True):
                pieces += [arc, line]
            last = path.lines[-1]
            middle = ((last.start[0] + last.end[0]) / 2, (last.start[1] + last.end[1]) / 2)
            # The last span is straight, so that its end lies a whole turn before the first run-up.
            winding = last.angle - path.arcs[0].start
            pieces = [Line(middle, last.end, last.angle - winding), *pieces[:-1], Line(last.start, middle, last.angle)]
        else:
            for line, arc in itertools.zip_longest(path.lines, path.arcs):
                pieces += [line] if arc is None else [line, arc]
        lengths = np.array([piece.length for piece in pieces])
        ends = np.append(0.0, np.cumsum(lengths)) / lengths.sum() - 0.5
        return cls(tuple(pieces), ends, float(lengths.sum()), winding)

    @property
    def direction(self) -> tuple[float, float]:
        """Direction of the belt where it begins."""
        first = self.pieces[0]
        assert isinstance(first, Line), "a belt begins free"
        return math.cos(first.angle), math.sin(first.angle)

    @property
    def strain(self) -> float:
        """Its strain, or that of a belt that is just taut."""
        return max(self.stretch - 1.0, LEAST_STRAIN)

    @property
    def touching(self) -> list[int]:
        """Indices of the arcs among the pieces, in the order of the pulleys."""
        return [i for i, piece in enumerate(self.pieces) if isinstance(piece, Arc)]

    @property
    def watersheds(self) -> Array:
        """Ends of the parts of the belt that are nearest to each pulley ``(pulleys + 1,)``."""
        on = self.touching
        between = [(self.ends[i + 1] + self.ends[j]) / 2 for i, j in itertools.pairwise(on)]
        return np.array([-0.5, *between, 0.5])

    def state(self, sigma: Array) -> tuple[Array, Array]:
        """x, y and theta ``(n, 3)``, and their derivatives by sigma ``(n, 3)``."""
        values, slopes = np.empty((len(sigma), 3)), np.empty((len(sigma), 3))
        inside = np.clip(np.searchsorted(self.ends, sigma, side="right") - 1, 0, len(self.pieces) - 1)
        for i in np.unique(inside):
            here, piece = inside == i, self.pieces[i]
            way = (sigma[here] - self.ends[i]) * self.stretch
            if isinstance(piece, Arc):
                phi = piece.start - piece.turn * way / piece.radius
                reach, rate = piece.turn * piece.radius, -piece.turn * self.stretch / piece.radius
                x, y = piece.center[0] - reach * np.sin(phi), piece.center[1] + reach * np.cos(phi)
            else:
                phi, rate = np.full_like(way, piece.angle), 0.0
                x, y = piece.start[0] + way * np.cos(phi), piece.start[1] + way * np.sin(phi)
            values[here] = np.column_stack([x, y, phi])
            slopes[here] = np.column_stack([self.stretch * np.cos(phi), self.stretch * np.sin(phi), 0.0 * phi + rate])
        return values, slopes

    def turned_nodes(self, nodes: Array) -> Array:
        """Nodes of a loop that are counted from its first run-up, from the one next to the middle of the last span."""
        first = int(np.argmin(np.abs(nodes + self.ends[1])))
        moved = np.concatenate([nodes[first:], nodes[1 : first + 1] + 1.0])
        return moved - moved[0] - 0.5

    def elements(self, scene: Scene) -> int:
        """Number of elements that resolve the bending layers and the shortest contact, within reason."""
        lengths = [float(self.ends[i + 1] - self.ends[i]) for i in self.touching]
        size = min(RESOLVED * bending_layer(scene, self.strain), min(lengths) / (2 * FEWEST))
        _, count = self._counted(scene, COUNTED)
        return min(MOST, math.ceil(count[-1] / size))

    def too_few_elements(self, nodes: Array) -> str:
        """What is to be said of a mesh with few elements on some pulley; empty where there are enough."""
        middles, on = (nodes[1:] + nodes[:-1]) / 2.0, self.touching
        lengths = np.array([self.ends[i + 1] - self.ends[i] for i in on])
        counts = lengths / np.interp([(self.ends[i] + self.ends[i + 1]) / 2.0 for i in on], middles, np.diff(nodes))
        pulley = int(np.argmin(counts))
        if counts[pulley] >= FEWEST:
            return ""
        wanted = math.ceil(FEWEST / counts[pulley] * (len(nodes) - 1))
        return f"; the taut belt has {counts[pulley]:.2g} elements on pulley {pulley}, {wanted} of all would do there"

    def nodes(self, scene: Scene, elements: int) -> Array:
        """Nodes of elements that are smaller where contact begins and ends, and at clamps ``(elements + 1,)``."""
        sigma, count = self._counted(scene, 64 * elements)
        nodes = np.interp(np.linspace(0.0, count[-1], elements + 1), count, sigma)
        nodes[[0, -1]] = -0.5, 0.5
        return nodes

    def _counted(self, scene: Scene, points: int) -> tuple[Array, Array]:
        """Places along the belt, and the elements up to there in units of the smallest one's length."""
        layer = bending_layer(scene, self.strain)
        inside = min(layer, shear_layer(scene, self.strain))
        sigma = np.linspace(-0.5, 0.5, points + 1)
        on = np.array([isinstance(piece, Arc) for piece in self.pieces])
        inside_of = np.clip(np.searchsorted(self.ends, sigma) - 1, 0, len(self.pieces) - 1)
        size = np.where(on[inside_of], LARGEST_ON_PULLEYS, LARGEST)
        for end in self.ends[1:-1] if scene.closed else self.ends:
            way = np.abs(sigma - end)
            size = np.minimum(size, 1.0 + np.maximum(0.0, way - NEAR * layer) / (2.0 * inside))
        pieces = np.diff(sigma) * (1.0 / size[1:] + 1.0 / size[:-1]) / 2.0
        return sigma, np.append(0.0, np.cumsum(pieces))
