"""What is read from the fields of any method: zones, contacts with pulleys, and free spans."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from belt_fenicsx.layout.arrays import Array, places
from belt_fenicsx.layout.kind import Part
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.contact import Contact, Span, Zone
from belt_fenicsx.solution.fields import Fields

NEAR = 4  # points round the middle of a span, through which its fields are interpolated


def zones_of(scene: Scene, parts: Sequence[Part], fields: Fields) -> tuple[Zone, ...]:
    """The zones of a belt whose fields have a point on each side of each border.

    Args:
        scene: The scene.
        parts: What the belt does in each zone.
        fields: The fields.
    """
    pulleys, points = [part.pulley if part.touches else None for part in parts], end_points(fields, len(parts))
    sigma, x = fields.sigma[points].tolist(), _borders(scene, pulleys, fields, points).real.tolist()
    return tuple(
        Zone(kind=part.kind, slip=part.slip, pulley=pulleys[i], sigma=tuple(sigma[i]), x=tuple(x[i]))
        for i, part in enumerate(parts)
    )


def contacts_and_spans(
    scene: Scene,
    zones: Sequence[Zone],
    fields: Fields,
    *,
    rate: float,
    omegas: Sequence[float],
    torques: Sequence[float],
    centers: Sequence[tuple[float, float]] | None = None,
    capacities: Sequence[float] | None = None,
    borders: Array | None = None,
) -> tuple[tuple[Contact, ...], tuple[Span, ...]]:
    """Contacts with the pulleys that are touched, in their order, and the free spans.

    Args:
        scene: The scene, in the units of the other arguments.
        zones: All zones, in the direction of travel.
        fields: Fields, with a point on each side of each border unless there are ``borders``.
        rate: Transport rate c.
        omegas: Angular velocity of each pulley.
        torques: Moment of the belt on each pulley, positive where it drives it along.
        centers: Centre of each pulley, with its take-up done; by default, that of the scene.
        capacities: Torque that each pulley transmits at most; not known by default.
        borders: Ends of the zones, those of the touching fibre on a pulley, in the complex plane ``(len(zones), 2)``;
            by default, the first and the last points of the zones.
    """
    points = end_points(fields, len(zones))
    if borders is None:
        borders = _borders(scene, [zone.pulley for zone in zones], fields, points)
    ends, phi, parts = borders.tolist(), fields.phi[points].tolist(), _slices(points)
    heavy = weighed(scene, fields)
    N = at_ends(zones, fields, force(scene, fields, rate), None if heavy is None else heavy[0]).tolist()
    line_weight = scene.belt.line_density * complex(*scene.gravity)
    slid = fields.weight * np.abs(fields.f * fields.v_rel)
    contacts = []
    for index, pulley in enumerate(scene.pulleys):
        on = [i for i, zone in enumerate(zones) if zone.pulley == index]
        if not on:
            continue
        first, last, touching = on[0], on[-1], tuple(zones[i] for i in on)
        center = complex(*(pulley.center if centers is None else centers[index]))
        sticks = [i for i in on if zones[i].kind == "stick"]
        up, left, off = (
            _counted_on((ends[i][end] - center) * pulley.turn / 1j, phi[i][end])
            for i, end in ((first, 0), (sticks[-1], 1) if sticks else (first, 0), (last, 1))
        )
        before, after = beside(scene, zones, N, index)
        contacts.append(
            Contact(
                pulley=index,
                omega=omegas[index],
                x_up=touching[0].x[0],
                # The belt leaves the pulley's speed for good where it first sticks no more.
                x_trans=zones[sticks[0]].x[1] if sticks else touching[0].x[len(touching) > 1],
                x_off=touching[-1].x[1],
                torque=torques[index],
                wrap_angle=pulley.turn * (up - off),
                center=_vector(center),
                run_up=_vector(ends[first][0]),
                run_off=_vector(ends[last][1]),
                angle_up=up,
                angle_off=off,
                slip_angle=pulley.turn * (left - off),
                hub_force=_vector(after - before + line_weight * (touching[-1].sigma[1] - touching[0].sigma[0])),
                sliding_loss=sum(float(slid[parts[i]].sum()) for i in on if zones[i].kind == "slip"),
                capacity=math.nan if capacities is None else capacities[index],
                take_up=along(pulley.take_up, center - complex(*pulley.center)),
                zones=touching,
            )
        )
    spans = (_span(zone, fields, part, rate) for zone, part in zip(zones, parts, strict=True) if zone.pulley is None)
    return tuple(contacts), tuple(spans)


def force(scene: Scene, fields: Fields, rate: float) -> Array:
    """Force N = Q - rhoA c^2 r' of the belt, which loads alone change, in the complex plane ``(n,)``."""
    Q, mass = places(fields.Q), scene.belt.line_density * rate**2
    if mass:
        Q = Q - mass * (1.0 + fields.eps + 1j * fields.Gamma)
    return Q * np.exp(1j * fields.theta)


def fibre(scene: Scene, fields: Fields, turn: Any, at: Any = slice(None)) -> Array:
    """Places r - d e2 of the fibre that touches pulleys on a side, in the complex plane.

    Args:
        scene: The scene.
        fields: The fields.
        turn: +1 for pulleys on the right of the belt, -1 for those on its left, 0 for the middle line.
        at: Indices of the points; all of them by default.
    """
    r, offset = places(fields.r)[at], scene.belt.contact_offset
    return r - 1j * offset * turn * np.exp(1j * fields.theta[at]) if offset else r


