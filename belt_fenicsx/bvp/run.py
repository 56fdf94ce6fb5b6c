"""A solve of the boundary-value problem that is under way: what the search asks of this method.

Its own ladder to a coarse state, each step for scenes in which those before it fail:

1. From the taut string.
2. From pure stick, with the transition where the scene wants it: for the lengths of parts, then for their logarithms.
3. In steps: from a belt that gives way in shear or bends more easily, which is more like a string, or from one that
   bends less easily, whose layers are wider.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from belt_fenicsx.bvp.creep import CELLS, WIDEST, creep_problem, narrowed, zones
from belt_fenicsx.bvp.guess import divided, from_drive
from belt_fenicsx.bvp.newton import CLOSER, COARSE, DOUBT, NEWTON, ROUNDING, Discrete, Refined, Work, refined
from belt_fenicsx.bvp.problem import Problem
from belt_fenicsx.bvp.reading import FIELDS, changes, plausible
from belt_fenicsx.bvp.state import State, pose
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered
from belt_fenicsx.layout.revision import Samples, Tolerances
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.scene.units import Units
from belt_fenicsx.search.divided import divide_stick
from belt_fenicsx.search.find import check_transition, settle, settle_from
from belt_fenicsx.search.limits import leaves_transition, meets
from belt_fenicsx.solution.stages import Stages, Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.bent import bent
from belt_fenicsx.taut_string.drive import string_drive
from belt_fenicsx.taut_string.shape import StringDrive, undivided
from belt_fenicsx.taut_string.standing import BeyondCapacity

# Stiffnesses on the way, over the belt's.
CONTINUATIONS = (
    ("b2", (1.0,)),
    ("b2", (0.01, 0.03, 0.1, 0.3, 1.0)),
    ("a", (0.1, 0.3, 1.0)),
    ("a", (10.0, 3.0, 1.0)),
)
LAST_WIDTHS = 3  # Zones of so many widths of creep are tried, the narrowest first.
SHORTEST = 1e-6  # At least this part of the contact sticks, or slides, in a first guess.
FINE, FINELY = 32, 1e-10  # Cells, and the end of Newton's iteration, for the comparison with a limit.
FIELD, FINEST_FIELD = 1e4, 1e-8  # A field may have this error, over that of omega, and at least.
NOTHING = 1e-12  # A part that is no longer, in belt lengths, has shrunk to nothing.
BROKEN = 1e-8  # A bound is broken where it is exceeded by this, relative to the largest one.
SLACK = 1e-5  # The same for the sense of sliding on a coarse mesh, relative to the largest speed of the part.


@dataclass
class Run:
    """A solve that is under way.

    Attributes:
        scene: The dimensionless scene.
        units: Its units, for messages.
        rtol: Wanted relative accuracy of what is asked for.
        find_zones: Whether the layout may change.
        cells: Of the coarse mesh.
        stages: What was done so far.
        work: What may still be spent, by this run and by those that it starts.
        end: The last refinement; None before the first one.
        positive: Whether to solve for the logarithms of the lengths of parts on the pulley.
    """

    scene: Scene
    units: Units
    rtol: float = 1e-8
    find_zones: bool = True
    cells: int = COARSE
    stages: Stages = field(default_factory=Stages)
    work: Work = field(default_factory=Work)
    end: Refined | None = None
    positive: bool = False

    @functools.cached_property
    def drive(self) -> StringDrive:
        """The exact string of a drive."""
        return string_drive(self.scene, slack=self.scene.is_published)

    @functools.cached_property
    def drawn(self) -> StringDrive:
        """The string, even if a torque asks it for more friction than there is: the belt may transmit a little more."""
        try:
            return self.drive
        except BeyondCapacity as beyond:
            return beyond.drawn

    @functools.cached_property
    def tension(self) -> float:
        """Typical force of the belt."""
        return max(max(part.force) for part in self.drawn.parts)

    @property
    def winding(self) -> float:
        """Angle by which a loop turns."""
        return self.drawn.parts[-1].angles[1] - self.drawn.parts[0].angles[0] if self.scene.closed else 0.0

    @property
    def wanted(self) -> Array:
        """Errors that are allowed: of omega or the torque, and of each of the fields."""
        return np.array([self.rtol, *[max(FIELD * self.rtol, FINEST_FIELD)] * len(FIELDS)])

    @property
    def refinement(self) -> Refined:
        """The last refinement, through which every answer has gone."""
        assert self.end is not None, "an answer has been refined"
        return self.end

    def at(self, scene: Scene) -> Run:
        """A run on the way of this one, for another scene."""
        return replace(self, scene=scene, stages=Stages(), end=None)

    def transfer(self, state: State, layout: Layout, ends: Array) -> State:
        """A state as a first guess on a layout whose parts have about these ends."""
        problem = self.pose(layout)
        return State(layout, problem, divided(state.problem, state.discrete, problem, ends))

    def pose(self, layout: Layout) -> Problem:
        """The equations of a layout."""
        return pose(self.scene, layout, self.tension, self.winding)

    def converge(self, start: State, stage: str, why: str) -> State:
        """Newton's iteration from a first guess; adds a stage.

        Raises:
            Stopped: It does not converge.
        """
        # Parts next to nothing need all digits, once the mesh is fine enough to tell.
        tolerance = NEWTON if self.end is None else ROUNDING
        discrete = self.work.newton(start.problem, start.discrete, tolerance, stage, positive=self.positive)
        self.stages.ran(stage, why, discrete.iterations)
        if not discrete.converged:
            raise Stopped(Status.NEWTON_DIVERGED, f"The {stage} leaves {unsolved(discrete)}.")
        return replace(start, discrete=discrete)

    def sharpen(self, state: State, why: str) -> State:
        """The same state on a mesh that is fine enough to compare it with a limit."""
        cells = max(FINE, state.discrete.cells)
        fine = self.work.newton(state.problem, state.discrete.on(state.problem, cells), FINELY, why)
        return replace(state, discrete=fine)

    def is_plausible(self, state: State) -> bool:
        """Whether a state has a mechanical sense."""
        # From a first guess of many rows, some parts get negative lengths; a revision leaves them out.
        rough = self.end is None and not self.scene.is_published
        return plausible(state.problem, state.layout, state.discrete, math.inf if rough else None)

    def samples(self, state: State) -> Samples:
        """What a state says about its layout."""
        return state.samples

    def tolerances(self, state: State) -> Tolerances | None:
        """How far a state is trusted; None where the layout is not to change."""
        if not self.find_zones:
            return None
        if self.end is not None:
            # What the first mesh left in doubt shows here; but not in a state without a mechanical sense.
            doubt = DOUBT if self.scene.is_published else math.inf
            sound = plausible(state.problem, state.layout, state.discrete, doubt) and meets(self, state)
            return Tolerances(shrunk=NOTHING, bound=BROKEN, sense=BROKEN) if sound else None
        doubt = state.discrete.doubt * float(state.discrete.values.lengths[state.problem.contacts.parts].sum())
        return Tolerances(shrunk=-doubt, bound=BROKEN, sense=SLACK)

    def refine(self, state: State) -> State | None:
        """The state on meshes fine enough for the wanted accuracy; None where it is on them.

        Raises:
            Stopped: Newton's iteration ends without convergence.
        """
        if self.end is not None and self.end.discrete is state.discrete:
            return None
        # Next to pure stick and pure slip, a given speed or torque is met by all digits only.
        closer = 0.0 if leaves_transition(self.scene) else CLOSER
        change = functools.partial(changes, self.scene, state.layout)
        self.end = refined(state.problem, state.discrete, change, self.wanted, self.work, closer=closer)
        fine = self.end.discrete
        self.stages.ran("refinement", f"to {fine.cells} cells in each part", self.end.iterations)
        if not fine.converged:
            raise Stopped(Status.NEWTON_DIVERGED, f"The finest mesh leaves {unsolved(fine)}.")
        return replace(state, discrete=fine)

    def start(self, near: State | None = None) -> State:
        """A coarse state of a scene that says where stick ends; pure slip also from pure stick.

        Raises:
            SceneError: Stick cannot end at this place.
            Stopped: There is none.
        """
        if not self.scene.is_published:
            return self._start_from_drive()
        layout = ordered(self.scene, [own.part for own in self.drawn.parts if own.part.touches])
        problem = self.pose(layout)
        first = State(layout, problem, from_drive(problem, self.drive, self.cells))
        if (state := settle_from(self, first, "taut string", "no plausible solution yet")) is not None:
            self.stages.skipped("continuation", "the first guess sufficed")
            return state
        near = check_transition(self) or near
        if near is not None and (ways := divide_stick(self.scene, near.layout, self.samples(near).densest, SHORTEST)):
            start = self.transfer(near, *ways)
            for run, why in ((self, "as they are"), (replace(self, positive=True), "by their logarithms")):
                if (state := settle_from(run, start, "pure stick", f"lengths {why}")) is not None:
                    return state
        state = self._continued(layout)
        return settle(self, state) if self.is_plausible(state) else state

    def _start_from_drive(self) -> State:
        """A coarse state from the exact string of a drive; where that is not enough, from friction that lets it creep.

        Raises:
            Stopped: There is none.
        """
        string = bent(self.scene, self.drive)
        layout = ordered(self.scene, [own.part for own in string.parts if own.part.touches])
        problem = self.pose(layout)
        first = State(layout, problem, from_drive(problem, string, self.cells))
        # What the string leads to on the coarsest mesh is no answer where another one is tried.
        if self.cells == COARSE and (state := settle_from(self, first, "string", "its rows and fields")) is not None:
            return state
        for crept in self._crept():
            if (state := settle_from(self, crept, "creep", f"its rows, {crept.layout}")) is not None:
                return state
        if (state := settle_from(self, first, "string", "its rows and fields")) is not None:
            return state
        raise Stopped(Status.NEWTON_DIVERGED, "Neither the string nor a belt that creeps leads to a plausible state.")

    def _crept(self) -> Iterator[State]:
        """First guesses from friction that grows with the speed of sliding.

        The narrower its width is, the closer are its zones, but the stiffer its equation: the last ones follow.
        """
        if any(pulley.drive.is_place for pulley in self.scene.pulleys):
            return
        before = self.work.iterations
        make = functools.partial(creep_problem, self.scene, self.tension, self.winding)
        start = from_drive(make(WIDEST), undivided(self.drive), max(CELLS, 2 * self.cells))
        states = narrowed(make, start, self.work)
        lost = shrunk(*states[-1]) if states else None
        if lost is not None:
            # The equations have solutions with contacts of negative length beside those with short ones.
            states = narrowed(make, start, self.work, positive=True)
        self.stages.ran("creep", "the string did not lead to a plausible state", self.work.iterations - before)
        if lost is not None and not states:
            raise Stopped(
                Status.CONTACT_LOST,
                f"The contact with pulley {lost} shrinks to a point: so stiff a belt turns by the angle of the "
                "wrap before it touches. Let the pulley reach further in, or stretch the belt more.",
                final=True,
            )
        for creep, found in states[: -LAST_WIDTHS - 1 : -1]:
            parts, ends = zones(self.scene, creep, found)
            layout = ordered(self.scene, parts)
            problem = self.pose(layout)
            yield State(layout, problem, divided(creep, found, problem, ends))

    def _continued(self, layout: Layout) -> State:
        """A state on the coarse mesh, from the taut string along belts of other stiffness.

        Where a belt that is rigid in shear would touch the pulley at a point, another has a contact as short as its
        kink there is slight. From a belt that gives way in shear, Newton's iteration finds it.

        Raises:
            Stopped: None of the ways converges.
        """
        problem, iterations = self.pose(layout), 0
        for stiffness, factors in CONTINUATIONS:
            coarse = from_drive(problem, self.drive, self.cells)
            value = getattr(problem.rod, stiffness)
            for factor in factors:
                rod = replace(problem.rod, **{stiffness: factor * value})
                coarse = self.work.newton(replace(problem, rod=rod), coarse, NEWTON, "continuation", positive=True)
                iterations += coarse.iterations
                if not coarse.converged:
                    break
            if plausible(problem, layout, coarse):
                break
        self.stages.ran("continuation", "the first guess did not lead to a plausible solution", iterations)
        if not coarse.converged:
            raise Stopped(Status.NEWTON_DIVERGED, f"The continuation leaves {unsolved(coarse)}.")
        return State(layout, problem, coarse)


def shrunk(problem: Problem, discrete: Discrete) -> int | None:
    """The pulley on which a belt that creeps has the shortest contact, if that has no length; None where all have."""
    lengths = discrete.values.lengths[problem.contacts.parts]
    return int(np.argmin(lengths)) if np.any(lengths <= 0.0) else None


def unsolved(discrete: Discrete) -> str:
    """What is left of the equations."""
    return f"a step of {discrete.missed:.1g} on {discrete.cells} cells"
