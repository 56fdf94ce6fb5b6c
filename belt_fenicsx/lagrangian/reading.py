"""What is read from a state on a fixed mesh: zones and their borders, contact and fields; the same on every rank."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from belt_fenicsx.lagrangian.multipliers import Multipliers
from belt_fenicsx.lagrangian.state import State
from belt_fenicsx.layout.arrays import Array, places
from belt_fenicsx.layout.kind import FREE, STICK, Part
from belt_fenicsx.scene.pulley import RUN_UP, Pulley
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.contact import Zone
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.reading import contacts_of

FORWARD, BACKWARD, SMOOTH = Part("slip", "forward"), Part("slip", "backward"), Part("slip")
# Arrays hold the parts' numbers in this table: words take six times the memory, and four times as long.
PARTS = (FREE, STICK, FORWARD, BACKWARD, SMOOTH)
NUMBER = {part: number for number, part in enumerate(PARTS)}

# A run of so many points inside the belt is longer than one element, which has two of them, and counts as a zone.
SHORTEST_RUN = 3


def answer(scene: Scene, state: State, multipliers: Multipliers) -> dict[str, Any]:
    """Contact, zones and fields, as arguments of a solution.

    Args:
        scene: The dimensionless scene.
        state: The state at all points of the belt ``(n,)``.
        multipliers: Pressure and friction there ``(n,)``.
    """
    pulley, numbers = scene.pulleys[0], _absorb_short_runs(_part_numbers(state, multipliers, scene.pulleys[0]))
    starts = np.flatnonzero(np.diff(numbers)) + 1
    r = np.column_stack([state.x, state.y])
    path = CubicHermiteSpline(state.sigma, r, np.column_stack([state.dx, state.dy]))
    borders = [_border(state, numbers, start, pulley) for start in starts.tolist()]
    zones = _zones(scene, [PARTS[number] for number in numbers[np.append(0, starts)]], borders, path)
    touching = tuple(zone for zone in zones if zone.pulley is not None)
    sigma_trans, x_trans = _transition(state, pulley, touching)
    speed = _speed(state, multipliers, numbers == NUMBER[STICK], pulley, float(np.hypot(*path(sigma_trans, 1))))
    fields = Fields.from_state(
        scene.belt, zone=np.searchsorted(starts, np.arange(len(r)), side="right"), weight=state.weight,
        sigma=state.sigma, r=r, theta=state.theta, phi=np.arctan2(state.dy, state.dx), D=state.D, rate=1.0,
        kappa=state.kappa, p=multipliers.p, f=multipliers.f, v_rel=state.D - speed,
    )  # fmt: skip
    (contact,) = contacts_of(
        scene, zones, fields, rate=1.0, omegas=(speed / pulley.radius,),
        torques=(float(-pulley.radius * np.sum(state.weight * multipliers.f)),),
        zone_ends=places(path([zone.sigma for zone in zones]).reshape(-1, 2)).reshape(-1, 2),
    )  # fmt: skip
    contacts = (replace(contact, x_trans=x_trans),)
    return {"transport_rate": 1.0, "contacts": contacts, "zones": zones, "fields": fields}


def _part_numbers(state: State, multipliers: Multipliers, pulley: Pulley) -> Array:
    """Number of each point's part; where the stick friction was clipped to its bound, the belt slides."""
    p, f = multipliers
    if pulley.friction == 0.0:
        return np.where(p > 0.0, NUMBER[SMOOTH], NUMBER[FREE])
    sliding = np.where(f < 0.0, NUMBER[FORWARD], NUMBER[BACKWARD])
    before = np.where(np.abs(f) >= pulley.friction * p, sliding, NUMBER[STICK])
    after = NUMBER[Part("slip", pulley.slip)]
    return np.where(p > 0.0, np.where(state.share < 0.5, before, after), NUMBER[FREE])


def _absorb_short_runs(numbers: Array) -> Array:
    """Gives short runs to a neighbour in contact: at a border one odd point is the mesh's doing, not a zone."""
    numbers = numbers.copy()
    bounds = [0, *(np.flatnonzero(np.diff(numbers)) + 1), len(numbers)]
    for start, end in itertools.pairwise(bounds[1:-1]):
        neighbours = [number for number in (numbers[start - 1], numbers[end]) if PARTS[number].touches]
        if end - start < SHORTEST_RUN and neighbours:
            numbers[start:end] = neighbours[0]
    return numbers


def _border(state: State, numbers: Array, after: int, pulley: Pulley) -> float:
    """Material coordinate of the border between a point and the one before it."""
    before = after - 1
    if not PARTS[numbers[before]].touches:
        return _lift_off(state, before, -1)
    if not PARTS[numbers[after]].touches:
        return _lift_off(state, after, 1)
    if isinstance(pulley.x_trans, float) and state.share[before] < 0.5 <= state.share[after]:
        return _sigma_at(state, before, pulley.x_trans)
    return float(state.sigma[before] + state.sigma[after]) / 2


def _lift_off(state: State, near: int, outwards: int) -> float:
    """Border of contact from the last free point, as the gap grows with the square of the distance from it."""
    far, touching = near + outwards, near - outwards
    far_gap, gap = np.sqrt(np.maximum(-state.g.take([far, near], mode="clip"), 0.0))
    if far_gap <= gap:
        return float(state.sigma[near] + state.sigma[touching]) / 2
    return float(state.sigma[near] + (state.sigma[near] - state.sigma[far]) * gap / (far_gap - gap))


def _sigma_at(state: State, near: int, x: float) -> float:
    """Material coordinate of a global one, from a point near it."""
    return float(state.sigma[near] + (x - state.x[near]) / state.dx[near])


def _zones(scene: Scene, parts: list[Part], borders: list[float], path: CubicHermiteSpline) -> tuple[Zone, ...]:
    """The zones between the borders and the clamps."""
    half, reach = scene.belt.length / 2, scene.span / 2
    sigma = itertools.pairwise([-half, *borders, half])
    x = itertools.pairwise([-reach, *path(borders)[:, 0].tolist(), reach])
    rows = zip(parts, sigma, x, strict=True)
    return tuple(
        Zone(kind=part.kind, slip=part.slip, pulley=0 if part.touches else None, sigma=material, x=place)
        for part, material, place in rows
    )


def _speed(state: State, multipliers: Multipliers, sticks: Array, pulley: Pulley, D_trans: float) -> float:
    """Speed of the belt where friction in stick is below its bound, or with the stretch at the transition."""
    p, f = multipliers
    stuck = sticks & (state.share == 0.0) & (np.abs(f) < pulley.friction * p)
    return float(np.average(state.D[stuck], weights=state.weight[stuck])) if stuck.any() else D_trans


def _transition(state: State, pulley: Pulley, touching: tuple[Zone, ...]) -> tuple[float, float]:
    """Material and global coordinate of the transition."""
    if isinstance(pulley.x_trans, float):
        return _sigma_at(state, int(np.argmin(np.abs(state.x - pulley.x_trans))), pulley.x_trans), pulley.x_trans
    zone, end = (touching[0], 0) if pulley.x_trans == RUN_UP else (touching[-1], 1)
    return zone.sigma[end], zone.x[end]
