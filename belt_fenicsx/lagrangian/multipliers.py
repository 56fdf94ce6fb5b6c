"""Multipliers of the contact, and the penalty factors of their updates (18.12)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.scene import Scene

# Elements below this size, in the belt's length, have no larger penalty. Penetrations are known to rounding; with a
# larger penalty this alone changes the pressure by more than the updates may. On so fine a mesh the coarser one's
# multipliers are so good that few updates with this penalty do.
FINEST = 1e-4


class Penalties(NamedTuple):
    """Penalty factors from the stiffnesses of the belt and the sizes of its elements.

    Attributes:
        relaxed: P in the first phase. The pressure of a strain eps then takes a penetration of eps R / 50.
        full: P at the end, some thirty times the shear stiffness of an element over its size: the updates contract
            by a factor that does not depend on the mesh, and Newton's matrix stays well conditioned. That of the
            smallest element; larger ones have less.
        size: Size of an element whose penalty is the full one; smaller ones have no more.
        friction: P_f. A string has D' = -f/b1, so b1 makes the update of the stick friction a Newton step. A fibre at
            an offset e is strained by the moment of friction, too, up to 1 + b1 e^2/a times as much where bending is
            free; the mean of these rates contracts best.
    """

    relaxed: float
    full: float
    size: float
    friction: float

    @classmethod
    def of(cls, scene: Scene, size: float, scale: float = 1.0) -> Penalties:
        """The penalties for a scene and the size of its smallest element; ``scale`` is a factor on the full one."""
        belt, radius = scene.belt, min(pulley.radius for pulley in scene.pulleys)
        relaxed = 50.0 * belt.extensional_stiffness / radius**2
        size = max(size, FINEST * belt.length)
        full = max(relaxed, scale * 32.0 * belt.shear_stiffness / size**2)
        b1 = belt.extensional_stiffness
        friction = b1 / (1.0 + b1 * belt.contact_offset**2 / (2.0 * belt.bending_stiffness))
        return cls(relaxed=relaxed, full=full, size=size, friction=friction)

    def limits(self, sizes: Array) -> Array:
        """The full penalty of elements of these sizes."""
        return np.maximum(self.relaxed, self.full * (self.size / np.maximum(self.size, sizes)) ** 2)


class Multipliers(NamedTuple):
    """Multipliers of pressure and friction at the Gauss points of the owned cells ``(cells, points)``."""

    p: Array
    f: Array
