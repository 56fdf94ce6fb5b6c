"""What is read from the fields of any method: zones, contacts with pulleys, and free spans."""

from __future__ import annotations

import cmath
import itertools
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
    """The zones of a belt whose fields have a point on each side of each joint.

    Args:
        scene: The scene.
        parts: What the belt does in each zone.
        fields: The fields.
    """
    zones = []
    for part, points in zip(parts, parts_of(fields, parts), strict=True):
        ends, turn = [points.start, points.stop - 1], scene.pulleys[part.pulley].turn if part.touches else 0.0
        sigma, x = fields.sigma[ends].tolist(), fibre(scene, fields, turn, ends).real.tolist()
        pulley = part.pulley if part.touches else None
        zones.append(Zone(kind=part.kind, slip=part.slip, pulley=pulley, sigma=tuple(sigma), x=tuple(x)))
    return tuple(zones)


def contacts_of(
    scene: Scene,
    zones: Sequence[Zone],
    fields: Fields,
    *,
    rate: float,
    omegas: Sequence[float],
    torques: Sequence[float],
    centers: Sequence[tuple[float, float]] | None = None,
    capacities: Sequence[float] | None = None,
    zone_ends: Array | None = None,
) -> tuple[Contact, ...]:
    """Contacts with the pulleys that are touched, in their order.

    Args:
        scene: The scene, in the units of the other arguments.
        zones: All zones, in the direction of travel.
        fields: Fields, with a point on each side of each joint unless there are ``zone_ends``.
        rate: Transport rate c.
        omegas: Angular velocity of each pulley.
        torques: Moment of the belt on each pulley, positive where it drives it along.
        centers: Centre of each pulley, with its take-up done; by default, that of the scene.
        capacities: Torque that each pulley transmits at most; not known by default.
        zone_ends: Ends of the zones, those of the touching fibre on a pulley, in the complex plane ``(len(zones), 2)``;
            by default, the first and the last points of the zones.
    """
    parts, N = parts_of(fields, zones), force(scene, fields, rate)
    taken, _ = weighed(scene, fields)
    line_weight = scene.belt.line_density * complex(*scene.gravity)
    driver = _driver(scene, omegas, torques)
    contacts = []
    for index, pulley in enumerate(scene.pulleys):
        on = on_pulley(zones, index)
        if not on:
            continue
        touching = tuple(zones[i] for i in on)
        center = complex(*(pulley.center if centers is None else centers[index]))
        sticks = [i for i in on if zones[i].kind == "stick"]
        before, after = beside(scene, fields, parts, on, N, taken)
        contacts.append(
            Contact(
                pulley=index,
                omega=omegas[index],
                x_up=touching[0].x[0],
                # The belt leaves the pulley's speed for good where it first sticks no more.
                x_trans=zones[sticks[0]].x[1] if sticks else touching[0].x[len(touching) > 1],
                x_off=touching[-1].x[1],
                torque=torques[index],
                center=_vector(center),
                hub_force=_vector(after - before + line_weight * (touching[-1].sigma[1] - touching[0].sigma[0])),
                creep=1.0 - pulley.radius * omegas[index] / driver,
                sliding_loss=sum(_lost(fields, parts[i]) for i in on if zones[i].kind == "slip"),
                capacity=math.nan if capacities is None else capacities[index],
                take_up=along(pulley.take_up, center - complex(*pulley.center)),
                zones=touching,
                **_at_ends(scene, zones, fields, on, center, zone_ends),
            )
        )
    return tuple(contacts)


