"""Answers for drives of several pulleys, or with loads, from the exact string.

1. The string says where the belt sticks and slides: its rows are the first ones, and the method starts from it.
2. A pulley with a given torque or speed, on which the string sticks all along, may need a short part that slides before
   its run-off: what is missing tells its sense and its length, R (mu p -+ f) d = missing torque.
3. One on which it slides all along in one sense may meet a torque by sliding both ways.
4. A pulley on which the belt slides all along, though its torque asks for more, has reached its capacity. Where there
   is no answer and the string slides along nearly all of a pulley, or more, the state at that limit says what is
   transmitted.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import Part, sliding
from belt_fenicsx.layout.posed import ordered
from belt_fenicsx.layout.revision import Sample, Samples
from belt_fenicsx.scene.path import tangent_path
from belt_fenicsx.scene.pulley import Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.search.find import attempt, limit_state, settle, settle_from
from belt_fenicsx.search.limits import ahead, meets, slides_as_driven, unmet
from belt_fenicsx.search.protocol import Method, S
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.drive import string_drive
from belt_fenicsx.taut_string.standing import BeyondCapacity

NEARLY = 0.8  # The string slides along so much of a wrap where the belt may be at its limit.
SHORT = 0.1  # So much of a contact next to its limit sticks in a first guess.
LONGEST = 0.5  # A new part that slides takes this part of a stick part, at most.
ROUNDS = 3  # Rounds of new parts for each pulley, at most.


def solve_several(method: Method[S]) -> S:
    """A coarse state.

    Raises:
        Stopped: There is none, or a torque is beyond what friction can transmit.
    """
    try:
        state = method.start()
    except BeyondCapacity as beyond:
        try:
            state = _below_limit(method, beyond.pulley, beyond.sense)
        except BeyondCapacity as first:
            # With all of this pulley, the string would already slide all along another one.
            state = _below_limit(method, first.pulley, first.sense)
    except Stopped as stopped:
        if stopped.final:
            raise
        limits = [functools.partial(_below_limit, method, *limit) for limit in _near_their_limits(method)]
        ways = [functools.partial(_by_torques, method), *limits]
        found = next((near for way in ways if (near := attempt(way)) is not None), None)
        if found is None:
            raise
        state = found
    return meet_drives(method, state)


def _by_torques(method: Method[S]) -> S:
    """A state of drives by slip angles, from the torques that the string has with them.

    A torque leaves it to the search how the belt slides, which a short contact or a stiff belt tells otherwise than the
    string does.

    Raises:
        Stopped: There is none.
    """
    scene, torques = method.scene, string_drive(method.scene).torques
    placed = [i for i, p in enumerate(scene.pulleys) if p.drive.kind == "slip_angle" and p.friction > 0.0]
    pulleys = [p.driven(torque=torques[i]) if i in placed else p for i, p in enumerate(scene.pulleys)]
    if not placed:
        raise Stopped(Status.NEWTON_DIVERGED, "No slip angle is given.")
    driven = method.at(scene.altered(pulleys=tuple(pulleys)))
    try:
        near = settle(driven, solve_several(driven))
    except Stopped as stopped:
        raise Stopped(Status.NEWTON_DIVERGED, f"With the torques of the string: {stopped.message}") from None
    finally:
        method.stages.ran("torques", "the string's, where slip angles are given", driven.stages.iterations)
    parts, behind = [*near.layout.parts], list[int]()
    for i in placed:
        on = near.layout.on(i)
        transition = near.layout.transition(i)
        if near.layout.slides_behind(i):
            # A torque may be met by sliding to and fro; where stick ends, the drive says the sense.
            parts[transition + 1] = Part("slip", scene.pulleys[i].slip, i)
            behind += range(transition + 2, on.stop)
    rows = ordered(scene, [part for i, part in enumerate(parts) if part.touches and i not in behind])
    guess = method.transfer(near, rows, np.delete(driven.samples(near).ends, behind))
    state = settle_from(method, guess, "torques", f"the place where stick ends; now {rows}")
    if state is None:
        raise Stopped(Status.NEWTON_DIVERGED, "No state was found near that of the string's torques.")
    return state


def meet_drives(method: Method[S], state: S) -> S:
    """A state near another one in which pulleys that slide nowhere, or all along, have the speeds and torques given.

    Raises:
        Stopped: A torque is beyond what friction can transmit.
    """
    for _ in range(ROUNDS * len(method.scene.pulleys)):
        missing = [index for index in unmet(method, state) if not slides_as_driven(method, state, index)]
        start = _divided(method, state, missing[0]) if missing else None
        if start is None:
            break
        why = f"the drive of pulley {missing[0]} is not met; now {start.layout}"
        if (slid := settle_from(method, start, "run-off", why)) is None or slid.layout == state.layout:
            break
        state = slid
    meets(method, state)
    return state


def _near_their_limits(method: Method[S]) -> list[tuple[int, Slip]]:
    """Pulleys along nearly all of which the string slides, with the sense; that along most of which it does first."""
    scene = method.scene
    string = string_drive(scene)
    wraps = [arc.wrap for arc in tangent_path(scene, string.centers).arcs]
    loaded = [i for i, pulley in enumerate(scene.pulleys) if pulley.drive.kind in ("omega", "torque", "slip_angle")]
    slid = {i: part for i in loaded if (part := string.slip_angles[i] / wraps[i]) >= NEARLY}
    return [(i, "forward" if string.torques[i] > 0.0 else "backward") for i in sorted(slid, key=lambda i: -slid[i])]


def _below_limit(method: Method[S], index: int, sense: Slip) -> S:
    """A state of a drive next to its limit, from the state in which the belt slides all along a pulley.

    Raises:
        Stopped: The drive is beyond its capacity, or there is none.
    """
    limit = limit_state(method, index, sense)
    layout, samples = limit.layout, method.samples(limit)
    first = layout.on(index)[0]
    contact = [part for part in layout.parts if part.touches]
    contact.insert(sum(part.touches for part in layout.parts[:first]), Part("stick", pulley=index))
    rows, (start, end) = ordered(method.scene, contact), samples.ends[first : first + 2]
    guess = method.transfer(limit, rows, np.insert(samples.ends, first + 1, start + SHORT * (end - start)))
    state = settle_from(method, guess, "capacity", f"the drive asks for less; now {rows}")
    if state is None:
        raise Stopped(Status.NEWTON_DIVERGED, f"No state was found next to sliding all along pulley {index}.")
    return state


def _divided(method: Method[S], state: S, index: int) -> S | None:
    """A first guess with other parts on a pulley whose drive is not met; None without any."""
    layout, samples = state.layout, method.samples(state)
    on = layout.on(index)
    last = samples.parts[on[-1]]
    assert last is not None, "a part on a pulley"
    ends = samples.ends[on[0] : on[-1] + 2]
    if layout.parts[on[-1]].kind == "stick":
        parts, ends = _slides_before_run_off(method.scene, samples, index, last, ends)
        parts = [*(layout.parts[i] for i in on), *parts]
    elif len(on) == 1 and method.scene.pulleys[index].drive.kind == "torque":
        parts, ends = _slides_both_ways(method.scene, samples, index, last, ends)
    else:
        return None
    before, after = [[p for p in some if p.touches] for some in (layout.parts[: on[0]], layout.parts[on[-1] + 1 :])]
    rows = ordered(method.scene, [*before, *parts, *after])
    return method.transfer(state, rows, np.concatenate([samples.ends[: on[0]], ends, samples.ends[on[-1] + 2 :]]))


def _slides_before_run_off(
    scene: Scene, samples: Samples, index: int, last: Sample, ends: Array
) -> tuple[list[Part], Array]:
    """A short part that slides before the run-off of a pulley, and the ends of the parts there with it."""
    exceeds = ahead(scene, samples, index)
    slides = sliding(-exceeds, index)
    gained = -slides.sense * scene.pulleys[index].friction * last.p[-1] - last.f[-1]
    length = exceeds / gained if gained * exceeds > 0.0 else math.inf
    return [slides], np.insert(ends, -1, ends[-1] - min(length, LONGEST * (ends[-1] - ends[-2])))


def _slides_both_ways(scene: Scene, samples: Samples, index: int, at: Sample, ends: Array) -> tuple[list[Part], Array]:
    """Parts on a pulley on which the belt slides forward where it is faster than what meets the torque; their ends."""
    pulley, rate = scene.pulleys[index], samples.rate
    pressures = np.append(0.0, np.diff(at.sigma) * (at.p[1:] + at.p[:-1]) / 2.0)
    order = np.argsort(at.D)
    # The resultant of friction, if the belt is slower than the pulley in the slowest of its places.
    friction = pulley.friction * (2.0 * np.cumsum(pressures[order]) - pressures.sum())
    torque = (pulley.torque or 0.0) + pulley.drag * rate * samples.pulleys[index].speed / pulley.radius
    faster = at.D > np.interp(-torque / pulley.radius, friction, at.D[order])
    changes = np.flatnonzero(np.diff(faster)) + 1
    parts = [sliding(1.0 if faster[i] else -1.0, index) for i in (0, *changes.tolist())]
    return parts, np.concatenate([ends[:1], (at.sigma[changes - 1] + at.sigma[changes]) / 2.0, ends[-1:]])
