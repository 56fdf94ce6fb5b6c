"""First states of a solve by the fitted method: a ladder of ways, each for scenes in which those before it fail.

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

from belt_fenicsx.fitted.guess import LOWEST, drive_guess, solution_guess
from belt_fenicsx.fitted.reading import lifts_off
from belt_fenicsx.fitted.state import State
from belt_fenicsx.layout.posed import posed
from belt_fenicsx.scene.belt import StiffnessBelt
from belt_fenicsx.scene.pulley import RUN_OFF
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

if TYPE_CHECKING:
    from belt_fenicsx.fitted.run import Run

METHOD = "fitted"
FIRST = 6  # The degree of a first guess from the string of a drive; a lower one has too many roots with many pulleys.
FINE = 8  # The degree with which a state is compared with a limit.
# Degrees that a given solution starts with, one after another, and one by another method. Where friction is little, or
# parts are short, a low degree knows it too coarsely to place a joint by it.
WARM, RESCUE = (6, 8), (8, 12)
MOVED = 0.1  # From an answer to the same scene, the length of no part changes by more than this part of it.
NEARLY = 0.95  # This part of the contact slides, at most, in a first guess from pure stick.
SOFTER = 1 / 20  # The bending stiffness of a belt that is more like a string, over the belt's.
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
