"""A solve of the fitted method that is under way: what the search asks of this method.

Its own ladder to a coarse state of the lowest degree, each step for scenes in which those before it fail:

1. From the taut string. It knows where a belt touches that is short of bending stiffness, or of clamps near by.
2. From the string by a first step that bends the belt and leaves the joints where they are.
3. By way of a belt that bends more easily and so is more like a string.
4. From pure stick, with the transition where the scene wants it.

With several pulleys or loads, it starts from the exact string of the drive, at a higher degree, with layers of bending
where the belt touches with its surface, and then by way of belts that bend more easily. What the string has of sliding
in the wrong sense is turned round, and what shrinks to nothing left out.

Then the degree rises by two. Where states of both degrees have the same rows, their difference tells the error.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Container
from dataclasses import dataclass, field, replace

import numpy as np

from belt_fenicsx.fitted.accuracy import COARSEST, Accuracy, coarse, estimate
from belt_fenicsx.fitted.dofs import local
from belt_fenicsx.fitted.guess import LOWEST, drive_guess, solution_guess, string_guess
from belt_fenicsx.fitted.newton import Newton
from belt_fenicsx.fitted.reading import friction_suffices, samples
from belt_fenicsx.fitted.state import State
from belt_fenicsx.fitted.transfer import from_fields
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import Part
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered, posed
from belt_fenicsx.layout.revision import Samples, Tolerances
from belt_fenicsx.scene.belt import StiffnessBelt
from belt_fenicsx.scene.pulley import RUN_OFF
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.scene.units import Units
from belt_fenicsx.search.drives import divide_stick, solve_driven
from belt_fenicsx.search.find import attempt, layout_of, limit
from belt_fenicsx.search.limits import leaves_transition
from belt_fenicsx.search.several import solve_several
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stages, Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.bent import bent, settled
from belt_fenicsx.taut_string.drive import string_drive

METHOD = "fitted"
FIRST = 6  # The degree of a first guess from the string of a drive; a lower one has too many roots with many pulleys.
FINE = 8  # The degree with which a state is compared with a limit.
HIGHEST = 14  # The highest degree.
LAST = {1e-6: 6, 1e-8: 8, 1e-10: 10, 0.0: 12}  # The degree that mostly reaches an rtol, by the rtol.
ARRIVED = 2e-2  # The degree may rise after a largest step of a joint of this, in lengths of the shortest cell.
CLOSE = 3e-4  # After such a step, the error is that of the degree.
PLACED = 1e-8  # After such a step, a state is compared with a limit.
# One step from the degree before leaves an error of second order in what the degree changes in a layer. Where a cell is
# shorter than this, in belt lengths, it can be as large as what the degree leaves.
SHORT = 0.012
NEGATIVE = 0.1  # No error of a coarse state explains a negative pressure of this, relative to the largest one.
SHORTEST = 1e-4  # A contact that is no longer, in radii, is none.
BREACH = 1e-3  # A coarse state may break a bound by this by its error, relative to the largest value.
TOLERANCE = 1e-6  # The tolerance of the certificate; what low degrees leave of the inequalities is below a tenth of it.
FURTHEST = 0.8  # Newton's iteration finds a joint again that starts in this part of a stick part.
# Degrees that a given solution starts with, one after another, and one by another method. Where friction is little, or
# parts are short, a low degree knows it too coarsely to place a joint by it.
WARM, RESCUE = (6, 8), (8, 12)
MOVED = 0.1  # From an answer to the same scene, the length of no part changes by more than this part of it.
NEARLY = 0.95  # This part of the contact slides, at most, in a first guess from pure stick.
SOFTER = 1 / 20  # The bending stiffness of a belt that is more like a string, over the belt's.
LEAST_GROWTH = 1.1  # No smaller step leads from a softer belt to a stiffer one.
SHRUNK = 0.01  # Of a part that shrinks to nothing, an iteration leaves less than this part.
BUDGET = 300  # All starts together may take so many Newton iterations.

Start = Callable[["Run"], State]


class NotConverged(Stopped):
    """Newton's iteration did not converge; `state` is where it stands."""

    def __init__(self, message: str, state: State) -> None:
        self.state = state
        super().__init__(Status.NEWTON_DIVERGED, message)


@dataclass(frozen=True)
class Known:
    """What is known of a state.

    Attributes:
        accuracy: The state, and how far it is from the exact answer.
        final: Whether it is accurate enough.
        trust: How far it is trusted to judge its rows; None where it is not judged.
        judged: Whether it, or one before it, was judged that was not coarse.
    """

    accuracy: Accuracy
    final: bool
    trust: Tolerances | None
    judged: bool


