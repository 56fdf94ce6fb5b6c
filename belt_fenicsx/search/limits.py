"""What a drive asks for, beside what a state gives: is it met, and can it be?"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from belt_fenicsx.layout.revision import Samples
from belt_fenicsx.scene.pulley import Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.search.protocol import Method, S
from belt_fenicsx.solution.certificate import DRIVE, ROUNDING, UNKNOWN, transmissible
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status


def driven_by(scene: Scene, x_trans: float | Literal["run-up", "run-off"], slip: Slip) -> Scene:
    """The scene with pulleys that are driven by ``x_trans``."""
    return replace(scene, pulleys=tuple(pulley.driven(x_trans=x_trans, slip=slip) for pulley in scene.pulleys))


def leaves_transition(scene: Scene) -> bool:
    """Whether a place of the transition is left to a speed or a torque."""
    return any(pulley.friction > 0.0 and not pulley.drive.is_place for pulley in scene.pulleys)


def ahead(scene: Scene, samples: Samples, index: int = 0) -> float:
    """By how much the given stretch, or resultant of friction, on a pulley exceeds that of a state."""
    pulley, of_state = scene.pulleys[index], samples.pulleys[index]
    if samples.closing is not None and samples.closing[0] == index:
        # Its speed gives the rate: what is asked of its friction is that the loop is in balance where it begins.
        return samples.closing[1]
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
    """Pulleys without a transition that their drive could place, whose speed or torque is not met.

    That which closes a loop comes last: what it lacks is what all others take.
    """
    scene, layout = method.scene, state.layout
    free = [
        index
        for index, pulley in enumerate(scene.pulleys)
        if (pulley.drive.kind in ("omega", "torque") or index == layout.closes)
        and pulley.friction > 0.0
        and not layout.slides_behind(index)
    ]
    free.sort(key=lambda index: index == layout.closes)
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


def check_smooth(scene: Scene) -> None:
    """Checks that no torque is asked of a pulley without friction.

    Raises:
        Stopped: One is.
    """
    if any(pulley.friction == 0.0 and pulley.torque for pulley in scene.pulleys):
        raise Stopped(Status.CAPACITY_EXCEEDED, "Without friction, the belt transmits 0 N m.")
