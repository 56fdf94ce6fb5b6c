"""Answers on the coarse mesh for a given speed or torque, between sliding all along and sticking all along.

1. Pure stick is solved first. What its pressure lets friction add to the belt's tension tells where stick ends; with
   sliding behind it, it is the first guess.
2. Where everything is to slide, or Newton's iteration finds no answer from there, pure slip is solved. It is the answer
   if the drive asks for no less.
3. If not, the transition is placed: between where it is in pure stick and in pure slip, moving until the speed or the
   torque is the given one.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.integrate import cumulative_trapezoid

from belt_fenicsx.bvp.coarse import Run, State, driven_by, earliest, limit, ordered, placed
from belt_fenicsx.bvp.equations import Stick
from belt_fenicsx.bvp.guess import divided
from belt_fenicsx.bvp.order import FINER, NOTHING, STICK, Order, pose, revision
from belt_fenicsx.bvp.problem import places
from belt_fenicsx.bvp.reading import grip, torque
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.pulley import RUN_OFF, RUN_UP
from belt_fenicsx.scene.pulley import Slip as Sense
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status

MET = 1e-13  # how closely pure stick or slip has to meet a given speed or torque: rounding in stretch and in b1 R
FINE, FINELY = 96, 1e-10  # intervals, and end of Newton's iteration, for the capacity
NEARLY = 0.95  # of the contact slides before sliding turns next to the run-off, in the first guess
LEAST = 1e-3  # part of the stick zone, at least, that sticks or slides in the first guess
MOST_PLACES = 12  # of the transition that are tried one after another


def driven(run: Run) -> State:
    """An answer for a given speed or torque.

    Raises:
        Stopped: There is none, or the torque is beyond what friction can transmit.
    """
    stick = limit(run, RUN_OFF, "forward")
    return _from_stick(run, stick) or _searched(run, stick)


def _from_stick(run: Run, stick: State) -> State | None:
    """An answer from pure stick, if a part of its stick zone is to slide."""
    if STICK not in stick.order.senses:
        return None
    sense, i = _sense(run, stick), stick.order.senses.index(STICK)
    borders = stick.problem.borders(stick.discrete.p)[1:-1]
    ends = _ends(run, stick, i, sense)
    if ends[0] <= borders[i]:
        return None
    order = Order((*stick.order.senses[:i], STICK, sense, -sense)[: i + 1 + len(ends)])
    problem = pose(run.scene, order)
    start = divided(stick.problem, stick.discrete, problem, np.array([*borders[: i + 1], *ends, borders[-1]]))
    return _tried(run, State(order, problem, start), "pure stick")


def _ends(run: Run, stick: State, i: int, sense: int) -> list[float]:
    """Where the stick zone ``i`` of pure stick about ends under the given drive, and where sliding turns if it does.

    Sliding adds the difference of its friction and that of stick to the tension. The pressure grows with the tension,
    and the stretch before the transition gives way, since the belt's length does not change.
    """
    problem, discrete = stick.problem, stick.discrete
    fine = discrete.finer(FINER)
    parts = problem.parts(discrete.between(fine), discrete.p)[i + 1 : -1]
    borders = problem.borders(discrete.p)[i + 1 : -1]
    inside = places(discrete.widths, fine)[i + 1 : -1]
    sigma = np.concatenate([a + (b - a) * part for (a, b), part in zip(pairwise(borders), inside, strict=True)])
    pressure, friction = np.concatenate([zone.tractions(problem.rod, y, c) for zone, y, c in parts], axis=1)
    held = np.concatenate([Stick().tractions(problem.rod, y[:3], [zone.stretch(y, c)])[1] for zone, y, c in parts])
    slip, strain = sense * run.scene.pulleys[0].friction * pressure, grip(problem, discrete)[0] - 1.0
    # Where friction cannot hold the stretch, it comes back to that in stick, and sliding turns.
    apart = sense * _integral(slip + held, sigma)
    peak = int(np.argmax(apart))
    back = np.interp(-apart, -apart[peak:], sigma[peak:])
    # From here on, all is for a transition at each of the nodes.
    growth = np.exp(_integral(slip / strain, sigma))
    tension = _integral((slip + friction) * growth, sigma)
    whole = _integral(tension, sigma)
    behind = (np.interp(back, sigma, tension) - tension) / growth
    mean = (np.interp(back, sigma, whole) - whole - tension * (back - sigma)) / growth + (0.5 - back) * behind
    ahead = _ahead(run, stick)
    change = -mean if run.scene.pulleys[0].drive.kind == "omega" else behind
    change *= math.copysign(1.0, ahead) / (1.0 + mean / strain)
    end = float(np.interp(-abs(ahead), -change[: fine.size], sigma[: fine.size]))
    if end > borders[0]:
        least = LEAST * (borders[1] - borders[0])
        end = min(max(end, borders[0] + least), borders[1] - least)
    turn = float(np.interp(end, sigma, back))
    return [end, turn] if turn < sigma[-1] else [end]


def _integral(values: Array, sigma: Array) -> Array:
    """Integral from the first node to each of them."""
    return cumulative_trapezoid(values, sigma, initial=0.0)


def _tried(run: Run, start: State, name: str) -> State | None:
    """An answer from a first guess; None where there is none."""
    state = run.converged(start, name)
    run.stages.ran(name, f"no plausible solution yet; now {state.order}", state.discrete.iterations)
    if state.plausible and answers(run, state := ordered(run, state)):
        run.stages.skipped("search", "the first guess sufficed")
        return state
    return None


def answers(run: Run, state: State, *, doubt: float | None = None) -> bool:
    """Whether a state is plausible, breaks no bound and meets the drive.

    Raises:
        Stopped: The torque is beyond what sliding all along transmits.
    """
    if not state.plausible or not meets(run, state):
        return False
    doubt = state.discrete.doubt if doubt is None else doubt
    return not (run.find_zones and revision(state.problem, state.order, state.discrete, run.scene.pulleys[0], doubt))


def meets(run: Run, state: State) -> bool:
    """Whether a state meets the drive, even if its order has no transition that the drive could place.

    Raises:
        Stopped: The torque is beyond what sliding all along transmits.
    """
    pulley, sense = run.scene.pulleys[0], state.order.senses[0]
    if pulley.drive.kind == "x_trans" or pulley.friction == 0.0 or state.order.transition is not None:
        return True
    ahead = sense * _ahead(run, state)
    if sense == STICK:
        return abs(_ahead(run, state)) <= MET
    if ahead <= MET:
        return pulley.drive.kind == "omega" or ahead >= -MET
    if pulley.drive.kind == "torque":
        _check_capacity(run, state)
    return False


def _check_capacity(run: Run, slip: State) -> None:
    """Checks that a torque is not beyond what sliding all along transmits, on a finer mesh.

    Raises:
        Stopped: It is.
    """
    intervals = max(FINE, slip.discrete.mesh.size - 1)
    fine = run.work.newton(slip.problem, slip.discrete.on(slip.problem, intervals), FINELY, "capacity")
    state = replace(slip, discrete=fine)
    if state.plausible and slip.order.senses[0] * _ahead(run, state) > MET:
        capacity = torque(slip.problem, fine)
        excess = 100.0 * (run.scene.pulleys[0].torque / capacity - 1.0)
        raise Stopped(
            Status.CAPACITY_EXCEEDED,
            f"Sliding all along, the belt transmits {capacity * run.units.of(length=1, force=1):.6g} N m, which the "
            f"given torque exceeds by {excess:.3g} %.",
            final=True,
        )


def _ahead(run: Run, state: State) -> float:
    """By how much a state's speed or torque falls short of the given one, in units of stretch and of b1 R."""
    pulley = run.scene.pulleys[0]
    if pulley.drive.kind == "omega":
        return pulley.radius * pulley.omega - grip(state.problem, state.discrete)[0]
    return (pulley.torque - torque(state.problem, state.discrete)) / pulley.radius


