"""The scene: a belt, its pulley and how they are driven. Pure Python, frozen, validated, in SI units.

Nothing here knows a numerical method. `Scene.dimensionless` gives the scene that all methods solve (lengths
in units of the belt's length, forces in units of its extensional stiffness, unit transport rate), so that
no answer depends on the units of the question.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from belt_fenicsx.scene.belt import STIFFNESSES, Belt, StiffnessBelt
from belt_fenicsx.scene.checks import SceneError, positive, store
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.units import Units


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A belt between two clamps, transported over a pulley. The defaults are the source's scene.

    The clamps stand at x = -span/2 and x = +span/2, y = 0, with cross-section angle zero; the belt lies above the
    pulley and travels from left to right.

    Attributes:
        belt: The belt.
        pulleys: The pulleys; one, so far.
        span: Distance Lx of the clamps [m].
        transport_rate: Mass transport rate c [m/s].

    Raises:
        SceneError: A value is out of its range, or a clamp lies inside the pulley.
    """

    belt: Belt | StiffnessBelt = field(default_factory=Belt)
    pulleys: tuple[Pulley, ...] = field(default_factory=lambda: (Pulley(),))
    span: float = 1.0
    transport_rate: float = 1.0

    def __post_init__(self) -> None:
        if not isinstance(self.belt, Belt | StiffnessBelt):
            raise SceneError("belt", "be a Belt or a StiffnessBelt", self.belt)
        if not isinstance(self.pulleys, tuple | list) or not all(isinstance(p, Pulley) for p in self.pulleys):
            raise SceneError("pulleys", "be a tuple of Pulley", self.pulleys)
        if len(self.pulleys) != 1:
            raise SceneError("pulleys", "hold exactly one pulley (more are not there yet)", len(self.pulleys))
        store(
            self,
            pulleys=tuple(self.pulleys),
            span=positive("span", self.span, "m"),
            transport_rate=positive("transport_rate", self.transport_rate, "m/s"),
        )
        for index, pulley in enumerate(self.pulleys):
            self._check_clearance(index, pulley)

    def _check_clearance(self, index: int, pulley: Pulley) -> None:
        for side, x in (("left", -self.span / 2), ("right", self.span / 2)):
            distance = math.dist((x, 0.0), pulley.center)
            if distance <= pulley.radius:
                raise SceneError(
                    f"pulleys.{index}.radius",
                    f"be below {distance:g} [m], the distance of the centre from the {side} clamp (a clamp inside "
                    "the pulley)",
                    pulley.radius,
                )

    def dimensionless(self) -> tuple[Scene, Units]:
        """The scene in units of the belt's length, its extensional stiffness and the transport rate.

        Returns:
            The dimensionless scene, whose belt has unit length and unit extensional stiffness, and the units that
            turn its answers into this scene's.
        """
        units = Units(length=self.belt.length, force=self.belt.extensional_stiffness, rate=self.transport_rate)
        stiffnesses = {name: getattr(self.belt, name) / quantity.scale(units) for name, quantity in STIFFNESSES.items()}
        belt = StiffnessBelt(length=1.0, **stiffnesses)
        pulleys = tuple(pulley.dimensionless(units) for pulley in self.pulleys)
        return Scene(belt=belt, pulleys=pulleys, span=self.span / units.length, transport_rate=1.0), units
