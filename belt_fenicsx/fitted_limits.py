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
from belt_fenicsx.solution import Solution

RTOL = 1e-6
MOST_PLACES = 12  # of the transition that are tried one after another
NEAR = 0.01  # of the way from pure stick to pure slip, within which Newton's iteration finds the given speed or moment

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
    slid = _placed(scene, solve, x_trans=RUN_UP, slip=slip)
    if not slid.success or ahead(slid) * ahead(stuck) >= 0.0:
        return None
    whole = abs(ahead(slid) - ahead(stuck))
    ends = [(_slowest(slid), ahead(slid)), (stuck.contacts[0].x_trans, ahead(stuck))]
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


def _placed(scene: Scene, solve: Solve, **drive: Any) -> Solution:
    """The solution with another drive."""
    pulley = replace(scene.pulleys[0], **{"omega": None, "torque": None, "slip": None, **drive})
    return solve(replace(scene, pulleys=(pulley,)), rtol=RTOL, throw=False)


def _slowest(slid: Solution) -> float:
    """Where the transition goes when sliding spreads over the contact: to the place where it is slowest.

    Next to the run-off, where sliding turns instead, the transition does not get; then it goes to the run-up.
    """
    (contact,), fields = slid.contacts, slid.fields
    sliding = fields.zone == 1
    place = float(fields.x[sliding][np.argmin(np.abs(fields.v_rel[sliding]))])
    return place if place < (contact.x_up + contact.x_off) / 2 else contact.x_up
