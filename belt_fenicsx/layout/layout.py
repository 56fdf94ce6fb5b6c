"""What the belt does, as rows: its parts, the joints between them, and the equations for all that is unknown of them.

The unknown scalars are the lengths of the parts, the surface speed of each pulley, and in a loop the transport rate if
it is not given. Their equations are one at each joint, one for each speed, and the length of the belt; in a loop whose
transport rate is given, one joint is placed by the closing of the loop. Each method has its own formula for each of
these equations. Pure Python.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Literal

from belt_fenicsx.layout.kind import Part

Equation = Literal["tangent", "x", "angle", "speed", "stretch", "coulomb", "loop"]
BEFORE, AFTER = 0, 1


@dataclass(frozen=True)
class Joint:
    """The equation that places the joint of two parts.

    Attributes:
        equation: ``"tangent"`` (the belt is tangent to the pulley: no concentrated force), ``"x"`` (the joint lies at
            the scene's transition), ``"angle"`` (the scene's slip angle lies behind it), ``"speed"`` (the belt in stick
            has the scene's angular velocity), ``"stretch"`` (the belt's stretch is that in stick), ``"coulomb"``
            (friction in stick reaches its bound) or ``"loop"`` (none of its own: the closing of the loop places it).
        side: The side from which the fields are taken, ``BEFORE`` or ``AFTER``.
    """

    equation: Equation
    side: int


RUN_UP_JOINT, RUN_OFF_JOINT = Joint("tangent", BEFORE), Joint("tangent", AFTER)


@dataclass(frozen=True)
class Speed:
    """The equation for the surface speed of a pulley, which the belt has where it sticks.

    Attributes:
        equation: ``"stretch"`` (the belt's stretch before this joint is the one that goes with this speed),
            ``"torque"`` (friction has the scene's torque) or ``"loop"`` (as ``"stretch"``, in a loop that no joint
            closes: this speed gives the transport rate, if that is unknown, and the balance along the belt in one place
            follows from all other equations).
        joint: Index of the joint at which the belt first has the pulley's speed.
    """

    equation: Literal["stretch", "torque", "loop"]
    joint: int


@dataclass(frozen=True)
class Layout:
    """What the belt does part by part, in the direction of travel.

    Attributes:
        parts: The parts; a loop begins with the first one on its first pulley.
        joints: One between each two parts; in a loop also one between the last and the first.
        speeds: One for each pulley that is touched.
        closed: Whether the belt is a loop.
        rate: Whether the transport rate is an unknown.
    """

    parts: tuple[Part, ...]
    joints: tuple[Joint, ...]
    speeds: tuple[Speed, ...]
    closed: bool = False
    rate: bool = False

    def __post_init__(self) -> None:
        unknowns, of_the_length = len(self.parts) + len(self._on) + self.rate, 1
        equations = sum(joint.equation != "loop" for joint in self.joints) + len(self.speeds) + of_the_length
        # Of a loop that only turns, one equation follows from the others; where the rate is unknown, that is instead.
        equations -= any(speed.equation == "loop" for speed in self.speeds) and not self.rate
        assert equations == unknowns, "as many equations as unknowns"

    def __str__(self) -> str:
        groups = [" | ".join(str(self.parts[i]) for i in on) for on in self._on.values()]
        return groups[0] if len(groups) == 1 else "; ".join(f"{name} on pulley {i}" for i, name in enumerate(groups))

    @property
    def contact(self) -> tuple[Part, ...]:
        """The parts that touch a pulley."""
        return tuple(part for part in self.parts if part.touches)

    @property
    def pulleys(self) -> tuple[int, ...]:
        """Indices of the pulleys that are touched."""
        return tuple(self._on)

    @property
    def closes(self) -> int | None:
        """The pulley that closes a loop without a joint that does so; None where there is one."""
        pairs = zip(self.pulleys, self.speeds, strict=True)
        return next((pulley for pulley, speed in pairs if speed.equation == "loop"), None)

    def on(self, pulley: int) -> range:
        """Indices of the parts on a pulley."""
        return self._on[pulley]

    @functools.cached_property
    def _on(self) -> dict[int, range]:
        touching: dict[int, list[int]] = {}
        for i, part in enumerate(self.parts):
            if part.touches:
                touching.setdefault(part.pulley, []).append(i)
        return {pulley: range(indices[0], indices[-1] + 1) for pulley, indices in touching.items()}

    def sticks(self, pulley: int) -> bool:
        """Whether the belt sticks somewhere on a pulley."""
        return any(self.parts[i].kind == "stick" for i in self.on(pulley))

    def transition(self, pulley: int) -> int:
        """The joint at which the belt leaves the pulley's speed for good: the end of its first stick part.

        It is the end of the first slip part where nothing sticks, and the run-up where that is the only part.
        """
        on = self.on(pulley)
        sticking = [i for i in on if self.parts[i].kind == "stick"]
        return sticking[0] if sticking else on[0] - (len(on) == 1)

    def slides_behind(self, pulley: int) -> bool:
        """Whether the belt slides behind the transition, so that the drive of the pulley can place it."""
        on, transition = self.on(pulley), self.transition(pulley)
        return transition in on and transition + 1 in on
