"""The belt as a boundary-value problem, solved by collocation: an independent check without finite elements.

Each zone of the belt has its own ordinary differential equations (section 18.3, `bvp_zones`), and each is mapped to
[0, 1] (`bvp_problem`). The unknown constants are the borders of the zones, the stretch in stick and the forces in the
free spans. With these forces the source's nineteen equations are fifteen: two of the six in each free span are
integrated by hand, which makes the collocation's matrices smaller and keeps the force constant to rounding.

1. A taut string on a coarse mesh is the first guess (`bvp_guess`), with stick and then slip. Where Newton's iteration
   does not find an answer from it, it goes there in steps: from a belt that bends more easily, which is more like a
   string, or from one that bends less easily, whose layers are wider.
2. Where a bound of friction breaks, the order of the zones changes (`bvp_order`), one zone at a time. A new border
   starts where the solution before breaks the bound.
3. Finer meshes then make the answer as accurate as wanted (`bvp_collocation`), and the order is reviewed once more.
"""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any

import numpy as np

from belt_fenicsx.bvp.coarse import Run, State, left, ordered, placed
from belt_fenicsx.bvp.drive import answers, driven, meets
from belt_fenicsx.bvp.guess import from_fields
from belt_fenicsx.bvp.newton import CLOSER, COARSE, DOUBT, Refined, refined
from belt_fenicsx.bvp.order import STICK, Order, asked, pose
from belt_fenicsx.bvp.reading import FIELDS, answer, changes, field_errors, plausible, seen
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.certificate import certified
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status

METHOD = "bvp"
MESHES = (COARSE, 8 * COARSE)  # on which the order of the zones is found
TOLERANCE = 1e-7  # of the certificate, at least
CAREFUL = 1e-8  # relative accuracy with which a scene is refused
FIELD, FINEST_FIELD = 1e4, 1e-8  # error of a field that is allowed, over that of omega, and at least


def solve(
    scene: Scene,
    *,
    rtol: float = 1e-8,
    comm: Any = None,
    find_zones: bool = True,
    initial: Solution | None = None,
) -> Solution:
    """Solves a scene.

    Meshes are refined until two things are as accurate as wanted. The first is the angular velocity, relatively; where
    it is given, it is the torque instead, relative to the radius times the tension before the pulley. Its error is the
    solution's ``error_estimate``. The second is each field, relative to its largest value: its error may be 1e4 times
    as large as the first, but need not be below 1e-8.

    Args:
        scene: The scene.
        rtol: Wanted relative accuracy of the angular velocity, from 1e-13 to 0.1 [-].
        comm: Not used: each rank solves all of a scene, to the same numbers.
        find_zones: Whether the order of the zones may change from the one that the scene asks for.
        initial: A solution by any method from which to start.

    Returns:
        The solution, or what there is of it, as its status says.

    Raises:
        SceneError: The transition lies where stick cannot end.
    """
    solution = _certified(scene, rtol, find_zones, initial)
    if solution.status is Status.NOT_ADMISSIBLE and rtol > CAREFUL:
        # A mesh that is fine enough for the wanted accuracy may be too coarse for the certificate.
        solution = _certified(scene, CAREFUL, find_zones, initial)
    return solution


def _certified(scene: Scene, rtol: float, find_zones: bool, initial: Solution | None) -> Solution:
    """The solution with its certificate, or what there is of it."""
    # A step too far may leave the equations' domain; what it leaves there is judged by its residual.
    with np.errstate(all="ignore"):
        solution = _solve(scene, rtol, find_zones, initial)
    if solution.fields is not None:
        solution = certified(solution, tolerance=max(TOLERANCE, rtol))
        if solution.status is Status.NOT_ADMISSIBLE:
            solution = replace(solution, message=seen(solution))
    return solution


def _solve(scene: Scene, rtol: float, find_zones: bool, initial: Solution | None) -> Solution:
    dimensionless, units = scene.dimensionless()
    run, pulley = Run(dimensionless, units, find_zones), dimensionless.pulleys[0]
    solution = Solution(scene=scene, method=METHOD, status=Status.SOLVED)
    try:
        if pulley.friction == 0.0 and pulley.torque:
            raise Stopped(Status.CAPACITY_EXCEEDED, "Without friction, the belt transmits 0 N m.")
        state, end = _found(run, initial, rtol)
        contact, zones, fields = answer(state.problem, dimensionless, end.discrete, pulley.omega)
        solution = replace(
            solution,
            contacts=(contact,),
            zones=zones,
            fields=fields,
            error_estimate=float(end.errors[0]),
            field_errors=field_errors(end.errors[1:]),
            measures={"residual": end.discrete.residual},
            state=state,
        ).in_units(scene, units)
        if not end.reached:
            solution = replace(solution, status=Status.ACCURACY_NOT_REACHED, message=_missed(run, end, rtol))
    except Stopped as stopped:
        solution = replace(solution, status=stopped.status, message=stopped.message)
    return replace(solution, stages=tuple(run.stages), iterations=run.stages.iterations)


