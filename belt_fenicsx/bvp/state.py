"""A state of the boundary-value problem: the equations of a layout, and their solution."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

from belt_fenicsx.bvp.equations import Free, Rod, Slip, Stick, ZoneEquations
from belt_fenicsx.bvp.newton import Discrete
from belt_fenicsx.bvp.problem import FIRST, LAST, Condition, Problem, component, moment, onset
from belt_fenicsx.bvp.reading import samples
from belt_fenicsx.layout.layout import BEFORE, Layout
from belt_fenicsx.layout.posed import posed
from belt_fenicsx.layout.revision import Samples
from belt_fenicsx.scene.scene import Scene

D = 5  # Index of the stretch among the components of a state.


@dataclass(frozen=True)
class State:
    """What a warm start needs: the layout, its equations and their solution."""

    layout: Layout
    problem: Problem
    discrete: Discrete

    @functools.cached_property
    def samples(self) -> Samples:
        """What it says about its layout."""
        return samples(self.problem, self.discrete)


def pose(scene: Scene, layout: Layout | None = None) -> Problem:
    """The boundary-value problem of a dimensionless scene, with the layout that it asks for if not another."""
    (pulley,), belt, layout = scene.pulleys, scene.belt, layout or posed(scene)
    rod = Rod(
        a=belt.bending_stiffness,
        b1=belt.extensional_stiffness,
        b2=belt.shear_stiffness,
        radius=pulley.radius,
        center=pulley.center,
    )
    of_kind: dict[str, ZoneEquations] = {"free": Free(), "stick": Stick()}
    zones = tuple(of_kind.get(part.kind) or Slip(part.sense * pulley.friction) for part in layout.parts)
    return Problem(rod, scene.span, zones, tuple(_conditions(scene, layout, rod)))


def _conditions(scene: Scene, layout: Layout, rod: Rod) -> Iterator[Condition]:
    """One condition for each joint of parts on a pulley; tangency is a part of what is continuous."""
    (pulley,), (speed,), on, transition = scene.pulleys, layout.speeds, layout.on(0), layout.transition(0)
    for i, joint in enumerate(layout.joints):
        before, after = layout.parts[i], layout.parts[i + 1]
        if joint.equation == "coulomb":
            # Friction in stick is that of the sliding before it, but opposes the sliding that begins after it.
            sense = -after.sense if joint.side == BEFORE else before.sense
            yield Condition(((i, LAST, onset(rod, Slip(sense * pulley.friction))),))
        elif joint.equation == "x":
            yield Condition(((i, LAST, component(0)),), pulley.drive.by("x_trans"))
        elif joint.equation == "speed":
            yield Condition(((i, LAST, component(D)),), rod.radius * pulley.drive.by("omega"))
        elif joint.equation == "stretch" and i != transition:
            yield Condition(((i, LAST, component(D)), (transition, LAST, component(D, -1.0))))
    if speed.equation == "torque":
        # It takes the place of the stretch at the transition, which is that in stick already.
        ends = (on[0], FIRST, moment(rod, 1.0)), (on[-1], LAST, moment(rod, -1.0))
        yield Condition(ends, pulley.drive.by("torque"))
