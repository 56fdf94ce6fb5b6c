"""Parts of the belt as rows: what each of them does, and what holds at the borders between them.

A list of parts is all that tells one scene's equations from another's. `posed` writes down the list that a scene asks
for. Pure Python.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from belt_fenicsx.layout.kind import FREE, STICK, Part
from belt_fenicsx.scene.pulley import RUN_OFF, RUN_UP, Slip
from belt_fenicsx.scene.scene import Scene

Condition = Literal["tangent", "x", "speed", "hold", "coulomb"]
BEFORE, AFTER = 0, 1


@dataclass(frozen=True)
class Border:
    """The condition that places a border.

    Attributes:
        condition: ``"tangent"`` (the belt is tangent to the pulley: no concentrated force), ``"x"`` (the border
            lies at the scene's transition), ``"speed"`` (the belt sticks at the scene's angular velocity),
            ``"hold"`` (the belt's stretch is that in stick) or ``"coulomb"`` (friction in stick reaches its bound).
        side: The side from which the fields are taken, ``BEFORE`` or ``AFTER``.
    """

    condition: Condition
    side: int


@dataclass(frozen=True)
class Zones:
    """An ordered list of zones, and the borders between them.

    Attributes:
        parts: The zones, in the direction of travel; the first and the last are free.
        borders: One border between each two zones.
        by_force: Whether the stretch in stick is the one at which friction has the scene's resultant, instead of the
            one at the border `grip`.
    """

    parts: tuple[Part, ...]
    borders: tuple[Border, ...]
    by_force: bool = False

    @property
    def transition(self) -> int:
        """The border at which the belt leaves the pulley's speed for good; the run-off in pure stick, the run-up where
        it slides all along in one sense."""
        if STICK in self.parts:
            return self.parts.index(STICK)
        return 1 if len(self.parts) > 3 else 0

    @property
    def grip(self) -> int:
        """The border at which the belt's stretch is the stretch in stick."""
        return self.transition - (STICK in self.parts)


RUN_UP_BORDER, RUN_OFF_BORDER = Border("tangent", BEFORE), Border("tangent", AFTER)


def posed(scene: Scene, slip: Slip | None = None) -> Zones:
    """The zones that a scene asks for, sliding in the given sense where the scene leaves it open."""
    pulley = scene.pulleys[0]
    sliding = Part("slip", pulley.slip or slip or "forward")
    if pulley.friction == 0.0 or pulley.x_trans == RUN_UP:
        return ordered(scene, [sliding])
    return ordered(scene, [STICK] if pulley.x_trans == RUN_OFF else [STICK, sliding])


def ordered(scene: Scene, contact: Sequence[Part]) -> Zones:
    """Zones in contact, with free ones around them and the conditions at the borders between them.

    The belt leaves the pulley's speed for good at the end of the first stick zone, or of the first slip zone where
    nothing sticks: it does so where the scene says, or else where friction cannot hold it any longer. Before, sliding
    passes into stick where friction is continuous; after, sliding turns where the belt has the pulley's speed.
    """
    drive = scene.pulleys[0].drive.kind
    placed: dict[str, Condition] = {"x_trans": "x", "omega": "speed", "torque": "hold"}
    borders, by_force = [RUN_UP_BORDER], False
    left = contact.index(STICK) if STICK in contact else 0
    for index, (_, after) in enumerate(itertools.pairwise(contact)):
        if after == STICK:
            borders.append(Border("coulomb", AFTER))
        elif index != left:
            borders.append(Border("hold", BEFORE))
        elif scene.pulleys[0].x_trans == RUN_OFF:
            borders.append(Border("coulomb", BEFORE))
        else:
            borders.append(Border(placed[drive], AFTER))
            by_force = drive == "torque"
    return Zones((FREE, *contact, FREE), (*borders, RUN_OFF_BORDER), by_force)
