"""First guesses of the fitted method: the exact string of a drive, and another solution."""

from __future__ import annotations

import numpy as np

from belt_fenicsx.fitted.dofs import local
from belt_fenicsx.fitted.elements import points
from belt_fenicsx.fitted.state import State
from belt_fenicsx.fitted.transfer import Driven, blank, drive, from_fields, placed
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layers import LEAST_STRAIN
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.taut_string.shape import StringDrive

LOWEST = 4  # The degree of a first guess over one pulley.
LEAST = 0.02  # A part on a pulley takes at least this part of the contact in a first guess.


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
    state = blank(scene, layout, ends, string.strain, degree, elements)
    radius = np.array([pulley.radius for pulley in scene.pulleys])
    elongations = np.zeros(radius.size)
    starts, widths = state.sigma[:, :1], state.length[:, None]
    nodes, gauss = points(degree)
    at_nodes, fractions = _in_parts((starts + widths * nodes) / scene.belt.length, true)
    x, y, theta, D = np.empty((4, *fractions.shape))
    for i, own in enumerate(string.parts):
        here = at_nodes == i
        x[here], y[here], theta[here], D[here] = own.at(fractions[here])
        if own.part.touches and (own.part.kind == "stick" or elongations[own.part.pulley] == 0.0):
            on = own.part.pulley
            # The touching fibre's stretch is as much smaller as its radius is.
            elongations[on] = own.stretches[0] * radius[on] / (radius[on] + scene.belt.contact_offset) - 1.0
    pressure, friction = np.zeros((2, len(state.cells), gauss.size))
    if string.bends:
        at_gauss, inside = _in_parts((starts + widths * gauss) / scene.belt.length, true)
        for i, own in enumerate(string.parts):
            here, there = at_nodes == i, at_gauss == i
            theta[here] += own.layers(fractions[here])[0]
            _, pressure[there], friction[there] = own.layers(inside[there])
    drive(state, Driven(elongations, string.rate, np.array(string.take_ups)))
    # At both ends of each cell.
    first, last = np.array([own.force for own in string.parts])[at_nodes[:, :2]].transpose(2, 0, 1)
    force = np.maximum(first + fractions[:, :2] * (last - first), LEAST_STRAIN * scene.belt.extensional_stiffness)
    _press(state, (force * D[:, :2]).sum(axis=1) / 2.0, pressure, friction)
    return placed(state, x + 1j * y, theta)


def _in_parts(places: Array, ends: Array) -> tuple[Array, Array]:
    """In which part places lie, and at which fraction of it."""
    part = ends[1:-1].searchsorted(places, side="right")
    return part, ((places - ends[part]) / (ends[1:] - ends[:-1])[part]).clip(0.0, 1.0)


def _apart(layout: Layout, ends: Array) -> Array:
    """Ends of parts, of which none takes less than a part `LEAST` of the contact that it is in."""
    ends = ends.copy()
    for pulley in layout.pulleys:
        on = layout.on(pulley)
        lengths = np.diff(ends[on[0] : on[-1] + 2])
        if lengths.min() >= LEAST * lengths.sum():
            continue
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
