"""Answers on the coarse mesh for a given speed or torque, between sliding all along and sticking all along.

1. A torque: the taut string knows forces well, and so about where stick ends.
2. A speed: the taut string knows it only as a difference from that in pure stick, which is solved first; its solution,
   with a part of the stick zone turned into sliding, is the first guess.
3. Where Newton's iteration finds no answer from there, the transition is placed instead: between where it is in pure
   stick and in pure slip, moving until the speed or the torque is the given one.
"""

from __future__ import annotations

import numpy as np

from belt_fenicsx.bvp_answer import grip, torque
from belt_fenicsx.bvp_coarse import Run, State, Stopped, driven_by, earliest, limit, ordered, placed
from belt_fenicsx.bvp_collocation import newton
from belt_fenicsx.bvp_guess import divided, guess
from belt_fenicsx.bvp_order import STICK, Order, pose, revision
from belt_fenicsx.certificate import SENSE
from belt_fenicsx.scene import RUN_OFF, RUN_UP, SceneError
from belt_fenicsx.scene import Slip as Sense
from belt_fenicsx.solution import Status
from belt_fenicsx.taut_string import taut_string

MET = 1e-6  # how closely pure stick has to meet a given speed or torque, in units of stretch and of b1 R
NEARLY = 0.95  # of the contact, at most, slides in the first guess of a contact that sticks somewhere
MOST_PLACES = 12  # of the transition that are tried one after another


def driven(run: Run) -> State:
    """An answer for a given speed or torque.

    Raises:
        Stopped: There is none, or the torque is beyond what friction can transmit.
    """
    if run.scene.pulleys[0].drive == "torque" and (state := _tried(run, None)):
        return state
    stick = limit(run, RUN_OFF, "forward")
    return _tried(run, stick) or _searched(run, stick)


def _tried(run: Run, stick: State | None) -> State | None:
    """An answer from the taut string or from pure stick, of the likelier order first."""
    sense, part = _estimate(run, stick)
    tries = [(STICK, int(SENSE[sense])), (int(SENSE[sense]),)]
    for senses in tries if part < 1.0 else reversed(tries):
        state = _first(run, stick, senses, sense, min(max(part, 1.0 - NEARLY), NEARLY))
        if state.plausible and answers(run, state := ordered(run, state)):
            run.skipped("search", "the first guess sufficed")
            return state
    return None


def answers(run: Run, state: State) -> bool:
    """Whether a state is plausible, breaks no bound and meets the drive.

    Raises:
        Stopped: The torque is beyond what sliding all along transmits.
    """
    if not state.plausible or not _meets(run, state):
        return False
    return not (run.find_zones and revision(state.problem, state.order, state.discrete, run.scene.pulleys[0]))


def _meets(run: Run, state: State) -> bool:
    """Whether a state meets the drive, even if its order has no transition that the drive could place."""
    pulley, sense = run.scene.pulleys[0], state.order.senses[0]
    if pulley.drive == "x_trans" or pulley.friction == 0.0 or state.order.transition is not None:
        return True
    ahead = _ahead(run, state)
    if sense == STICK:
        return abs(ahead) <= MET
    if pulley.drive == "omega":
        return sense * ahead <= 0.0
    if sense * ahead < 0.0:
        return False
    capacity = torque(state.problem, state.discrete) * run.units.of(length=1, force=1)
    raise Stopped(Status.CAPACITY_EXCEEDED, f"Sliding all along, the belt transmits {capacity:.6g} N m.")


def _ahead(run: Run, state: State) -> float:
    """By how much a state's speed or torque falls short of the given one, in units of stretch and of b1 R."""
    pulley = run.scene.pulleys[0]
    if pulley.drive == "omega":
        return pulley.radius * pulley.omega - grip(state.problem, state.discrete)[0]
    return (pulley.torque - torque(state.problem, state.discrete)) / pulley.radius


