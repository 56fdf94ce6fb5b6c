"""What a drive asks for, beside what a state gives: is it met, and can it be?"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered, slips_through
from belt_fenicsx.layout.revision import Samples
from belt_fenicsx.scene.pulley import Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.search.protocol import Method, S
from belt_fenicsx.solution.certificate import DRIVE, ROUNDING, UNKNOWN, transmissible
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.drive import at_capacity

RATES, STEADY = 8, 1e-9  # Rates that are tried at a limit, at most; a change that ends it.


def driven_by(scene: Scene, x_trans: float | Literal["run-up", "run-off"], slip: Slip) -> Scene:
    """The scene with a pulley that is driven by ``x_trans``."""
    return replace(scene, pulleys=(scene.pulleys[0].driven(x_trans=x_trans, slip=slip),))


def ahead(scene: Scene, samples: Samples, index: int = 0) -> float:
    """By how much the given stretch, or resultant of friction, on a pulley exceeds that of a state."""
    pulley, of_state = scene.pulleys[index], samples.pulleys[index]
    if pulley.omega is not None:
        return pulley.radius * pulley.omega / samples.rate - of_state.speed
    torque = (pulley.torque or 0.0) + pulley.drag * samples.rate * of_state.speed / pulley.radius
    return -torque / pulley.radius - of_state.friction


def missed(scene: Scene, samples: Samples, index: int = 0) -> float:
    """By how much a state misses a given speed or torque, as `ahead`, less what the certificate allows."""
    of_state = samples.pulleys[index]
    most = transmissible(scene.pulleys[index].friction, of_state.pressure)
    return abs(ahead(scene, samples, index)) - (DRIVE * most + min(of_state.doubt, UNKNOWN * most) + ROUNDING)


def unmet(method: Method[S], state: S) -> list[int]:
    """Pulleys without a transition that their drive could place, whose speed or torque is not met."""
    scene, layout = method.scene, state.layout
    free = [
        index
        for index, pulley in enumerate(scene.pulleys)
        if pulley.drive.kind in ("omega", "torque") and pulley.friction > 0.0 and not layout.slides_behind(index)
    ]
    return [index for index in free if missed(scene, method.samples(state), index) > 0.0] if free else []


def slides_as_driven(method: Method[S], state: S, index: int) -> bool:
    """Whether the belt slides all along a pulley, in the sense that a given speed or torque asks for."""
    on = [state.layout.parts[i] for i in state.layout.on(index)]
    exceeds = ahead(method.scene, method.samples(state), index)
    return len(on) == 1 and on[0].kind == "slip" and on[0].sense * exceeds <= 0.0


def meets(method: Method[S], state: S) -> bool:
    """Whether a state meets the drives, even if its layout has no transition that they could place.

    Raises:
        Stopped: A torque is beyond what sliding all along transmits.
    """
    for index in unmet(method, state):
        if not slides_as_driven(method, state, index):
            return False
        pulley = method.scene.pulleys[index]
        if pulley.torque is not None:
            check_capacity(method, state, index)
            return False
    return True


def check_capacity(method: Method[S], slip: S, index: int) -> None:
    """Checks that a torque is not beyond what sliding all along its pulley transmits, which has to be admissible
    itself.

    Raises:
        Stopped: It is.
    """
    scene, on = method.scene, slip.layout.on(index)
    slip = method.sharpen(slip, "capacity")
    samples, part = method.samples(slip), slip.layout.parts[on[0]]
    exceeds = ahead(scene, samples, index)
    if method.is_plausible(slip) and part.sense * exceeds < 0.0 and missed(scene, samples, index) > 0.0:
        radius, capacity = scene.pulleys[index].radius, -samples.pulleys[index].friction
        unit = method.units.of(length=1, force=1)
        on_pulley = "" if len(scene.pulleys) == 1 else f" pulley {index}"
        raise Stopped(
            Status.CAPACITY_EXCEEDED,
            f"Sliding all along{on_pulley}, the belt transmits {radius * capacity * unit:.6g} N m, which the given "
            f"torque exceeds by {-100.0 * exceeds / capacity:.3g} %.",
            final=True,
        )


def limit_state(method: Method[S], index: int, sense: Slip, near: tuple[S, Layout, Array] | None = None) -> S:
    """The drive at its limit: sliding all along a pulley, and the torque that `at_capacity` names left open.

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
    radii, resultants = [p.radius for p in limit.pulleys], solve.samples(state).pulleys
    transmitted, given = -radii[load] * resultants[load].friction, method.scene.pulleys[load].torque or 0.0
    if given / transmitted > 1.0:
        unit, own = method.units.of(length=1, force=1), -radii[index] * resultants[index].friction
        there = "" if index == load else f", and {own * unit:.6g} N m to pulley {index}"
        raise Stopped(
            Status.CAPACITY_EXCEEDED,
            f"Sliding all along pulley {index}, the belt transmits {transmitted * unit:.6g} N m to pulley {load}{there}"
            f"; the torque given to pulley {load} exceeds that by {100.0 * (given / transmitted - 1.0):.3g} %.",
            final=True,
        )
    return state


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


def check_smooth(scene: Scene) -> None:
    """Checks that no torque is asked of a pulley without friction.

    Raises:
        Stopped: One is.
    """
    if any(pulley.friction == 0.0 and pulley.torque for pulley in scene.pulleys):
        raise Stopped(Status.CAPACITY_EXCEEDED, "Without friction, the belt transmits 0 N m.")
