"""What is read from the state of a general drive on a fixed mesh; the same on every rank."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from belt_fenicsx.lagrangian.drive_forms import DriveState
from belt_fenicsx.lagrangian.grip import Grip
from belt_fenicsx.lagrangian.multipliers import Multipliers
from belt_fenicsx.lagrangian.reading import SHORTEST_RUN
from belt_fenicsx.lagrangian.track import Track
from belt_fenicsx.layout.arrays import Array, places
from belt_fenicsx.layout.kind import FREE, Part, sliding
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.contact import Zone
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.reading import contacts_and_spans


# What friction does at a point in contact: it sticks, it is at its bound in one of two senses, or it slides before the
# run-off, as the drive asks for.
STICKS, FORWARD, BACKWARD, SLIDES = 0, 1, -1, 2


class Run(NamedTuple):
    """A part of the belt.

    Attributes:
        part: What it does.
        end: Where it ends, in the material-length coordinate.
        points: Number of the first point behind it.
    """

    part: Part
    end: float
    points: int


def answer(
    scene: Scene, track: Track, state: DriveState, multipliers: Multipliers, grips: Sequence[Grip], rate: float
) -> dict[str, Any]:
    """Contacts, spans, zones and fields, as arguments of a solution.

    Args:
        scene: The dimensionless scene.
        track: Its taut belt.
        state: The state at all points of the belt and at its ends ``(n,)``.
        multipliers: Pressure and friction there ``(n,)``.
        grips: Friction on each pulley.
        rate: Transport rate.
    """
    runs: list[Run] = []
    for i, grip in enumerate(grips):
        on = np.flatnonzero((state.pulley == i) & (state.weight > 0.0))
        runs += _on_pulley(scene, i, on, state, multipliers, grip)
    runs.append(Run(FREE, 0.5, len(state.sigma)))
    zone = np.searchsorted([run.points for run in runs], np.arange(len(state.sigma)), side="right")
    points = np.column_stack([state.sigma, *state[2:8], *multipliers, state.weight, zone])
    shift = 0.0
    if scene.closed:
        start = runs[0].end
        points = _from_run_up(points, start, track.winding)
        # The part before the first run-up is that behind the last run-off.
        points[:, -1] = np.where(points[:, -1] == 0, len(runs) - 1, points[:, -1]) - 1
        runs = [*runs[1:-1], Run(FREE, start + 1.0, len(points))]
        shift = -0.5 - start
    parts, ends = [run.part for run in runs], np.array([run.end for run in runs]) + shift
    sigma, zone = points[:, 0] + shift, points[:, -1].astype(int)
    return _read(scene, parts, np.append(-0.5, ends), zone, sigma, points[:, 1:-1], grips, rate)


def _read(
    scene: Scene,
    parts: list[Part],
    ends: Array,
    zone: Array,
    sigma: Array,
    columns: Array,
    grips: Sequence[Grip],
    rate: float,
) -> dict[str, Any]:
    x, y, theta, dx, dy, kappa, p, f, weight = columns.T
    turns = np.array([scene.pulleys[part.pulley].turn if part.touches else 0.0 for part in parts])
    offsets = turns * scene.belt.contact_offset
    d = offsets[zone]
    cos, sin = np.cos(theta), np.sin(theta)
    along, across = dx * cos + dy * sin + d * kappa, dy * cos - dx * sin
    omegas = tuple(
        pulley.drive.by("omega") if pulley.drive.kind == "omega" else rate * grip.level / pulley.radius
        for pulley, grip in zip(scene.pulleys, grips, strict=True)
    )
    surface = np.array([scene.pulleys[part.pulley].radius * omegas[part.pulley] if part.touches else 0.0 for part in parts])
    D = np.hypot(along, across)
    fields = Fields.from_state(
        scene.belt, zone=zone, weight=weight, sigma=sigma, r=np.column_stack([x, y]), theta=theta,
        phi=theta + np.arctan2(across, along), D=D, kappa=kappa, p=p, f=f, v_rel=rate * D - surface[zone],
        offset=d if scene.belt.contact_offset else None,
    )  # fmt: skip
    single = np.append(True, np.diff(sigma) > 0.0)
    spline = CubicHermiteSpline(
        sigma[single], np.column_stack([x, y, theta])[single], np.column_stack([dx, dy, kappa])[single]
    )
    at = np.column_stack([ends[:-1], ends[1:]])
    values = spline(at.ravel()).reshape(len(parts), 2, 3)
    borders = values[..., 0] + 1j * values[..., 1] - 1j * offsets[:, None] * np.exp(1j * values[..., 2])
    zones = tuple(
        Zone(
            kind=part.kind,
            slip=part.slip,
            pulley=part.pulley if part.touches else None,
            sigma=tuple(at[i].tolist()),
            x=tuple(borders[i].real.tolist()),
        )
        for i, part in enumerate(parts)
    )
    torques = tuple(
        float(-pulley.radius * np.sum((weight * f)[_numbers(parts, zone) == i])) for i, pulley in enumerate(scene.pulleys)
    )
    contacts, spans = contacts_and_spans(
        scene, zones, fields, rate=rate, omegas=omegas, torques=torques, borders=borders
    )
    contacts = tuple(
        replace(contact, **{scene.pulleys[contact.pulley].drive.kind: scene.pulleys[contact.pulley].drive.value})
        if scene.pulleys[contact.pulley].drive.is_place
        and not isinstance(scene.pulleys[contact.pulley].drive.value, str)
        else contact
        for contact in contacts
    )
    return {"transport_rate": rate, "contacts": contacts, "spans": spans, "zones": zones, "fields": fields}


def _numbers(parts: Sequence[Part], zone: Array) -> Array:
    """Index of the pulley of each point, -1 of free ones."""
    return np.array([part.pulley if part.touches else -1 for part in parts])[zone]


def _from_run_up(points: Array, start: float, winding: float) -> Array:
    """Points of a loop that begin at a place of it and end there again, without those where the mesh began."""
    inner = points[1:-1]
    before = int(np.searchsorted(inner[:, 0], start))
    turned = inner[:before].copy()
    turned[:, 0] += 1.0
    turned[:, 3] += winding
    rows = np.concatenate([inner[before:], turned])
    spline = CubicHermiteSpline(points[:, 0], points[:, 1:4], points[:, 4:7])
    first = np.concatenate([[start], spline(start), spline(start, 1), rows[0, 7:9], [0.0], rows[0, 10:]])
    last = first.copy()
    last[0] += 1.0
    last[3] += winding
    last[7:10], last[10] = 0.0, rows[-1, 10]
    return np.concatenate([[first], rows, [last]])


def _on_pulley(
    scene: Scene, index: int, on: Array, state: DriveState, multipliers: Multipliers, grip: Grip
) -> list[Run]:
    """The free part before a pulley, and the parts on it.

    Args:
        scene: The scene.
        index: Index of the pulley.
        on: Numbers of the points that are nearest to it.
        state: The state.
        multipliers: Pressure and friction.
        grip: Friction on the pulley.
    """
    pulley, p, f = scene.pulleys[index], multipliers.p[on], multipliers.f[on]
    touching = np.flatnonzero(p > 0.0)
    first, last = int(touching[0]), int(touching[-1])
    runs = [Run(FREE, _lift_off(state, on[first], -1), int(on[first]))]
    up_to = int(on[last]) + 1, _lift_off(state, on[last], 1)
    if pulley.friction == 0.0:
        return [*runs, Run(Part("slip", pulley=index), up_to[1], up_to[0])]
    share = grip.share.ravel()
    held = np.where(np.abs(f) < pulley.friction * p, STICKS, np.where(f < 0.0, FORWARD, BACKWARD))
    kinds = _absorbed(np.where(share >= 0.5, SLIDES, held)[first : last + 1])
    # Where the points' parts of their cells end; the first cell begins half of its length before its middle.
    weight = state.weight[on]
    edges = (state.sigma[on[0]] + state.sigma[on[1]]) / 2.0 - weight[0] + np.cumsum(weight)
    bounds = [*(np.flatnonzero(np.diff(kinds)) + 1).tolist(), len(kinds)]
    for end in bounds:
        kind, point = int(kinds[end - 1]), first + end
        sense = grip.sense if kind == SLIDES else float(kind)
        part = Part("stick", pulley=index) if kind == STICKS else sliding(sense, index)
        place = up_to[1]
        if point <= last:
            partial = point - 1 if share[point - 1] > 0.0 or kinds[end] != SLIDES else point
            place = float(edges[partial] - (share[partial] * weight[partial] if kinds[end] == SLIDES else 0.0))
        if runs[-1].part == part:
            runs.pop()
        runs.append(Run(part, place, int(on[0]) + point))
    return runs


def _absorbed(kinds: Array) -> Array:
    """Gives short runs before the sliding behind stick to a neighbour: at a border, one odd point is no zone."""
    kinds = kinds.copy()
    bounds = [0, *(np.flatnonzero(np.diff(kinds)) + 1).tolist(), len(kinds)]
    for start, end in itertools.pairwise(bounds):
        if end - start < SHORTEST_RUN and kinds[start] != SLIDES and len(bounds) > 2:
            kinds[start:end] = kinds[start - 1] if start else kinds[end]
    return kinds


def _lift_off(state: DriveState, last: int, outwards: int) -> float:
    """Border of contact between its last point and the first free one.

    The gap grows with the square of the distance from it.
    """
    touching, near, far = (last + i * outwards for i in range(3))
    far_gap, gap = np.sqrt(np.maximum(-state.g.take([far, near], mode="clip"), 0.0))
    if far_gap <= gap:
        return float(state.sigma[near] + state.sigma[touching]) / 2.0
    place = float(state.sigma[near] + (state.sigma[near] - state.sigma[far]) * gap / (far_gap - gap))
    inside = float(0.9 * state.sigma[touching] + 0.1 * state.sigma[near])
    return max(place, inside) if outwards > 0 else min(place, inside)
