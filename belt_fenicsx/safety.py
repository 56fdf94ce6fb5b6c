"""How far a drive is from slipping: by a solve of the drive at its limit, which is made when it is asked for."""

from __future__ import annotations

import math
from typing import Any

from belt_fenicsx.scene.checks import SceneError, Verbatim
from belt_fenicsx.scene.pulley import RUN_UP
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.search.find import RATES, STEADY
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.status import SolveError
from belt_fenicsx.solver import solve
from belt_fenicsx.taut_string.capacity import limits


def slip_safety(solution: Solution, pulley: int, **options: Any) -> float:
    """Slip safety of a pulley: the torque at which the belt slides through, over the torque that it transmits.

    At the limit the belt slides all along this pulley or along another one that slides first. What grows up to there is
    the torque on the pulley or, where this pulley gives the drive its speed, the largest torque that is given; the rest
    of the drive stays as it is.

    Args:
        solution: The drive, solved.
        pulley: Index of the pulley.
        options: Options of `solve` for the drive at its limit. Its method is that of the boundary-value problem, in
            which a part may be a point, as it is where two pulleys begin to slip together; of a string, the string.

    Returns:
        The safety [-]; infinite of a pulley that transmits nothing, NaN where no torque leads to a limit.

    Raises:
        SceneError: The solution has no contact with such a pulley.
        SolveError: There is no answer at the limit.
    """
    torques = {contact.pulley: contact.torque for contact in solution.contacts}
    if isinstance(pulley, bool) or pulley not in torques:
        known = ", ".join(map(str, torques))
        raise SceneError("pulley", f"be one that the belt touches, of {known}" if known else "be touched", pulley)
    if not solution.success:
        raise SceneError("solution", "be SOLVED", Verbatim(solution.status.name))
    torque, drive = torques[pulley], solution.scene.pulleys[pulley].drive
    if torque == 0.0 or (drive.kind == "torque" and drive.value == drive.drag == 0.0):
        return math.inf
    scene, units = solution.scene.dimensionless()
    method, first = "string" if solution.method == "string" else "bvp", None
    for limit in limits(scene, pulley):
        at_limit = _at_its_rate(scene, limit, **{"method": method, **options, "throw": False})
        if at_limit.success:
            capacity = next(contact.torque for contact in at_limit.contacts if contact.pulley == pulley)
            return capacity * units.of(length=1, force=1) / torque
        first = first or at_limit
    if first is not None:
        raise SolveError(first)
    return math.nan


def _at_its_rate(scene: Scene, limit: Scene, **options: Any) -> Solution:
    """The drive at its limit, at the transport rate with which the belt just sticks to the pulley that gives its speed.

    The rate of a limit is the string's, where that pulley slides and the belt has inertia.
    """
    solution = solve(limit, **options)
    slides = [i for i, p in enumerate(scene.pulleys) if p.drive.kind == "omega" and limit.pulleys[i].x_trans == RUN_UP]
    for _ in range(RATES if slides and scene.transport_rate is None and scene.has_inertia else 0):
        if not solution.success or solution.fields is None:
            break
        first = next(i for i, zone in enumerate(solution.zones) if zone.pulley == slides[0])
        stretch = float(solution.fields.D[solution.fields.zone == first][0])
        rate = scene.pulleys[slides[0]].surface_speed / stretch
        if abs(rate / solution.transport_rate - 1.0) <= STEADY:
            break
        solution = solve(limit.altered(transport_rate=rate), **options)
    return solution
