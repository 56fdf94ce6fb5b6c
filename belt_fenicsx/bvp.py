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

from dataclasses import replace

import numpy as np

from belt_fenicsx.bvp_answer import answer, final_stretch, seen, speed
from belt_fenicsx.bvp_coarse import Run, State, left, ordered, placed
from belt_fenicsx.bvp_collocation import COARSE, newton, refined
from belt_fenicsx.bvp_drive import answers, driven, meets
from belt_fenicsx.bvp_order import STICK, Order, asked, pose
from belt_fenicsx.certificate import certified
from belt_fenicsx.scene import Scene, SceneError, number
from belt_fenicsx.solution import Solution, Status, finish
from belt_fenicsx.stages import Stopped
from belt_fenicsx.taut_string import taut_string

METHOD = "bvp"
MESHES = (COARSE, 8 * COARSE)  # on which the order of the zones is found
TOLERANCE = 1e-7  # of the certificate, at least


def solve(
    scene: Scene, *, rtol: float = 1e-8, find_zones: bool = True, initial: Solution | None = None, throw: bool = True
) -> Solution:
    """Solves a scene.

    Args:
        scene: The scene.
        rtol: Wanted relative accuracy of the angular velocity, from 1e-12 to 0.1 [-].
        find_zones: Whether to look for the order of stick and slip that Coulomb's law calls for, instead of taking
            it for one stick zone and one slip zone after it.
        initial: A solution by this method from which to start.
        throw: Whether to raise where there is no admissible answer, instead of returning what there is.

    Returns:
        The solution. Where the angular velocity is given, the estimated error is that of the belt's speed at the
        run-off instead.

    Raises:
        SceneError: The transition lies where stick cannot end, or an argument is out of its range.
        SolveError: There is no admissible answer and ``throw`` is true.
    """
    if not 1e-12 <= number("rtol", rtol, "-") <= 0.1:
        raise SceneError("rtol", "lie in [1e-12, 0.1] [-]", rtol)
    # A step too far may leave the equations' domain; what it leaves there is judged by its residual.
    with np.errstate(all="ignore"):
        solution = _solve(scene, rtol, find_zones, initial.state if initial is not None else None)
    if solution.status is Status.SOLVED:
        solution = certified(solution, tolerance=max(TOLERANCE, rtol))
        if not solution.success:
            solution = replace(solution, message=seen(solution))
    return finish(solution, throw=throw)


def _solve(scene: Scene, rtol: float, find_zones: bool, initial: State | None) -> Solution:
    dimensionless, units = scene.dimensionless()
    run = Run(dimensionless, units, find_zones)
    solution = Solution(scene=scene, method=METHOD, status=Status.SOLVED)
    try:
        _check_contact(dimensionless)
        state, error = _found(run, initial, rtol)
        contact, zones, fields = answer(state.problem, dimensionless, state.discrete, dimensionless.pulleys[0].omega)
        solution = replace(
            solution,
            contacts=(contact,),
            zones=zones,
            fields=fields,
            error_estimate=error,
            measures={"residual": state.discrete.residual},
            state=state,
        ).in_units(scene, units)
    except Stopped as stopped:
        solution = replace(solution, status=stopped.status, message=stopped.message)
    return replace(solution, stages=tuple(run.stages), iterations=run.stages.iterations)


def _check_contact(scene: Scene) -> None:
    """Stops where no belt could be an answer."""
    pulley = scene.pulleys[0]
    if taut_string(scene) is None:
        raise Stopped(Status.NO_CONTACT, "The straight belt is clear of the pulley.")
    if pulley.friction == 0.0 and pulley.torque:
        raise Stopped(Status.CAPACITY_EXCEEDED, "Without friction, the belt transmits 0 N m.")


def _found(run: Run, initial: State | None, rtol: float) -> tuple[State, float]:
    """The answer and its estimated error.

    With little friction, all admissible speeds may lie closer together than those of coarse and fine meshes do; next
    to pure stick and pure slip, so may speeds and torques of other zones.
    """
    meshes = MESHES if run.scene.pulleys[0].drive != "x_trans" else MESHES[:1]
    for intervals in meshes:
        run.intervals = intervals
        try:
            state, error = _refined(run, _warm(run, initial) or _cold(run), rtol)
        except Stopped as stopped:
            if stopped.final or intervals == meshes[-1]:
                raise
        else:
            if answers(run, state):
                break
    if state.plausible and not meets(run, state):
        raise Stopped(Status.NEWTON_DIVERGED, f"The finest mesh leaves {state.order}, which does not meet the drive.")
    return state, error


def _warm(run: Run, initial: State | None) -> State | None:
    """An answer on the coarse mesh from a given one; None where there is none."""
    pulley = run.scene.pulleys[0]
    if initial is None or (pulley.drive == "x_trans" and not _asked_for(asked(pulley), initial.order)):
        run.stages.skipped("warm start", "no solution with the same zones was given")
        return None
    problem = pose(run.scene, initial.order)
    coarse = newton(problem, initial.discrete.on(problem, run.intervals))
    run.stages.ran("warm start", "from the given solution", coarse.iterations)
    state = ordered(run, State(initial.order, problem, coarse))
    if not answers(run, state):
        return None
    run.stages.skipped("taut string", "the warm start sufficed")
    run.stages.skipped("continuation", "the warm start sufficed")
    return state


def _asked_for(wanted: Order, order: Order) -> bool:
    """Whether an order that was found is one that was asked for, up to sliding where Coulomb's bound breaks."""
    if wanted.transition is None or order.transition is None or order.longest:
        return wanted.transition is None and (wanted == order or (order.longest and wanted.senses == (STICK,)))
    return wanted.senses[1] == order.senses[order.transition + 1]


def _cold(run: Run) -> State:
    """An answer on the coarse mesh, from the taut string."""
    pulley = run.scene.pulleys[0]
    return placed(run) if pulley.drive == "x_trans" or pulley.friction == 0.0 else driven(run)


def _refined(run: Run, state: State, rtol: float) -> tuple[State, float]:
    """The answer as accurate as wanted, and its estimated error."""
    functional = final_stretch if run.scene.pulleys[0].drive == "omega" else speed
    while True:
        fine, error, iterations = refined(state.problem, state.discrete, functional, rtol)
        run.stages.ran("refinement", f"to {fine.mesh.size - 1} intervals in each zone", iterations)
        if not (fine.converged and error <= rtol):
            raise Stopped(Status.NEWTON_DIVERGED, f"The finest mesh leaves {left(fine)} and an error of {error:.1g}.")
        state = replace(state, discrete=fine)
        reviewed = ordered(run, state) if state.plausible and meets(run, state) else state
        if reviewed.order == state.order or not reviewed.plausible:
            return state, error
        state = reviewed
