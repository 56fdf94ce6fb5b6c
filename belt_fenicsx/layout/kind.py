"""What a part of the belt does: it is free, sticks, or slides in one of two senses."""

from __future__ import annotations

from dataclasses import dataclass, replace

from belt_fenicsx.scene.pulley import Slip

SENSE = {"forward": 1.0, "backward": -1.0}
OTHER: dict[Slip | None, Slip] = {"forward": "backward", "backward": "forward"}


@dataclass(frozen=True)
class Part:
    """What a part of the belt does.

    Attributes:
        kind: ``"free"``, ``"stick"`` or ``"slip"``.
        slip: Sense of sliding of a slip part, otherwise None.
        pulley: Index of the pulley that it lies on; without a meaning for a free part.
    """

    kind: str
    slip: Slip | None = None
    pulley: int = 0

    def __str__(self) -> str:
        return f"{self.slip} {self.kind}" if self.slip else self.kind

    @property
    def touches(self) -> bool:
        """Whether the part lies on a pulley."""
        return self.kind != "free"

    @property
    def sense(self) -> float:
        """+1 where the belt slides forward, -1 backward, 0 where it does not slide."""
        return SENSE.get(self.slip or "", 0.0)

    @property
    def turned(self) -> Part:
        """The part that slides in the other sense."""
        return replace(self, slip=OTHER[self.slip])


FREE, STICK = Part("free"), Part("stick")


def sliding(sense: float, pulley: int = 0) -> Part:
    """A part that slides forward where ``sense`` is positive, otherwise backward."""
    return Part("slip", "forward" if sense > 0.0 else "backward", pulley)
