"""The state of the belt on a fixed mesh: its kinematics point by point."""

from __future__ import annotations

from typing import NamedTuple

from belt_fenicsx.layout.arrays import Array


class State(NamedTuple):
    """Kinematics at points of the belt, arrays of one shape.

    They are ``(cells, points)`` at the Gauss points of the owned cells, and ``(n,)`` at the points of all ranks and the
    belt's ends, in their order along the belt.

    Attributes:
        sigma: Material-length coordinate; a loop begins in the middle of its last span.
        weight: Gauss weight, a material length.
        x: Global coordinate x.
        y: Global coordinate y.
        theta: Angle of the cross-section, counted on along the belt.
        dx: x'.
        dy: y'.
        kappa: theta'.
        dD: D' of the fibre that would touch the nearest pulley.
        g: Penetration into the nearest pulley, negative outside.
        fibre_x: Global coordinate x of the fibre.
        stretch: Stretch D of the fibre.
        level: D from which the speed of a belt that sticks is taken: that at the point, or the mean at its cell's ends.
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
    fibre_x: Array
    stretch: Array
    level: Array