def end_points(fields: Fields, zones: int) -> Array:
    """Indices of the first and the last point of each zone ``(zones, 2)``."""
    starts = fields.zone.searchsorted(np.arange(zones + 1))
    return np.column_stack([starts[:-1], starts[1:] - 1])


def at_ends(zones: Sequence[Zone], fields: Fields, values: Array, weighed: Array | None) -> Array:
    """What loads alone change, at both ends of each zone ``(..., len(zones), 2)``.

    In a free span it is constant but for the weight; its mean is what a fixed mesh holds in equilibrium where it does
    not resolve the layers.

    Args:
        zones: All zones.
        fields: The fields.
        values: Values at the points ``(..., n)``.
        weighed: What the weight has taken from them on the way there ``(..., n)``; None without weight.
    """
    points = end_points(fields, len(zones))
    found = values[..., points]
    for i, part in enumerate(_slices(points)):
        if zones[i].pulley is None:
            weight = fields.weight[part]
            if weighed is None:
                found[..., i, :] = (values[..., part] @ weight / weight.sum())[..., None]
            else:
                kept = (values + weighed)[..., part] @ weight / weight.sum()
                found[..., i, :] = kept[..., None] - weighed[..., points[i]]
    return found


def weighed(scene: Scene, fields: Fields, origin: complex = 0j) -> Array | None:
    """Force of the weight, and its moment about a point, summed up along the belt ``(2, n)``; None without weight.

    The places of the belt are integrated as cubics between the points.
    """
    line_weight = scene.belt.line_density * complex(*scene.gravity)
    if not line_weight:
        return None
    arm, steps = places(fields.r) - origin, np.diff(fields.sigma)
    slope = (1.0 + fields.eps + 1j * fields.Gamma) * np.exp(1j * fields.theta)
    pieces = steps * (arm[1:] + arm[:-1]) / 2.0 - steps**2 * np.diff(slope) / 12.0
    lever = np.append(0.0, np.cumsum(pieces))
    return np.array([line_weight * fields.sigma, (lever.conj() * line_weight).imag])


def beside(scene: Scene, zones: Sequence[Zone], ends: Any, pulley: int) -> tuple[Any, Any]:
    """Values at the end of the span before a pulley and at the start of the one behind it.

    Args:
        scene: The scene.
        zones: All zones.
        ends: Values at both ends of each zone.
        pulley: Index of the pulley. Where the belt touches it next to a clamp, there is no span on that side.
    """
    on = [i for i, zone in enumerate(zones) if zone.pulley == pulley]
    before = ends[on[0] - 1][1] if on[0] or scene.closed else ends[0][0]
    after = ends[on[-1] + 1][0] if on[-1] + 1 < len(zones) else ends[-1][1]
    return before, after


def points_on(zones: Sequence[Zone], fields: Fields, pulley: int) -> slice:
    """The points from the run-up to the run-off of a pulley."""
    on = [i for i, zone in enumerate(zones) if zone.pulley == pulley]
    first, end = fields.zone.searchsorted([on[0], on[-1] + 1]).tolist()
    return slice(first, end)


def _slices(points: Array) -> list[slice]:
    return [slice(first, last + 1) for first, last in points.tolist()]


def _borders(scene: Scene, pulleys: Sequence[int | None], fields: Fields, points: Array) -> Array:
    """Places of the zones' ends, those of the touching fibre on a pulley ``(len(pulleys), 2)``."""
    turns = [0.0 if pulley is None else scene.pulleys[pulley].turn for pulley in pulleys]
    return fibre(scene, fields, np.array(turns)[:, None], points)


def _counted_on(direction: complex, near: float) -> float:
    """Angle of a direction, counted on from one near it."""
    return near + cmath.phase(direction * cmath.rect(1.0, -near))


def _vector(place: complex) -> tuple[float, float]:
    return place.real, place.imag


def along(direction: tuple[float, float] | None, way: complex) -> float:
    """Component of a vector in a direction; zero without one."""
    return 0.0 if direction is None else (way * complex(*direction).conjugate()).real / math.hypot(*direction)


def _span(zone: Zone, fields: Fields, part: slice, rate: float) -> Span:
    sigma, r, D, along = fields.sigma[part], places(fields.r)[part], fields.D[part], 1.0 + fields.eps[part]
    tension = (fields.Q[part, 0] * along + fields.Q[part, 1] * fields.Gamma[part]) / D
    chord, start = complex(r[-1] - r[0]), float(fields.phi[part.start])
    weights, near = _weights(sigma, (sigma[0] + sigma[-1]) / 2)
    return Span(
        sigma=zone.sigma,
        length=zone.sigma[1] - zone.sigma[0],
        tension=(float(tension[0]), float(weights @ tension[near]), float(tension[-1])),
        speed=rate * float(weights @ D[near]),
        sag=float(np.abs(((r - r[0]) * chord.conjugate()).imag).max()) / (abs(chord) or math.nan),
        angle=_counted_on(chord, start),
    )


def _weights(x: Array, place: float) -> tuple[Array, slice]:
    """Weights of the values at a few points round a place, and these points: Lagrange's interpolation."""
    first = max(0, min(int(x.searchsorted(place)) - NEAR // 2, x.size - NEAR))
    near = slice(first, first + NEAR)
    ways = x[near] - place
    with np.errstate(divide="ignore", invalid="ignore"):
        factors = ways / (ways - ways[:, None])
    np.fill_diagonal(factors, 1.0)
    return factors.prod(axis=1), near
