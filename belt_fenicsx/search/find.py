"""The search for an answer: Newton's iteration, a judgement, a revision of the rows, until nothing changes.

1. Settle the rows: revise the layout until no bound breaks. A scene that wants stick to end where it cannot is
   refused, by comparison with the belt that sticks, or slides, all along, whose own rows are settled in the same way.
2. Refine the state; where nothing finer is wanted, it is the answer. Then go on with 1.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from typing import Literal

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import Part
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered, posed, slips_through
from belt_fenicsx.layout.revision import Samples, revise
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.pulley import RUN_OFF, RUN_UP, Pulley, Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.search.limits import driven_by, meets
from belt_fenicsx.search.protocol import Method, S
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.capacity import at_capacity

RATES, STEADY = 8, 1e-9  # Rates that are tried at a limit, at most; a change that ends it.
MOST_LAYOUTS = 8  # That many layouts for each pulley are tried one after another, at most.
SURE = 1e-6  # The place of a limit is known to about this part of the interval between both limits.
STRETCH = 1e-8  # A state that is compared with a limit knows a stretch to about this.
ANGLE = 1e-4  # A slip angle at a limit is known to about this part of itself.
NEAR = 1e-3  # A state shows a transition to be impossible in this part of the interval next to its ends, and beyond.


def find(method: Method[S], state: S) -> S:
    """The answer from a coarse state. Where revised rows lead nowhere, a finer state is judged anew."""
    while (finer := method.refine(state)) is not None:
        settled = attempt(functools.partial(settle, method, finer))
        state = settled if settled is not None and (settled is finer or method.is_plausible(settled)) else finer
    return state


def attempt(way: Callable[[], S]) -> S | None:
    """What a way leads to; None where Newton's iteration does not converge on it."""
    try:
        return way()
    except Stopped as stopped:
        if stopped.final or stopped.status is not Status.NEWTON_DIVERGED:
            raise
        return None


def settle_from(method: Method[S], start: S, stage: str, why: str) -> S | None:
    """A state with a mechanical sense on settled rows, from a first guess; None where that does not lead to one."""
    state = attempt(lambda: method.converge(start, stage, why))
    if state is None or not method.is_plausible(state):
        return None
    settled = attempt(functools.partial(settle, method, state))
    return settled if settled is state or (settled is not None and method.is_plausible(settled)) else None


def answers(method: Method[S], state: S) -> bool:
    """Whether a state has a mechanical sense, meets the drive and breaks no bound that it is trusted to judge."""
    if not method.is_plausible(state) or not meets(method, state):
        return False
    tolerances = method.tolerances(state)
    return tolerances is None or not revise(method.scene, state.layout, method.samples(state), tolerances)


def settle(method: Method[S], state: S) -> S:
    """Revises the layout of a state until no bound breaks; ends where a layout comes back.

    Raises:
        SceneError: The scene wants stick to end where it cannot.
        Stopped: A layout leads nowhere, or the contact is lost.
    """
    tolerances, tried = method.tolerances(state), [state.layout]
    if tolerances is None:
        return state
    while revision := revise(method.scene, state.layout, method.samples(state), tolerances):
        if revision.layout is None or revision.ends is None:
            if method.scene.is_published:
                check_transition(method, outside=True)
            return state
        if len(revision.layout.pulleys) < len(method.scene.pulleys):
            lost = min({*range(len(method.scene.pulleys))} - {*revision.layout.pulleys})
            on_pulley = "" if len(method.scene.pulleys) == 1 else f" with pulley {lost}"
            raise Stopped(Status.CONTACT_LOST, f"The contact{on_pulley} shrinks to a point.")
        if revision.layout in tried or len(tried) == MOST_LAYOUTS * len(method.scene.pulleys):
            return state
        if (slipping := slips_through(method.scene, revision.layout)) is not None:
            sense = revision.layout.parts[revision.layout.on(slipping)[0]].slip
            limit_state(method, slipping, sense or "forward", (state, revision.layout, revision.ends))
            raise Stopped(Status.NEWTON_DIVERGED, f"The belt slides all along pulley {slipping} short of its capacity.")
        tried.append(revision.layout)
        why = f"{revision.why}; now {revision.layout}"
        state = method.converge(method.transfer(state, revision.layout, revision.ends), "zone order", why)
    method.stages.skipped("zone order", "no bound is broken")
    return state


