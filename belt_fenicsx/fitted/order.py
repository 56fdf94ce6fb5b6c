"""Which zones a state calls for: where Coulomb's bound breaks the belt slides, and sliding turns with its sense.

In the order of travel: next to the run-up, where friction would have to be largest to hold the belt's stretch, it
slides before it sticks; next to the run-off, it slides again, or turns from sliding one way to the other. Pure NumPy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from belt_fenicsx.fitted.elimination import local
from belt_fenicsx.fitted.reading import along, pulley_speed
from belt_fenicsx.fitted.state import POINTS, State
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import FREE, STICK, Part
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered
from belt_fenicsx.scene.pulley import RUN_OFF, Slip
from belt_fenicsx.scene.scene import Scene

FURTHEST = 0.8  # of a zone, that another one may take from it
SHORTEST = 1e-4  # belt lengths, of a zone that is worth to be found
OTHER: dict[Slip | None, Slip] = {"forward": "backward", "backward": "forward"}


@dataclass(frozen=True)
class Change:
    """Layout that a state calls for instead of its own.

    Attributes:
        why: The state and what is wrong with it.
        zones: The zones.
        ends: Their ends, about ``(len(zones.parts) + 1,)``.
    """

    why: str
    zones: Layout
    ends: Array


def calm(scene: Scene, state: State) -> bool:
    """Whether friction holds at all Gauss points of stick, so that a coarse state calls for no other zones."""
    at, values = local(state.degree), state.values[state.mesh.sticks]
    return not np.any(np.abs(values[:, at.f]) > scene.pulleys[0].friction * values[:, at.p])


def change(scene: Scene, state: State, error: float) -> Change | None:
    """What the first broken bound calls for; None where all hold, or where no other zones could mend it.

    Args:
        scene: The dimensionless scene.
        state: The state.
        error: How far a bound may seem to be broken by the state's error, relative to its largest value.
    """
    pulley, parts = scene.pulleys[0], state.mesh.layout.parts
    if pulley.friction == 0.0:
        return None
    for index, part in enumerate(parts[1:-1], start=1):
        found = (_held if part == STICK else _slid)(scene, state, index, error)
        if found is not None:
            return found
    return None


def _held(scene: Scene, state: State, index: int, breach: float) -> Change | None:
    """Sliding next to the free ends of a stick zone."""
    parts = state.mesh.layout.parts
    sigma, p, f, _ = along(state, index)
    bound = scene.pulleys[0].friction * p
    excess = np.abs(f) - bound
    broken = excess > breach * np.max(bound)
    holds = sigma[excess <= 0.0]
    start, end = state.ends[index : index + 2]
    if not holds.size and parts[index + 1] != FREE:
        contact = [*(parts[1:index] or [_sliding(-f[0])]), *parts[index + 1 : -1]]
        if contact[index - 1 - (index > 1)] == parts[index + 1]:
            return None
        ends = np.delete(state.ends, index) if index > 1 else state.ends
        return Change("stick that breaks Coulomb's bound all along", ordered(scene, contact), ends)
    if broken[0] and parts[index - 1] == FREE:
        place = min(holds[0] if holds.size else end, start + FURTHEST * (end - start))
        contact = [_sliding(-f[0]), *parts[1:-1]]
        why = "zones that break Coulomb's bound at the run-up"
    elif broken[-1] and parts[index + 1] == FREE and scene.pulleys[0].x_trans == RUN_OFF:
        place = max(holds[-1] if holds.size else start, end - FURTHEST * (end - start))
        contact = [*parts[1:-1], _sliding(f[-1])]
        why = "zones that break Coulomb's bound at the run-off"
    else:
        return None
    return Change(why, ordered(scene, contact), np.sort(np.append(state.ends, place)))


def _sliding(sense: float) -> Part:
    return Part("slip", "forward" if sense > 0.0 else "backward")


def _slid(scene: Scene, state: State, index: int, breach: float) -> Change | None:
    """The other sense of sliding, from where the belt has the pulley's speed again."""
    parts = state.mesh.layout.parts
    if index <= state.mesh.layout.transition(0) or parts[index + 1] != FREE:
        return None
    sigma, _, _, D = along(state, index)
    ahead = parts[index].sense * (D - pulley_speed(scene, state))
    if ahead[-1] >= -breach * np.max(np.abs(ahead)):
        return None
    turned = replace(parts[index], slip=OTHER[parts[index].slip])
    right = np.flatnonzero(ahead > 0.0)
    if sigma[-1] - (sigma[right[-1]] if right.size else sigma[0]) < SHORTEST:
        return None
    if right.size and right[-1] > POINTS // 2:
        contact = [*parts[1 : index + 1], turned, *parts[index + 1 : -1]]
        ends = np.sort(np.append(state.ends, sigma[right[-1]]))
        return Change("zones in which sliding turns", ordered(scene, contact), ends)
    if scene.pulleys[0].drive == "x_trans":
        return None
    return Change(
        "zones that slide in the other sense",
        ordered(scene, [*parts[1:index], turned, *parts[index + 1 : -1]]),
        state.ends,
    )


def transition(scene: Scene, stick: State, sense: float, ahead: float) -> float | None:
    """About where stick ends by a given speed or moment, from pure stick.

    What friction in sliding exceeds that in stick by, stretches the belt behind it as it would stretch a string, and
    the belt's length makes the stretch elsewhere less.

    Args:
        scene: The dimensionless scene.
        stick: The belt in pure stick.
        sense: +1 for forward, -1 for backward sliding.
        ahead: By how much the given stretch, or resultant of friction, exceeds that in pure stick.

    Returns:
        The place; None where sliding all along is not enough.
    """
    zone = range(1, len(stick.mesh.layout.parts) - 1)
    sigma, p, f, _ = (np.concatenate(columns) for columns in zip(*(along(stick, i) for i in zone), strict=True))
    more = f + sense * scene.pulleys[0].friction * p
    steps = np.diff(sigma) * (more[1:] + more[:-1]) / 2
    if scene.pulleys[0].drive == "omega":
        # The belt behind is longer by its stretch, which the whole belt makes good.
        steps *= 0.5 - (sigma[1:] + sigma[:-1]) / (2 * scene.belt.length)
    reach = np.maximum.accumulate(np.append(0.0, -np.sign(ahead) * np.cumsum(steps[::-1])))
    return float(np.interp(abs(ahead), reach, sigma[::-1])) if abs(ahead) < reach[-1] else None
