"""What the updates on a fixed mesh begin with: the taut string, or the fields of another solution."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from belt_fenicsx.lagrangian.multipliers import Multipliers
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.string import taut_string


class Guess(NamedTuple):
    """A state to begin with.

    Attributes:
        values: x, y and theta at the nodes ``(n, 3)``.
        slopes: Their derivatives by sigma ``(n, 3)``.
        multipliers: Multipliers at the Gauss points.
    """

    values: Array
    slopes: Array
    multipliers: Multipliers


def from_string(scene: Scene, nodes: Array, points: Array) -> Guess:
    """The taut string with its pressure T D / R, and no friction.

    Args:
        scene: The dimensionless scene.
        nodes: Coordinates sigma of nodes ``(n,)``.
        points: Coordinates sigma of the Gauss points between them ``(cells, points)``.

    Raises:
        Stopped: It does not touch the pulley.
    """
    string, radius = taut_string(scene), scene.pulleys[0].radius
    if string is None:
        raise Stopped(Status.CONTACT_LOST, "the taut string does not touch the pulley")
    up, off = string.joints[0], string.joints[-1]
    D, phi = string.D(nodes), string.phi(nodes)
    kappa = np.where((up <= nodes) & (nodes <= off), -D / radius, 0.0)
    tension = scene.belt.extensional_stiffness * float(np.mean(string.strain))
    pressure = np.where((up <= points) & (points <= off), tension * float(np.mean(D)) / radius, 0.0)
    return Guess(
        values=_clamped(scene, nodes, np.column_stack([string.r(nodes), phi])),
        slopes=_slopes(D, phi, kappa),
        multipliers=Multipliers(p=pressure, f=np.zeros_like(points)),
    )


def from_fields(scene: Scene, fields: Fields, nodes: Array, points: Array) -> Guess:
    """The dimensionless fields of another solution; other arguments as those of `from_string`."""
    first, last = np.searchsorted(fields.sigma, nodes[[0, -1]])
    # Around this rank's part of the belt alone; borders of zones have two points.
    near = slice(max(0, first - 3), last + 3)
    sigma, single = np.unique(fields.sigma[near], return_index=True)
    r, theta, D, phi, kappa = (
        field[near][single] for field in (fields.r, fields.theta, fields.D, fields.phi, fields.kappa)
    )
    spline = CubicHermiteSpline(sigma, np.column_stack([r, theta]), _slopes(D, phi, kappa))
    p, f = (np.interp(points, fields.sigma, traction) for traction in (fields.p, fields.f))
    return Guess(_clamped(scene, nodes, spline(nodes)), spline(nodes, 1), Multipliers(p, f))


def _slopes(D: Array, phi: Array, kappa: Array) -> Array:
    return np.column_stack([D * np.cos(phi), D * np.sin(phi), kappa])


def _clamped(scene: Scene, nodes: Array, values: Array) -> Array:
    """The values, with the clamps where they are."""
    for side in (-1, 1):
        values[nodes == side * scene.belt.length / 2] = (side * scene.span / 2, 0.0, 0.0)
    return values
