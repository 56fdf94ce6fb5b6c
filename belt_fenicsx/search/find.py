"""The search for an answer: Newton's iteration, a judgement, a revision of the rows, until nothing changes.

1. Settle the rows: revise the layout until no bound breaks.
2. Refine the state; where nothing finer is wanted, it is the answer. Then go on with 1.
"""

from __future__ import annotations

from belt_fenicsx.layout.kind import Part
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered, posed
from belt_fenicsx.scene.pulley import RUN_OFF
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.search.protocol import Method, S
from belt_fenicsx.search.settle import settle
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stopped


def find(method: Method[S], state: S) -> S:
    """The answer from a coarse state. Where revised rows lead nowhere, a finer state is judged anew."""
    while (finer := method.refine(state)) is not None:
        state = finer
        try:
            settled = settle(method, finer)
        except Stopped as stopped:
            if stopped.final:
                raise
        else:
            state = settled if method.is_plausible(settled) else finer
    return state


def layout_of(scene: Scene, initial: Solution) -> Layout | None:
    """The layout of a given solution, to start from; None where the scene asks for another one.

    A scene that says where stick ends asks for what is behind it. A speed or a torque leaves the layout open; whether
    it is met is seen afterwards.
    """
    contact = [Part(zone.kind, zone.slip) for zone in initial.zones[1:-1]]
    if initial.fields is None or not contact:
        return None
    layout, wanted, pulley = ordered(scene, contact), posed(scene), scene.pulleys[0]
    if pulley.drive != "x_trans":
        return layout
    if not wanted.slides_behind(0):
        sticks = any(part.kind == "stick" for part in contact)
        longest = initial.scene.pulleys[0].x_trans == RUN_OFF or not layout.slides_behind(0)
        return layout if layout == wanted or (pulley.x_trans == RUN_OFF and sticks and longest) else None
    if not layout.slides_behind(0):
        return None
    return layout if layout.parts[layout.transition(0) + 1] == wanted.contact[-1] else None
