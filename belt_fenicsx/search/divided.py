"""Where the belt sticks and slides on a pulley in a first guess, from a state in which it does so elsewhere."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import Part, sliding
from belt_fenicsx.layout.layers import LEAST_STRAIN
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered, posed
from belt_fenicsx.layout.revision import Sample, Samples
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.search.limits import ahead
from belt_fenicsx.taut_string.forces import MOST_GROWTH

LEAST = 1e-7  # At least this part of a stick part sticks, or slides, in a first guess.


def divide_stick(scene: Scene, stick: Layout, samples: Samples, least: float) -> tuple[Layout, Array] | None:
    """The layout that a scene asks for by ``x_trans``, and about its ends, from pure stick.

    Args:
        scene: The dimensionless scene.
        stick: The layout of pure stick.
        samples: Its samples.
        least: Part of the contact that sticks, or slides, at least.

    Returns:
        None where nothing sticks where stick is to end.
    """
    wanted, on, ends = posed(scene), stick.on(0), samples.ends
    if not wanted.slides_behind(0):
        # The belt slides all along, or sticks.
        return wanted, ends[[0, on[0], on[-1] + 1, -1]]
    sticks = [i for i in on if stick.parts[i].kind == "stick"]
    if not sticks or (at := samples.parts[sticks[0]]) is None:
        return None
    start, stop = ends[sticks[0]], ends[on[-1] + 1]
    margin = least * (stop - ends[on[0]])
    (pulley,) = scene.pulleys
    place = min(max(float(np.interp(pulley.drive.by("x_trans"), at.x, at.sigma)), start + margin), stop - margin)
    layout = ordered(scene, [*stick.parts[on[0] : sticks[0] + 1], wanted.contact[-1]])
    return layout, np.array([*ends[: sticks[0] + 1], place, stop, ends[-1]])


def place_transition(scene: Scene, layout: Layout, samples: Samples, index: int) -> tuple[list[Part], Array]:
    """Parts on a pulley with the speed or torque given, and their ends, from a state with stick before its run-off.

    Where nothing is to stick, the belt slides all along.
    """
    on = layout.on(index)
    first = next(i for i in on if layout.parts[i].kind == "stick")
    parts = [part for part in samples.parts[first : on[-1] + 1] if part is not None]
    sigma, gained, back = _gained_by_sliding(scene, samples, parts, index)
    exceeds, inside = ahead(scene, samples, index), parts[0].sigma.size
    slides = sliding(-exceeds, index)
    start, stop, last = samples.ends[first], samples.ends[first + 1], samples.ends[on[-1] + 1]
    end = float(np.interp(-abs(exceeds), -math.copysign(1.0, exceeds) * gained[:inside], sigma[:inside]))
    if end <= start:
        return [slides], samples.ends[[on[0], on[-1] + 1]]
    end = min(max(end, start + LEAST * (stop - start)), stop - LEAST * (stop - start))
    turn = float(np.interp(end, sigma, back))
    behind, ends = ([slides], []) if turn >= sigma[-1] else ([slides, slides.turned], [turn])
    return [*layout.parts[on[0] : first + 1], *behind], np.array([*samples.ends[on[0] : first + 1], end, *ends, last])


def _gained_by_sliding(
    scene: Scene, samples: Samples, parts: Sequence[Sample], index: int
) -> tuple[Array, Array, Array]:
    """What sliding behind a transition adds to the stretch in stick, or to the resultant of friction.

    Sliding adds the difference of its friction and that of stick to the tension. The pressure grows with the tension,
    and the stretch before the transition gives way, since the belt's length does not change.

    Args:
        scene: The dimensionless scene.
        samples: Samples of a state.
        parts: Those of the parts on a pulley, from the one that sticks on.
        index: The pulley.

    Returns:
        Places of the transition, what is gained for each of them, and where sliding turns, all ``(m,)``.
    """
    pulley = scene.pulleys[index]
    sigma, p, f = (np.concatenate([getattr(part, name) for part in parts]) for name in ("sigma", "p", "f"))
    keeping = np.concatenate([part.keeping() for part in parts])
    sense = sliding(-ahead(scene, samples, index)).sense
    slip, strain = sense * pulley.friction * p, max(samples.pulleys[index].speed - 1.0, LEAST_STRAIN)
    # Where friction cannot hold the stretch, it comes back to that in stick, and sliding turns.
    apart = sense * _integral(slip + keeping, sigma)
    peak = int(np.argmax(apart))
    back = np.interp(-apart, -apart[peak:], sigma[peak:])
    growth = np.exp(np.clip(_integral(slip / strain, sigma), -MOST_GROWTH, MOST_GROWTH))
    tension = _integral((slip + f) * growth, sigma)
    whole = _integral(tension, sigma)
    behind = (np.interp(back, sigma, tension) - tension) / growth
    mean = (np.interp(back, sigma, whole) - whole - tension * (back - sigma)) / growth + (0.5 - back) * behind
    return sigma, -(mean if pulley.drive.kind == "omega" else behind) / (1.0 + mean / strain), back


def _integral(values: Array, sigma: Array) -> Array:
    """Integral from the first point to each of them, by the trapezoidal rule."""
    return np.append(0.0, np.cumsum(np.diff(sigma) * (values[1:] + values[:-1]) / 2.0))


def slides_both_ways(scene: Scene, layout: Layout, samples: Samples, index: int) -> tuple[list[Part], Array]:
    """Parts on a pulley on which the belt slides forward where it is faster than what meets the drive; their ends."""
    (part,) = layout.on(index)
    pulley, rate, at = scene.pulleys[index], samples.rate, samples.parts[part]
    assert at is not None, "a part on a pulley"
    if pulley.omega is not None:
        meeting = pulley.radius * pulley.omega / rate
    else:
        pressures = np.append(0.0, np.diff(at.sigma) * (at.p[1:] + at.p[:-1]) / 2.0)
        order = np.argsort(at.D)
        # The resultant of friction, if the belt is slower than the pulley in the slowest of its places.
        friction = pulley.friction * (2.0 * np.cumsum(pressures[order]) - pressures.sum())
        torque = (pulley.torque or 0.0) + pulley.drag * rate * samples.pulleys[index].speed / pulley.radius
        meeting = np.interp(-torque / pulley.radius, friction, at.D[order])
    faster = at.D > meeting
    changes = np.flatnonzero(np.diff(faster)) + 1
    parts = [sliding(1.0 if faster[i] else -1.0, index) for i in (0, *changes.tolist())]
    places = (at.sigma[changes - 1] + at.sigma[changes]) / 2.0
    return parts, np.array([samples.ends[part], *places, samples.ends[part + 1]])
