"""What a part of the belt does: it is free, sticks, or slides in one of two senses."""

from __future__ import annotations

from dataclasses import dataclass

from belt_fenicsx.scene.pulley import Slip

SENSE = {"forward": 1.0, "backward": -1.0}


@dataclass(frozen=True)
class Part:
    """A zone that is to be found.

    Attributes:
        kind: ``"free"``, ``"stick"`` or ``"slip"``.
        slip: Sense of sliding of a slip zone, otherwise None.
    """

    kind: str
    slip: Slip | None = None

    @property
    def touches(self) -> bool:
        """Whether the zone lies on the pulley."""
        return self.kind != "free"

    @property
    def sense(self) -> float:
        """+1 where the belt slides forward, -1 backward, 0 where it does not slide."""
        return SENSE.get(self.slip or "", 0.0)


FREE, STICK = Part("free"), Part("stick")
