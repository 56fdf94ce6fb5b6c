"""The state of the belt on a fixed mesh: its kinematics point by point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.pulley import RUN_UP, Pulley


class State(NamedTuple):
    """Kinematics at points of the belt, arrays of one shape.

    They are ``(cells, points)`` at the Gauss points of the owned cells, and ``(n,)`` at the points of all ranks and the
    clamps, in their order along the belt.

    Attributes:
        sigma: Material-length coordinate.
        weight: Gauss weight, a material length.
        x: Global coordinate x.
        y: Global coordinate y.
        theta: Angle of the cross-section.
        dx: x'.
        dy: y'.
        kappa: theta'.
        dD: D'.
        g: Penetration, negative outside the pulley.
        share: Share of the point's part of its cell that lies after the transition, from 0 to 1.
    """

    sigma: Array
    weight: Array
    x: Array
    y: Array
    theta: Array
    dx: Array
    dy: Array
    kappa: Array
    dD: Array
    g: Array
    share: Array

    @property
    def D(self) -> Array:
        """Stretch."""
        return np.hypot(self.dx, self.dy)


def slip_share(x: Array, width: Array, pulley: Pulley) -> Array:
    """The ``share`` of a state, from its x and the widths in x of the points' parts of their cells.

    A sharp choice would move the transition by up to such a part, and the answer with it.
    """
    if not isinstance(pulley.x_trans, float):
        return np.full_like(x, float(pulley.x_trans == RUN_UP))
    return np.clip((x - pulley.x_trans) / width + 0.5, 0.0, 1.0)