def _at_ends(
    scene: Scene, zones: Sequence[Zone], fields: Fields, on: Sequence[int], center: complex, zone_ends: Array | None
) -> dict[str, Any]:
    """Places, angles and tensions of a contact at its run-up and its run-off, from the zones ``on`` the pulley."""
    turn, parts = scene.pulleys[zones[on[0]].pulley or 0].turn, parts_of(fields, zones)
    sticks = [i for i in on if zones[i].kind == "stick"]
    # Run-up, the last place at which the belt sticks, and run-off: zones, and at which of their ends.
    wanted = ((on[0], 0), (sticks[-1], 1) if sticks else (on[0], 0), (on[-1], 1))
    points = [parts[i].stop - 1 if end else parts[i].start for i, end in wanted]
    if zone_ends is None:
        ends = fibre(scene, fields, turn, points).tolist()
    else:
        ends = [complex(zone_ends[i, end]) for i, end in wanted]
    angles = [
        _counted_on((place - center) * turn / 1j, near)
        for place, near in zip(ends, fields.phi[points].tolist(), strict=True)
    ]
    tensions = fields.tension[points].tolist()
    return dict(
        run_up=_vector(ends[0]),
        run_off=_vector(ends[2]),
        angle_up=angles[0],
        angle_off=angles[2],
        wrap_angle=turn * (angles[0] - angles[2]),
        slip_angle=turn * (angles[1] - angles[2]),
        tension_up=tensions[0],
        tension_off=tensions[2],
    )


def spans_of(scene: Scene, zones: Sequence[Zone], fields: Fields) -> tuple[Span, ...]:
    """The free spans.

    Args:
        scene: The scene.
        zones: All zones, in the direction of travel.
        fields: The fields.
    """
    rows = zip(zones, parts_of(fields, zones), strict=True)
    return tuple(_span(scene, zone, fields, part) for zone, part in rows if zone.pulley is None)


def goes_along_x(scene: Scene) -> bool:
    """Whether the coordinate x tells places on the belt apart: on one pulley between clamps."""
    return not scene.closed and len(scene.pulleys) == 1


def force(scene: Scene, fields: Fields, rate: float) -> Array:
    """Force N = Q - rhoA c^2 r' of the belt, which loads alone change, in the complex plane ``(n,)``."""
    Q, mass = places(fields.Q), scene.belt.line_density * rate**2
    if mass:
        Q = Q - mass * (1.0 + fields.eps + 1j * fields.Gamma)
    return Q * directions(fields.theta)


def directions(angles: Array) -> Array:
    """Unit vectors with these angles in the complex plane ``(m,)``; a complex exponential takes twice the time."""
    unit = np.empty(angles.shape, dtype=complex)
    np.cos(angles, out=unit.real)
    np.sin(angles, out=unit.imag)
    return unit


def fibre(scene: Scene, fields: Fields, turn: Any, at: Any = slice(None)) -> Array:
    """Places r - d e2 of the fibre that touches pulleys on a side, in the complex plane.

    Args:
        scene: The scene.
        fields: The fields.
        turn: +1 for pulleys on the right of the belt, -1 for those on its left, 0 for the middle line.
        at: Indices of the points; all of them by default.
    """
    r, offset = places(fields.r)[at], scene.belt.contact_offset
    return r - 1j * offset * turn * directions(fields.theta[at]) if offset else r


def parts_of(fields: Fields, zones: Sequence[Any]) -> list[slice]:
    """The points of each zone."""
    starts = fields.zone.searchsorted(range(len(zones) + 1)).tolist()
    return [slice(start, end) for start, end in itertools.pairwise(starts)]


def on_pulley(zones: Sequence[Zone], pulley: int) -> list[int]:
    """Indices of the zones on a pulley."""
    return [i for i, zone in enumerate(zones) if zone.pulley == pulley]


def arc(parts: Sequence[slice], on: Sequence[int]) -> slice:
    """The points on a pulley, of which these are the zones."""
    return slice(parts[on[0]].start, parts[on[-1]].stop)


def beside(
    scene: Scene, fields: Fields, parts: Sequence[slice], on: Sequence[int], values: Array, taken: Array | None
) -> tuple[complex, complex]:
    """What loads alone change, at the end of the span before a pulley and at the start of the one behind it.

    In a span it is constant but for the weight; its mean is what a fixed mesh holds in equilibrium where it does not
    resolve the layers. Where the belt touches the pulley next to a clamp, there is no span on that side.

    Args:
        scene: The scene.
        fields: The fields.
        parts: The points of each zone.
        on: Indices of the zones on the pulley.
        values: Values at all points ``(n,)``.
        taken: What the weight has taken from them on the way there ``(n,)``; None without weight.
    """
    before = parts[on[0] - 1] if on[0] or scene.closed else slice(0, 1)
    after = parts[on[-1] + 1] if on[-1] + 1 < len(parts) else slice(-1, None)
    first, last = fields.weight[before], fields.weight[after]
    kept = values if taken is None else values + taken
    up, off = complex(kept[before] @ first / first.sum()), complex(kept[after] @ last / last.sum())
    return (up, off) if taken is None else (up - complex(taken[before][-1]), off - complex(taken[after][0]))


