"""First guesses for Newton's iteration: the taut string, and a solution whose zones are divided in another way."""

from __future__ import annotations

import math

import numpy as np

from belt_fenicsx.bvp_collocation import COARSE, Discrete, graded
from belt_fenicsx.bvp_problem import Problem
from belt_fenicsx.fields import Array
from belt_fenicsx.scene import Scene
from belt_fenicsx.taut_string import LEAST_STRAIN, taut_string


def guess(problem: Problem, scene: Scene, intervals: int = COARSE) -> Discrete:
    """The taut string on a coarse mesh."""
    rod, string = problem.rod, taut_string(scene)
    borders = string.borders if len(problem.zones) == 4 else string.borders[[0, 2]]
    ends = np.array([-0.5, *borders, 0.5])
    strains = np.maximum(string.strain, LEAST_STRAIN)
    layers = [
        math.sqrt(rod.a / (rod.b1 * np.mean(strains))) if zone.kind == "free" else math.sqrt(rod.a / rod.b2)
        for zone in problem.zones
    ]
    width = float(np.clip(2.0 * np.min(layers / np.diff(ends)), 1e-4, 1.0))
    mesh = graded(width, intervals)
    y, constants = [], []
    for i, zone in enumerate(problem.zones):
        sigma = ends[i] + mesh * (ends[i + 1] - ends[i])
        phi, D = string.phi(sigma), string.D(sigma)
        if zone.kind == "free":
            side = 0 if i == 0 else -1
            phi = np.full_like(sigma, string.angles[side])
            y += [*string.r(sigma).T, phi, np.zeros_like(sigma)]
            force = rod.b1 * strains[side]
            constants += [force * math.cos(phi[0]), force * math.sin(phi[0])]
        else:
            y += [phi, phi, -D / rod.radius]
            if zone.kind == "stick":
                constants.append(1.0 + strains[0])
            else:
                y.append(D)
    return Discrete(width=width, mesh=mesh, y=np.array(y), p=np.array([*borders, *constants]))


def divided(old: Problem, discrete: Discrete, new: Problem, borders: Array) -> Discrete:
    """A solution as a guess for another order of zones on the pulley.

    Args:
        old: The problem that was solved.
        discrete: Its solution.
        new: The problem to solve.
        borders: Borders of its zones on the pulley, both ends of the contact among them ``(len(new.zones) - 1,)``.
    """
    before = np.maximum.accumulate(old.borders(discrete.p))
    parts = old.parts(discrete.y, discrete.p)
    sticks = [c for zone, _, c in parts if zone.kind == "stick"]

    def state(sigma: float) -> Array:
        i = int(np.clip(np.searchsorted(before, sigma) - 1, 1, len(parts) - 2))
        xi = np.clip((sigma - before[i]) / max(before[i + 1] - before[i], 1e-300), 0.0, 1.0)
        zone, y, c = old.parts(discrete.between(xi)[:, None], discrete.p)[i]
        return zone.state(old.rod, y, c)[2:, 0]

    y, constants = [parts[0][1]], [parts[0][2]]
    for zone, start, end in zip(new.zones[1:-1], borders[:-1], borders[1:], strict=True):
        states = np.array([state(sigma) for sigma in start + discrete.mesh * (end - start)]).T
        y.append(states[: zone.unknowns])
        constants.append(sticks[0] if zone.kind == "stick" and sticks else states[3, : zone.constants])
    y, constants = np.concatenate([*y, parts[-1][1]]), np.concatenate([borders, *constants, parts[-1][2]])
    return Discrete(width=discrete.width, mesh=discrete.mesh, y=y, p=constants)
