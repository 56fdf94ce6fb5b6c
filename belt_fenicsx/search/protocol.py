"""What a method gives to the search: states on layouts, and what they say."""

from __future__ import annotations

from typing import Protocol, Self, TypeVar

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.revision import Samples, Tolerances
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.scene.units import Units
from belt_fenicsx.solution.stages import Stages


class State(Protocol):
    """A converged state of a method."""

    @property
    def layout(self) -> Layout:
        """What the belt does in it."""


S = TypeVar("S", bound=State)


class Method(Protocol[S]):
    """A solve that is under way.

    Attributes:
        scene: The dimensionless scene.
        units: Its units, for messages.
        stages: What was done so far.
    """

    scene: Scene
    units: Units
    stages: Stages

    def at(self, scene: Scene) -> Self:
        """A solve on the way of this one, for another scene, out of the same budget."""

    def start(self, near: S | None = None) -> S:
        """A coarse state of a scene that says where stick ends, by the method's own ways; also from one near by.

        Raises:
            Stopped: None of them leads to a state.
        """

    def transfer(self, state: S, layout: Layout, ends: Array) -> S:
        """A state as a first guess on a layout whose parts have about these ends, for the scene of this solve."""

    def converge(self, start: S, stage: str, why: str) -> S:
        """Newton's iteration from a first guess; adds a stage.

        Raises:
            Stopped: It does not converge.
        """

    def sharpen(self, state: S, why: str) -> S:
        """The same state known well enough to compare it with a limit.

        Raises:
            Stopped: It does not converge.
        """

    def is_plausible(self, state: S) -> bool:
        """Whether a state has a mechanical sense: joints in order, and the belt pressed onto the pulley."""

    def samples(self, state: S) -> Samples:
        """What a state says about its layout."""

    def tolerances(self, state: S) -> Tolerances | None:
        """How far a state is trusted; None where its layout is not to be judged."""

    def refine(self, state: S) -> S | None:
        """The same state on a finer discretisation; None where nothing finer is wanted."""
