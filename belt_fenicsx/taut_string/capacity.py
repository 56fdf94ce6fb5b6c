"""The drive at its limit: the torque that grows until the belt slides all along a pulley, and what goes over then."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from belt_fenicsx.scene.pulley import RUN_UP, Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.drive import string_drive
from belt_fenicsx.taut_string.shape import StringDrive
from belt_fenicsx.taut_string.standing import BeyondCapacity, leading

CONVERGED = 1e-13  # Transport rates that are no farther apart are the same.
RATES = 10  # Corrections of the transport rate, at most.


def at_capacity(scene: Scene, index: int, sense: Slip, load: int | None = None) -> tuple[Scene, int]:
    """The scene in which the belt slides all along a pulley, and the pulley whose drive is left open for that.

    It is the same pulley or, if that gives the speed of all, the one with the largest slip angle or else the largest
    torque. Where speeds slip, forces depend on none; with inertia, the transport rate is the one with which the belt
    would just stick at the run-up.

    Args:
        scene: The scene.
        index: The pulley.
        sense: Sense of sliding on it.
        load: The pulley whose drive is left open, if it is to be another one.

    Raises:
        Stopped: No drive can be left open.
    """
    load = _load(scene, index) if load is None else load
    pulleys = [p.driven() if i == load else p for i, p in enumerate(scene.pulleys)]
    pulleys[index] = scene.pulleys[index].driven(x_trans=RUN_UP, slip=sense)
    if not _leads(scene, index) or scene.transport_rate is not None:
        return scene.altered(pulleys=tuple(pulleys)), load
    limit = scene.altered(pulleys=tuple(pulleys), transport_rate=1.0)
    surface = scene.pulleys[index].drive.by("omega") * (scene.pulleys[index].radius + scene.belt.contact_offset)

    def sticking(rate: float) -> float:
        """Transport rate with which the belt would stick at the run-up, if forces are those of another one."""
        return surface / string_drive(limit.altered(transport_rate=rate)).on(index)[0].stretches[0]

    if scene.has_inertia:
        limit = limit.altered(transport_rate=_fixed_point(sticking, 1.0))
    return limit, load


def _fixed_point(function: Callable[[float], float], start: float) -> float:
    """Where a function gives its argument back, by the secant method."""
    old, value = start, function(start)
    old_off, x = value - old, value
    for _ in range(RATES):
        off = function(x) - x
        if abs(off) <= CONVERGED or off == old_off:
            break
        old, old_off, x = x, off, x - off * (x - old) / (off - old_off)
    return x


def capacities(scene: Scene, string: StringDrive) -> tuple[float, ...]:
    """Torques that the pulleys transmit at most, as the one that `at_capacity` leaves open grows; NaN where none does.

    The pulley on which the belt then slides all along first may be another one, which gives the speed of all.
    """
    found = []
    for index, torque in enumerate(string.torques):
        limit = limited(scene, index, "backward" if torque < 0.0 else "forward")
        found.append(math.nan if limit is None else limit[1].torques[index])
    return tuple(found)


def limits(scene: Scene, index: int) -> Iterator[Scene]:
    """Scenes in which the belt slides all along a pulley, or another one, as the torque grows that `at_capacity` names.

    The first one is that of the string; which pulley slides first may be another one for a belt.
    """
    torques = string_drive(scene).torques
    senses: list[Slip] = ["backward" if torque < 0.0 else "forward" for torque in torques]
    first = limited(scene, index, senses[index])
    if first is None:
        return
    yield first[0]
    for other, pulley in enumerate(scene.pulleys):
        if pulley.friction and torques[other]:
            limit, _ = at_capacity(scene, other, senses[other], _load(scene, index))
            if limit.pulleys != first[0].pulleys:
                yield limit


def limited(scene: Scene, index: int, sense: Slip) -> tuple[Scene, StringDrive] | None:
    """The scene in which the belt slides all along a pulley, or along what slides first, and its string.

    There is none without friction, and where no torque could be left open for that.
    """
    if scene.pulleys[index].friction == 0.0:
        return None
    try:
        load = _load(scene, index)
        limit, _ = at_capacity(scene, index, sense)
        try:
            return limit, string_drive(limit)
        except BeyondCapacity as beyond:
            if not (beyond.pulley == load or _leads(scene, beyond.pulley)):
                return None
            limit, _ = at_capacity(scene, beyond.pulley, beyond.sense, load)
            return limit, string_drive(limit)
    except Stopped:
        return None


def _load(scene: Scene, index: int) -> int:
    """The pulley whose slip angle or torque grows, on the way to the limit of a pulley.

    Raises:
        Stopped: There is none.
    """
    if not _leads(scene, index):
        return index
    # A slip angle goes first: a stiff belt that slides to and fro may have it with more than one torque.
    for kind in ("slip_angle", "torque"):
        loads = [i for i, p in enumerate(scene.pulleys) if p.drive.kind == kind and p.friction > 0.0]
        if loads:
            return max(loads, key=lambda i: abs(scene.pulleys[i].drive.by(kind)))
    raise Stopped(Status.NEWTON_DIVERGED, f"No torque could be left open for pulley {index} to slide all along.")


def _leads(scene: Scene, index: int) -> bool:
    """Whether nothing but this pulley gives a loop its speed, or takes the torque that is left."""
    return scene.closed and leading(scene) == [index]
