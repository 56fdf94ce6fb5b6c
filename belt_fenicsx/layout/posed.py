"""The layout that a scene asks for, and the equations of any other one.

On a pulley, D' is about f0 - f, where f0 is the friction that would keep the stretch D constant. Stick needs f = f0 and
|f0| <= mu p; sliding has f = -s mu p, its sense s being the sign of D less the stretch in stick. So:

- Sliding passes into stick only where D' = 0, that is f0 = -s mu p: friction is continuous there ("coulomb").
- Stick can end anywhere and in both senses, with a jump of friction. Where it does is what the drive decides. It ends
  where |f0| = mu p at the latest: D' then has the sign of f0 whatever the friction, and so has the sliding.
- Where D comes back to the stretch in stick otherwise, it crosses it, and sliding goes on in the other sense
  ("stretch").

Around a loop that only turns, the belt sticks to the end of each contact, and no drive places a joint. N.r' + M theta'
less the energy of strain changes by -D f alone and comes back to itself around the loop: sum D int f = 0, by power too.
So the balance along the belt in one place follows from that in all others. Elsewhere, a joint placed by a given speed
makes up for it; here, the speed says how fast the belt runs, and no more. What such a joint would have to close shows
as a force that is missing in that one place ("loop").
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

from belt_fenicsx.layout.kind import FREE, Part
from belt_fenicsx.layout.layout import AFTER, BEFORE, RUN_OFF_JOINT, RUN_UP_JOINT, Equation, Joint, Layout, Speed
from belt_fenicsx.scene.pulley import RUN_OFF, RUN_UP, Pulley, Slip
from belt_fenicsx.scene.scene import Scene

PLACED_BY: dict[str, Equation] = {
    "x_trans": "x",
    "slip_angle": "angle",
    "omega": "speed",
    "torque": "stretch",
    "none": "loop",
}


def posed(scene: Scene, slip: Slip | None = None) -> Layout:
    """The layout that a scene asks for, sliding in the given sense where the scene leaves it open."""
    contact: list[Part] = []
    for index, pulley in enumerate(scene.pulleys):
        after = Part("slip", pulley.slip or slip or "forward", index)
        stick = Part("stick", pulley=index)
        if pulley.friction == 0.0 or pulley.x_trans == RUN_UP:
            contact.append(after)
        else:
            contact += [stick] if pulley.x_trans == RUN_OFF else [stick, after]
    return ordered(scene, contact)


def ordered(scene: Scene, contact: Sequence[Part]) -> Layout:
    """The layout of parts in contact, with free ones around those of each pulley and the equations at all joints."""
    parts: list[Part] = [] if scene.closed else [FREE]
    joints: list[Joint] = []
    speeds: list[Speed] = []
    # Speeds that may close a loop.
    closing: list[int] = []
    for index, group in itertools.groupby(contact, key=lambda part: part.pulley):
        pulley, on = scene.pulleys[index], list(group)
        sticks = [part.kind == "stick" for part in on]
        # The part at whose end the belt leaves the pulley's speed for good.
        left = sticks.index(True) if any(sticks) else 0
        placed_by_torque = pulley.drive.kind == "torque" and left + 1 < len(on)
        speeds.append(
            Speed("torque" if placed_by_torque else "stretch", len(joints) + left + (len(on) > 1 and not any(sticks)))
        )
        if any(sticks) and pulley.drive.kind == ("omega" if scene.transport_rate is None else "none"):
            closing.append(len(speeds) - 1)
        joints += [RUN_UP_JOINT, *_inner_joints(pulley, on, left), RUN_OFF_JOINT]
        parts += [*on, FREE]
    if scene.closed:
        # The last joint is the first run-up.
        joints = [*joints[1:], joints[0]]
        speeds = [Speed(speed.equation, speed.joint - 1) for speed in speeds]
        if closing and not any(joint.equation in ("speed", "loop") for joint in joints):
            speeds[closing[0]] = Speed("loop", speeds[closing[0]].joint)
    return Layout(tuple(parts), tuple(joints), tuple(speeds), scene.closed, scene.transport_rate is None)


def gives_rate(scene: Scene, layout: Layout) -> int | None:
    """The pulley whose speed gives the transport rate where no force depends on it; None if there is none.

    It is the first one whose speed is given, and which the belt leaves behind a transition; without one, it is the
    first one to which the belt sticks.
    """
    driven = [i for i, pulley in enumerate(scene.pulleys) if pulley.drive.kind == "omega" and i in layout.pulleys]
    sliding = (i for i in driven if layout.slides_behind(i))
    return next(sliding, next((i for i in driven if layout.sticks(i)), None))


def slips_through(scene: Scene, layout: Layout) -> int | None:
    """A pulley that slides all along though the rest of the drive needs its speed; None where there is none.

    A given speed gives the transport rate of a loop. If the belt does not stick to any pulley of given speed, the drive
    is at the limit of what friction can transmit.
    """
    if scene.transport_rate is not None or gives_rate(scene, layout) is not None:
        return None
    return next((i for i, pulley in enumerate(scene.pulleys) if pulley.drive.kind == "omega"), 0)


def _inner_joints(pulley: Pulley, on: Sequence[Part], left: int) -> Iterator[Joint]:
    """The joints between parts on a pulley, of which part ``left`` ends where the drive decides."""
    for i, after in enumerate(on[1:]):
        if after.kind == "stick":
            yield Joint("coulomb", AFTER)
        elif i != left:
            yield Joint("stretch", BEFORE)
        elif pulley.x_trans == RUN_OFF:
            yield Joint("coulomb", BEFORE)
        else:
            yield Joint(PLACED_BY[pulley.drive.kind], AFTER)