def _sense(run: Run, stick: State) -> int:
    """Sense of the sliding that a drive asks for, from pure stick."""
    return 1 if (_ahead(run, stick) < 0.0) == (run.scene.pulleys[0].drive.kind == "omega") else -1


def _searched(run: Run, stick: State) -> State:
    """An answer from solutions whose transition is placed, between pure stick and pure slip."""
    sense: Sense = "forward" if _sense(run, stick) > 0 else "backward"
    slip = limit(run, RUN_UP, sense, stick)
    if meets(run, slip):
        return slip
    ends = [[grip(stick.problem, stick.discrete)[1], _ahead(run, stick)], [earliest(slip), _ahead(run, slip)]]
    if ends[1][0] != grip(slip.problem, slip.discrete)[1] and (state := _turned(run, slip)):
        return state
    for _ in range(MOST_PLACES):
        (x, ahead), (x_other, ahead_other) = ends
        if abs(x_other - x) <= NOTHING:
            break
        place = x + float(np.clip(ahead / (ahead - ahead_other), 0.05, 0.95)) * (x_other - x)
        search = run.other(driven_by(run.scene, place, sense))
        try:
            near = placed(search, stick)
        except SceneError:
            break
        except Stopped as stopped:
            if stopped.final:
                raise
            break
        problem = pose(run.scene, near.order)
        run.stages.ran("search", f"with the transition at {place:.6g} at first", search.stages.iterations)
        if state := _tried(run, replace(near, problem=problem), "search"):
            return state
        ends[int(_ahead(run, near) * ahead < 0.0)] = [place, _ahead(run, near)]
    raise Stopped(Status.NEWTON_DIVERGED, "No place of the transition was found for the drive.")


def _turned(run: Run, slip: State) -> State | None:
    """An answer next to pure slip, if sliding turns next to the run-off there and nowhere else."""
    if run.scene.pulleys[0].drive.kind == "omega":
        state = ordered(run, slip)
        return state if answers(run, state) else None
    (sense,), (first, last) = slip.order.senses, slip.problem.borders(slip.discrete.p)[1:-1]
    order = Order((sense, -sense))
    problem = pose(run.scene, order)
    borders = np.array([first, (1.0 - NEARLY) * first + NEARLY * last, last])
    start = divided(slip.problem, slip.discrete, problem, borders)
    return _tried(run, State(order, problem, start), "pure slip")
