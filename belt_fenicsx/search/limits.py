"""What a drive asks for, beside what a state gives: is it met, and can it be?"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from belt_fenicsx.layout.revision import Samples
from belt_fenicsx.scene.pulley import Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.search.protocol import Method, S
from belt_fenicsx.solution.certificate import DRIVE, ROUNDING, transmissible
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status


def driven_by(scene: Scene, x_trans: float | Literal["run-up", "run-off"], slip: Slip) -> Scene:
    """The scene with a pulley that is driven by ``x_trans``."""
    pulley = replace(scene.pulleys[0], x_trans=x_trans, slip=slip, omega=None, torque=None)
    return replace(scene, pulleys=(pulley,))


def ahead(scene: Scene, samples: Samples) -> float:
    """By how much the given stretch, or resultant of friction, exceeds that of a state."""
    pulley, of_state = scene.pulleys[0], samples.pulleys[0]
    if pulley.omega is not None:
        return pulley.radius * pulley.omega - of_state.speed
    return -(pulley.torque or 0.0) / pulley.radius - of_state.friction


def missed(scene: Scene, samples: Samples) -> float:
    """By how much a state misses the given speed or torque, as `ahead`, less what the certificate allows."""
    allowed = DRIVE * transmissible(scene.pulleys[0].friction, samples.pulleys[0].pressure) + ROUNDING
    return abs(ahead(scene, samples)) - allowed


def meets(method: Method[S], state: S) -> bool:
    """Whether a state meets the drive, even if its layout has no transition that the drive could place.

    Raises:
        Stopped: The torque is beyond what sliding all along transmits.
    """
    scene, layout = method.scene, state.layout
    pulley = scene.pulleys[0]
    if pulley.drive.kind == "x_trans" or pulley.friction == 0.0 or layout.slides_behind(0):
        return True
    samples, (part, *others) = method.samples(state), layout.contact
    if missed(scene, samples) <= 0.0:
        return True
    if part.kind == "stick" or others or part.sense * ahead(scene, samples) > 0.0:
        return False
    if pulley.torque is not None:
        check_capacity(method, state, pulley.torque)
    return pulley.drive.kind == "omega"


def check_capacity(method: Method[S], slip: S, torque: float) -> None:
    """Checks that a torque is not beyond what sliding all along transmits, which has to be admissible itself.

    Raises:
        Stopped: It is.
    """
    scene, (part,) = method.scene, slip.layout.contact
    slip = method.sharpen(slip, "capacity")
    samples = method.samples(slip)
    if method.is_plausible(slip) and part.sense * ahead(scene, samples) < 0.0 and missed(scene, samples) > 0.0:
        capacity = -scene.pulleys[0].radius * samples.pulleys[0].friction
        excess = 100.0 * (torque / capacity - 1.0)
        raise Stopped(
            Status.CAPACITY_EXCEEDED,
            f"Sliding all along, the belt transmits {capacity * method.units.of(length=1, force=1):.6g} N m, which the "
            f"given torque exceeds by {excess:.3g} %.",
            final=True,
        )


def check_smooth(scene: Scene) -> None:
    """Checks that no torque is asked of a pulley without friction.

    Raises:
        Stopped: One is.
    """
    if any(pulley.friction == 0.0 and pulley.torque for pulley in scene.pulleys):
        raise Stopped(Status.CAPACITY_EXCEEDED, "Without friction, the belt transmits 0 N m.")
