"""Multipliers of the contact, their update (18.12), (18.16), and the penalty factors that it takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from belt_fenicsx.lagrangian.forms import State
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import SENSE
from belt_fenicsx.scene.pulley import RUN_OFF, RUN_UP, Pulley
from belt_fenicsx.scene.scene import Scene

# Size of an element, in the belt's length, below which the penalty stays as it is. Penetrations are known to rounding;
# with a larger penalty this alone changes the pressure by more than the updates may. On so fine a mesh the coarser
# one's multipliers are so good that few updates with this penalty do.
FINEST = 1e-4


@dataclass(frozen=True)
class Penalties:
    """Penalty factors from the stiffnesses of the belt and the sizes of its elements.

    Attributes:
        relaxed: P in the first phase. The pressure of a strain eps then takes a penetration of eps R / 50.
        full: P at the end, some thirty times the shear stiffness of an element over its size: the updates contract
            by a factor that does not depend on the mesh, and Newton's matrix stays well conditioned. That of the
            smallest element; larger ones have less.
        growth: Factor of P from one update to the next.
        size: Size of an element whose penalty is the full one; smaller ones have no more.
        friction: P_f. A string has D' = -f/b1, so b1 makes the update of the stick friction a Newton step.
    """

    relaxed: float
    full: float
    growth: float
    size: float
    friction: float

    @classmethod
    def of(cls, scene: Scene, size: float, scale: float = 1.0) -> Penalties:
        """The penalties for a scene and the size of its smallest element; ``scale`` is a factor on the full one."""
        belt, radius = scene.belt, scene.pulleys[0].radius
        relaxed = 50.0 * belt.extensional_stiffness / radius**2
        size = max(size, FINEST * belt.length)
        full = max(relaxed, scale * 32.0 * belt.shear_stiffness / size**2)
        return cls(relaxed=relaxed, full=full, growth=10.0, size=size, friction=belt.extensional_stiffness)

    def limits(self, sizes: Array) -> Array:
        """The full penalty of elements of these sizes."""
        return np.maximum(self.relaxed, self.full * (self.size / np.maximum(self.size, sizes)) ** 2)


@dataclass(frozen=True)
class Multipliers:
    """Multipliers of pressure and friction at the Gauss points of the owned cells ``(cells, points)``."""

    p: Array
    f: Array

    def updated(self, state: State, pulley: Pulley, *, penalty: Array, friction: float) -> Multipliers:
        """The multipliers after one update.

        Args:
            state: The state that Newton's method found for these multipliers.
            pulley: The pulley, whose transition tells stick from slip.
            penalty: Penalty P of the pressure ``(cells, points)``.
            friction: Penalty P_f of the stick friction; zero leaves the friction out.
        """
        p = np.maximum(0.0, self.p + penalty * state.g)
        if friction == 0.0:
            return Multipliers(p=p, f=self.f)
        bound = pulley.friction * p
        share = slip_share(state, pulley)
        stick = np.clip(_mean(self.f + friction * state.dD, state.weights * (p > 0.0)), -bound, bound)
        return Multipliers(p=p, f=(1.0 - share) * stick - share * SENSE[pulley.slip] * bound)


def _mean(values: Array, weights: Array) -> Array:
    """Mean over the points of each cell ``(cells, 1)``; zero where they have no weight.

    A cubic on a circle has D' of opposite signs at a cell's two points, which falls with the third power of its size.
    Little friction cannot make it zero at either: at its bound at both, with opposite signs, it held nothing at all.
    """
    whole = np.sum(weights, axis=1, keepdims=True)
    return np.sum(weights * values, axis=1, keepdims=True) / np.where(whole > 0.0, whole, 1.0)


def slip_share(state: State, pulley: Pulley) -> Array:
    """How much of each Gauss point's part of its cell lies after the transition, from 0 to 1.

    A sharp choice would move the transition by up to a Gauss point's part of the cell, and the answer with it.
    """
    if isinstance(pulley.x_trans, str):
        return np.full_like(state.sigma, {RUN_UP: 1.0, RUN_OFF: 0.0}[pulley.x_trans])
    width = np.abs(state.dr[..., 0]) * state.weights
    return np.clip((state.r[..., 0] - pulley.x_trans) / width + 0.5, 0.0, 1.0)
