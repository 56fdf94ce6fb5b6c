"""The default method: finite elements whose nodes move with the borders of the zones.

1. Start from the taut string over the pulley, or from another solution (`start`).
2. Newton's iteration with elements of the lowest degree, on few cells graded by the belt's layers. Unknowns are the
   fields, the borders of the zones and the stretch in stick, all at once.
3. Raise the degree, for which one Newton step each is enough, until the angular velocity is known; where no degree
   suffices, with twice as many cells.
4. On the way, where Coulomb's bound breaks in stick or sliding has the wrong sense, change the zones
   (`order`).

The fields are smooth inside of each zone, so that the error falls by the same factor from each degree to the next. To
be exact, it does so in two sequences: among the odd degrees the error may change its sign, and then be small by
accident; among the even ones it falls steadily. So all degrees are even, and a part of what the last one changes is an
estimate of the error that it leaves.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from mpi4py import MPI

from belt_fenicsx.fitted.accuracy import change_of_pressure, error_of_known, errors_of_fields, rounding
from belt_fenicsx.fitted.elimination import local
from belt_fenicsx.fitted.newton import newton
from belt_fenicsx.fitted.order import calm, change
from belt_fenicsx.fitted.reading import answer, fields_at
from belt_fenicsx.fitted.start import ARRIVED, LOWEST, METHOD, NEGATIVE, WARM, Run, Start, meets, starts
from belt_fenicsx.fitted.state import State
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.pulley import RUN_UP, Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.certificate import certified
from belt_fenicsx.solution.solution import Solution, Status
from belt_fenicsx.solution.stages import Stopped

HIGHEST = 14
LAST = {1e-6: 6, 1e-8: 8, 1e-10: 10, 0.0: 12}  # the degree, by the rtol that it mostly reaches
CLOSE = 3e-4  # largest step of a border, in lengths of the shortest cell, after which the error is that of the degree
# Belt lengths, of a cell. One step from the degree before leaves an error of second order in what the degree changes in
# a layer. Where layers are thin, it can be as large as what the degree leaves.
SHORT = 0.012
BREACH = 1e-3  # of a bound, relative to its largest value, that a coarse state may show by its error, at least
COARSEST = 1e-2  # error of the pressure, relative to the largest, with which a state is judged
TOLERANCE = 1e-6  # of the certificate; what low degrees leave of the inequalities stays below a tenth of it
MOST_CHANGES = 6  # of the order of zones
UNFINISHED = (Status.NEWTON_DIVERGED, Status.NOT_ADMISSIBLE)  # from another start, there may be an answer


def solve(
    scene: Scene,
    *,
    rtol: float = 1e-8,
    elements: int | None = None,
    degree: int | None = None,
    comm: MPI.Comm | None = None,
    options: Mapping[str, Any] = MappingProxyType({}),
    initial: Solution | None = None,
) -> Solution:
    """Solves a scene by finite elements whose nodes move with the borders of the zones.

    Args:
        scene: The scene.
        rtol: Wanted relative accuracy of the angular velocity [-].
        elements: Number of elements; by default, as many as the belt's layers call for.
        degree: Degree of the elements, even and at least 6; by default, rising until the error estimate is below
            ``rtol``.
        comm: Not used: a scene is so small that each rank solves all of it, to the same numbers.
        options: PETSc options of Newton's iteration, without their prefix ``belt_``.
        initial: A solution from which to start.

    Returns:
        The solution, or what there is of it, as its status says; its error estimate is that of the angular velocity.
        Where that is given, it is that of the moment, as the stretch that it makes in a string.

    Raises:
        SceneError: The transition lies outside of the contact, or the degree cannot be meant.
    """
    if degree is not None and (degree <= LOWEST or degree % 2):
        raise SceneError("degree", f"be even and at least {LOWEST + 2}", degree)
    run = Run(scene, *scene.dimensionless(), elements, newton(tuple(options.items())))
    solution = solved(run, starts(run, initial), rtol, degree)
    if solution.status is Status.CAPACITY_EXCEEDED and not exceeds_capacity(scene):
        solution = replace(solution, status=Status.NEWTON_DIVERGED, message="Sliding all along is not admissible.")
    return solution


def exceeds_capacity(scene: Scene) -> bool:
    """Whether a torque is beyond that of sliding all along, which has to be admissible itself."""
    pulley = scene.pulleys[0]
    sliding: Slip = "forward" if pulley.torque > 0.0 else "backward"
    limit = replace(pulley, torque=None, x_trans=RUN_UP, slip=sliding)
    if pulley.friction == 0.0:
        return True
    solution = solve(replace(scene, pulleys=(limit,)))
    return solution.success and abs(pulley.torque) > abs(solution.contacts[0].torque)


def solved(run: Run, ways: Sequence[Start], rtol: float, degree: int | None) -> Solution:
    """The solution with its certificate, or what there is of it, by the first of several ways to start.

    Raises:
        SceneError: The transition lies outside of the contact.
    """
    scene = run.asked
    try:
        result = found(run, ways, rtol, degree)
    except Stopped as stopped:
        return _ended(run, status=stopped.status, message=stopped.message)
    missed = "" if degree is not None else result.missed(rtol)
    found_there = answer(run.scene, result.state)
    run.stages.ran("answer", "fields between the nodes")
    solution = _ended(
        run,
        status=Status.ACCURACY_NOT_REACHED if missed else Status.SOLVED,
        message=missed,
        error_estimate=result.error,
        field_errors=result.errors_of_fields,
        measures={"change of p": result.change_of_p},
        state=result.state,
        evaluator=functools.partial(fields_at, run.scene, result.state),
        **found_there,
    ).in_units(scene, run.units)
    return certified(solution, tolerance=TOLERANCE)


def _ended(run: Run, **what_there_is: Any) -> Solution:
    stages = run.stages
    return Solution(scene=run.asked, method=METHOD, stages=tuple(stages), iterations=stages.iterations, **what_there_is)


@dataclass(frozen=True)
class Result:
    """A state and how far it is from the exact answer.

    Attributes:
        state: The state.
        error: Estimated relative error of its angular velocity.
        errors_of_fields: Those of its fields, relative to their largest values.
        change_of_p: Largest change of its pressure by the last degree, relative to the largest pressure.
    """

    state: State
    error: float
    errors_of_fields: Mapping[str, float]
    change_of_p: float

    def missed(self, rtol: float) -> str:
        """What is not as accurate as wanted; empty where all is."""
        if self.error > rtol:
            return f"The angular velocity is known to {self.error:.1g} of itself, {rtol:.1g} was asked for."
        worst = max(self.errors_of_fields, key=lambda name: self.errors_of_fields[name])
        if self.errors_of_fields[worst] > of_fields(rtol):
            reached = f"{self.errors_of_fields[worst]:.1g} of its largest value"
            return f"The field {worst} is known to {reached}, {of_fields(rtol):.1g} goes with rtol {rtol:.1g}."
        return ""


def of_fields(rtol: float) -> float:
    """Accuracy of the fields, relative to their largest values, that goes with one of the angular velocity.

    Energy methods know a functional to about the square of the error of their fields.
    """
    return math.sqrt(rtol)


def found(run: Run, ways: Sequence[Start], rtol: float, degree: int | None) -> Result:
    """The result that `raised` gives back, with twice as many cells where no degree suffices.

    Raises:
        Stopped: There is none.
    """
    failure = None
    for start in ways:
        try:
            result = raised(run, start(run), rtol, degree)
            if not meets(run, result.state):
                continue
            if degree is None and result.missed(rtol) and rtol > rounding(run.scene, result.state):
                # Shorter cells do not help against rounding, and may lead nowhere; then what there is has to do.
                try:
                    better = raised(run, finer(run, result.state), rtol, degree)
                except Stopped as stopped:
                    run.stages.skipped("more cells", str(stopped))
                else:
                    result = result if better.missed(rtol) else better
            return result
        except Stopped as stopped:
            if stopped.status not in UNFINISHED:
                raise
            # That contact is not one arc says more than that there was no convergence.
            failure = stopped if failure is None or stopped.status is Status.NOT_ADMISSIBLE else failure
    raise failure or Stopped(Status.NEWTON_DIVERGED, "No zones meet the drive.")


def raised(run: Run, state: State, rtol: float, degree: int | None) -> Result:
    """Raises the degree until the angular velocity and the fields are known, the latter well enough to judge by them.

    Raises:
        Stopped: There is none.
    """
    last = degree or next(last for reach, last in LAST.items() if rtol >= reach)
    judged, change_before = False, 0.0
    lowest = min(state.degree + 2, degree or HIGHEST)
    for k in range(lowest, (degree or HIGHEST) + 1, 2):
        before, start = state, state.of_degree(k)
        state = run.newton(start, "the degree before", arrived=CLOSE if k >= last else ARRIVED)
        if k > lowest and state.length.min() < SHORT:
            state = run.newton(state, "short cells, in which one step is not enough", arrived=CLOSE)
        if (p := state.values[:, local(k).p]).min() < -NEGATIVE * p.max():
            raise Stopped(Status.NOT_ADMISSIBLE, _lifted(run, state))
        change = change_of_pressure(start, state)
        error, errors = error_of_known(run.scene, before, start, state, change, change_before), {}
        known = error <= max(rtol, rounding(run.scene, state)) and change <= COARSEST
        if known or k >= (degree or HIGHEST):
            errors = errors_of_fields(run.scene, before, state, change, change_before)
            known = known and max(errors.values()) <= of_fields(rtol)
        final = k >= last and (known or k == degree)
        early = (k == lowest or (change <= COARSEST and not judged)) and (k >= last or not calm(run.scene, state))
        change_before = change
        if early or (final and k < (degree or HIGHEST)):
            judged, zones = change <= COARSEST, state.mesh.layout
            try:
                state = reviewed(run, state, max(TOLERANCE if final else BREACH, change))
            except Stopped:
                # Other zones are not found where friction is known too coarsely: a higher degree goes on from the same.
                continue
            if state.mesh.layout != zones:
                # What is known of the error is that of other zones.
                change_before, error = 0.0, math.inf
                continue
        if final:
            break
    return Result(state, error, errors, change)


def _lifted(run: Run, state: State) -> str:
    """What negative pressure inside of the contact means."""
    dense = state.dense
    x = float(dense.r.real.flat[np.argmin(dense.p)]) * run.units.length
    return (
        f"The pressure is negative at x = {x:.6g} m: the belt would lift off there, and contact is not one arc; "
        "or this is another root of the equations."
    )


def reviewed(run: Run, state: State, error: float) -> State:
    """The state with the zones that Coulomb's law calls for."""
    for _ in range(MOST_CHANGES):
        called = change(run.scene, state, error)
        if called is None:
            run.stages.skipped("other zones", "Coulomb's bound holds in stick, and the sense of sliding in slip")
            return state
        state = run.on(called.zones, called.ends, state, called.why, degree=state.degree)
    return state


def finer(run: Run, state: State) -> State:
    """The same zones with twice as many cells, at a low degree."""
    run.elements = 2 * len(state.cells)
    return run.on(state.mesh.layout, state.ends, state, "an error that no degree made small enough", degree=WARM[0])
