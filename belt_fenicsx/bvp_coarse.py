"""Answers on the coarse mesh for pulleys driven by ``x_trans``, the order of whose zones is found on the way."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from belt_fenicsx.bvp_answer import grip, plausible
from belt_fenicsx.bvp_collocation import COARSE, Discrete, newton
from belt_fenicsx.bvp_guess import divided, guess
from belt_fenicsx.bvp_order import Order, asked, pose, revision
from belt_fenicsx.bvp_problem import FIRST, LAST, Problem
from belt_fenicsx.scene import RUN_OFF, RUN_UP, Scene, SceneError, Units
from belt_fenicsx.scene import Slip as Sense
from belt_fenicsx.solution import Status
from belt_fenicsx.stages import Stages, Stopped

CONTINUATIONS = ((0.1, 0.3, 1.0), (10.0, 3.0, 1.0))  # bending stiffnesses on the way, over the belt's
MOST_ORDERS = 8  # that are tried one after another


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
    """

    scene: Scene
    units: Units
    find_zones: bool = True
    intervals: int = COARSE
    stages: Stages = field(default_factory=Stages)


def placed(run: Run) -> State:
    """An answer for a pulley driven by ``x_trans``, from the taut string.

    Raises:
        SceneError: Stick cannot end at this place.
        Stopped: There is none.
    """
    order = asked(run.scene.pulleys[0])
    problem = pose(run.scene, order)
    coarse = newton(problem, guess(problem, run.scene, run.intervals))
    run.stages.ran("taut string", "no plausible solution yet", coarse.iterations)
    state = State(order, problem, coarse)
    if state.plausible and (state := ordered(run, state)).plausible:
        run.stages.skipped("continuation", "the first guess sufficed")
        return state
    _check_transition(run)
    if not plausible(problem, coarse):
        state = _continued(run, order)
        state = ordered(run, state) if state.plausible else state
    if not state.discrete.converged:
        raise Stopped(Status.NEWTON_DIVERGED, f"The continuation leaves {left(state.discrete)}.")
    return state


def ordered(run: Run, state: State) -> State:
    """Changes the order of the zones until no bound is broken; ends where an order comes back."""
    pulley, tried, reasons, iterations = run.scene.pulleys[0], [state.order], [], 0
    if not run.find_zones:
        run.stages.skipped("zone order", "the order is not to change")
        return state
    while state.discrete.converged and (change := revision(state.problem, state.order, state.discrete, pulley)):
        reasons.append(change.why)
        if change.order is None:
            _check_transition(run)
            break
        if not change.order.senses:
            raise Stopped(Status.CONTACT_LOST, "The contact shrinks to a point.")
        if change.order in tried or len(tried) == MOST_ORDERS:
            reasons.append(f"{change.order} does not hold either")
            break
        tried.append(change.order)
        problem = pose(run.scene, change.order)
        discrete = newton(problem, divided(state.problem, state.discrete, problem, change.borders))
        iterations += discrete.iterations
        state = State(change.order, problem, discrete)
    if reasons:
        run.stages.ran("zone order", "; ".join([*reasons, f"now {state.order}"]), iterations)
    else:
        run.stages.skipped("zone order", "no bound is broken")
    return state


def _continued(run: Run, order: Order) -> State:
    """A solution on the coarse mesh, from the taut string along belts of other bending stiffness."""
    problem, iterations = pose(run.scene, order), 0
    for factors in CONTINUATIONS:
        coarse = guess(problem, run.scene, run.intervals)
        for factor in factors:
            rod = replace(problem.rod, a=factor * problem.rod.a)
            coarse = newton(replace(problem, rod=rod), coarse)
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


def limit(run: Run, x_trans: str, slip: Sense) -> State:
    """Pure stick or pure slip."""
    pure = Run(driven_by(run.scene, x_trans, slip), run.units, run.find_zones, run.intervals)
    state = placed(pure)
    run.stages.ran("limits", f"{state.order}, to compare with", pure.stages.iterations)
    return state


def _check_transition(run: Run) -> None:
    """Checks that the transition lies where stick can end: between where it does in pure slip and in pure stick.

    Raises:
        SceneError: It does not.
    """
    pulley = run.scene.pulleys[0]
    if isinstance(pulley.x_trans, str):
        return
    try:
        limits = [limit(run, x_trans, pulley.slip) for x_trans in (RUN_UP, RUN_OFF)]
    except Stopped:
        return
    x_up, x_off = earliest(limits[0]), grip(limits[1].problem, limits[1].discrete)[1]
    if all(state.plausible for state in limits) and not x_up < pulley.x_trans < x_off:
        length = run.units.length
        between = f"lie where stick can end in the contact zone, in ({x_up * length:.6g}, {x_off * length:.6g}) [m]"
        raise SceneError("pulleys.0.x_trans", between, pulley.x_trans * length)


def earliest(slip: State) -> float:
    """Where the transition goes when sliding spreads over the contact, from the solution of pure slip."""
    zone, y, c = slip.problem.parts(slip.discrete.y, slip.discrete.p)[1]
    x = zone.state(slip.problem.rod, y, c)[0]
    nearest = grip(slip.problem, slip.discrete)[1]
    # Next to the run-off, sliding turns: the transition does not get there.
    return nearest if nearest < (x[FIRST] + x[LAST]) / 2 else float(x[FIRST])


def left(discrete: Discrete) -> str:
    return f"a residual of {discrete.residual:.1g} on {discrete.mesh.size - 1} intervals"
