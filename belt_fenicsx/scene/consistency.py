"""Whether a belt, its pulleys and what drives them make sense together, before anything is solved."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from belt_fenicsx.scene.checks import SceneError, Verbatim
from belt_fenicsx.scene.path import ROUNDING, Arc, Path, tangent_path, taut_path

if TYPE_CHECKING:
    from belt_fenicsx.scene.scene import Scene

A_DRIVE = "a drive (`omega`, `torque`, which is 0 for a free idler, `slip_angle` or `x_trans`)"
MOST_STEPS = 50  # of Newton's iteration for a way


def check_drives(scene: Scene) -> None:
    """As many drives as the belt needs, and a speed among them that says how fast it runs.

    In a loop, the transition on one pulley follows from those on all others, so that N pulleys leave room for N
    conditions, of which the transport rate may be one.

    Raises:
        SceneError: There are too many or too few, or none of them, or not the first, makes the belt run on.
    """
    undriven = [index for index, pulley in enumerate(scene.pulleys) if pulley.drive.kind == "none"]
    count, without = len(scene.pulleys), Verbatim(f"none at {_listed(undriven)}")
    if not scene.closed:
        if undriven:
            raise SceneError(f"pulleys.{undriven[0]}", f"have {A_DRIVE}, as each pulley between clamps", without)
        return
    if count < 2:
        raise SceneError("pulleys", "be at least two in a loop", Verbatim("one"))
    if scene.transport_rate is None:
        if undriven:
            expected = f"have {A_DRIVE}: a loop of {count} needs {count} drives, or {count - 1} beside `transport_rate`"
            raise SceneError(f"pulleys.{undriven[0]}", expected, without)
    elif not undriven:
        expected = f"be left out, or one of {count} drives, as the torque of one pulley in a loop follows from the rest"
        raise SceneError("transport_rate", expected, scene.transport_rate)
    elif len(undriven) > 1:
        expected = f"have {A_DRIVE}: beside `transport_rate`, one pulley of a loop stays without"
        raise SceneError(f"pulleys.{undriven[1]}", expected, without)
    else:
        pulley = scene.pulleys[undriven[0]]
        if pulley.slip is not None:
            expected = "be left out without a drive, as it follows"
            raise SceneError(f"pulleys.{undriven[0]}.slip", expected, pulley.slip)
        if pulley.friction == 0.0:
            expected = "be positive [-] where no drive is given, as the torque follows from the other pulleys"
            raise SceneError(f"pulleys.{undriven[0]}.friction", expected, pulley.friction)
    _check_speeds(scene)


def _check_speeds(scene: Scene) -> None:
    speeds = {index: pulley.omega for index, pulley in enumerate(scene.pulleys) if pulley.omega is not None}
    unknown = scene.transport_rate is None
    if unknown and not speeds:
        expected = (
            "be given, or that of another pulley, as nothing else says how fast the loop runs (or give "
            "`transport_rate` and leave one pulley without a drive)"
        )
        kinds = ", ".join(pulley.drive.kind for pulley in scene.pulleys)
        raise SceneError("pulleys.0.omega", expected, Verbatim(f"nothing but {kinds}"))
    first = next((index for index, omega in speeds.items() if omega), next(iter(speeds), None))
    if first is not None and (speeds[first] < 0.0 or (unknown and speeds[first] == 0.0)):
        expected = "be positive [rad/s], so that the belt runs on from pulley to pulley (list them in order of travel)"
        raise SceneError(f"pulleys.{first}.omega", expected, speeds[first])
    if unknown and not any(omega > 0.0 and scene.pulleys[index].friction for index, omega in speeds.items()):
        expected = "be positive [-] on a pulley whose speed says how fast the loop runs"
        raise SceneError(f"pulleys.{first}.friction", expected, 0.0)


def check_on_path(scene: Scene, path: Path) -> None:
    """What is given of places, of take-ups and of the belt's length, on the path of the taut belt.

    Raises:
        SceneError: A place is not on it or not unique, a take-up moves away from the belt, or the belt is slack.
    """
    for arc, pulley in zip(path.arcs, scene.pulleys, strict=True):
        name = f"pulleys.{arc.pulley}"
        if pulley.slip_angle is not None and pulley.slip_angle > arc.wrap + ROUNDING:
            expected = f"be at most {arc.wrap:.9g} [rad], the wrap"
            raise SceneError(f"{name}.slip_angle", expected, pulley.slip_angle)
        if isinstance(pulley.x_trans, float) and not _has_unique_places(arc):
            expected = (
                f"be left out where the belt turns by {arc.wrap:g} [rad] and so that a place is not unique; "
                "say `slip_angle` [rad]"
            )
            raise SceneError(f"{name}.x_trans", expected, pulley.x_trans)
        if pulley.take_up and arc.gain(pulley) <= 0.0:
            x, y = (round(part, 6) + 0.0 for part in arc.pull)
            expected = f"push the pulley into the belt, which pulls it along ({x:g}, {y:g}) [-]"
            raise SceneError(f"{name}.take_up", expected, pulley.take_up)
    # Between clamps, a belt can be stiff enough to be held over one pulley, even if it is slack.
    if scene.belt.length >= path.length and (scene.closed or len(scene.pulleys) > 1):
        if not any(pulley.take_up for pulley in scene.pulleys):
            slack = scene.belt.length - path.length
            expected = f"be below {path.length:.9g} [m], the path of the taut belt (it is slack by {slack:g} [m])"
            raise SceneError("belt.length", expected, scene.belt.length)
        _check_taken_up(scene, path)


def _has_unique_places(arc: Arc) -> bool:
    """Whether it is less than half a turn, and nowhere passes the vertical."""
    low, high = sorted((arc.start, arc.end))
    quarters = [math.floor((angle - math.pi / 2) / math.pi) for angle in (low + ROUNDING, high - ROUNDING)]
    return arc.wrap < math.pi - ROUNDING and quarters[0] == quarters[1]


def _check_taken_up(scene: Scene, path: Path) -> None:
    """That a slack belt becomes taut as the pulleys with a take-up move, all of them equally far."""
    movable = [(index, pulley) for index, pulley in enumerate(scene.pulleys) if pulley.take_up]
    name, direction = f"pulleys.{movable[0][0]}.take_up", movable[0][1].take_up
    centers, slack, way = [pulley.center for pulley in scene.pulleys], scene.belt.length - path.length, 0.0
    try:
        for _ in range(MOST_STEPS):
            missing, gain = scene.belt.length - path.length, sum(path.arcs[i].gain(pulley) for i, pulley in movable)
            if abs(missing) <= ROUNDING * scene.belt.length:
                break
            if gain <= 0.0:
                raise SceneError(name, f"take up the slack of {slack:g} [m]", direction)
            way += missing / gain
            for i, pulley in movable:
                centers[i] = pulley.displaced(way)
            path = tangent_path(scene, centers)
        else:
            raise SceneError(name, f"take up the slack of {slack:g} [m]", direction)
        taut_path(scene, centers)
    except SceneError as error:
        if error.field == name:
            raise
        expected = (
            f"lead to where the belt is no longer slack by {slack:g} [m]: after {way:g} [m], `{error.field}` would "
            f"have to {error.expected}"
        )
        raise SceneError(name, expected, direction) from None


def _listed(indices: list[int]) -> str:
    return ", ".join(f"pulleys.{index}" for index in indices)
