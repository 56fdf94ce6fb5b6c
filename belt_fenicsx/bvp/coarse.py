"""Answers on the coarse mesh for pulleys driven by ``x_trans``, the order of whose zones is found on the way."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from belt_fenicsx.bvp.guess import divided, guess
from belt_fenicsx.bvp.newton import COARSE, NEWTON, Discrete, Work, rounding
from belt_fenicsx.bvp.order import FINER, STICK, Order, asked, pose, revision
from belt_fenicsx.bvp.problem import FIRST, LAST, Problem
from belt_fenicsx.bvp.reading import grip, plausible, samples
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.pulley import RUN_OFF, RUN_UP
from belt_fenicsx.scene.pulley import Slip as Sense
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.scene.units import Units
from belt_fenicsx.solution.stages import Stages, Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.string import taut_string

CONTINUATIONS = (  # stiffnesses on the way, over the belt's
    ("b2", (1.0,)),
    ("b2", (0.01, 0.03, 0.1, 0.3, 1.0)),
    ("a", (0.1, 0.3, 1.0)),
    ("a", (10.0, 3.0, 1.0)),
)
MOST_ORDERS = 8  # that are tried one after another
SHORTEST = 1e-6  # part of the contact that sticks or slides in a first guess, at least
SURE, SURELY = 96, 1e-10  # intervals and end of Newton's iteration, for the limits of a transition


@dataclass(frozen=True)
class State:
    """What a warm start needs: the order of the zones, their equations and their solution."""

    order: Order
    problem: Problem
    discrete: Discrete

    @property
    def plausible(self) -> bool:
        """Whether it converged to a state with a mechanical sense."""
        return plausible(self.problem, self.discrete)


@dataclass
class Run:
    """A solve that is under way.

    Attributes:
        scene: The dimensionless scene.
        units: Its units, for messages.
        find_zones: Whether the order of the zones may change.
        intervals: Of the coarse mesh.
        stages: What was done so far.
        work: What may still be spent, by this run and by those that it starts.
    """

    scene: Scene
    units: Units
    find_zones: bool = True
    intervals: int = COARSE
    stages: Stages = field(default_factory=Stages)
    work: Work = field(default_factory=Work)

    def converged(self, start: State, stage: str, *, positive: bool = False) -> State:
        """A state on the coarse mesh from a first guess."""
        coarse = self.work.newton(start.problem, start.discrete, NEWTON, stage, positive=positive)
        return replace(start, discrete=coarse)

    def other(self, scene: Scene) -> Run:
        """A run on the way of this one, for another scene."""
        return Run(scene, self.units, self.find_zones, self.intervals, work=self.work)


def placed(run: Run, near: State | None = None) -> State:
    """An answer for a pulley driven by ``x_trans``: from the taut string, from pure stick, or in steps.

    Args:
        run: The run.
        near: Pure stick, if it is known.

    Raises:
        SceneError: Stick cannot end at this place.
        Stopped: There is none.
    """
    pulley, order = run.scene.pulleys[0], asked(run.scene.pulleys[0])
    if slack := taut_string(run.scene).slack:
        raise Stopped(Status.CONTACT_LOST, slack, final=True)
    problem = pose(run.scene, order)
    first = run.converged(State(order, problem, guess(problem, run.scene, run.intervals)), "taut string")
    run.stages.ran("taut string", "no plausible solution yet", first.discrete.iterations)
    if first.plausible and (state := ordered(run, first)).plausible:
        run.stages.skipped("continuation", "the first guess sufficed")
        return state
    if pulley.friction > 0.0 and not isinstance(pulley.x_trans, str):
        near = check_transition(run)
    if near is not None and (start := _divided_stick(run, near)):
        for positive in (False, True):
            state = run.converged(start, "pure stick", positive=positive)
            why = "lengths by their logarithms" if positive else "the taut string did not lead to a plausible solution"
            run.stages.ran("pure stick", why, state.discrete.iterations)
            if state.plausible and (state := ordered(run, state)).plausible:
                return state
    if first.plausible:
        return ordered(run, first)
    state = _continued(run, order)
    if state.plausible:
        return ordered(run, state)
    if not state.discrete.converged:
        raise Stopped(Status.NEWTON_DIVERGED, f"The continuation leaves {left(state.discrete)}.")
    return state


def _divided_stick(run: Run, stick: State) -> State | None:
    """A first guess from pure stick; None where nothing sticks where stick is to end."""
    order, x_trans = asked(run.scene.pulleys[0]), run.scene.pulleys[0].x_trans
    borders = stick.problem.borders(stick.discrete.p)[1:-1]
    if order.transition is None:
        # The belt slides all along, or sticks.
        ends = borders[[0, -1]]
    elif STICK not in stick.order.senses:
        return None
    else:
        i = stick.order.senses.index(STICK)
        fine = np.linspace(0.0, 1.0, FINER * run.intervals)
        sigma, x = samples(stick.problem, stick.discrete, np.tile(fine, (len(stick.problem.zones), 1)))[:2, i + 1]
        place, least = float(np.interp(x_trans, x, sigma)), SHORTEST * (borders[-1] - borders[0])
        order = Order((*stick.order.senses[: i + 1], order.senses[-1]))
        ends = np.array([*borders[: i + 1], min(max(place, borders[i] + least), borders[-1] - least), borders[-1]])
    problem = pose(run.scene, order)
    return State(order, problem, divided(stick.problem, stick.discrete, problem, ends))


def ordered(run: Run, state: State, *, doubt: float | None = None) -> State:
    """Changes the order of the zones until no bound is broken; ends where an order comes back.

    Args:
        run: The run.
        state: A state that converged.
        doubt: Negative length of a zone that does not count, in lengths of the contact; by default, what the mesh
            leaves in doubt.
    """
    pulley, tried, reasons, iterations = run.scene.pulleys[0], [state.order], [], 0
    if not run.find_zones:
        run.stages.skipped("zone order", "the order is not to change")
        return state
    while state.discrete.converged and (
        change := revision(
            state.problem, state.order, state.discrete, pulley, state.discrete.doubt if doubt is None else doubt
        )
    ):
        reasons.append(change.why)
        if change.order is None:
            check_transition(run, outside=True)
            break
        if not change.order.senses:
            raise Stopped(Status.CONTACT_LOST, "The contact shrinks to a point.")
        if change.order in tried or len(tried) == MOST_ORDERS:
            reasons.append(f"{change.order} does not hold either")
            break
        tried.append(change.order)
        problem = pose(run.scene, change.order)
        start = divided(state.problem, state.discrete, problem, change.borders)
        # Zones next to nothing need all digits, once the mesh is fine enough to tell.
        tolerance = NEWTON if doubt is None else rounding(problem, start.mesh.size)
        discrete = run.work.newton(problem, start, tolerance, "zone order")
        iterations += discrete.iterations
        state = State(change.order, problem, discrete)
    if reasons:
        run.stages.ran("zone order", "; ".join([*reasons, f"now {state.order}"]), iterations)
    else:
        run.stages.skipped("zone order", "no bound is broken")
    return state


def _continued(run: Run, order: Order) -> State:
    """A solution on the coarse mesh, from the taut string along belts of other stiffness.

    Where a belt that is rigid in shear would touch the pulley at a point, another has a contact as short as its kink
    there is slight. From a belt that gives way in shear, Newton's iteration finds it.
    """
    problem, iterations = pose(run.scene, order), 0
    for stiffness, factors in CONTINUATIONS:
        coarse, value = guess(problem, run.scene, run.intervals), getattr(problem.rod, stiffness)
        for factor in factors:
            rod = replace(problem.rod, **{stiffness: factor * value})
            coarse = run.work.newton(replace(problem, rod=rod), coarse, NEWTON, "continuation", positive=True)
            iterations += coarse.iterations
            if not coarse.converged:
                break
        if plausible(problem, coarse):
            break
    run.stages.ran("continuation", "the first guess did not lead to a plausible solution", iterations)
    return State(order, problem, coarse)


def driven_by(scene: Scene, x_trans: float | str, slip: Sense) -> Scene:
    pulley = replace(scene.pulleys[0], x_trans=x_trans, slip=slip, omega=None, torque=None)
    return replace(scene, pulleys=(pulley,))


def limit(run: Run, x_trans: str, slip: Sense, near: State | None = None) -> State:
    """Pure stick or pure slip, the latter also from the former."""
    pure = run.other(driven_by(run.scene, x_trans, slip))
    state = placed(pure, near)
    run.stages.ran("limits", f"{state.order}, to compare with", pure.stages.iterations)
    return state


def check_transition(run: Run, *, outside: bool = False) -> State | None:
    """Checks that the transition lies where stick can end: between where it does in pure slip and in pure stick.

    Args:
        run: The run, driven by ``x_trans``.
        outside: Whether it does not, as its own solution shows.

    Returns:
        Pure stick; None where it is not plausible.

    Raises:
        SceneError: It does not.
        Stopped: There is no contact.
    """
    pulley = run.scene.pulleys[0]
    if isinstance(pulley.x_trans, str):
        return None
    stick = limit(run, RUN_OFF, pulley.slip)
    if not stick.plausible:
        return None
    try:
        slip = limit(run, RUN_UP, pulley.slip, stick)
    except Stopped as stopped:
        if stopped.final and stopped.status is Status.NEWTON_DIVERGED:
            raise
        return stick
    if not slip.plausible:
        return stick
    stick, slip = (
        replace(
            state, discrete=run.work.newton(state.problem, state.discrete.on(state.problem, SURE), SURELY, "limits")
        )
        for state in (stick, slip)
    )
    places = sorted([earliest(slip), grip(stick.problem, stick.discrete)[1]])
    doubt = 0.0 if outside else stick.discrete.doubt * (places[1] - places[0])
    if outside or not places[0] - doubt < pulley.x_trans < places[1] + doubt:
        first, last = (place * run.units.length for place in places)
        between = f"lie where stick can end in the contact zone, in ({first:.9g}, {last:.9g}) [m]"
        raise SceneError("pulleys.0.x_trans", between, pulley.x_trans * run.units.length)
    return stick


def earliest(slip: State) -> float:
    """Where the transition goes when sliding spreads over the contact, from the solution of pure slip."""
    zone, y, c = slip.problem.parts(slip.discrete.y, slip.discrete.p)[1]
    x = zone.state(slip.problem.rod, y, c)[0]
    nearest = grip(slip.problem, slip.discrete)[1]
    # Next to the run-off, sliding turns: the transition does not get there.
    return nearest if nearest < (x[FIRST] + x[LAST]) / 2 else float(x[FIRST])


def left(discrete: Discrete) -> str:
    return f"a residual of {discrete.residual:.1g} on {discrete.mesh.size - 1} intervals"