def _estimate(run: Run, stick: State | None) -> tuple[Sense, float]:
    """Sense of sliding, and about which part of the contact slides."""
    pulley = run.scene.pulleys[0]
    by_speed = pulley.drive == "omega"
    ahead = pulley.torque / pulley.radius if stick is None else _ahead(run, stick)
    sense: Sense = "forward" if (ahead < 0.0) == by_speed else "backward"
    stuck, slide = (taut_string(driven_by(run.scene, x_trans, sense)).strain for x_trans in (RUN_OFF, RUN_UP))
    return sense, ahead / (slide[0] - stuck[0] if by_speed else slide[1] - slide[0])


def _first(run: Run, stick: State | None, senses: tuple[int, ...], sense: Sense, part: float) -> State:
    """A first solution with a given order, from pure stick where there is some, and from the taut string."""
    if len(senses) > 1 and stick is not None and STICK in stick.order.senses:
        i = stick.order.senses.index(STICK)
        order = Order((*stick.order.senses[:i], *senses))
        borders = stick.problem.borders(stick.discrete.p)[1:-1]
        end = borders[i] + (1.0 - part) * (borders[i + 1] - borders[i])
        problem = pose(run.scene, order)
        start = divided(stick.problem, stick.discrete, problem, np.array([*borders[: i + 1], end, borders[-1]]))
        name = "pure stick"
    else:
        string = taut_string(driven_by(run.scene, RUN_OFF, sense))
        x_trans = RUN_UP if len(senses) == 1 else float(string.x[2] + part * (string.x[0] - string.x[2]))
        order = Order(senses)
        problem = pose(run.scene, order)
        start = guess(problem, driven_by(run.scene, x_trans, sense), run.intervals)
        name = "taut string"
    coarse = newton(problem, start)
    run.ran(name, f"no plausible solution yet; now {order}", coarse.iterations)
    return State(order, problem, coarse)


def _searched(run: Run, stick: State) -> State:
    """An answer from solutions whose transition is placed, between pure stick and pure slip."""
    pulley = run.scene.pulleys[0]
    by_speed = pulley.drive == "omega"
    sense: Sense = "forward" if (_ahead(run, stick) < 0.0) == by_speed else "backward"
    slip = limit(run, RUN_UP, sense)
    if _meets(run, slip):
        return slip
    ends = [[grip(stick.problem, stick.discrete)[1], _ahead(run, stick)], [earliest(slip), _ahead(run, slip)]]
    if ends[1][0] != grip(slip.problem, slip.discrete)[1]:
        # Next to pure slip, sliding turns next to the run-off and nowhere else.
        first, last = slip.problem.borders(slip.discrete.p)[1:-1]
        order = Order((int(SENSE[sense]), -int(SENSE[sense])))
        problem = pose(run.scene, order)
        start = divided(
            slip.problem, slip.discrete, problem, np.array([first, (1.0 - NEARLY) * first + NEARLY * last, last])
        )
        coarse = newton(problem, start)
        run.ran("pure slip", f"now {order}", coarse.iterations)
        state = State(order, problem, coarse)
        if state.plausible and answers(run, state := ordered(run, state)):
            return state
    for _ in range(MOST_PLACES):
        (x, ahead), (x_other, ahead_other) = ends
        place = x + float(np.clip(ahead / (ahead - ahead_other), 0.05, 0.95)) * (x_other - x)
        search = Run(driven_by(run.scene, place, sense), run.units, run.find_zones, run.intervals)
        try:
            near = placed(search)
        except (Stopped, SceneError):
            break
        problem = pose(run.scene, near.order)
        coarse = newton(problem, near.discrete)
        run.ran("search", f"with the transition at {place:.6g} at first", search.iterations + coarse.iterations)
        state = State(near.order, problem, coarse)
        if state.plausible and answers(run, state := ordered(run, state)):
            return state
        ends[int(_ahead(run, near) * ahead < 0.0)] = [place, _ahead(run, near)]
    raise Stopped(Status.NEWTON_DIVERGED, "No place of the transition was found for the drive.")
