"""The belt as a boundary-value problem, solved by collocation: an independent check without finite elements.

Each part of the belt has its own ordinary differential equations (section 18.3, `equations`), and each is mapped to
[0, 1] (`problem`). The unknown constants are the joints of the parts, the stretch in stick and the forces in the
free spans. With these forces the source's nineteen equations are fifteen: two of the six in each free span are
integrated by hand, which makes the collocation's matrices smaller and keeps the force constant to rounding.

1. A coarse state, by the ladder in `run`; for a given speed or torque, by way of pure stick and pure slip
   (`search.drives`).
2. Where a bound of friction breaks, other rows (`search.find`), one part at a time.
3. Finer meshes make the answer as accurate as wanted (`newton`), and the rows are judged once more.
4. Where that is no answer, the same from a finer first mesh.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from belt_fenicsx.bvp.guess import divided, from_fields
from belt_fenicsx.bvp.newton import COARSE, Refined
from belt_fenicsx.bvp.reading import FIELDS, answer, explained, field_errors
from belt_fenicsx.bvp.run import Run
from belt_fenicsx.bvp.state import State
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.search.drives import meet_drives, solve_driven
from belt_fenicsx.search.find import answers, find, layout_of, settle_from
from belt_fenicsx.search.limits import check_smooth, leaves_transition, meets
from belt_fenicsx.solution.certificate import certified
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status

METHOD = "bvp"
MESHES = (COARSE, 4 * COARSE)  # Numbers of cells of the meshes on which the layout is found.
TOLERANCE = 1e-7  # The tolerance of the certificate is no smaller.
CAREFUL = 1e-8  # A scene is refused by an answer of no less relative accuracy.


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
            solution = replace(solution, message=explained(solution))
    return solution


def _solve(scene: Scene, rtol: float, find_zones: bool, initial: Solution | None) -> Solution:
    dimensionless, units = scene.dimensionless()
    run = Run(dimensionless, units, rtol, find_zones)
    solution = Solution(scene=scene, method=METHOD, status=Status.SOLVED)
    if not find_zones:
        run.stages.skipped("zone order", "the order is not to change")
    try:
        check_smooth(dimensionless)
        state = _find(run, initial)
        solution = replace(
            solution,
            **answer(dimensionless, state.layout, state.problem, state.discrete),
            error_estimate=float(run.refinement.errors[0]),
            field_errors=field_errors(run.refinement.errors[1:]),
            measures={"residual": state.discrete.missed},
            state=state,
        ).in_units(scene, units)
        if not run.refinement.reached:
            solution = replace(solution, status=Status.ACCURACY_NOT_REACHED, message=_missed(run))
    except Stopped as stopped:
        solution = replace(solution, status=stopped.status, message=stopped.message)
    return replace(solution, stages=tuple(run.stages), iterations=run.stages.iterations)


def _missed(run: Run) -> str:
    """What is less accurate than wanted."""
    asked_for = "the torque" if all(pulley.omega is not None for pulley in run.scene.pulleys) else "omega"
    worst = int(np.argmax(run.refinement.errors / run.wanted))
    return (
        f"On {run.refinement.discrete.cells} cells, {(asked_for, *FIELDS)[worst]} has a relative error of "
        f"{run.refinement.errors[worst]:.1g}, {run.wanted[worst]:.1g} is wanted. Give a larger `rtol`."
    )


def _find(run: Run, initial: Solution | None) -> State:
    """The answer on the finest mesh that it needs.

    With little friction, all admissible speeds may lie closer together than those of coarse and fine meshes do; next
    to pure stick and pure slip, so may speeds and torques of other zones.
    """
    found: list[tuple[State, Refined]] = []
    for cells in MESHES:
        run.cells, run.end = cells, None
        try:
            state = find(run, _warm(run, initial) or _cold(run))
            if not meets(run, state):
                state = find(run, meet_drives(run, state))
        except Stopped as stopped:
            diverged = stopped.status is Status.NEWTON_DIVERGED
            if not diverged or (not found and (stopped.final or cells == MESHES[-1])):
                raise
        else:
            found.append((state, run.refinement))
            if answers(run, state):
                return state
    # What the first mesh showed may say why there is no answer.
    state, run.end = found[-1]
    if run.is_plausible(state) and not meets(run, state):
        message = f"The finest mesh leaves {state.layout}, which does not meet the drive."
        raise Stopped(Status.NEWTON_DIVERGED, message)
    return state


def _warm(run: Run, initial: Solution | None) -> State | None:
    """An answer on the coarse mesh from a given one; None where there is none."""
    if initial is None or (layout := layout_of(run.scene, initial)) is None:
        run.stages.skipped("warm start", "no solution with the same zones was given")
        return None
    problem = run.pose(layout)
    if isinstance(initial.state, State):
        known = initial.state.discrete
        near = divided(initial.state.problem, known, problem, known.ends).on(problem, run.cells)
    else:
        near = from_fields(problem, initial, run.cells)
    state = settle_from(run, State(layout, problem, near), "warm start", "from the given solution")
    if state is None or not answers(run, state):
        return None
    run.stages.skipped("taut string", "the warm start sufficed")
    run.stages.skipped("continuation", "the warm start sufficed")
    return state


def _cold(run: Run) -> State:
    """An answer on the coarse mesh, from the taut string."""
    if not run.scene.is_published or leaves_transition(run.scene):
        return solve_driven(run)
    return run.start()