@dataclass
class Run:
    """A solve that is under way.

    Attributes:
        asked: The scene, in its own units.
        scene: The dimensionless scene.
        units: The units of the latter.
        solver: The solver of Newton's iterations.
        elements: Number of cells; None for as many as the layers call for.
        rtol: Wanted relative accuracy of the angular velocity.
        degree: Degree of the answer; None where it rises until the error is small enough.
        stages: What was done so far.
        most: Newton iterations, counted from the first stage on, after which it ends.
        known: What is known of the last state since the search began from a coarse one; None before.
    """

    asked: Scene
    scene: Scene
    units: Units
    solver: Newton
    elements: int | None = None
    rtol: float = 1e-8
    degree: int | None = None
    stages: Stages = field(default_factory=Stages)
    most: int = BUDGET
    known: Known | None = None

    def at(self, scene: Scene) -> Run:
        """The same run for another scene, with what is left of its iterations."""
        left = self.most - self.stages.iterations
        return replace(self, scene=scene, stages=Stages(), most=left, known=None)

    def newton(self, state: State, why: str, *, arrived: float = ARRIVED, fixed_joints: bool = False) -> State:
        """Newton's iteration from a state, with elements of its degree; its first step may hold the joints.

        Raises:
            Stopped: It does not converge, or there were too many iterations already.
        """
        if self.stages.iterations >= self.most:
            tried = ", ".join(dict.fromkeys(stage.why for stage in self.stages if stage.iterations))
            message = (
                f"At degree {state.degree}, from {why}: {self.most} iterations are spent, tried were {tried}. "
                "Start from a solution nearby (`initial`)."
            )
            raise Stopped(Status.NEWTON_DIVERGED, message)
        result, iterations = self.solver.solve(self.scene, state, arrived, fixed_joints=fixed_joints)
        self.stages.ran(f"degree {state.degree}", why, abs(iterations))
        if iterations <= 0:
            raise NotConverged(f"At degree {state.degree}, after {-iterations} iterations from {why}.", result)
        return result

    def transfer(self, state: State, layout: Layout, ends: Array) -> State:
        """A state as a first guess on a layout whose parts have about these ends."""
        return from_fields(self.scene, state, layout, ends, state.degree, self.elements)

    def converge(self, start: State, stage: str, why: str) -> State:
        """Newton's iteration from a first guess; adds a stage.

        Where a part that slides shrinks to nothing, once more without it. The last one behind stick is turned round: on
        a pulley that is hardly loaded a first guess may have the wrong sense.
        """
        turned, arrived = set[int](), ARRIVED if self.scene.is_published else CLOSE
        while True:
            try:
                return self.newton(start, f"{stage}: {why}", arrived=arrived)
            except NotConverged as failed:
                last, others = shrunk_to_nothing(start, failed.state)
                turns = {i for i in last if start.layout.parts[i].pulley not in turned}
                if self.scene.is_published or not turns | others:
                    raise
            turned |= {start.layout.parts[i].pulley for i in turns}
            start = self.transfer(start, *revised(start, turns, others))

    def sharpen(self, state: State, why: str) -> State:
        """The same state known well enough to compare it with a limit."""
        return self.newton(
            state.of_degree(max(FINE, state.degree)), why, arrived=PLACED if self.scene.is_published else CLOSE
        )

    def is_plausible(self, state: State) -> bool:
        """Whether a state has a contact and, but for the lowest degree, the belt is pressed onto the pulley."""
        for index, pulley in enumerate(self.scene.pulleys):
            on = state.layout.on(index)
            if state.ends[on[-1] + 1] - state.ends[on[0]] < SHORTEST * pulley.radius:
                return False
        return state.degree == LOWEST or not lifts_off(state)

    def samples(self, state: State) -> Samples:
        """What a state says about its layout."""
        return samples(self.scene, state)

    def tolerances(self, state: State) -> Tolerances | None:
        """How far a state is trusted; None where it is not judged."""
        if self.known is not None:
            return self.known.trust if self.known.accuracy.state is state else None
        return None if state.degree < FINE else trusted(state, BREACH)

    def refine(self, state: State) -> State | None:
        """The state with elements of the next even degree; None where the error is small enough.

        Raises:
            Stopped: Newton's iteration does not converge, or the belt lifts off.
        """
        before, highest = self.known, self.degree or HIGHEST
        same = before if before is not None and before.accuracy.state is state else None
        if before is not None and (state.degree >= highest or (same is not None and same.final)):
            return None
        last = self.degree or next(last for reach, last in LAST.items() if self.rtol >= reach)
        start = state.of_degree(min(state.degree + 2, highest))
        finer = self.newton(start, "the degree before", arrived=CLOSE if start.degree >= last else ARRIVED)
        if before is not None and finer.length.min() < SHORT:
            finer = self.newton(finer, "short cells, in which one step is not enough", arrived=CLOSE)
        if lifts_off(finer):
            raise Stopped(Status.NOT_ADMISSIBLE, lift_off_message(self, finer))
        at_last, change_before = finer.degree >= highest, 0.0 if same is None else same.accuracy.change_of_p
        if finer.degree < last:
            accuracy = coarse(start, finer)
        else:
            accuracy = estimate(self.scene, state, start, finer, change_before, self.rtol, last=at_last)
        self.known = self._judged(accuracy, last, before)
        return finer

    def _judged(self, accuracy: Accuracy, last: int, before: Known | None) -> Known:
        """Says whether a state is final, and how far it is trusted.

        Its rows are judged at first, once it is no longer coarse, and at last; not where friction plainly holds in a
        state of a low degree.
        """
        state, unsettled = accuracy.state, accuracy.change_of_p > COARSEST
        final = state.degree >= last and (accuracy.known or state.degree == self.degree)
        due = before is None or not (unsettled or before.judged)
        early = due and (state.degree >= last or not friction_suffices(self.scene, state))
        if early or (final and state.degree < HIGHEST and self.degree is None):
            breach = max(TOLERANCE if final else BREACH, accuracy.change_of_p)
            return Known(accuracy, final, trusted(state, breach), judged=not unsettled)
        return Known(accuracy, final, None, judged=before is not None and before.judged)

    def start(self, near: State | None = None) -> State:
        """A coarse state of a scene that says where stick ends; pure slip also from pure stick."""
        if not self.scene.is_published:
            return self._start_from_drive()
        near_by: list[Start] = [] if near is None else [functools.partial(from_stick, stick=near)]
        for way in [*near_by, *STRING]:
            state = attempt(functools.partial(way, self))
            if state is not None and self.is_plausible(state):
                return state
        raise Stopped(Status.NEWTON_DIVERGED, "No state with a contact was found from the taut string.")

    def _start_from_drive(self) -> State:
        """A coarse state from the exact string of a drive; well known where the drive does not place each transition.

        Raises:
            Stopped: None of the ways leads to one.
        """
        for way in DRIVE:
            state = attempt(functools.partial(way, self))
            if state is not None and self.is_plausible(state):
                placed = all(state.layout.slides_behind(index) for index in state.layout.pulleys)
                return (
                    state if placed else self.sharpen(state, "pulleys on which the belt sticks, or slides, all along")
                )
        raise Stopped(Status.NEWTON_DIVERGED, "No state with a contact was found from the exact string.")


