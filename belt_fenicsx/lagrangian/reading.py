"""What is read from a state on a fixed mesh: zones and their ends, contacts and fields; the same on every rank."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from belt_fenicsx.lagrangian.drives import Drives
from belt_fenicsx.lagrangian.friction import Friction, lift_off
from belt_fenicsx.lagrangian.multipliers import Multipliers
from belt_fenicsx.lagrangian.state import State
from belt_fenicsx.lagrangian.taut import TautBelt
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.hermite import interpolate
from belt_fenicsx.layout.kind import FREE, Part, sliding
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.contact import Contact, Zone
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.reading import contacts_of

# What friction does at a point in contact: it sticks, it is at its bound in one of two senses, or it slides before the
# run-off, as the drive asks for.
STICKS, FORWARD, BACKWARD, SLIDES = 0, 1, -1, 2

# A run of so many points inside the belt is longer than one element, which has two of them, and counts as a zone.
SHORTEST_RUN = 3


class Run(NamedTuple):
    """A part of the belt.

    Attributes:
        part: What it does.
        end: Where it ends, in the material-length coordinate.
        next: Number of the first point behind it.
    """

    part: Part
    end: float
    next: int


class Points(NamedTuple):
    """The points of the belt in the order in which they are told, arrays ``(n,)``: see `State`."""

    sigma: Array
    x: Array
    y: Array
    theta: Array
    dx: Array
    dy: Array
    kappa: Array
    p: Array
    f: Array
    weight: Array
    zone: Array

    def at(self, sigma: Array) -> tuple[Array, Array]:
        """x, y and theta at some places, and their derivatives ``(m, 3)``."""
        values, slopes = (np.column_stack(self[first : first + 3]) for first in (1, 4))
        return interpolate(sigma, self.sigma, values, slopes)


def answer(scene: Scene, taut: TautBelt, state: State, multipliers: Multipliers, drives: Drives) -> dict[str, Any]:
    """Contacts, zones and fields, as arguments of a solution.

    Args:
        scene: The dimensionless scene.
        taut: Its taut belt.
        state: The state at all points of the belt and at its ends ``(n,)``.
        multipliers: Pressure and friction there ``(n,)``.
        drives: Friction on each pulley, and the transport rate.
    """
    runs: list[Run] = []
    starts: list[float] = []
    first = 1
    for index, friction in enumerate(drives.frictions):
        near = slice(first, first + friction.f.size)
        on_pulley = _on_pulley(scene.pulleys[index], index, near, state, multipliers, friction)
        up, off = on_pulley[0].end, on_pulley[-1].end
        starts.append(min(max(up, friction.transition), off) if scene.pulleys[index].friction else up)
        runs += on_pulley
        first = near.stop
    runs.append(Run(FREE, 0.5, len(state.sigma)))
    zone = np.repeat(np.arange(float(len(runs))), np.diff([0, *(run.next for run in runs)]))
    points = Points(state.sigma, *state[2:8], *multipliers, state.weight, zone)
    stretches = [
        friction.level or _stretch_at(points, start, pulley.turn * scene.belt.contact_offset)
        for friction, start, pulley in zip(drives.frictions, starts, scene.pulleys, strict=True)
    ]
    if scene.closed:
        points, runs = _from_run_up(points, runs, taut.winding)
    ends = np.array([-0.5, *(run.end for run in runs)])
    return _read(scene, [run.part for run in runs], ends, points, drives, stretches)


def _read(
    scene: Scene, parts: Sequence[Part], ends: Array, points: Points, drives: Drives, stretches: Sequence[float]
) -> dict[str, Any]:
    """What `answer` gives, from the parts of the belt, their ends ``(len(parts) + 1,)``, and each pulley's stretch."""
    rate = drives.rate
    omegas = tuple(
        pulley.drive.by("omega") if pulley.drive.kind == "omega" else rate * stretch / pulley.radius
        for pulley, stretch in zip(scene.pulleys, stretches, strict=True)
    )
    touched = [scene.pulleys[part.pulley] if part.touches else None for part in parts]
    offsets = np.array([pulley.turn * scene.belt.contact_offset if pulley else 0.0 for pulley in touched])
    surfaces = [
        pulley.radius * omegas[part.pulley] if pulley else 0.0 for part, pulley in zip(parts, touched, strict=True)
    ]
    zone = points.zone.astype(int)
    cos, sin, d = np.cos(points.theta), np.sin(points.theta), offsets[zone]
    along = points.dx * cos + points.dy * sin + d * points.kappa
    across = points.dy * cos - points.dx * sin
    D = np.hypot(along, across)
    fields = Fields.from_state(
        scene.belt, zone=zone, weight=points.weight, sigma=points.sigma, r=np.column_stack([points.x, points.y]),
        theta=points.theta, phi=points.theta + np.arctan2(across, along), D=D, rate=rate, kappa=points.kappa,
        p=points.p, f=points.f, v_rel=rate * D - np.array(surfaces)[zone],
        offset=d if scene.belt.contact_offset else None,
    )  # fmt: skip
    sigma = np.column_stack([ends[:-1], ends[1:]])
    x, y, theta = points.at(sigma.ravel())[0].T.reshape(3, *sigma.shape)
    zone_ends = x + 1j * y - 1j * offsets[:, np.newaxis] * np.exp(1j * theta)
    zones = tuple(
        Zone(kind=part.kind, slip=part.slip, pulley=part.pulley if part.touches else None, sigma=material, x=place)
        for part, material, place in zip(parts, _pairs(sigma), _pairs(zone_ends.real), strict=True)
    )
    torques = [pulley.radius * growth for pulley, growth in zip(scene.pulleys, drives.growths.tolist(), strict=True)]
    contacts = contacts_of(scene, zones, fields, rate=rate, omegas=omegas, torques=torques, zone_ends=zone_ends)
    contacts = tuple(_placed(contact, scene.pulleys[contact.pulley]) for contact in contacts)
    return {"transport_rate": rate, "contacts": contacts, "zones": zones, "fields": fields}


