"""What the updates for a general drive begin with: the taut belt, or the fields of another solution."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from belt_fenicsx.lagrangian.multipliers import Multipliers
from belt_fenicsx.lagrangian.track import Track
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.path import Arc
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.fields import Fields


class DriveGuess(NamedTuple):
    """A state to begin with.

    Attributes:
        values: x, y and theta at the nodes ``(n, 3)``.
        slopes: Their derivatives by sigma ``(n, 3)``.
        multipliers: Multipliers at the Gauss points.
        rate: Transport rate.
    """

    values: Array
    slopes: Array
    multipliers: Multipliers
    rate: float


def from_track(scene: Scene, track: Track, nodes: Array, points: Array) -> DriveGuess:
    """The taut belt with its pressure F D / R, and no friction.

    Args:
        scene: The dimensionless scene.
        track: Its taut belt.
        nodes: Coordinates sigma of nodes ``(n,)``.
        points: Coordinates sigma of the Gauss points between them ``(cells, points)``.
    """
    values, slopes = track.state(nodes)
    rate = scene.transport_rate
    if rate is None:
        rate = next(p.surface_speed for p in scene.pulleys if p.drive.kind == "omega") / track.stretch
    force = scene.belt.extensional_stiffness * track.strain - scene.belt.line_density * rate**2 * track.stretch
    pressure = np.zeros_like(points)
    for i in track.touching:
        arc = track.pieces[i]
        assert isinstance(arc, Arc)
        touching = (track.ends[i] <= points) & (points <= track.ends[i + 1])
        pressure[touching] = max(force, 0.0) * track.stretch / arc.radius
    return DriveGuess(_clamped(scene, nodes, values), slopes, Multipliers(pressure, np.zeros_like(points)), rate)


def from_fields(scene: Scene, fields: Fields, rate: float, nodes: Array, points: Array) -> DriveGuess:
    """The dimensionless fields and transport rate of another solution; other arguments as those of `from_track`."""
    cos, sin = np.cos(fields.theta), np.sin(fields.theta)
    slopes = np.column_stack(
        [(1.0 + fields.eps) * cos - fields.Gamma * sin, (1.0 + fields.eps) * sin + fields.Gamma * cos, fields.kappa]
    )
    table = np.column_stack([fields.sigma, fields.r, fields.theta, slopes, fields.p, fields.f])
    if scene.closed:
        # Fields of a loop begin at its first run-up, and the mesh in the middle of its last span.
        last = table[fields.zone == fields.zone[-1], 0]
        turned = table.copy()
        turned[:, 0] -= 1.0
        turned[:, 3] -= table[-1, 3] - table[0, 3]
        table = np.concatenate([turned, table])
        table[:, 0] += 0.5 - (last[0] + last[-1]) / 2.0
    sigma, single = np.unique(table[:, 0], return_index=True)
    spline = CubicHermiteSpline(sigma, table[single, 1:4], table[single, 4:7])
    p, f = (np.interp(points, table[:, 0], table[:, i]) for i in (7, 8))
    return DriveGuess(
        _clamped(scene, nodes, spline(nodes)), spline(nodes, 1), Multipliers(p, f), scene.transport_rate or rate
    )


def _clamped(scene: Scene, nodes: Array, values: Array) -> Array:
    """The values, with the clamps where they are."""
    if not scene.closed:
        for node, end in zip((-0.5, 0.5), scene.ends, strict=True):
            values[nodes == node] = end
    return values
