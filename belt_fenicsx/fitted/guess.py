"""First guesses of the fitted method: the taut string, bent where a clamp presses the belt onto the pulley."""

from __future__ import annotations

import math

import numpy as np

from belt_fenicsx.fitted.dofs import local
from belt_fenicsx.fitted.elements import points
from belt_fenicsx.fitted.state import State
from belt_fenicsx.fitted.transfer import Driven, blank, drive, from_fields, placed
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layers import LEAST_STRAIN, bending_layer
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered, posed
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.shape import StringDrive
from belt_fenicsx.taut_string.string import TautString, taut_string

LOWEST = 4  # The degree of a first guess from the string.
LEAST = 0.02  # A part on a pulley takes at least this part of the contact in a first guess.
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


def from_string(scene: Scene, string: TautString, layout: Layout, degree: int, elements: int | None = None) -> State:
    """The taut string, with its pressure and its friction in sliding.

    Args:
        scene: The dimensionless scene.
        string: The string over its pulley.
        layout: The zones, of which the string has one or two in contact.
        degree: Degree k.
        elements: Number of cells; by default, as many as the layers call for.
    """
    half = scene.belt.length / 2
    joints = string.joints if len(layout.joints) == 3 else string.joints[[0, 2]]
    ends = np.array([-half, *joints, half])
    state = blank(scene, layout, ends, float(np.mean(string.strain)), degree, elements)
    nodes, sigma = points(degree)[0], state.sigma
    inside = (sigma[:, :1] + state.length[:, None] * nodes).ravel()
    n = len(sigma)
    drive(state, Driven(string.strain[:1], 1.0, np.zeros(1)))
    D = string.D((sigma[:, 0] + sigma[:, 1]) / 2)
    tension = scene.belt.extensional_stiffness * np.maximum(D - 1.0, string.strain.min())
    _press(state, tension * D)
    return placed(state, string.r(inside).view(complex).reshape(n, -1), string.phi(inside).reshape(n, -1))


def drive_guess(scene: Scene, string: StringDrive, degree: int, elements: int | None = None) -> State:
    """The exact string of a drive, with its parts, its layers, its pressure and its friction in sliding.

    Args:
        scene: The dimensionless scene.
        string: The string, which may have layers of a belt that bends.
        degree: Degree k.
        elements: Number of cells; by default, as many as the layers call for.
    """
    layout = ordered(scene, [own.part for own in string.parts if own.part.touches])
    lengths = np.array([own.length for own in string.parts])
    # Scaled, the last end is where the belt ends to the last bit.
    true = np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum() - 0.5
    ends = scene.belt.length * (true if string.bends else _apart(layout, true))
    strain = float(np.mean([own.stretches for own in string.parts])) - 1.0
    state = blank(scene, layout, ends, strain, degree, elements)
    nodes, gauss = (
        (state.sigma[:, :1] + state.length[:, None] * inside) / scene.belt.length for inside in points(degree)
    )
    radius = np.array([pulley.radius for pulley in scene.pulleys])
    elongations = np.zeros(radius.size)
    r, theta, along = np.empty(nodes.shape, dtype=complex), np.empty(nodes.shape), np.empty(nodes.shape)
    pressure, friction = np.zeros((2, *gauss.shape))
    for i, own in enumerate(string.parts):
        (here, fraction), (there, inside) = _in_part(nodes, true, i), _in_part(gauss, true, i)
        x, y, phi, D = own.at(fraction)
        r[here], theta[here] = x + 1j * y, phi + own.layers(fraction)[0]
        _, pressure[there], friction[there] = own.layers(inside)
        force = own.force[0] + fraction * (own.force[1] - own.force[0])
        along[here] = np.maximum(force, LEAST_STRAIN * scene.belt.extensional_stiffness) * D
        if own.part.touches and (own.part.kind == "stick" or elongations[own.part.pulley] == 0.0):
            on = own.part.pulley
            # The touching fibre's stretch is as much smaller as its radius is.
            elongations[on] = own.stretches[0] * radius[on] / (radius[on] + scene.belt.contact_offset) - 1.0
    drive(state, Driven(elongations, string.rate, np.array(string.take_ups)))
    _press(state, along[:, :2].mean(axis=1), pressure, friction)
    return placed(state, r, theta)


def _in_part(places: Array, ends: Array, part: int) -> tuple[Array, Array]:
    """Which places lie in a part, and at which fractions of it."""
    here = np.clip(np.searchsorted(ends, places, side="right") - 1, 0, ends.size - 2) == part
    return here, np.clip((places[here] - ends[part]) / (ends[part + 1] - ends[part]), 0.0, 1.0)


def _apart(layout: Layout, ends: Array) -> Array:
    """Ends of parts, of which none takes less than a part `LEAST` of the contact that it is in."""
    ends = ends.copy()
    for pulley in layout.pulleys:
        on = layout.on(pulley)
        lengths = np.diff(ends[on[0] : on[-1] + 2])
        grown = np.maximum(lengths, LEAST * lengths.sum())
        lengths = grown * (lengths.sum() / grown.sum())
        ends[on[0] + 1 : on[-1] + 1] = ends[on[0]] + np.cumsum(lengths)[:-1]
    return ends


def _press(state: State, tension: Array, pressure: Array | float = 0.0, friction: Array | float = 0.0) -> None:
    """Sets the pressure of a string of so much tension in each cell, and its friction where it slides.

    Args:
        state: The state.
        tension: The tension ``(n,)``.
        pressure: What layers add to the pressure at the Gauss points ``(n, k)``.
        friction: The friction there in stick.
    """
    at, (radius, mu, _), mesh = local(state.degree), state.pulleys, state.mesh
    p = np.where(mesh.touches, tension / (radius + state.scene.belt.contact_offset), 0.0)[:, None] + pressure
    state.values[:, at.p] = p
    state.values[:, at.f] = np.where(mesh.sticks[:, None], friction, -(mesh.senses * mu)[:, None] * p)
