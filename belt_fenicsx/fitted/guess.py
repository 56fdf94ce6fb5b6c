"""First guesses of the fitted method: the taut string, bent where a clamp presses the belt onto the pulley."""

from __future__ import annotations

import math

import numpy as np

from belt_fenicsx.fitted.state import Driven, State, from_fields, from_string
from belt_fenicsx.layout.layers import bending_layer
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import posed
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.string import TautString, taut_string

LOWEST = 4  # The degree of a first guess from the string.
PRESSED = 2.0  # A clamp presses the belt onto the pulley where the free span is shorter than this in bending layers.


def string_guess(scene: Scene, elements: int | None) -> tuple[State, bool]:
    """The taut string as a first guess, and whether a clamp presses the belt onto the pulley.

    Raises:
        Stopped: The string is clear of the pulley, or slack.
    """
    string = taut_string(scene)
    if string is None:
        raise Stopped(Status.CONTACT_LOST, "The straight belt is clear of the pulley.")
    if string.slack:
        raise Stopped(Status.CONTACT_LOST, string.slack)
    pressed = _pressed(scene, string)
    if pressed is not None:
        string = taut_string(scene, pressed) or string
    return from_string(scene, string, posed(scene), LOWEST, elements), pressed is not None


def _pressed(scene: Scene, string: TautString) -> tuple[float, float] | None:
    """Angles at which contact begins and ends, where a clamp next to the pulley presses the belt onto it.

    Within its bending layer, the belt comes from the clamp to the pulley as a cubic parabola, whatever its tension: it
    goes down by the clamp's distance from the pulley, and turns by the angle from the clamp's direction to the tangent.
    """
    (pulley,), layer = scene.pulleys, bending_layer(scene, float(np.mean(string.strain)))
    angles = [float(string.angles[0]), float(string.angles[-1])]
    pressed = False
    for end, sign in enumerate((1.0, -1.0)):
        across = scene.span / 2 + sign * pulley.center[0]
        turn = math.atan2(across, -pulley.center[1])
        length = 3.0 * (math.hypot(across, pulley.center[1]) - pulley.radius) / turn
        if length < PRESSED * layer:
            angles[end], pressed = sign * (turn - length / pulley.radius), True
    return (angles[0], angles[1]) if pressed else None


def solution_guess(scene: Scene, initial: Solution, layout: Layout, degree: int, elements: int | None) -> State:
    """A given solution by any method on a layout, as a first guess."""
    if isinstance(initial.state, State):
        return from_fields(scene, initial.state, layout, initial.state.ends, degree, elements)
    assert initial.fields is not None, "a solution with zones has fields"
    units = initial.scene.dimensionless()[1].inverse()
    ends = np.array([zone.sigma[0] for zone in initial.zones] + [initial.zones[-1].sigma[1]]) * units.length
    speeds = [contact.omega * initial.scene.pulleys[contact.pulley].radius for contact in initial.contacts]
    driven = Driven(
        elongations=np.array(speeds) / initial.transport_rate - 1.0,
        rate=initial.transport_rate * units.rate,
        moves=np.array([contact.take_up for contact in initial.contacts]) * units.length,
    )
    return from_fields(scene, initial.fields.in_units(units), layout, ends, degree, elements, driven)