def limit_state(method: Method[S], index: int, sense: Slip, near: tuple[S, Layout, Array] | None = None) -> S:
    """The drive at its limit: sliding all along a pulley, and what `at_capacity` names left open.

    Args:
        method: The solve.
        index: The pulley.
        sense: Sense of sliding on it.
        near: A state, the layout with sliding all along the pulley and about its ends; by default it starts from the
            string.

    Returns:
        The state, if the drive asks for less.

    Raises:
        Stopped: The drive is beyond its capacity, or there is no such state.
    """
    limit, load = at_capacity(method.scene, index, sense)
    solve = method.at(limit)
    if near is not None and load != index and not near[1].slides_behind(load):
        raise Stopped(Status.NEWTON_DIVERGED, f"Pulley {index} slides all along, though no torque asks for it.")
    if near is None:
        state = solve.start()
    else:
        state, layout, ends = near
        rows = ordered(limit, [part for part in layout.parts if part.touches])
        if slips_through(limit, rows) is not None:
            raise Stopped(
                Status.CAPACITY_EXCEEDED,
                "The given speeds are so far apart that the belt slides all along every pulley that has one: nothing "
                "says how fast it runs. Let a torque drive one of them.",
                final=True,
            )
        state = solve.converge(solve.transfer(state, rows, ends), "capacity", f"now {rows}")
    solve, state = _at_its_rate(method, solve, state, index)
    method.stages.ran("capacity", f"sliding all along pulley {index}", solve.stages.iterations)
    if not solve.is_plausible(state):
        raise Stopped(Status.NEWTON_DIVERGED, f"No state was found that slides all along pulley {index}.")
    pulley = method.scene.pulleys[load]
    reach = _slip_angle if pulley.drive.kind == "slip_angle" else _torque
    if (pulley.slip_angle or pulley.torque or 0.0) / reach(solve, state, load) > 1.0:
        state = _well_known(solve, state)
        _check_load(solve, state, index, load, pulley)
    return state


def _check_load(method: Method[S], state: S, index: int, load: int, given: Pulley) -> None:
    """Checks that what a pulley is given is not beyond what it has where the belt slides all along another one.

    Raises:
        Stopped: It is.
    """
    if given.slip_angle is not None:
        reached, asked, known = _slip_angle(method, state, load), given.slip_angle, ANGLE
        what, has = "slip angle", f"the slip angle of pulley {load} is {reached:.6g} rad"
    else:
        reached, asked, known = _torque(method, state, load), given.torque or 0.0, 0.0
        unit = method.units.of(length=1, force=1)
        there = "" if index == load else f", and {_torque(method, state, index) * unit:.6g} N m to pulley {index}"
        what, has = "torque", f"the belt transmits {reached * unit:.6g} N m to pulley {load}{there}"
    if asked / reached > 1.0 + known:
        raise Stopped(
            Status.CAPACITY_EXCEEDED,
            f"Sliding all along pulley {index}, {has}; the {what} given to pulley {load} exceeds that by "
            f"{100.0 * (asked / reached - 1.0):.3g} %.",
            final=True,
        )


def _slip_angle(method: Method[S], state: S, index: int) -> float:
    """Angle of a pulley along which the belt slides before its run-off, R angle = int D dsigma."""
    layout, samples = state.layout, method.samples(state).densest
    on = layout.on(index)
    sliding = itertools.takewhile(lambda i: layout.parts[i].kind != "stick", reversed(on))
    parts = [part for i in sliding if (part := samples.parts[i]) is not None]
    angles = [float(np.diff(part.sigma) @ (part.D[1:] + part.D[:-1])) / 2.0 for part in parts]
    return sum(angles) / method.scene.pulleys[index].radius


def _at_its_rate(method: Method[S], solve: Method[S], state: S, index: int) -> tuple[Method[S], S]:
    """A state that slides all along the pulley that gives the speed, at the rate at which it just sticks at the run-up.

    The rate of `at_capacity` is the string's; forces depend on it by inertia alone, so that the iteration is short.
    """
    drive, scene = method.scene.pulleys[index].drive, solve.scene
    if drive.kind != "omega" or method.scene.transport_rate is not None or not scene.has_inertia:
        return solve, state
    for _ in range(RATES):
        first = solve.samples(state).parts[state.layout.on(index)[0]]
        assert first is not None, "a part on a pulley"
        rate = method.scene.pulleys[index].surface_speed / float(first.D[0])
        if abs(rate / (solve.scene.transport_rate or rate) - 1.0) <= STEADY:
            break
        solve = solve.at(solve.scene.altered(transport_rate=rate))
        start = solve.transfer(state, state.layout, solve.samples(state).ends)
        state = solve.converge(start, "capacity", "the rate of a belt that just sticks")
    return solve, state


def _torque(method: Method[S], state: S, index: int) -> float:
    """Moment of the belt on a pulley in a state."""
    return -method.scene.pulleys[index].radius * method.samples(state).pulleys[index].friction


def _well_known(method: Method[S], state: S) -> S:
    """A state at a limit, sharp and on settled rows, before a torque is refused by it; as it is where that fails."""
    try:
        sharp = settle(method, method.sharpen(state, "capacity"))
    except Stopped:
        return state
    return sharp if method.is_plausible(sharp) else state


