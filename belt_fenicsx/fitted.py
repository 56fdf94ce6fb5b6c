"""The default method: finite elements whose nodes move with the borders of the zones.

1. Start from the taut string over the pulley, or from another solution.
2. Newton's iteration with elements of the lowest degree, on few cells graded by the belt's layers. Unknowns are the
   fields, the borders of the zones and the stretch in stick, all at once.
3. Raise the degree, for which one Newton step each is enough, until the angular velocity is known.
4. Where friction in stick then breaks Coulomb's bound at the run-up, the belt slides there first: add that zone.

The fields are smooth inside of each zone, so that the error falls by a factor of ten from one degree to the next, on
the average. It falls more from even to odd degrees than from odd to even ones. So the last degree is an odd one, and
what it changes is an estimate from above of the error that it leaves.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from belt_fenicsx.certificate import certified, check_transition
from belt_fenicsx.condensed import local
from belt_fenicsx.fitted_newton import newton
from belt_fenicsx.fitted_state import State, answer, entry_sliding, from_state, from_string
from belt_fenicsx.scene import RUN_OFF, Scene, SceneError
from belt_fenicsx.solution import Solution, Stage, Status, finish
from belt_fenicsx.taut_string import taut_string
from belt_fenicsx.zones import entered_sliding, posed

METHOD = "fitted"
LOWEST = 3
PAIRS = {1e-6: (4, 5), 1e-8: (6, 7), 1e-10: (8, 9), 3e-12: (10, 11), 0.0: (12, 13)}  # by the rtol they mostly reach
ARRIVED = 1e-3  # largest step of the borders, in belt lengths, and of the stretch, after which the degree may rise


class Diverged(RuntimeError):
    """Newton's iteration did not converge; the message says where."""


@dataclass
class Run:
    """A solve that is under way.

    Attributes:
        asked: The scene, in its own units.
        scene: The dimensionless scene.
        length: The unit of length of the latter [m].
        options: PETSc options.
        stages: What was done so far.
        since: When the last stage ended.
    """

    asked: Scene
    scene: Scene
    length: float
    options: tuple[tuple[str, Any], ...] = ()
    stages: list[Stage] = field(default_factory=list)
    since: float = field(default_factory=time.perf_counter)

    def ran(self, name: str, why: str, iterations: int = 0) -> None:
        """Adds a stage that has just ended."""
        now = time.perf_counter()
        self.stages.append(Stage(name=name, why=why, iterations=iterations, seconds=now - self.since))
        self.since = now

    def skipped(self, name: str, why: str) -> None:
        """Adds a stage that the scene did not need."""
        self.stages.append(Stage(name=name, why=why))

    def newton(self, state: State, why: str, *, arrived: float = ARRIVED) -> State:
        """Newton's iteration from a state, with elements of its degree."""
        friction = self.scene.pulleys[0].friction > 0.0
        result, iterations = newton(state.mesh, state.degree, friction, self.options).solve(self.scene, state, arrived)
        self.ran(f"degree {state.degree}", why, abs(iterations))
        if iterations <= 0:
            raise Diverged(f"At degree {state.degree}, after {-iterations} iterations from {why}.")
        return result


def solve(
    scene: Scene,
    *,
    rtol: float = 1e-8,
    elements: int | None = None,
    degree: int | None = None,
    comm: MPI.Comm | None = None,
    options: Mapping[str, Any] | None = None,
    initial: Solution | None = None,
    throw: bool = True,
) -> Solution:
    """Solves a scene by finite elements whose nodes move with the borders of the zones.

    Args:
        scene: The scene.
        rtol: Wanted relative accuracy of the angular velocity [-].
        elements: Number of elements; by default, as many as the belt's layers call for.
        degree: Degree of the elements, at least 4; by default, rising until the error estimate is below ``rtol``.
        comm: Not used: a scene is so small that each rank solves all of it, to the same numbers.
        options: PETSc options of Newton's iteration, without their prefix ``belt_``.
        initial: A solution by this method from which to start.
        throw: Whether to raise where there is no admissible answer, instead of returning what there is.

    Returns:
        The solution; its error estimate is that of the angular velocity, or of the moment where that is given.

    Raises:
        SceneError: The transition lies outside of the contact, or an argument cannot be meant.
        SolveError: There is no admissible answer and ``throw`` is true.
    """
    if degree is not None and degree <= LOWEST:
        raise SceneError("degree", f"be at least {LOWEST + 1}", degree)
    if (torque := scene.pulleys[0].torque) is not None:
        raise SceneError("pulleys.0.torque", "be left out: not available yet; give `x_trans` or `omega`", torque)
    dimensionless, units = scene.dimensionless()
    run = Run(scene, dimensionless, units.length, tuple(sorted((options or {}).items())))
    solution = Solution(scene=scene, method=METHOD, status=Status.SOLVED)
    tolerance = 0.0
    try:
        state = arrived(run, initial, elements)
        if state is None:
            message = "The straight belt is clear of the pulley."
            return finish(replace(solution, status=Status.CONTACT_LOST, message=message), throw=throw)
        state, estimate, tolerance = raised(run, state, rtol, elements, degree)
        solution = replace(
            solution,
            error_estimate=estimate,
            measures={"change of p": tolerance},
            state=state,
            **answer(dimensionless, state),
        ).in_units(scene, units)
        run.ran("answer", "fields between the nodes")
    except Diverged as diverged:
        solution = replace(solution, status=Status.NEWTON_DIVERGED, message=str(diverged))
    iterations = sum(stage.iterations or 0 for stage in run.stages)
    solution = replace(solution, stages=tuple(run.stages), iterations=iterations)
    if solution.status is Status.SOLVED:
        check_transition(scene, solution.contacts[0].x_up, solution.contacts[0].x_off)
        solution = certified(solution, tolerance=min(max(tolerance, 1e-9), 1e-3))
    if not solution.success:
        explain(run, elements)
    return finish(solution, throw=throw)


