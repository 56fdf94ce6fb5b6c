"""What is read from the state of a general drive on a fixed mesh; the same on every rank."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from belt_fenicsx.lagrangian.drive_forms import DriveState
from belt_fenicsx.lagrangian.grip import Grip, lift_off
from belt_fenicsx.lagrangian.multipliers import Multipliers
from belt_fenicsx.lagrangian.reading import SHORTEST_RUN
from belt_fenicsx.lagrangian.track import Track
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import FREE, Part, sliding
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.contact import Contact, Zone
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.reading import contacts_of

# What friction does at a point in contact: it sticks, it is at its bound in one of two senses, or it slides before the
# run-off, as the drive asks for.
STICKS, FORWARD, BACKWARD, SLIDES = 0, 1, -1, 2


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
    """The points of the belt in the order in which they are told, arrays ``(n,)``: see `DriveState`."""

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

    @property
    def path(self) -> CubicHermiteSpline:
        """x, y and theta as functions of sigma."""
        single = np.append(True, np.diff(self.sigma) > 0.0)
        values, slopes = (np.column_stack(self[first : first + 3])[single] for first in (1, 4))
        return CubicHermiteSpline(self.sigma[single], values, slopes)


def answer(
    scene: Scene, track: Track, state: DriveState, multipliers: Multipliers, grips: Sequence[Grip], rate: float
) -> dict[str, Any]:
    """Contacts, zones and fields, as arguments of a solution.

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
        runs += _on_pulley(scene.pulleys[i], i, on, state, multipliers, grip)
    runs.append(Run(FREE, 0.5, len(state.sigma)))
    zone = np.searchsorted([run.next for run in runs], np.arange(len(state.sigma)), side="right").astype(float)
    points = Points(state.sigma, *state[2:8], *multipliers, state.weight, zone)
    if scene.closed:
        points, runs = _from_run_up(points, runs, track.winding)
    ends = np.array([-0.5, *(run.end for run in runs)])
    return _read(scene, [run.part for run in runs], ends, points, grips, rate)


def _read(
    scene: Scene, parts: Sequence[Part], ends: Array, points: Points, grips: Sequence[Grip], rate: float
) -> dict[str, Any]:
    """What `answer` gives, from the parts of the belt and their ends ``(len(parts) + 1,)``."""
    omegas = tuple(
        pulley.drive.by("omega") if pulley.drive.kind == "omega" else rate * grip.level / pulley.radius
        for pulley, grip in zip(scene.pulleys, grips, strict=True)
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
    x, y, theta = np.moveaxis(points.path(sigma), -1, 0)
    borders = x + 1j * y - 1j * offsets[:, np.newaxis] * np.exp(1j * theta)
    zones = tuple(
        Zone(kind=part.kind, slip=part.slip, pulley=part.pulley if part.touches else None, sigma=material, x=place)
        for part, material, place in zip(parts, _pairs(sigma), _pairs(borders.real), strict=True)
    )
    number = np.array([part.pulley if part.touches else -1 for part in parts])[zone]
    pushed = points.weight * points.f
    torques = [-pulley.radius * float(pushed[number == i].sum()) for i, pulley in enumerate(scene.pulleys)]
    contacts = contacts_of(scene, zones, fields, rate=rate, omegas=omegas, torques=torques, zone_ends=borders)
    contacts = tuple(_placed(contact, scene.pulleys[contact.pulley]) for contact in contacts)
    return {"transport_rate": rate, "contacts": contacts, "zones": zones, "fields": fields}


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
    start, path, table = runs[0].end, points.path, np.column_stack(points)[1:-1]
    before = int(np.searchsorted(points.zone[1:-1], 0.0, side="right"))
    turned = table[:before].copy()
    turned[:, [0, 3]] += 1.0, winding
    # The part before the first run-up is that behind the last run-off.
    turned[:, -1] = len(runs) - 1
    first = np.concatenate([[start], path(start), path(start, 1), table[before, 7:9], [0.0, 1.0]])
    last = np.concatenate([[start + 1.0], path(start), path(start, 1), [0.0, 0.0, 0.0, len(runs) - 1.0]])
    last[3] += winding
    rows = np.concatenate([[first], table[before:], turned, [last]])
    rows[:, 0] -= start + 0.5
    rows[:, -1] -= 1.0
    ended = [run._replace(end=run.end - start - 0.5) for run in runs[1:-1]]
    return Points(*np.ascontiguousarray(rows.T)), [*ended, Run(FREE, 0.5, len(rows))]


def _on_pulley(
    pulley: Pulley, index: int, on: Array, state: DriveState, multipliers: Multipliers, grip: Grip
) -> list[Run]:
    """The free part before a pulley, and the parts on it.

    Args:
        pulley: The pulley.
        index: Its index.
        on: Numbers of the points that are nearest to it.
        state: The state.
        multipliers: Pressure and friction.
        grip: Friction on the pulley.
    """
    p, f, share = multipliers.p[on], multipliers.f[on], grip.share.ravel()
    touching = np.flatnonzero(p > 0.0)
    first, last = int(touching[0]), int(touching[-1])
    runs = [Run(FREE, lift_off(state.sigma, state.g, int(on[first]), -1), int(on[first]))]
    off = lift_off(state.sigma, state.g, int(on[last]), 1)
    if pulley.friction == 0.0:
        return [*runs, Run(Part("slip", pulley=index), off, int(on[last]) + 1)]
    held = np.where(np.abs(f) < pulley.friction * p, STICKS, np.where(f < 0.0, FORWARD, BACKWARD))
    kinds = _absorbed(np.where(share >= 0.5, SLIDES, held)[first : last + 1])
    # Where the points' parts of their cells end; the first cell begins half of its length before its middle.
    weight = state.weight[on]
    edges = (state.sigma[on[0]] + state.sigma[on[1]]) / 2.0 - weight[0] + np.cumsum(weight)
    for stop in _ends(kinds):
        kind, point = int(kinds[stop - 1]), first + stop
        sticks, sense = kind == STICKS, grip.sense if kind == SLIDES else float(kind)
        part = Part("stick", pulley=index) if sticks else sliding(sense, index)
        if point > last:
            end = off
        elif kinds[stop] == SLIDES:
            # The point that slides by a share only is this one or the one before.
            partial = point - 1 if share[point - 1] > 0.0 else point
            end = float(edges[partial] - share[partial] * weight[partial])
        else:
            end = float(edges[point - 1])
        if runs[-1].part == part:
            runs.pop()
        runs.append(Run(part, end, int(on[0]) + point))
    return runs


def _ends(kinds: Array) -> list[int]:
    """Ends of the runs of equal kinds."""
    return [*(np.flatnonzero(np.diff(kinds)) + 1).tolist(), len(kinds)]


def _absorbed(kinds: Array) -> Array:
    """Gives short runs before the sliding behind stick to a neighbour: at a border, one odd point is no zone."""
    kinds, ends = kinds.copy(), _ends(kinds)
    for start, end in itertools.pairwise([0, *ends]):
        if end - start < SHORTEST_RUN and kinds[start] != SLIDES and len(ends) > 1:
            kinds[start:end] = kinds[start - 1] if start else kinds[end]
    return kinds
