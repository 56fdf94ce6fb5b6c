"""First states of the fitted method: a ladder of ways, each for scenes in which those before it fail, and the first
guesses that they begin with, strings and other solutions.

The state is a coarse one of the lowest degree:

1. From the taut string. It knows where a belt touches that is short of bending stiffness, or of clamps near by.
2. From the string by a first step that bends the belt and leaves the joints where they are.
3. By way of a belt that bends more easily and so is more like a string.
4. From pure stick, with the transition where the scene wants it.

With several pulleys or loads, it starts from the exact string of the drive, at a higher degree, with layers of bending
where the belt touches with its surface, and then by way of belts that bend more easily.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from belt_fenicsx.fitted.dofs import local
from belt_fenicsx.fitted.elements import points
from belt_fenicsx.fitted.reading import lifts_off
from belt_fenicsx.fitted.state import State
from belt_fenicsx.fitted.transfer import Driven, blank, drive, from_fields, placed
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layers import LEAST_STRAIN
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered, posed
from belt_fenicsx.scene.belt import StiffnessBelt
from belt_fenicsx.scene.pulley import RUN_OFF
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.search.divided import divide_stick
from belt_fenicsx.search.drives import solve_driven
from belt_fenicsx.search.find import layout_of, limit
from belt_fenicsx.search.limits import leaves_transition
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.bent import bent, settled
from belt_fenicsx.taut_string.drive import string_drive
from belt_fenicsx.taut_string.pressed import pressed
from belt_fenicsx.taut_string.shape import StringDrive

if TYPE_CHECKING:
    from belt_fenicsx.fitted.run import Run

METHOD = "fitted"
LOWEST = 4  # The degree of a first guess over one pulley.
FIRST = 6  # The degree of a first guess from the string of a drive; a lower one has too many roots with many pulleys.
FINE = 8  # The degree with which a state is compared with a limit.
# Degrees that a given solution starts with, one after another, and one by another method. Where friction is little, or
# parts are short, a low degree knows it too coarsely to place a joint by it.
WARM, RESCUE = (6, 8), (8, 12)
MOVED = 0.1  # From an answer to the same scene, the length of no part changes by more than this part of it.
NEARLY = 0.95  # This part of the contact slides, at most, in a first guess from pure stick.
SOFTER = 1 / 20  # The bending stiffness of a belt that is more like a string, over the belt's.
LEAST = 0.02  # A part on a pulley takes at least this part of the contact in a first guess.
LEAST_GROWTH = 1.1  # No smaller step leads from a softer belt to a stiffer one.

Start = Callable[["Run"], State]


def from_string(run: Run, *, fixed_joints: bool = False) -> State:
    """From the string; by a first step that bends the belt, where the joints are fixed in it."""
    string = pressed(run.scene, string_drive(run.scene, slack=True))
    guess = drive_guess(run.scene, string, LOWEST, run.elements)
    run.stages.ran("taut string", "first guess")
    return run.newton(guess, "the taut string", fixed_joints=fixed_joints or string.pressed)


def from_drive(run: Run, degree: int) -> State:
    """From the exact string of a drive."""
    guess = drive_guess(run.scene, settled(run.scene, string_drive(run.scene)), degree, run.elements)
    run.stages.ran("string", "first guess")
    return run.converge(guess, "string", "the rows of the string")


def from_bent_drive(run: Run) -> State:
    """From the string with the layers of a belt that touches with its surface, or only turns.

    Of a loop that only turns, the string itself is no guess: where two spans are parallel, nothing in it says where the
    belt leaves the pulley between them, and the equations are singular.

    Raises:
        Stopped: There are none in the string.
    """
    string = bent(run.scene, string_drive(run.scene))
    if not string.bends:
        raise Stopped(Status.NEWTON_DIVERGED, "The touching fibre is the middle line.")
    guess = drive_guess(run.scene, string, FIRST, run.elements)
    run.stages.ran("string", "first guess, with layers")
    return run.converge(guess, "string", "the rows of the string with layers")


def from_softer_drive(run: Run) -> State:
    """By way of belts that bend more easily and so are more like a string; each step as long as it can be."""
    belt, factor, growth = run.scene.belt, SOFTER, 1.0 / SOFTER
    assert isinstance(belt, StiffnessBelt), "the scene is dimensionless"

    def softer(factor: float) -> Run:
        return replace(
            run, scene=run.scene.altered(belt=replace(belt, bending_stiffness=factor * belt.bending_stiffness))
        )

    state = from_drive(softer(factor), FINE)
    while factor < 1.0:
        stiffer = min(factor * growth, 1.0)
        way = softer(stiffer)
        try:
            found = way.newton(
                way.transfer(state, state.layout, state.ends), f"a belt of {factor:.3g} of the stiffness"
            )
        except Stopped:
            found = state
        if found is not state and not lifts_off(found):
            state, factor = found, stiffer
        elif (growth := math.sqrt(growth)) < LEAST_GROWTH:
            raise Stopped(Status.NEWTON_DIVERGED, f"From a belt of {factor:.3g} of the stiffness no step leads on.")
    return state


def from_softer(run: Run) -> State:
    """By way of a belt that bends more easily and so is more like a string."""
    belt = run.scene.belt
    assert isinstance(belt, StiffnessBelt), "the scene is dimensionless"
    softer = replace(belt, bending_stiffness=SOFTER * belt.bending_stiffness)
    state = from_string(replace(run, scene=replace(run.scene, belt=softer)), fixed_joints=True)
    return run.newton(run.transfer(state, state.layout, state.ends), "a belt that bends more easily")


def from_stick(run: Run, stick: State | None = None) -> State:
    """From pure stick, with the transition where the scene wants it.

    Raises:
        Stopped: Nothing sticks there.
    """
    stick = stick or limit(run, RUN_OFF, "forward")
    start = divide_stick(run.scene, stick.layout, run.samples(stick), 1.0 - NEARLY)
    if start is None:
        raise Stopped(Status.NEWTON_DIVERGED, "Nothing sticks where stick is to end.")
    return run.newton(run.transfer(stick, *start), "pure stick")


def from_solution(run: Run, initial: Solution, degree: int) -> State:
    """From a given solution, whatever its method, with elements of this degree."""
    layout = layout_of(run.scene, initial)
    if layout is None:
        run.stages.skipped("warm start", "the given solution has other zones")
        raise Stopped(Status.NEWTON_DIVERGED, "The given solution has other zones.")
    run.stages.skipped("taut string", "a solution was given to start from")
    guess = solution_guess(run.scene, initial, layout, degree, run.elements)
    state = run.newton(guess, "the given solution")
    grown = np.abs(np.diff(state.ends) / np.diff(guess.ends) - 1.0)
    if initial.scene == run.asked and grown.max() > MOVED:
        raise Stopped(Status.NEWTON_DIVERGED, f"Degree {degree} is too low for the parts of the given solution.")
    return state


DRIVE: tuple[Start, ...] = (from_bent_drive, functools.partial(from_drive, degree=FIRST), from_softer_drive)
STRING: tuple[Start, ...] = (from_string, functools.partial(from_string, fixed_joints=True), from_softer)


def ways(run: Run, initial: Solution | None) -> list[Start]:
    """Ways to a coarse state, of which each is for scenes in which those before it fail."""
    warm: list[Start] = []
    if initial is not None:
        degrees = WARM if initial.method == METHOD else RESCUE
        warm += [functools.partial(from_solution, initial=initial, degree=degree) for degree in degrees]
    if not run.scene.is_published or leaves_transition(run.scene):
        return [*warm, solve_driven]
    return [*warm, *STRING, *([from_stick] if posed(run.scene).slides_behind(0) else [])]


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
