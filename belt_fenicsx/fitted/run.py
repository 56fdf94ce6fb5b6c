"""A solve of the fitted method that is under way: what the search asks of this method.

What a first guess has of sliding in the wrong sense is turned round, and what shrinks to nothing left out. From there
on, the degree rises by two. Where states of both degrees have the same rows, their difference tells the error.
"""

from __future__ import annotations

import functools
from collections.abc import Container
from dataclasses import dataclass, field, replace

import numpy as np

from belt_fenicsx.fitted.accuracy import COARSEST, Accuracy, coarse, estimate
from belt_fenicsx.fitted.guess import DRIVE, FINE, LOWEST, STRING, Start, from_stick
from belt_fenicsx.fitted.newton import Newton
from belt_fenicsx.fitted.reading import friction_suffices, lifts_off, samples
from belt_fenicsx.fitted.state import State
from belt_fenicsx.fitted.transfer import from_fields
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import Part
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered
from belt_fenicsx.layout.revision import Samples, Tolerances
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.scene.units import Units
from belt_fenicsx.search.find import attempt
from belt_fenicsx.solution.stages import Stages, Stopped
from belt_fenicsx.solution.status import Status

HIGHEST = 14  # The highest degree.
LAST = {1e-6: 6, 1e-8: 8, 1e-10: 10, 0.0: 12}  # The degree that mostly reaches an rtol, by the rtol.
ARRIVED = 2e-2  # The degree may rise after a largest step of a joint of this, in lengths of the shortest cell.
CLOSE = 3e-4  # After such a step, the error is that of the degree.
PLACED = 1e-8  # After such a step, a state is compared with a limit.
# One step from the degree before leaves an error of second order in what the degree changes in a layer. Where a cell is
# shorter than this, in belt lengths, it can be as large as what the degree leaves.
SHORT = 0.012
SHORTEST = 1e-4  # A contact that is no longer, in radii, is none.
BREACH = 1e-3  # A coarse state may break a bound by this by its error, relative to the largest value.
TOLERANCE = 1e-6  # The tolerance of the certificate; what low degrees leave of the inequalities is below a tenth of it.
FURTHEST = 0.8  # Newton's iteration finds a joint again that starts in this part of a stick part.
SHRUNK = 0.01  # Of a part that shrinks to nothing, an iteration leaves less than this part.
BUDGET = 300  # All starts together may take so many Newton iterations.


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


def lift_off_message(run: Run, state: State) -> str:
    """What negative pressure inside of the contact means."""
    dense = state.dense
    x = float(dense.r.real.flat[np.argmin(dense.p)]) * run.units.length
    return (
        f"The pressure is negative at x = {x:.6g} m: the belt would lift off there, and contact is not one arc; "
        "or this is another root of the equations."
    )


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
