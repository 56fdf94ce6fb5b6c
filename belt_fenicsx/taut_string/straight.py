"""The straight belt above a pulley that it does not touch: there is nothing to solve."""

from __future__ import annotations

import math

import numpy as np

from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.contact import Zone
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stage
from belt_fenicsx.solution.status import Status


def touches(scene: Scene) -> bool:
    """Whether the pulley reaches above the straight line between the clamps."""
    (pulley,) = scene.pulleys
    xc, H = pulley.center
    nearest = math.hypot(max(0.0, abs(xc) - scene.span / 2), H)
    return H >= 0.0 or nearest < pulley.radius


def straight_belt(scene: Scene, method: str) -> Solution:
    """The answer, in the name of the method that was asked."""
    belt = scene.belt
    stretch = scene.span / belt.length
    sigma = np.array([-0.5, 0.5]) * belt.length
    zero = np.zeros(2)
    fields = Fields.from_state(
        belt,
        zone=np.zeros(2, dtype=int),
        sigma=sigma,
        r=np.column_stack([stretch * sigma, zero]),
        theta=zero,
        phi=zero,
        D=np.full(2, stretch),
        rate=scene.transport_rate or math.nan,
        kappa=zero,
        p=zero,
        f=zero,
        v_rel=np.full(2, np.nan),
    )
    half = scene.span / 2
    return Solution(
        scene=scene,
        method=method,
        status=Status.NO_CONTACT,
        zones=(Zone(kind="free", sigma=(float(sigma[0]), float(sigma[1])), x=(-half, half)),),
        fields=fields,
        stages=(Stage(name="contact", why="skipped: the straight belt does not touch the pulley"),),
    )