def _stretch_at(points: Points, sigma: float, offset: float) -> float:
    """Stretch of a fibre where the belt begins to slide, which the points know to a part of a cell."""
    ((_, _, theta),), ((dx, dy, kappa),) = points.at(np.array([sigma]))
    return float(abs(dx + 1j * dy + offset * kappa * np.exp(1j * theta)))


def _pairs(values: Array) -> list[tuple[float, float]]:
    return [(start, end) for start, end in values.tolist()]


def _placed(contact: Contact, pulley: Pulley) -> Contact:
    """A contact whose transition is exactly where the scene says."""
    match pulley.drive.kind, pulley.drive.value:
        case "x_trans", float(x):
            return replace(contact, x_trans=x)
        case "slip_angle", float(angle):
            return replace(contact, slip_angle=angle)
    return contact


def _from_run_up(points: Points, runs: Sequence[Run], winding: float) -> tuple[Points, list[Run]]:
    """Points and parts of a loop that begin at its first run-up and end there again, the whole angle later."""
    table = np.column_stack(points)[1:-1]
    before = int(np.searchsorted(points.zone[1:-1], 0.0, side="right"))
    # The end of contact may lie behind the first point that touches, but points increase.
    start = min(runs[0].end, float(table[before - 1 : before + 1, 0] @ [0.1, 0.9]))
    (place,), (slope,) = points.at(np.array([start]))
    turned = table[:before].copy()
    turned[:, [0, 3]] += 1.0, winding
    # The part before the first run-up is that behind the last run-off.
    turned[:, -1] = len(runs) - 1
    first = np.concatenate([[start], place, slope, table[before, 7:9], [0.0, 1.0]])
    last = np.concatenate([[start + 1.0], place, slope, [0.0, 0.0, 0.0, len(runs) - 1.0]])
    last[3] += winding
    rows = np.concatenate([[first], table[before:], turned, [last]])
    rows[:, 0] -= start + 0.5
    rows[:, -1] -= 1.0
    ended = [run._replace(end=run.end - start - 0.5) for run in runs[1:-1]]
    return Points(*np.ascontiguousarray(rows.T)), [*ended, Run(FREE, 0.5, len(rows))]


def _on_pulley(
    pulley: Pulley, index: int, near: slice, state: State, multipliers: Multipliers, friction: Friction
) -> list[Run]:
    """The free part before a pulley, and the parts on it.

    Args:
        pulley: The pulley.
        index: Its index.
        near: The points that are nearest to it.
        state: The state.
        multipliers: Pressure and friction.
        friction: Friction on the pulley.
    """
    p, f, share = multipliers.p[near], multipliers.f[near], friction.share.ravel()
    touching = np.flatnonzero(p > 0.0)
    first, last = int(touching[0]), int(touching[-1])
    up, off = (lift_off(state.sigma, state.g, near.start + end, out) for end, out in ((first, -1), (last, 1)))
    runs = [Run(FREE, up, near.start + first)]
    if pulley.friction == 0.0:
        return [*runs, Run(Part("slip", pulley=index), off, near.start + last + 1)]
    within = np.where(np.abs(f) < pulley.friction * p, STICKS, np.where(f < 0.0, FORWARD, BACKWARD))
    kinds = _absorb_short_runs(np.where(share >= 0.5, SLIDES, within)[first : last + 1])
    for stop in _ends(kinds):
        kind, point = int(kinds[stop - 1]), first + stop
        sticks, sense = kind == STICKS, friction.sense if kind == SLIDES else float(kind)
        part = Part("stick", pulley=index) if sticks else sliding(sense, index)
        if point > last:
            end = off
        elif kinds[stop] == SLIDES:
            end = friction.transition
        else:
            end = float(friction.at.edges[point])
        if runs[-1].part == part:
            runs.pop()
        runs.append(Run(part, end, near.start + point))
    return runs


def _ends(kinds: Array) -> list[int]:
    """Ends of the runs of equal kinds."""
    return [*(np.flatnonzero(np.diff(kinds)) + 1).tolist(), len(kinds)]


def _absorb_short_runs(kinds: Array) -> Array:
    """Gives short runs before the sliding behind stick to a neighbour: at a joint, one odd point is no zone."""
    kinds, ends = kinds.copy(), _ends(kinds)
    for start, end in itertools.pairwise([0, *ends]):
        if end - start < SHORTEST_RUN and kinds[start] != SLIDES and len(ends) > 1:
            kinds[start:end] = kinds[start - 1] if start else kinds[end]
    return kinds
