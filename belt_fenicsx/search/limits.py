"""Limits of what a pulley can do: the belt that sticks, or slides, all along the contact."""

from __future__ import annotations

from dataclasses import replace

from belt_fenicsx.layout.revision import Samples
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.pulley import RUN_OFF, RUN_UP, Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.search.protocol import Method, S
from belt_fenicsx.solution.certificate import DRIVE, ROUNDING, transmissible
from belt_fenicsx.solution.solution import Status
from belt_fenicsx.solution.stages import Stopped

SURE = 1e-6  # The place of a limit is known to about this part of the interval between both limits.


def driven_by(scene: Scene, x_trans: float | str, slip: Slip) -> Scene:
    """The scene with a pulley that is driven by ``x_trans``."""
    pulley = replace(scene.pulleys[0], x_trans=x_trans, slip=slip, omega=None, torque=None)
    return replace(scene, pulleys=(pulley,))


def limit(method: Method[S], x_trans: str, slip: Slip, near: S | None = None) -> S:
    """The belt that sticks, or slides, all along; the latter also from the former.

    Raises:
        Stopped: There is none.
    """
    pure = method.at(driven_by(method.scene, x_trans, slip))
    state = pure.start(near)
    method.stages.ran("limits", f"{state.layout}, to compare with", pure.stages.iterations)
    return state


def check_transition(method: Method[S], *, outside: bool = False) -> S | None:
    """Checks that the transition lies where stick can end: between where it does in pure slip and in pure stick.

    Args:
        method: The solve, of a scene that is driven by ``x_trans``.
        outside: Whether it does not, as its own state shows.

    Returns:
        Pure stick; None where there is none.

    Raises:
        SceneError: It does not.
        Stopped: There is no contact.
    """
    pulley = method.scene.pulleys[0]
    if pulley.slip is None or not isinstance(pulley.x_trans, float):
        return None
    stick = limit(method, RUN_OFF, pulley.slip)
    if not method.is_plausible(stick):
        return None
    try:
        slip = limit(method, RUN_UP, pulley.slip, stick)
    except Stopped as stopped:
        if stopped.final and stopped.status is Status.NEWTON_DIVERGED:
            raise
        return stick
    if not method.is_plausible(slip):
        return stick
    stick, slip = (method.sharpen(state, "limits") for state in (stick, slip))
    places = sorted([earliest(method.samples(slip)), method.samples(stick).pulleys[0].place])
    doubt = 0.0 if outside else SURE * (places[1] - places[0])
    if outside or not places[0] - doubt < pulley.x_trans < places[1] + doubt:
        first, last = (place * method.units.length for place in places)
        between = f"lie where stick can end in the contact zone, in ({first:.9g}, {last:.9g}) [m]"
        raise SceneError("pulleys.0.x_trans", between, pulley.x_trans * method.units.length)
    return stick


def earliest(slip: Samples) -> float:
    """Where the transition goes when sliding spreads over the contact, from samples of pure slip."""
    (part,) = (part for part in slip.parts if part is not None)
    nearest = slip.pulleys[0].place
    # Next to the run-off, sliding turns: the transition does not get there.
    return nearest if nearest < (part.x[0] + part.x[-1]) / 2 else float(part.x[0])


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
    if pulley.drive == "x_trans" or pulley.friction == 0.0 or layout.slides_behind(0):
        return True
    samples, (part, *others) = method.samples(state), layout.contact
    if missed(scene, samples) <= 0.0:
        return True
    if part.kind == "stick" or others or part.sense * ahead(scene, samples) > 0.0:
        return False
    if pulley.drive == "torque":
        check_capacity(method, state)
    return pulley.drive == "omega"


def check_capacity(method: Method[S], slip: S) -> None:
    """Checks that a torque is not beyond what sliding all along transmits, which has to be admissible itself.

    Raises:
        Stopped: It is.
    """
    scene, (part,) = method.scene, slip.layout.contact
    slip = method.sharpen(slip, "capacity")
    samples = method.samples(slip)
    if method.is_plausible(slip) and part.sense * ahead(scene, samples) < 0.0 and missed(scene, samples) > 0.0:
        capacity = -scene.pulleys[0].radius * samples.pulleys[0].friction
        excess = 100.0 * (scene.pulleys[0].torque / capacity - 1.0)
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
