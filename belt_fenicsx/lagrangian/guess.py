"""What the updates on a fixed mesh begin with: the taut belt, or the fields of another solution."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from belt_fenicsx.lagrangian.multipliers import Multipliers
from belt_fenicsx.lagrangian.taut import TautBelt
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.hermite import interpolate
from belt_fenicsx.scene.path import Arc
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.fields import Fields


class Guess(NamedTuple):
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


def from_taut_belt(scene: Scene, taut: TautBelt, nodes: Array, points: Array) -> Guess:
    """The taut belt with its pressure F D / R, and no friction.

    Args:
        scene: The dimensionless scene.
        taut: Its taut belt.
        nodes: Coordinates sigma of nodes ``(n,)``.
        points: Coordinates sigma of the Gauss points between them ``(cells, points)``.
    """
    values, slopes = taut.state(nodes)
    rate = scene.transport_rate
    if rate is None:
        rate = next(p.surface_speed for p in scene.pulleys if p.drive.kind == "omega") / taut.stretch
    force = scene.belt.extensional_stiffness * taut.strain - scene.belt.line_density * rate**2 * taut.stretch
    pressure = np.zeros_like(points)
    for i in taut.touching:
        arc = taut.pieces[i]
        assert isinstance(arc, Arc)
        touching = (taut.ends[i] <= points) & (points <= taut.ends[i + 1])
        pressure[touching] = max(force, 0.0) * taut.stretch / arc.radius
    return Guess(_clamped(scene, nodes, values), slopes, Multipliers(pressure, np.zeros_like(points)), rate)


def from_fields(scene: Scene, fields: Fields, rate: float, nodes: Array, points: Array) -> Guess:
    """The dimensionless fields and transport rate of another solution; other arguments as those of `from_taut_belt`."""
    sigma, number, turn = fields.sigma, np.arange(len(fields.sigma)), 0.0
    if scene.closed:
        # Fields of a loop begin at its first run-up, and the mesh in the middle of its last span.
        last = fields.sigma[fields.zone == fields.zone[-1]]
        sigma = np.concatenate([sigma - 1.0, sigma]) + 0.5 - (last[0] + last[-1]) / 2.0
        number, turn = np.tile(number, 2), fields.theta[-1] - fields.theta[0]
    # Around this rank's part of the belt alone; joints have two points.
    first, stop = np.searchsorted(sigma, nodes[[0, -1]]) + np.array([-3, 3])
    near = slice(max(0, first), stop)
    sigma, single = np.unique(sigma[near], return_index=True)
    at = number[near][single]
    theta, along, across = fields.theta[at], 1.0 + fields.eps[at], fields.Gamma[at]
    cos, sin = np.cos(theta), np.sin(theta)
    slopes = np.column_stack([along * cos - across * sin, along * sin + across * cos, fields.kappa[at]])
    # Before it begins, a loop's angle is that of the turn before.
    values = np.column_stack([fields.r[at], theta - turn * (single + near.start < len(fields.sigma))])
    values, slopes = interpolate(nodes, sigma, values, slopes)
    p, f = (np.interp(points, sigma, traction[at]) for traction in (fields.p, fields.f))
    return Guess(_clamped(scene, nodes, values), slopes, Multipliers(p, f), scene.transport_rate or rate)


def _clamped(scene: Scene, nodes: Array, values: Array) -> Array:
    """The values, with the clamps where they are."""
    if not scene.closed:
        for node, end in zip((-0.5, 0.5), scene.ends, strict=True):
            values[nodes == node] = end
    return values
