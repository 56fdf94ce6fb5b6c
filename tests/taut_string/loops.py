"""Closed loops at random."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from belt_fenicsx import Belt, Pulley, Scene, SceneError
from belt_fenicsx.scene.path import taut_path

YOUNG, SPEED, LEAST_WRAP = 1e8, 10.0, 0.05


def loops(count: int, seed: int) -> Iterator[Scene]:
    """Loops of two to six pulleys on either side: one gives the speed, the others turn freely."""
    random, made = np.random.default_rng(seed), 0
    while made < count:
        try:
            scene = _loop(random)
        except SceneError:
            continue
        if min(arc.wrap for arc in taut_path(scene).arcs) > LEAST_WRAP:
            made += 1
            yield scene


def driven(scene: Scene, index: int, **drive: Any) -> Scene:
    """The scene with another drive of a pulley."""
    none = {"omega": None, "torque": None, "slip_angle": None, "x_trans": None}
    pulleys = list(scene.pulleys)
    pulleys[index] = replace(pulleys[index], **{**none, **drive})
    return replace(scene, pulleys=tuple(pulleys))


def speeder(scene: Scene) -> int:
    """The pulley that gives the speed."""
    return next(i for i, pulley in enumerate(scene.pulleys) if pulley.omega is not None)


def _loop(random: Any) -> Scene:
    def spread(low: float, high: float) -> float:
        return float(np.exp(random.uniform(math.log(low), math.log(high))))

    inside = int(random.integers(2, 5))
    turns = np.sort(random.uniform(0.0, 2.0 * math.pi, inside))[::-1]
    centers = random.uniform(0.5, 1.0, inside) * (np.cos(turns) + 1j * random.uniform(0.3, 1.0, inside) * np.sin(turns))
    radii, mu, pulleys = [spread(0.05, 0.35) for _ in range(inside)], spread(0.02, 1.0), []
    for i, (center, radius) in enumerate(zip(centers, radii, strict=True)):
        pulleys.append(Pulley(radius=radius, center=(center.real, center.imag), friction=mu, torque=0.0))
        if random.random() < 0.4:
            # An idler presses on the belt's back.
            way = centers[(i + 1) % inside] - center
            idler, edge = spread(0.04, 0.15), 0.5 * (radius + radii[(i + 1) % inside])
            at = center + 0.5 * way + 1j * way / abs(way) * (edge + idler - random.uniform(0.05, 0.6) * edge)
            pulleys.append(Pulley(radius=idler, center=(at.real, at.imag), friction=mu, side="left", torque=0.0))
    pulleys = pulleys[:6]
    lead = int(random.integers(len(pulleys)))
    pulleys[lead] = replace(pulleys[lead], omega=SPEED / pulleys[lead].radius, torque=None)
    strain, smallest = spread(0.003, 0.04), min(pulley.radius for pulley in pulleys)
    thickness = spread(0.005, 0.12) * smallest
    belt = Belt(
        youngs_modulus=YOUNG,
        thickness=thickness,
        width=smallest / 2.0,
        contact_offset=float(random.choice((0.0, thickness / 2.0))),
        density=float(random.choice((0.0, random.uniform(0.01, 0.5) * strain * YOUNG / SPEED**2))),
    )
    return Scene(belt=belt, pulleys=tuple(pulleys), closed=True, elongation=strain)