def explain(run: Run, elements: int | None) -> None:
    """Looks for a reason of a failure in the scene.

    Raises:
        SceneError: There is one.
    """
    try:
        in_pure_stick(run, elements)
    except Diverged:
        pass


def arrived(run: Run, initial: Solution | None, elements: int | None) -> State | None:
    """The state of the lowest degree with the zones that the scene asks for, or None without contact."""
    if run.scene.pulleys[0].drive == "omega":
        return from_pure_stick(run, elements)
    zones = posed(run.scene)
    if initial is not None and isinstance(initial.state, State) and initial.state.mesh.zones == zones:
        start = from_state(run.scene, initial.state, zones, initial.state.ends, LOWEST, elements)
        try:
            state = run.newton(start, "the given solution")
        except Diverged:
            pass
        else:
            run.skipped("taut string", "a solution was given to start from")
            return state
    string = taut_string(run.scene)
    if string is None:
        return None
    start = from_string(run.scene, string, zones, LOWEST, elements)
    run.ran("taut string", "first guess")
    try:
        return run.newton(start, "the taut string")
    except Diverged:
        if len(zones.parts) == 3:
            raise
    return from_pure_stick(run, elements)


def from_pure_stick(run: Run, elements: int | None) -> State | None:
    """The state of the lowest degree, by way of the belt that sticks all along the contact.

    It has one border less to be found, shows where the contact is, and says in which sense the belt slides at a given
    angular velocity: forward on a slower pulley.

    Raises:
        SceneError: The transition lies outside of the contact.
    """
    pulley, stick = run.scene.pulleys[0], in_pure_stick(run, elements)
    if stick is None:
        return None
    left, up, off, right = stick.ends
    if pulley.drive == "omega":
        slip = "forward" if pulley.omega * pulley.radius < stick.D_stick else "backward"
        place = (up + off) / 2
    else:
        slip, place = pulley.slip, np.interp(pulley.x_trans, *stick.nodes.T[::-1])
    ends = np.array([left, up, place, off, right])
    start = from_state(run.scene, stick, posed(run.scene, slip), ends, LOWEST, elements)
    return run.newton(start, "the belt in pure stick")


def in_pure_stick(run: Run, elements: int | None) -> State | None:
    """The state of the lowest degree of the belt that sticks all along the contact, or None without contact.

    Raises:
        SceneError: The scene's transition lies outside of this contact.
    """
    pulley = replace(run.scene.pulleys[0], omega=None, x_trans=RUN_OFF)
    stick = arrived(replace(run, scene=replace(run.scene, pulleys=(pulley,))), None, elements)
    if stick is not None:
        check_transition(run.asked, *(np.interp(stick.ends[1:3], *stick.nodes.T) * run.length))
    return stick


def slid_in(run: Run, state: State, elements: int | None) -> State:
    """The state with a sliding zone in front of stick, where it needs one."""
    if (entry := entry_sliding(run.scene, state)) is None:
        run.skipped("entry sliding", "Coulomb's bound holds at the run-up")
        return state
    place, slip = entry
    zones, ends = entered_sliding(state.mesh.zones, slip), np.insert(state.ends, 2, place)
    start = from_state(run.scene, state, zones, ends, state.degree, elements)
    return run.newton(start, "zones without sliding at the run-up, which break Coulomb's bound there")


def raised(run: Run, state: State, rtol: float, elements: int | None, degree: int | None) -> tuple[State, float, float]:
    """Raises the degree until the angular velocity is known.

    Returns:
        The state, the estimated relative error of its angular velocity, and the largest change of its pressure by the
        last degree, relative to the largest pressure.
    """
    pairs = list(PAIRS.values())
    first = next(index for index, reach in enumerate(PAIRS) if rtol >= reach)
    on_the_way = [even for even, _ in pairs[:first] if even % 4 == 2]
    degrees = [k for pair in pairs[first:] for k in pair]
    if degree is not None:
        on_the_way, degrees = [k for k, _ in pairs if k < degree - 1], [degree - 1, degree]
    for k in on_the_way:
        state = run.newton(state.of_degree(k), "the degree before")
    close = min(ARRIVED, math.sqrt(rtol) / 3)
    estimate = change = math.inf
    for even, odd in zip(degrees[::2], degrees[1::2], strict=True):
        coarse = run.newton(state.of_degree(even), "the degree before")
        if even == degrees[0]:
            coarse = slid_in(run, coarse, elements)
        start = coarse.of_degree(odd)
        state = run.newton(start, "the degree before", arrived=close)
        p, p_start = (s.values[:, local(odd).p] for s in (state, start))
        change = float(np.abs(p - p_start).max() / p.max())
        moved = abs(1.0 - _known(run.scene, coarse) / _known(run.scene, state))
        estimate = max(moved, rounding(state))
        if estimate <= rtol:
            break
    return state, estimate, change


def rounding(state: State) -> float:
    """Rounding error of a stretch, which is the slope of positions in a short cell."""
    return float(np.finfo(float).eps * state.degree**2 / np.min(np.diff(state.sigma)))


def _known(scene: Scene, state: State) -> float:
    """What the estimate is of: the angular velocity, or the force of friction where that is given."""
    if scene.pulleys[0].drive != "omega":
        return state.D_stick
    return state.friction_force