def _missed(run: Run, end: Refined, rtol: float) -> str:
    """What is less accurate than wanted."""
    asked_for = "the torque" if run.scene.pulleys[0].drive.kind == "omega" else "omega"
    worst = int(np.argmax(end.errors / _wanted(rtol)))
    return (
        f"On {end.discrete.mesh.size - 1} intervals, {(asked_for, *FIELDS)[worst]} has a relative error of "
        f"{end.errors[worst]:.1g}, {_wanted(rtol)[worst]:.1g} is wanted. Give a larger `rtol`."
    )


def _wanted(rtol: float) -> np.ndarray:
    """Errors that are allowed: of omega or the torque, and of each of the fields."""
    return np.array([rtol, *[max(FIELD * rtol, FINEST_FIELD)] * len(FIELDS)])


def _found(run: Run, initial: Solution | None, rtol: float) -> tuple[State, Refined]:
    """The answer on the finest mesh that it needs.

    With little friction, all admissible speeds may lie closer together than those of coarse and fine meshes do; next
    to pure stick and pure slip, so may speeds and torques of other zones.
    """
    found = None
    for intervals in MESHES:
        run.intervals = intervals
        try:
            found = _refined(run, _warm(run, initial) or _cold(run), rtol)
        except Stopped as stopped:
            diverged = stopped.status is Status.NEWTON_DIVERGED
            if not diverged or (found is None and (stopped.final or intervals == MESHES[-1])):
                raise
        else:
            if answers(run, found[0], doubt=0.0):
                return found
    # What the first mesh showed may say why there is no answer.
    if found[0].plausible and not meets(run, found[0]):
        order = found[0].order
        raise Stopped(Status.NEWTON_DIVERGED, f"The finest mesh leaves {order}, which does not meet the drive.")
    return found


def _warm(run: Run, initial: Solution | None) -> State | None:
    """An answer on the coarse mesh from a given one; None where there is none."""
    pulley = run.scene.pulleys[0]
    near = None if initial is None else _near(run, initial)
    if near is None or (pulley.drive.kind == "x_trans" and not _asked_for(asked(pulley), near.order)):
        run.stages.skipped("warm start", "no solution with the same zones was given")
        return None
    coarse = run.converged(near, "warm start")
    run.stages.ran("warm start", "from the given solution", coarse.discrete.iterations)
    state = ordered(run, coarse)
    if not answers(run, state):
        return None
    run.stages.skipped("taut string", "the warm start sufficed")
    run.stages.skipped("continuation", "the warm start sufficed")
    return state


def _near(run: Run, initial: Solution) -> State | None:
    """A given solution as a first guess on the coarse mesh; None where it has no contact."""
    if isinstance(initial.state, State):
        order = initial.state.order
        problem = pose(run.scene, order)
        return State(order, problem, initial.state.discrete.on(problem, run.intervals))
    if initial.fields is None or not initial.contacts:
        return None
    order = Order.of(initial.zones)
    problem = pose(run.scene, order)
    return State(order, problem, from_fields(problem, initial, run.intervals))


def _asked_for(wanted: Order, order: Order) -> bool:
    """Whether an order that was found is one that was asked for, up to sliding where Coulomb's bound breaks."""
    if wanted.transition is None or order.transition is None or order.longest:
        return wanted.transition is None and (wanted == order or (order.longest and wanted.senses == (STICK,)))
    return wanted.senses[1] == order.senses[order.transition + 1]


def _cold(run: Run) -> State:
    """An answer on the coarse mesh, from the taut string."""
    pulley = run.scene.pulleys[0]
    return placed(run) if pulley.drive.kind == "x_trans" or pulley.friction == 0.0 else driven(run)


def _refined(run: Run, state: State, rtol: float) -> tuple[State, Refined]:
    """The answer as accurate as wanted."""
    change = functools.partial(changes, run.scene)
    # Next to pure stick and pure slip, a given speed or torque is met by all digits only.
    closer = CLOSER if run.scene.pulleys[0].drive.kind == "x_trans" else 0.0
    while True:
        end = refined(state.problem, state.discrete, change, _wanted(rtol), run.work, closer=closer)
        fine = end.discrete
        run.stages.ran("refinement", f"to {fine.mesh.size - 1} intervals in each zone", end.iterations)
        if not fine.converged:
            raise Stopped(Status.NEWTON_DIVERGED, f"The finest mesh leaves {left(fine)}.")
        state = replace(state, discrete=fine)
        # What the first mesh left in doubt shows here.
        calm = plausible(state.problem, fine, DOUBT) and meets(run, state)
        reviewed = ordered(run, state, doubt=0.0) if calm else state
        if reviewed.order == state.order or not reviewed.plausible:
            return state, end
        state = reviewed
