"""The default method: finite elements whose nodes move with the joints of the belt's parts.

1. A coarse state, by the ladder in `guess`: Newton's iteration with elements of the lowest degree, on few cells graded
   by the belt's layers. Unknowns are the fields, the joints and the stretch in stick, all at once. For a given speed or
   torque, it goes by way of pure stick and pure slip (`search.drives`).
2. Raise the degree, for which one Newton step each is enough, until the angular velocity is known (`accuracy`).
3. On the way, where Coulomb's bound breaks in stick or sliding has the wrong sense, other rows (`search.find`).
4. Where no degree suffices, the same with twice as many cells.

The fields are smooth inside of each part, so that the error falls by the same factor from each degree to the next. To
be exact, it does so in two sequences: among the odd degrees the error may change its sign, and then be small by
accident; among the even ones it falls steadily. So all degrees are even, and a part of what the last one changes is an
estimate of the error that it leaves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from mpi4py import MPI

from belt_fenicsx.fitted.accuracy import Accuracy, rounding
from belt_fenicsx.fitted.evaluator import Evaluator
from belt_fenicsx.fitted.guess import LOWEST, METHOD, WARM, Start, ways
from belt_fenicsx.fitted.newton import newton
from belt_fenicsx.fitted.reading import answer
from belt_fenicsx.fitted.run import TOLERANCE, Run
from belt_fenicsx.fitted.state import State
from belt_fenicsx.fitted.transfer import from_fields
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.search.drives import meet_drives
from belt_fenicsx.search.find import find
from belt_fenicsx.search.limits import check_smooth, meets
from belt_fenicsx.solution.certificate import certified
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import UNFINISHED, Status


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
    """Solves a scene by finite elements whose nodes move with the joints of the zones.

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
        Where that is given, it is that of the torque, as the stretch that it makes in a string. Of several pulleys, it
        is the largest one, that of the transport rate and of take-ups, in belt lengths, among them.

    Raises:
        SceneError: The transition lies outside of the contact, or the degree cannot be meant.
    """
    if degree is not None and (degree <= LOWEST or degree % 2):
        raise SceneError("degree", f"be even and at least {LOWEST + 2}", degree)
    run = Run(scene, *scene.dimensionless(), newton(tuple(options.items())), elements, rtol, degree)
    return solved(run, ways(run, initial))


def solved(run: Run, starts: Sequence[Start]) -> Solution:
    """The solution with its certificate, or what there is of it, by the first of several ways to start.

    Raises:
        SceneError: The transition lies outside of the contact.
    """
    scene = run.asked
    try:
        check_smooth(run.scene)
        known = answer_by(run, starts)
    except Stopped as stopped:
        return _ended(run, status=stopped.status, message=stopped.message)
    missed = "" if run.degree is not None else known.missed(run.rtol)
    found_there = answer(run.scene, known.state)
    run.stages.ran("answer", "fields between the nodes")
    solution = _ended(
        run,
        status=Status.ACCURACY_NOT_REACHED if missed else Status.SOLVED,
        message=missed,
        error_estimate=known.error,
        field_errors=known.errors_of_fields,
        measures={"change of p": known.change_of_p, "error of torque": known.error_of_torque},
        state=known.state,
        evaluator=Evaluator(scene, known.state, run.units),
        **found_there,
    ).in_units(scene, run.units)
    doubts = (known.state.doubts * run.units.force).tolist()
    return certified(solution, tolerance=TOLERANCE, doubts=doubts)


def _ended(run: Run, **what_there_is: Any) -> Solution:
    stages = run.stages
    return Solution(scene=run.asked, method=METHOD, stages=tuple(stages), iterations=stages.iterations, **what_there_is)


def answer_by(run: Run, starts: Sequence[Start]) -> Accuracy:
    """The state of the first way that leads to one, and its accuracy.

    Raises:
        Stopped: There is none.
    """
    failure = None
    for start in starts:
        try:
            known = raise_degree(run, start(run))
            if not meets(run, known.state):
                known = raise_degree(run, meet_drives(run, known.state))
            if meets(run, known.state):
                return refine_mesh(run, known)
        except Stopped as stopped:
            if stopped.status not in UNFINISHED:
                raise
            # That contact is not one arc says more than that there was no convergence.
            failure = stopped if failure is None or stopped.status is Status.NOT_ADMISSIBLE else failure
    raise failure or Stopped(Status.NEWTON_DIVERGED, "No zones meet the drive.")


def raise_degree(run: Run, state: State) -> Accuracy:
    """The state on settled rows and of as high a degree as it takes, from a coarse one."""
    way = replace(run, known=None)
    state = find(way, state)
    assert way.known is not None
    return way.known.accuracy.of(state)


def refine_mesh(run: Run, known: Accuracy) -> Accuracy:
    """The same with twice as many cells, where no degree suffices and these do.

    Shorter cells do not help against rounding, and may lead nowhere; then what there is has to do.
    """
    state = known.state
    if run.degree is not None or not known.missed(run.rtol) or run.rtol <= rounding(run.scene, state):
        return known
    finer = replace(run, elements=2 * len(state.cells))
    try:
        start = from_fields(run.scene, state, state.layout, state.ends, WARM[0], finer.elements)
        better = raise_degree(finer, finer.newton(start, "an error that no degree made small enough"))
    except Stopped as stopped:
        run.stages.skipped("more cells", str(stopped))
        return known
    return known if better.missed(run.rtol) else better
