"""Answers for a given speed or torque, between sticking all along and sliding all along.

1. Pure stick is solved first. It may be the answer; if not, what its pressure lets friction add to the belt's tension
   tells where stick ends, and with sliding behind it, it is the first guess.
2. Where everything is to slide, or Newton's iteration finds no answer from there, pure slip is solved. It may be the
   answer; if not, and if it is slowest inside of the contact, sliding turns from there on in the first guess.
3. If there is still none, the transition is placed: between where it is in pure stick and in pure slip, moving until
   the speed or the torque is the given one.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import sliding
from belt_fenicsx.layout.layers import LEAST_STRAIN
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered, posed
from belt_fenicsx.layout.revision import Sample, Samples
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.pulley import RUN_OFF, RUN_UP, Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.search.find import answers, attempt, earliest, limit, settle_from
from belt_fenicsx.search.limits import ahead, driven_by, meets
from belt_fenicsx.search.protocol import Method, S
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.forces import MOST_GROWTH

LEAST = 1e-7  # At least this part of a stick part sticks, or slides, in a first guess.
NEARLY = 0.95  # This part of the contact slides before sliding turns, in the first guess.
SHORT = 0.05  # Where less of the contact is to slide, only a well known pure stick can place it.
NOTHING = 1e-12  # Places that differ by less, in belt lengths, are the same.
MOST_PLACES = 12  # That many places of the transition are tried one after another.


def solve_driven(method: Method[S]) -> S:
    """A coarse state for a given speed or torque.

    Raises:
        Stopped: There is none, or the torque is beyond what friction can transmit.
    """
    stick = limit(method, RUN_OFF, "forward")
    if _is_answer(method, stick):
        return stick
    if (state := _from_stick(method, stick)) is not None:
        return state
    slip = limit(method, RUN_UP, _sense(method, stick), stick)
    if _is_answer(method, slip):
        return slip
    return _from_slip(method, slip) or _search_transition(method, stick, slip)


def _is_answer(method: Method[S], limit_state: S) -> bool:
    """Whether pure stick or pure slip is an answer itself, with no transition that the drive could place."""
    return not limit_state.layout.slides_behind(0) and meets(method, limit_state)


def _sense(method: Method[S], stick: S) -> Slip:
    """Sense of the sliding that a drive asks for, seen from pure stick."""
    return "forward" if ahead(method.scene, method.samples(stick)) < 0.0 else "backward"


def _from_stick(method: Method[S], stick: S) -> S | None:
    """An answer from pure stick, if a part of its stick part is to slide."""
    if (start := place_transition(method.scene, stick.layout, method.samples(stick).densest)) is None:
        return None
    layout, ends = start
    if ends[-2] - ends[layout.transition(0) + 1] < SHORT * (ends[-2] - ends[1]):
        stick = method.sharpen(stick, "a short slip part")
        if _is_answer(method, stick):
            return stick
        if (start := place_transition(method.scene, stick.layout, method.samples(stick).densest)) is None:
            return None
        layout, ends = start
    return _tried(method, method.transfer(stick, layout, ends), "pure stick")


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


def place_transition(scene: Scene, stick: Layout, samples: Samples) -> tuple[Layout, Array] | None:
    """The layout of a given speed or torque, and about its ends, from pure stick; None where nothing is to stick."""
    on = stick.on(0)
    sticks = [i for i in on if stick.parts[i].kind == "stick"]
    if not sticks:
        return None
    parts = [part for part in samples.parts[sticks[0] :] if part is not None]
    sigma, gained, back = _gained_by_sliding(scene, samples, parts)
    exceeds, inside = ahead(scene, samples), parts[0].sigma.size
    start, stop = samples.ends[sticks[0]], samples.ends[sticks[0] + 1]
    end = float(np.interp(-abs(exceeds), -math.copysign(1.0, exceeds) * gained[:inside], sigma[:inside]))
    if end <= start:
        return None
    end = min(max(end, start + LEAST * (stop - start)), stop - LEAST * (stop - start))
    turn = float(np.interp(end, sigma, back))
    contact = [*stick.parts[on[0] : sticks[0] + 1], sliding(-exceeds)]
    ends = [*samples.ends[: sticks[0] + 1], end]
    if turn < sigma[-1]:
        contact, ends = [*contact, contact[-1].turned], [*ends, turn]
    return ordered(scene, contact), np.array([*ends, *samples.ends[-2:]])


def _gained_by_sliding(scene: Scene, samples: Samples, parts: Sequence[Sample]) -> tuple[Array, Array, Array]:
    """What sliding behind a transition adds to the stretch in stick, or to the resultant of friction.

    Sliding adds the difference of its friction and that of stick to the tension. The pressure grows with the tension,
    and the stretch before the transition gives way, since the belt's length does not change.

    Args:
        scene: The dimensionless scene.
        samples: Samples of pure stick.
        parts: Those of its parts, from the one that sticks on.

    Returns:
        Places of the transition, what is gained for each of them, and where sliding turns, all ``(m,)``.
    """
    (pulley,) = scene.pulleys
    sigma, p, f = (np.concatenate([getattr(part, name) for part in parts]) for name in ("sigma", "p", "f"))
    keeping = np.concatenate([part.keeping() for part in parts])
    sense = sliding(-ahead(scene, samples)).sense
    slip, strain = sense * pulley.friction * p, max(samples.only.speed - 1.0, LEAST_STRAIN)
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


def _tried(method: Method[S], start: S, stage: str) -> S | None:
    """An answer from a first guess; None where there is none."""
    state = settle_from(method, start, stage, f"no answer yet; now {start.layout}")
    return state if state is not None and answers(method, state) else None


def _from_slip(method: Method[S], slip: S) -> S | None:
    """An answer next to pure slip, where sliding turns next to the run-off and nowhere else; None where it does not."""
    samples, (part,) = method.samples(slip), slip.layout.contact
    if earliest(samples) == samples.only.place:
        return None
    start, stop = samples.ends[1:3]
    layout = ordered(method.scene, [part, part.turned])
    ends = np.insert(samples.ends, 2, start + NEARLY * (stop - start))
    return _tried(method, method.transfer(slip, layout, ends), "pure slip")


def _search_transition(method: Method[S], stick: S, slip: S) -> S:
    """An answer from states whose transition is placed, between pure stick and pure slip.

    Raises:
        Stopped: There is none.
    """
    scene, samples, sense = method.scene, method.samples(stick), _sense(method, stick)
    slid = method.samples(slip)
    ends = [(samples.only.place, ahead(scene, samples)), (earliest(slid), ahead(scene, slid))]
    for _ in range(MOST_PLACES):
        (x, exceeds), (x_other, exceeds_other) = ends
        if abs(x_other - x) <= NOTHING:
            break
        place = x + float(np.clip(exceeds / (exceeds - exceeds_other), 0.05, 0.95)) * (x_other - x)
        search = method.at(driven_by(scene, place, sense))
        try:
            near = attempt(functools.partial(search.start, stick))
        except SceneError:
            break
        if near is None:
            break
        method.stages.ran("search", f"with the transition at {place:.6g} at first", search.stages.iterations)
        there = method.samples(near)
        layout = ordered(scene, near.layout.contact)
        if (state := _tried(method, method.transfer(near, layout, there.ends), "search")) is not None:
            return state
        exceeds_there = ahead(scene, there)
        ends[int(exceeds_there * exceeds < 0.0)] = (place, exceeds_there)
    raise Stopped(Status.NEWTON_DIVERGED, "No place of the transition was found for the drive.")