def weighed(scene: Scene, fields: Fields, origin: complex = 0j) -> tuple[Array, Array] | tuple[None, None]:
    """Force of the weight, and its moment about a point, summed up along the belt ``(n,)``; None without weight.

    The places of the belt are integrated as cubics between the points.
    """
    line_weight = scene.belt.line_density * complex(*scene.gravity)
    if not line_weight:
        return None, None
    arm, steps = places(fields.r) - origin, np.diff(fields.sigma)
    slope = (1.0 + fields.eps + 1j * fields.Gamma) * directions(fields.theta)
    pieces = steps * (arm[1:] + arm[:-1]) / 2.0 - steps**2 * np.diff(slope) / 12.0
    lever = np.append(0.0, np.cumsum(pieces))
    return line_weight * fields.sigma, (lever.conj() * line_weight).imag


def _driver(scene: Scene, omegas: Sequence[float], torques: Sequence[float]) -> float:
    """Surface speed of the pulley that puts in most power; NaN where none does."""
    power, index = min((omega * torque, i) for i, (omega, torque) in enumerate(zip(omegas, torques, strict=True)))
    return scene.pulleys[index].radius * omegas[index] if power < 0.0 else math.nan


def _lost(fields: Fields, part: slice) -> float:
    """Power that friction takes along a part."""
    return float(fields.weight[part] @ np.abs(fields.f[part] * fields.v_rel[part]))


def _counted_on(direction: complex, near: float) -> float:
    """Angle of a direction, counted on from one near it."""
    return near + cmath.phase(direction * cmath.rect(1.0, -near))


def _vector(place: complex) -> tuple[float, float]:
    return place.real, place.imag


def along(direction: tuple[float, float] | None, way: complex) -> float:
    """Component of a vector in a direction; zero without one."""
    return 0.0 if direction is None else (way * complex(*direction).conjugate()).real / math.hypot(*direction)


def _span(scene: Scene, zone: Zone, fields: Fields, part: slice) -> Span:
    sigma, r, tension = fields.sigma[part], places(fields.r)[part], fields.tension[part]
    chord, (near, weights) = complex(r[-1] - r[0]), _middle(sigma)
    middle, speed, D = (float(weights @ values[near]) for values in (tension, fields.speed[part], fields.D[part]))
    length = zone.sigma[1] - zone.sigma[0]
    return Span(
        sigma=zone.sigma,
        length=length,
        tension=(float(tension[0]), middle, float(tension[-1])),
        speed=speed,
        sag=float(np.abs(((r - r[0]) * chord.conjugate()).imag).max()) / (abs(chord) or math.nan),
        frequency=_frequency(middle, scene.belt.line_density / D, length * D, speed),
        angle=_counted_on(chord, float(fields.phi[part.start])),
    )


def _frequency(tension: float, mass: float, length: float, speed: float) -> float:
    """First frequency of a taut moving string [Hz]; NaN without mass or tension."""
    if not (mass > 0.0 and tension > 0.0):
        return math.nan
    wave = math.sqrt(tension / mass)
    return (wave**2 - speed**2) / (2.0 * length * wave)


def _middle(x: Array) -> tuple[slice, list[float]]:
    """A few points round the middle, and the weights of the values there: Lagrange's interpolation."""
    middle = (x[0] + x[-1]) / 2
    first = max(0, min(int(x.searchsorted(middle)) - NEAR // 2, x.size - NEAR))
    near = slice(first, first + NEAR)
    ways = (x[near] - middle).tolist()
    weights = [
        math.prod(other / ((other - way) or math.nan) for j, other in enumerate(ways) if j != i)
        for i, way in enumerate(ways)
    ]
    return near, weights
