"""Answers for drives of several pulleys, or with loads, from the exact string.

1. The string says where the belt sticks and slides: its rows are the first ones, and the method starts from it.
2. Where that leads nowhere, more friction does, with which less of the belt slides: from there, friction falls to what
   it is, step by step.
3. A pulley with a given torque or speed, on which the string sticks all along, may need a short part that slides before
   its run-off: what is missing tells its sense and its length, R (mu p -+ f) d = missing torque.
4. A pulley on which the belt slides all along, though its torque asks for more, has reached its capacity. Where there
   is no answer and the string slides along nearly all of a pulley, or more, the state at that limit says what is
   transmitted.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from belt_fenicsx.layout.kind import Part, sliding
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered
from belt_fenicsx.scene.path import tangent_path
from belt_fenicsx.scene.pulley import Slip
from belt_fenicsx.search.find import settle_from
from belt_fenicsx.search.limits import ahead, limit_state, meets, slides_as_driven, unmet
from belt_fenicsx.search.protocol import Method, S
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.drive import BeyondCapacity, string_drive

MUCH, FALL, LEAST_FALL = 2.0, 0.5, 0.9  # Friction to start from; by which it falls in a step, at least and at most.
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
        state = _below_limit(method, beyond.pulley, beyond.sense)
    except Stopped as stopped:
        if stopped.final:
            raise
        found = None
        if found is None and (nearest := _nearest_to_its_limit(method)) is not None:
            found = _below_limit(method, *nearest)
        if found is None:
            raise
        state = found
    for _ in range(ROUNDS * len(method.scene.pulleys)):
        sticking = [index for index in unmet(method, state) if not slides_as_driven(method, state, index)]
        if not sticking:
            break
        start = _slides_before_run_off(method, state, sticking[0])
        if start is None:
            break
        why = f"the drive of pulley {sticking[0]} is not met; now {start.layout}"
        if (slid := settle_from(method, start, "run-off", why)) is None or slid.layout == state.layout:
            break
        state = slid
    meets(method, state)
    return state


def _from_more_friction(method: Method[S]) -> S | None:
    """A state of the drive, from one with more friction; None where there is none on the way."""
    scene = method.scene
    state: S | None = None
    frictions = [pulley.friction for pulley in scene.pulleys if pulley.friction > 0.0]
    factor, ratio, iterations = max(MUCH / min(frictions, default=MUCH), 1.0), FALL, 0
    while True:
        pulleys = tuple(replace(pulley, friction=factor * pulley.friction) for pulley in scene.pulleys)
        easier = method.at(scene.altered(pulleys=pulleys)) if factor > 1.0 else method
        try:
            if state is None:
                reached = easier.start()
            else:
                start = easier.transfer(state, state.layout, method.samples(state).ends)
                reached = settle_from(easier, start, "more friction", f"{factor:.3g} times as much")
        except Stopped:
            reached = None
        iterations += easier.stages.iterations if easier is not method else 0
        if reached is None or not method.is_plausible(reached):
            if state is None or ratio > LEAST_FALL:
                break
            factor, ratio = factor / ratio, math.sqrt(ratio)
        elif factor == 1.0:
            state = reached
            break
        else:
            state = reached
        factor = max(factor * ratio, 1.0)
    method.stages.ran("more friction", "the string did not lead to a plausible solution", iterations)
    return state if reached is state else None


def _nearest_to_its_limit(method: Method[S]) -> tuple[int, Slip] | None:
    """The pulley along nearly all of which the string slides, with the sense; None where it is none."""
    scene = method.scene
    string = string_drive(scene)
    wraps = [arc.wrap for arc in tangent_path(scene, string.centers).arcs]
    loaded = [i for i, pulley in enumerate(scene.pulleys) if pulley.drive.kind in ("omega", "torque")]
    index = max(loaded, key=lambda i: string.slip_angles[i] / wraps[i])
    if string.slip_angles[index] < NEARLY * wraps[index]:
        return None
    return index, "forward" if string.torques[index] > 0.0 else "backward"


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


def _slides_before_run_off(method: Method[S], state: S, index: int) -> S | None:
    """A first guess with a short part that slides before the run-off of a pulley; None where it does not stick
    there.
    """
    layout, samples, pulley = state.layout, method.samples(state), method.scene.pulleys[index]
    last = layout.on(index)[-1]
    at = samples.parts[last]
    if layout.parts[last].kind != "stick" or at is None:
        return None
    exceeds = ahead(method.scene, samples, index)
    part = sliding(-exceeds, index)
    gained = -part.sense * pulley.friction * at.p[-1] - at.f[-1]
    start, end = samples.ends[last : last + 2]
    length = exceeds / gained if gained * exceeds > 0.0 else math.inf
    place = end - min(length, LONGEST * (end - start))
    contact = [p for p in layout.parts if p.touches]
    contact.insert(sum(p.touches for p in layout.parts[: last + 1]), part)
    wanted: Layout = ordered(method.scene, contact)
    return method.transfer(state, wanted, np.insert(samples.ends, last + 1, place))
