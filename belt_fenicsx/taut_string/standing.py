"""The exact extensible string of a drive whose pulleys stand still, without gravity in its spans.

`forces` finds F in all spans, with friction that is not exceeded. A pulley of given speed may then slide all along, if
another one gives the transport rate; a torque that is not met is beyond the capacity of the drive.
"""

from __future__ import annotations

from belt_fenicsx.scene.path import Path, Point, tangent_path
from belt_fenicsx.scene.pulley import Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.forces import Chain, Forces
from belt_fenicsx.taut_string.shape import NOTHING, StringDrive, drawn_on

LACKING = 1e-11  # A torque that lacks no more is met, in parts of the radius and the larger force.


class BeyondCapacity(Stopped):
    """A torque that friction cannot transmit.

    Attributes:
        pulley: The pulley on which the belt would slide all along.
        sense: Sense of this sliding.
        drawn: The string that slides there, and asks for more friction than there is.
    """

    def __init__(self, message: str, drawn: StringDrive, pulley: int, sense: Slip) -> None:
        self.drawn, self.pulley, self.sense = drawn, pulley, sense
        super().__init__(Status.CAPACITY_EXCEEDED, message, final=True)


def standing_string(scene: Scene, centers: tuple[Point, ...], *, slack: bool = False) -> StringDrive:
    """The string where the pulleys have these centres.

    Args:
        scene: The dimensionless scene.
        centers: The centres.
        slack: Whether a belt that is longer than its path has a small force all the same.

    Raises:
        BeyondCapacity: A torque is more than friction can transmit, whichever pulley leads.
        Stopped: There is no taut string.
    """
    path, beyond = tangent_path(scene, centers), []
    for first in leading(scene):
        forces = Chain(scene, path, first).solved(slack=slack)
        string = drawn_on(path, scene, forces, centers)
        over = _overloaded(scene, path, string, forces, first)
        if over is None:
            return string
        beyond.append(BeyondCapacity(f"A string would slide all along pulley {over[0]}.", string, *over))
    raise beyond[0]


def leading(scene: Scene) -> list[int]:
    """Pulleys that may give a loop its speed, or take the torque that is left; any number between clamps."""
    if not scene.closed:
        return [0]
    kind = "omega" if scene.transport_rate is None else "none"
    pulleys = enumerate(scene.pulleys)
    return [i for i, p in pulleys if p.drive.kind == kind and p.friction > 0.0 and (p.omega is None or p.omega > 0.0)]


def _overloaded(scene: Scene, path: Path, string: StringDrive, forces: Forces, first: int) -> tuple[int, Slip] | None:
    """A pulley whose friction is not enough, with the sense of sliding; None where there is none."""
    if scene.closed and string.slip_angles[first] > path.arcs[first].wrap * (1.0 + NOTHING):
        return first, "forward" if string.torques[first] > 0.0 else "backward"
    lacking = {
        i: (string.asked(pulley, i) - string.torques[i]) / (path.arcs[i].radius * max(forces.up[i], forces.off[i]))
        for i, pulley in enumerate(scene.pulleys)
        if pulley.drive.kind == "torque"
    }
    worst = max(lacking, key=lambda i: abs(lacking[i]), default=None)
    if worst is None or abs(lacking[worst]) <= LACKING:
        return None
    return worst, "forward" if lacking[worst] > 0.0 else "backward"
