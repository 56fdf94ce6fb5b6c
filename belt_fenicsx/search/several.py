"""Answers for drives of several pulleys, or with loads, from the exact string.

1. The string says where the belt sticks and slides: its rows are the first ones, and the method starts from it.
2. A pulley with a given torque or speed, on which the string sticks all along, may need a short part that slides before
   its run-off: what is missing tells its sense and its length, R (mu p -+ f) d = missing torque.
3. A pulley on which the belt slides all along, though its torque asks for more, has reached its capacity.
"""

from __future__ import annotations

import math

import numpy as np

from belt_fenicsx.layout.kind import sliding
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered
from belt_fenicsx.search.find import settle_from
from belt_fenicsx.search.limits import ahead, meets, slides_as_driven, unmet
from belt_fenicsx.search.protocol import Method, S

LONGEST = 0.5  # A new part that slides takes this part of a stick part, at most.
ROUNDS = 3  # Rounds of new parts for each pulley, at most.


def solve_several(method: Method[S]) -> S:
    """A coarse state.

    Raises:
        Stopped: There is none, or a torque is beyond what friction can transmit.
    """
    state = method.start()
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


def _slides_before_run_off(method: Method[S], state: S, index: int) -> S | None:
    """A first guess with a short part that slides before the run-off of a pulley; None where it does not stick there."""
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