def limit(
    method: Method[S], x_trans: Literal["run-up", "run-off"], slip: Slip, near: S | None = None, *, sharp: bool = False
) -> S:
    """The belt that sticks, or slides, all along the contact.

    Args:
        method: The solve that it is compared with.
        x_trans: ``"run-off"`` or ``"run-up"``.
        slip: Sense of the sliding.
        near: Pure stick, from which pure slip may start.
        sharp: Whether it has to be known well.

    Raises:
        Stopped: There is none.
    """
    pure = method.at(driven_by(method.scene, x_trans, slip))
    state = pure.start(near)
    if sharp and method.is_plausible(state):
        state = settle(pure, pure.sharpen(state, "limits"))
    method.stages.ran("limits", f"{state.layout}, to compare with", pure.stages.iterations)
    return state


def check_transition(method: Method[S], *, outside: bool = False) -> S | None:
    """Checks that the transition lies where stick can end: between where it does in pure slip and in pure stick.

    Args:
        method: The solve, of a scene that is driven by ``x_trans``.
        outside: Whether its own state shows that it does not.

    Returns:
        Pure stick; None where there is none.

    Raises:
        SceneError: It does not.
        Stopped: There is no contact.
    """
    (pulley,) = method.scene.pulleys
    x_trans, slides = pulley.x_trans, pulley.slip
    if slides is None or not isinstance(x_trans, float) or pulley.friction == 0.0:
        return None
    stick = limit(method, RUN_OFF, slides, sharp=True)
    if not method.is_plausible(stick):
        return None
    try:
        slip = attempt(lambda: limit(method, RUN_UP, slides, stick, sharp=True))
    except Stopped as stopped:
        if stopped.status is Status.NEWTON_DIVERGED:
            raise
        # The belt that slides all along may be slack.
        slip = None
    if slip is None or not (_is_limit(method, stick, RUN_OFF, slides) and _is_limit(method, slip, RUN_UP, slides)):
        return stick
    places = sorted([earliest(method.samples(slip)), method.samples(stick).only.place])
    doubt = (-NEAR if outside else SURE) * (places[1] - places[0])
    if not places[0] - doubt < x_trans < places[1] + doubt and not _is_nearest_to_stick(method.samples(slip), x_trans):
        first, last = (place * method.units.length for place in places)
        between = f"lie where stick can end in the contact zone, in ({first:.9g}, {last:.9g}) [m]"
        raise SceneError("pulleys.0.x_trans", between, x_trans * method.units.length)
    return stick


def _is_nearest_to_stick(slip: Samples, x: float) -> bool:
    """Whether the belt that slides all along has, at a place, but for rounding the stretch nearest to that in stick."""
    (part,) = (part for part in slip.parts if part is not None)
    return bool(part.x[0] < x < part.x[-1] and np.interp(x, part.x, abs(part.D - slip.only.speed)) < STRETCH)


def _is_limit(method: Method[S], state: S, x_trans: Literal["run-up", "run-off"], slip: Slip) -> bool:
    """Whether a state is an answer for the belt that sticks, or slides, all along, so that a place is refused by it."""
    return answers(method.at(driven_by(method.scene, x_trans, slip)), state)


def earliest(slip: Samples) -> float:
    """Where the transition goes when sliding spreads over the contact, from samples of pure slip."""
    (part,) = (part for part in slip.parts if part is not None)
    nearest = slip.only.place
    # Next to the run-off, sliding turns: the transition does not get there.
    return nearest if nearest < (part.x[0] + part.x[-1]) / 2 else float(part.x[0])


def layout_of(scene: Scene, initial: Solution) -> Layout | None:
    """The layout of a given solution, to start from; None where the scene asks for another one.

    A scene that says where stick ends asks for what is behind it. A speed or a torque leaves the layout open; whether
    it is met is seen afterwards.
    """
    contact = [Part(zone.kind, zone.slip, zone.pulley) for zone in initial.zones if zone.pulley is not None]
    same = initial.scene.closed == scene.closed and {part.pulley for part in contact} == {*range(len(scene.pulleys))}
    if initial.fields is None or not same:
        return None
    layout = ordered(scene, contact)
    placed = [index for index, pulley in enumerate(scene.pulleys) if pulley.drive.kind == "x_trans"]
    return layout if all(_has_place(scene, initial, layout, index) for index in placed) else None


def _has_place(scene: Scene, initial: Solution, layout: Layout, index: int) -> bool:
    """Whether the layout of a given solution has on a pulley what the given place there asks for."""
    wanted = posed(scene)
    own, asked = ([rows.parts[i] for i in rows.on(index)] for rows in (layout, wanted))
    if wanted.slides_behind(index):
        return layout.slides_behind(index) and layout.parts[layout.transition(index) + 1] == asked[-1]
    longest = initial.scene.pulleys[index].x_trans == RUN_OFF or not layout.slides_behind(index)
    return own == asked or (scene.pulleys[index].x_trans == RUN_OFF and layout.sticks(index) and longest)
