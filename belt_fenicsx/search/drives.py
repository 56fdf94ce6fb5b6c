"""Answers for drives, from the exact string or, over one pulley between clamps, from a belt that sticks.

1. The string says where the belt sticks and slides: its rows are the first ones, and the method starts from it. Over
   one pulley between clamps, a given speed or torque starts from pure stick, which a stiff belt tells better, then from
   pure slip, and at last from places of the transition between those of both.
2. On a pulley that sticks all along, what its pressure lets friction add tells the part that slides before the run-off
   where a given speed or torque is not met.
3. One on which the belt slides all along in one sense may meet its drive by sliding both ways.
4. A pulley on which the belt slides all along, though its torque asks for more, has reached its capacity. Where there
   is no answer and the string slides along nearly all of a pulley, or more, the state at that limit says what is
   transmitted.
"""

from __future__ import annotations

import functools

import numpy as np

from belt_fenicsx.layout.kind import Part
from belt_fenicsx.layout.posed import ordered
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.path import tangent_path
from belt_fenicsx.scene.pulley import RUN_OFF, RUN_UP, Slip
from belt_fenicsx.search.divided import place_transition, slides_both_ways
from belt_fenicsx.search.find import answers, attempt, earliest, limit, limit_state, settle, settle_from
from belt_fenicsx.search.limits import ahead, driven_by, meets, slides_as_driven, unmet
from belt_fenicsx.search.protocol import Method, S
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.drive import string_drive
from belt_fenicsx.taut_string.standing import BeyondCapacity

NEARLY = 0.8  # The string slides along so much of a wrap where the belt may be at its limit.
STICKS = 0.1  # So much of a contact next to its limit sticks in a first guess.
SHORT = 0.05  # Where less of the contact is to slide, only a well known state can place it.
NOTHING = 1e-12  # Places that differ by less, in belt lengths, are the same.
MOST_PLACES = 12  # That many places of the transition are tried one after another.
ROUNDS = 3  # Rounds of new parts for each pulley, at most.


def solve_driven(method: Method[S]) -> S:
    """A coarse state.

    Raises:
        Stopped: There is none, or a torque is beyond what friction can transmit.
    """
    if method.scene.is_published and (near := attempt(functools.partial(_from_stick, method))) is not None:
        return near
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


def _from_stick(method: Method[S]) -> S:
    """An answer over one pulley between clamps, from the belt that sticks all along, or slides all along.

    Raises:
        Stopped: There is none, or a torque is beyond what friction can transmit.
    """
    stick = limit(method, RUN_OFF, "forward")
    if (state := _from_limit(method, stick, "pure stick")) is not None:
        return state
    sense: Slip = "forward" if ahead(method.scene, method.samples(stick)) < 0.0 else "backward"
    slip = limit(method, RUN_UP, sense, stick)
    return _from_limit(method, slip, "pure slip") or _between_limits(method, stick, slip, sense)


def _from_limit(method: Method[S], near: S, stage: str) -> S | None:
    """An answer from the belt that sticks, or slides, all along a pulley; None where there is none.

    Raises:
        Stopped: A torque is beyond what friction can transmit.
    """
    if not near.layout.slides_behind(0) and meets(method, near):
        return near
    if (start := _divided(method, near, 0)) is None:
        return None
    state = settle_from(method, start, stage, f"no answer yet; now {start.layout}")
    return state if state is not None and answers(method, state := meet_drives(method, state)) else None


def _between_limits(method: Method[S], stick: S, slip: S, sense: Slip) -> S:
    """An answer from states whose transition is placed, between pure stick and pure slip.

    Raises:
        Stopped: There is none.
    """
    scene, samples, slid = method.scene, method.samples(stick), method.samples(slip)
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
        start = method.transfer(near, ordered(scene, near.layout.contact), there.ends)
        state = settle_from(method, start, "search", f"no answer yet; now {start.layout}")
        if state is not None and answers(method, state):
            return state
        exceeds_there = ahead(scene, there)
        ends[int(exceeds_there * exceeds < 0.0)] = (place, exceeds_there)
    raise Stopped(Status.NEWTON_DIVERGED, "No place of the transition was found for the drive.")


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
        near = settle(driven, solve_driven(driven))
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
    guess = method.transfer(limit, rows, np.insert(samples.ends, first + 1, start + STICKS * (end - start)))
    state = settle_from(method, guess, "capacity", f"the drive asks for less; now {rows}")
    if state is None:
        raise Stopped(Status.NEWTON_DIVERGED, f"No state was found next to sliding all along pulley {index}.")
    return state


def _divided(method: Method[S], state: S, index: int) -> S | None:
    """A first guess with other parts on a pulley whose drive is not met; None without any."""
    scene, layout = method.scene, state.layout
    on = layout.on(index)
    if layout.sticks(index):
        parts, ends = place_transition(scene, layout, method.samples(state).densest, index)
        place = next((ends[i + 1] for i, part in enumerate(parts) if part.kind == "stick"), ends[0])
        if ends[-1] - place < SHORT * (ends[-1] - ends[0]):
            state = method.sharpen(state, "a short part that slides")
            if not layout.slides_behind(index) and index not in unmet(method, state):
                return state
            parts, ends = place_transition(scene, layout, method.samples(state).densest, index)
    elif len(on) == 1:
        parts, ends = slides_both_ways(scene, layout, method.samples(state), index)
    else:
        return None
    known = method.samples(state).ends
    before, after = [[p for p in some if p.touches] for some in (layout.parts[: on[0]], layout.parts[on[-1] + 1 :])]
    rows = ordered(scene, [*before, *parts, *after])
    return method.transfer(state, rows, np.concatenate([known[: on[0]], ends, known[on[-1] + 2 :]]))
