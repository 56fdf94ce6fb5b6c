"""First guesses for Newton's iteration: the taut string, and a solution whose zones are divided in another way."""

from __future__ import annotations

import math

import numpy as np

from belt_fenicsx.bvp.newton import COARSE, Discrete
from belt_fenicsx.bvp.problem import FIRST, LAST, Problem, placed_at, places
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layers import LEAST_STRAIN
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.taut_string.string import taut_string


def guess(problem: Problem, scene: Scene, intervals: int = COARSE) -> Discrete:
    """The taut string on a coarse mesh."""
    rod, string = problem.rod, taut_string(scene)
    assert string is not None, "a belt that is clear of the pulley is straight"
    borders = string.borders if len(problem.zones) == 4 else string.borders[[0, 2]]
    ends = np.array([-0.5, *borders, 0.5])
    strains = np.maximum(string.strain, LEAST_STRAIN)
    forces = [
        rod.b1 * strain * np.array([math.cos(angle), math.sin(angle)])
        for strain, angle in zip(strains, string.angles[[0, -1]], strict=True)
    ]
    sticks = [[1.0 + strains[0]] for zone in problem.zones if zone.kind == "stick"]
    p = np.concatenate([borders, forces[0], *sticks, forces[1]])
    widths, mesh = problem.widths(p), np.linspace(0.0, 1.0, intervals + 1)
    y = []
    for i, (zone, part) in enumerate(zip(problem.zones, places(widths, mesh), strict=True)):
        sigma = ends[i] + part * (ends[i + 1] - ends[i])
        phi, D = string.phi(sigma), string.D(sigma)
        if zone.kind == "free":
            angle = string.angles[0 if i == 0 else -1]
            y.append(np.array([*string.r(sigma).T, np.full_like(sigma, angle), np.zeros_like(sigma)]))
        else:
            y.append(np.array([phi, phi, -D / rod.radius, D][: zone.unknowns]))
    return Discrete(widths=widths, mesh=mesh, y=problem.stacked(y), p=p)


def from_fields(problem: Problem, solution: Solution, intervals: int = COARSE) -> Discrete:
    """The fields of a solution by any method, whose zones are those of the problem, on a coarse mesh."""
    assert solution.fields is not None, "a solution with zones has fields"
    _, units = solution.scene.dimensionless()
    fields, mesh = solution.fields.in_units(units.inverse()), np.linspace(0.0, 1.0, intervals + 1)
    borders = [zone.sigma[1] / units.length for zone in solution.zones[:-1]]
    force = (fields.Q[:, 0] + 1j * fields.Q[:, 1]) * np.exp(1j * fields.theta)
    constants = []
    for i, zone in enumerate(problem.zones):
        here = fields.zone == i
        if zone.kind == "free":
            mean = np.average(force[here], weights=fields.weight[here])
            constants += [mean.real, mean.imag]
        elif zone.kind == "stick":
            constants.append(np.average(fields.D[here], weights=fields.weight[here]))
    p, y = np.array([*borders, *constants]), []
    widths, ends = problem.widths(p), problem.borders(p)
    for i, (zone, part) in enumerate(zip(problem.zones, places(widths, mesh), strict=True)):
        here = fields.zone == i
        sigma = ends[i] + part * (ends[i + 1] - ends[i])
        names = (fields.x, fields.y) if zone.kind == "free" else (fields.phi,)
        unknowns = (*names, fields.theta, fields.kappa, fields.D)[: zone.unknowns]
        y.append(np.array([np.interp(sigma, fields.sigma[here], values[here]) for values in unknowns]))
    return Discrete(widths=widths, mesh=mesh, y=problem.stacked(y), p=p)


def divided(old: Problem, discrete: Discrete, new: Problem, borders: Array) -> Discrete:
    """A solution as a guess for another order of zones on the pulley.

    Args:
        old: The problem that was solved.
        discrete: Its solution.
        new: The problem to solve.
        borders: Borders of its zones on the pulley, both ends of the contact among them ``(len(new.zones) - 1,)``.
    """
    before = np.maximum.accumulate(old.borders(discrete.p))
    sticks = [c for zone, _, c in old.parts(discrete.y, discrete.p) if zone.kind == "stick"]
    spans = [old.parts(discrete.y, discrete.p)[end] for end in (FIRST, LAST)]

    def states(sigma: Array) -> Array:
        """The state phi, theta, kappa, D at places in contact ``(4, m)``."""
        index = np.clip(np.searchsorted(before, sigma) - 1, 1, len(old.zones) - 2)
        result = np.empty((4, sigma.size))
        for i in np.unique(index):
            here = index == i
            place = np.clip((sigma[here] - before[i]) / max(before[i + 1] - before[i], 1e-300), 0.0, 1.0)
            xi = placed_at(discrete.widths[i : i + 1], place[None])[0]
            zone, y, c = old.parts(discrete.between(xi), discrete.p)[i]
            result[:, here] = zone.state(old.rod, y, c)[2:]
        return result

    constants = [spans[0][2]]
    for zone, D in zip(new.zones[1:-1], states(borders[:-1])[3], strict=True):
        constants.append(sticks[0] if zone.kind == "stick" and sticks else np.full(zone.constants, D))
    p = np.concatenate([borders, *constants, spans[1][2]])
    widths = new.widths(p)
    widths[[FIRST, LAST]] = discrete.widths[[FIRST, LAST]]
    y = [spans[0][1]]
    inside = places(widths[1:-1], discrete.mesh)
    for zone, part, start, end in zip(new.zones[1:-1], inside, borders[:-1], borders[1:], strict=True):
        y.append(states(start + part * (end - start))[: zone.unknowns])
    y.append(spans[1][1])
    return Discrete(widths=widths, mesh=discrete.mesh, y=new.stacked(y), p=p)