def trusted(state: State, breach: float) -> Tolerances:
    """Tolerances of a state that may break bounds by this part of the largest value by its error.

    It knows a stretch much better: to about the square of that.
    """
    stretch = breach**2 * max(float(state.stretches.max()) - 1.0, 0.0)
    return Tolerances(shrunk=0.0, bound=breach, sense=breach, furthest=FURTHEST, stretch=stretch)


def lifts_off(state: State) -> bool:
    """Whether the pressure is so negative in contact that no error explains it."""
    p = state.values[:, local(state.degree).p]
    return bool(p.min() < -NEGATIVE * p.max())


def lift_off_message(run: Run, state: State) -> str:
    """What negative pressure inside of the contact means."""
    dense = state.dense
    x = float(dense.r.real.flat[np.argmin(dense.p)]) * run.units.length
    return (
        f"The pressure is negative at x = {x:.6g} m: the belt would lift off there, and contact is not one arc; "
        "or this is another root of the equations."
    )


def from_string(run: Run, *, fixed_joints: bool = False) -> State:
    """From the string; by a first step that bends the belt, where the joints are fixed in it."""
    guess, pressed = string_guess(run.scene, run.elements)
    run.stages.ran("taut string", "first guess")
    return run.newton(guess, "the taut string", fixed_joints=fixed_joints or pressed)


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


def shrunk_to_nothing(start: State, end: State) -> tuple[set[int], set[int]]:
    """Parts that slide, of which an iteration has left next to nothing: the last ones behind stick, and others."""
    layout, left = start.layout, np.diff(end.ends) < SHRUNK * np.diff(start.ends)
    last, others = set[int](), set[int]()
    for on in map(layout.on, layout.pulleys):
        for i in on:
            if left[i] and not left[on[0] : on[-1] + 1].all() and layout.parts[i].kind == "slip":
                (last if i == on[-1] and layout.parts[i - 1].kind == "stick" else others).add(i)
    return last, others


def revised(state: State, turns: Container[int], out: Container[int]) -> tuple[Layout, Array]:
    """The layout of a state with some parts turned round and others left out, and the ends of its parts."""
    layout, parts, ends = state.layout, list[Part](), list[float]()
    for i, part in enumerate(layout.parts):
        part = part.turned if i in turns else part
        behind = part.touches and bool(parts) and parts[-1].touches
        if i in out or (behind and part == parts[-1]):
            continue
        ends.append(state.ends[i if behind or not part.touches else layout.on(part.pulley)[0]])
        parts.append(part)
    return ordered(state.scene, [part for part in parts if part.touches]), np.array([*ends, state.ends[-1]])


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
    return run.newton(run.transfer(state, posed(run.scene), state.ends), "a belt that bends more easily")


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
    if not run.scene.is_published:
        return [*warm, solve_several]
    if leaves_transition(run.scene):
        return [*warm, solve_driven]
    return [*warm, *STRING, *([from_stick] if posed(run.scene).slides_behind(0) else [])]
