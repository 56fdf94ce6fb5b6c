"""Where stick can end: the limits of the transition, and its place for a given speed or moment.

Sliding spreads from the run-off over the contact as the pulley is driven harder, from pure stick to pure slip. So the
solutions of these two tell whether a transition can lie where a scene has it; and one after another with the transition
placed between them comes close to a given speed or moment.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from belt_fenicsx.scene import RUN_OFF, RUN_UP, Scene, SceneError, Slip
from belt_fenicsx.solution import Solution, Status

RTOL = 1e-8
MOST_PLACES = 12  # of the transition that are tried one after another
NEAR = 0.01  # of the way from pure stick to pure slip, within which Newton's iteration finds the given speed or moment
WAY = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)  # parts of the contact that slide, one after another

Solve = Callable[..., Solution]


def check_limits(scene: Scene, solve: Solve) -> None:
    """Checks that the transition lies where stick can end: between where it does in pure slip and in pure stick.

    Raises:
        SceneError: It does not.
    """
    pulley = scene.pulleys[0]
    if pulley.x_trans is None or isinstance(pulley.x_trans, str):
        return
    slid, stuck = (_placed(scene, solve, x_trans=limit, slip=pulley.slip) for limit in (RUN_UP, RUN_OFF))
    if slid.success and stuck.success:
        first, last = _slowest(slid), stuck.contacts[0].x_trans
        if not first < pulley.x_trans < last:
            where = f"lie where stick can end in the contact zone, in ({first:.6g}, {last:.6g}) [m]"
            raise SceneError("pulleys.0.x_trans", where, pulley.x_trans)


def near_by(scene: Scene, solve: Solve) -> Solution | None:
    """A solution with the transition placed so that the speed or the moment is about the given one.

    Returns:
        The solution; None where there is none, or the drive is another one.
    """
    pulley = scene.pulleys[0]
    if pulley.drive == "x_trans" or pulley.friction == 0.0:
        return None
    given: float = getattr(pulley, pulley.drive)
    stuck = _placed(scene, solve, x_trans=RUN_OFF)
    if not stuck.success:
        return None

    def ahead(solution: Solution) -> float:
        return given - getattr(solution.contacts[0], pulley.drive)

    slip: Slip = "forward" if (ahead(stuck) < 0.0) == (pulley.drive == "omega") else "backward"
    ends = _ends(scene, solve, stuck, slip, ahead)
    if ends is None:
        return None
    whole = abs(ends[0][1] - ends[1][1])
    for _ in range(MOST_PLACES):
        (x, a), (x_other, a_other) = ends
        place = x + float(np.clip(a / (a - a_other), 0.05, 0.95)) * (x_other - x)
        solution = _placed(scene, solve, x_trans=place, slip=slip)
        if not solution.success:
            return None
        if abs(ahead(solution)) <= NEAR * whole:
            return solution
        ends[int(ahead(solution) * a < 0.0)] = (place, ahead(solution))
    return None


def _ends(
    scene: Scene, solve: Solve, stuck: Solution, slip: Slip, ahead: Callable[[Solution], float]
) -> list[tuple[float, float]] | None:
    """Two places between which the transition lies, and by how much the given value exceeds that for each of them.

    One is where stick ends in pure stick, the other where it does in pure slip. Where the belt cannot slide all along,
    the transition goes back from the run-off until it is far enough.
    """
    here = (stuck.contacts[0].x_trans, ahead(stuck))
    slid = _placed(scene, solve, x_trans=RUN_UP, slip=slip)
    if slid.success:
        there = (_slowest(slid), ahead(slid))
        return [there, here] if there[1] * here[1] < 0.0 else None
    for part in WAY:
        place = stuck.contacts[0].x_trans + part * (stuck.contacts[0].x_up - stuck.contacts[0].x_trans)
        solution = _placed(scene, solve, x_trans=place, slip=slip)
        if not solution.success:
            return None
        there = (place, ahead(solution))
        if there[1] * here[1] < 0.0:
            return [there, here]
        here = there
    return None


def _placed(scene: Scene, solve: Solve, **drive: Any) -> Solution:
    """The solution with another drive; where its transition cannot be meant, one that is no success."""
    pulley = replace(scene.pulleys[0], **{"omega": None, "torque": None, "slip": None, **drive})
    placed = replace(scene, pulleys=(pulley,))
    try:
        return solve(placed, rtol=RTOL, throw=False)
    except SceneError as error:
        return Solution(scene=placed, method="fitted", status=Status.REFUSED, message=str(error))


def _slowest(slid: Solution) -> float:
    """Where the transition goes when sliding spreads over the contact: to the place where it is slowest.

    Next to the run-off, where sliding turns instead, the transition does not get; then it goes to the run-up.
    """
    (contact,), fields = slid.contacts, slid.fields
    sliding = fields.zone == 1
    place = float(fields.x[sliding][np.argmin(np.abs(fields.v_rel[sliding]))])
    return place if place < (contact.x_up + contact.x_off) / 2 else contact.x_up
