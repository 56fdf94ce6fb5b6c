"""First guesses for Newton's iteration: the exact string, and a solution whose parts are divided in another way."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from belt_fenicsx.bvp.newton import COARSE, Discrete, interpolated
from belt_fenicsx.bvp.problem import Problem, placed_at
from belt_fenicsx.bvp.system import Values
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.taut_string.shape import StringDrive

EMPTY = np.zeros((0, 0, 0))


def guessed(
    problem: Problem,
    lengths: Array,
    rate: float,
    moves: Array,
    unknowns: Callable[[int, Array], Array],
    cells: int = COARSE,
) -> Discrete:
    """A guess from functions along each part.

    Args:
        problem: The problem.
        lengths: Lengths of the parts ``(parts,)``.
        rate: Transport rate.
        moves: Displacements of take-ups ``(take-ups,)``.
        unknowns: Unknowns of a part ``(n, q)`` at places in [0, 1] of it ``(q,)``.
        cells: Number of cells.
    """
    known = rate if problem.rate is None else problem.rate
    values = Values((EMPTY, EMPTY), (EMPTY, EMPTY), lengths, known, moves)

    def scaled(group: int, place: Array) -> Array:
        own = problem.groups[group]
        each = [unknowns(int(part), at) for part, at in zip(own.parts, place, strict=True)]
        return own.scaled(np.stack(each, axis=1))

    return interpolated(problem, cells, problem.widths(lengths), values, scaled)


def from_fields(problem: Problem, solution: Solution, cells: int = COARSE) -> Discrete:
    """The fields of a solution by any method, whose zones are those of the problem."""
    assert solution.fields is not None, "a solution with zones has fields"
    scene, units = solution.scene.dimensionless()
    fields, rod = solution.fields.in_units(units.inverse()), problem.rod
    lengths = np.array([(zone.sigma[1] - zone.sigma[0]) / units.length for zone in solution.zones])
    rate = solution.transport_rate / units.rate
    N = fields.Q - rod.density * rate**2 * np.column_stack([1.0 + fields.eps, fields.Gamma])
    force = (N[:, 0] + 1j * N[:, 1]) * np.exp(1j * fields.theta)

    def unknowns(part: int, place: Array) -> Array:
        here = fields.zone == part
        sigma = fields.sigma[here]
        at = sigma[0] + place * (sigma[-1] - sigma[0])

        def of(values: Array) -> Array:
            return np.interp(at, sigma, values[here])

        if problem.parts[part].touches:
            return np.array(
                [of(fields.phi), of(fields.theta - fields.phi), of(fields.kappa), of(fields.D - 1.0), 0.0 * at]
            )
        if rod.weight == (0.0, 0.0):
            mean = np.average(force[here], weights=fields.weight[here])
            X, Y = np.full_like(at, mean.real), np.full_like(at, mean.imag)
        else:
            X, Y = of(force.real), of(force.imag)
        return np.array([of(fields.x), of(fields.y), of(fields.theta), of(fields.kappa), X, Y])

    moves = np.array([contact.take_up / units.length for contact in solution.contacts])
    moving = [index for index, pulley in enumerate(scene.pulleys) if pulley.take_up is not None]
    return guessed(problem, lengths, rate, moves[moving], unknowns, cells)


def divided(old: Problem, discrete: Discrete, new: Problem, ends: Array) -> Discrete:
    """A solution as a guess for other parts on the pulleys.

    Args:
        old: The problem that was solved.
        discrete: Its solution.
        new: The problem to solve.
        ends: Ends of its parts in the material-length coordinate ``(len(new.parts) + 1,)``.
    """
    before = np.maximum.accumulate(discrete.ends)
    spans = iter([i for i, part in enumerate(old.parts) if not part.touches])
    same = {i: next(spans) for i, part in enumerate(new.parts) if not part.touches}
    touching: dict[int, list[int]] = {}
    for i, part in enumerate(old.parts):
        if part.touches:
            touching.setdefault(part.pulley, []).append(i)

    def old_values(part: int, place: Array) -> Array:
        """Unknowns of an old part at places of it ``(n, q)``."""
        group, index = old.place[part]
        which = int(group is old.contacts)
        xi = placed_at(discrete.widths[part : part + 1], place[None])
        return group.unscaled(discrete.between(which, np.repeat(xi, group.parts.size, axis=0)))[:, index]

    def unknowns(part: int, place: Array) -> Array:
        if part in same:
            return old_values(same[part], place)
        sigma = ends[part] + place * (ends[part + 1] - ends[part])
        on = touching[new.parts[part].pulley]
        index = np.clip(np.searchsorted(before, sigma) - 1, on[0], on[-1])
        result = np.empty((5, sigma.size))
        for i in np.unique(index):
            here = index == i
            inside = np.clip((sigma[here] - before[i]) / max(before[i + 1] - before[i], 1e-300), 0.0, 1.0)
            result[:, here] = old_values(int(i), inside)[:5]
        result[4] = 0.0
        if new.parts[part].kind == "stick":
            sticks = [i for i in on if old.parts[i].kind == "stick"]
            result[3] = old_values(sticks[0], place[:1])[3, 0] if sticks else result[3, 0]
        return result

    return guessed(new, np.diff(ends), discrete.values.c, discrete.values.moves, unknowns, discrete.cells)


def from_drive(problem: Problem, string: StringDrive, cells: int = COARSE) -> Discrete:
    """The exact string of a drive, whose parts are those of the problem."""
    rod = problem.rod

    def unknowns(part: int, place: Array) -> Array:
        own = string.parts[part]
        x, y, phi, D = own.at(place)
        zero = np.zeros_like(place)
        if own.part.touches:
            on = problem.on(part)
            radius, turn = on.radius[0, 0], on.turn[0, 0]
            # The touching fibre's stretch is as much smaller as its radius is.
            strain = D * radius / (radius + rod.offset) - 1.0
            known = np.array(
                [phi, own.layers(place)[0], -turn * (1.0 + strain) / radius, strain, zero, zero + strain[0]]
            )
            return known[: on.size]
        return np.array([x, y, phi, zero, own.force[0] * np.cos(phi), own.force[0] * np.sin(phi)])

    lengths = np.array([own.length for own in string.parts])
    moves = np.array([string.take_ups[problem.parts[take_up.parts[0]].pulley] for take_up in problem.take_ups])
    return guessed(problem, lengths, string.rate, moves, unknowns, cells)
