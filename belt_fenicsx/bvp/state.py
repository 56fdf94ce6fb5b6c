"""A state of the boundary-value problem: the equations of a layout, and their solution."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from belt_fenicsx.bvp.equations import Free, OnPulleys, Rod
from belt_fenicsx.bvp.newton import Discrete
from belt_fenicsx.bvp.problem import FIRST, LAST, Condition, End, Group, Joining, Problem, TakeUp
from belt_fenicsx.bvp.reading import samples
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layout import BEFORE, Layout
from belt_fenicsx.layout.posed import gives_rate
from belt_fenicsx.layout.revision import Samples
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene

PHI, STRAIN, FRICTION = 0, 3, 4  # Indices of unknowns on a pulley.


@dataclass(frozen=True)
class State:
    """What a warm start needs: the layout, its equations and their solution."""

    layout: Layout
    problem: Problem
    discrete: Discrete

    @functools.cached_property
    def samples(self) -> Samples:
        """What it says about its layout."""
        return samples(self.problem, self.layout, self.discrete)


def pose(
    scene: Scene,
    layout: Layout,
    tension: float,
    winding: float = 0.0,
    conditions: tuple[Condition, ...] | None = None,
) -> Problem:
    """The boundary-value problem of a dimensionless scene on a layout.

    Args:
        scene: The scene.
        layout: The layout.
        tension: Typical force of the belt.
        winding: Angle by which a loop turns, from its first run-up round to it again.
        conditions: The equations of joints, drives and take-ups, if others than those of the layout.
    """
    parts, rod = layout.parts, rod_of(scene)
    radius, giving = min(pulley.radius for pulley in scene.pulleys), _giving(scene, layout)
    spans = [i for i, part in enumerate(parts) if not part.touches]
    touching = [i for i, part in enumerate(parts) if part.touches]
    joinings = [Joining(i, i + 1) for i in range(len(parts) - 1)]
    if layout.closed:
        follows = conditions is None and layout.closes is not None
        joinings.append(Joining(len(parts) - 1, 0, winding, follows))
    return Problem(
        rod=rod,
        parts=parts,
        spans=Group(Free(), np.array(spans), np.array([1.0, 1.0, 1.0, radius, 1.0 / tension, 1.0 / tension])),
        contacts=Group(
            _on_pulleys(scene, layout, touching),
            np.array(touching),
            np.array([1.0, rod.b2 / tension, radius, rod.b1 / tension, 1.0 / tension]),
        ),
        clamps=None if layout.closed else scene.ends,
        joinings=tuple(joinings),
        conditions=tuple(_conditions(scene, layout, rod)) if conditions is None else conditions,
        returning=() if conditions is not None else _returning(layout),
        take_ups=tuple(
            TakeUp(pulley.direction, tuple(layout.on(index)))
            for index, pulley in enumerate(scene.pulleys)
            if pulley.take_up is not None
        ),
        rate=scene.transport_rate if scene.transport_rate is not None else None if scene.has_inertia else 0.0,
        giving=None if giving is None else (giving, scene.pulleys[giving].surface_speed),
        tension=tension,
    )


def rod_of(scene: Scene) -> Rod:
    """The belt of a dimensionless scene."""
    belt = scene.belt
    return Rod(
        a=belt.bending_stiffness,
        b1=belt.extensional_stiffness,
        b2=belt.shear_stiffness,
        density=belt.line_density,
        inertia=belt.rotary_inertia,
        weight=(belt.line_density * scene.gravity[0], belt.line_density * scene.gravity[1]),
        offset=belt.contact_offset,
    )


def _on_pulleys(scene: Scene, layout: Layout, touching: Sequence[int]) -> OnPulleys:
    """Equations of the parts on pulleys."""
    parts = [layout.parts[i] for i in touching]
    pulleys = [scene.pulleys[part.pulley] for part in parts]
    return OnPulleys(
        radius=np.array([[pulley.radius] for pulley in pulleys]),
        center=np.array([[[pulley.center[axis]] for pulley in pulleys] for axis in (0, 1)]),
        turn=np.array([[pulley.turn] for pulley in pulleys]),
        slope=np.array([[part.sense * pulley.friction] for part, pulley in zip(parts, pulleys, strict=True)]),
        slides=np.array([[float(part.kind == "slip")] for part in parts]),
    )


def _giving(scene: Scene, layout: Layout) -> int | None:
    """The pulley whose speed gives the transport rate afterwards; None where the rate is given or an unknown."""
    return None if scene.transport_rate is not None or scene.has_inertia else gives_rate(scene, layout)


def _conditions(scene: Scene, layout: Layout, rod: Rod) -> Iterator[Condition]:
    """One condition for each joint of parts on a pulley, and one for each take-up."""
    giving = _giving(scene, layout)
    for index, pulley in enumerate(scene.pulleys):
        on, transition = layout.on(index), layout.transition(index)
        for i in on[:-1]:
            joint, before, after = layout.joints[i], layout.parts[i], layout.parts[i + 1]
            if joint.equation == "coulomb":
                # Friction in stick is that of the sliding before it, but opposes the sliding that begins after it.
                sense = -after.sense if joint.side == BEFORE else before.sense
                end = (i, LAST) if before.kind == "stick" else (i + 1, FIRST)
                yield Condition((end,), functools.partial(_onset, rod, np.array([[sense * pulley.friction]])))
            elif i != transition:
                differs = _stretch_rate if i in _returning(layout) else _stretch_differs
                yield Condition(((i, LAST), (transition, LAST)), differs)
            elif index != giving and joint.equation != "loop":
                yield _drive(scene, layout, index, giving)
        if index == layout.closes and layout.rate and giving is None:
            yield _drive(scene, layout, index, giving)
        yield from take_up_conditions(scene, layout, index)


def take_up_conditions(scene: Scene, layout: Layout, index: int) -> Iterator[Condition]:
    """The condition of a pulley that moves: its hub load along the way is what pushes it there."""
    pulley, on = scene.pulleys[index], layout.on(index)
    if pulley.take_up is not None and pulley.force is not None:
        ends = ((on[0], FIRST), *((i, LAST) for i in on))
        yield Condition(ends, functools.partial(_pushed, rod_of(scene), pulley.direction, pulley.force))


def _onset(rod: Rod, slope: Array, ends: Sequence[End], c: Array) -> Array:
    (end,) = ends
    assert isinstance(end.equations, OnPulleys)
    return end.equations.onset(rod, end.y, c, slope)


def _stretch_differs(ends: Sequence[End], c: Array) -> Array:
    return ends[0].y[STRAIN] - ends[1].y[STRAIN]


def _stretch_rate(ends: Sequence[End], c: Array) -> Array:
    """The same of a part that begins with this stretch: without the root that is a part of no length."""
    return _stretch_differs(ends, c) / ends[0].length


def _returning(layout: Layout) -> tuple[int, ...]:
    """Slip parts that begin and end with the stretch in stick."""
    return tuple(
        i
        for index in layout.pulleys
        for i in layout.on(index)
        if i > layout.transition(index) and layout.parts[i].kind == "slip" and layout.joints[i].equation == "stretch"
    )


def _pushed(rod: Rod, direction: tuple[float, float], force: float, ends: Sequence[End], c: Array) -> Array:
    """Hub load along the direction of a take-up, and the force that pushes it there."""
    first, last = (end.equations.joined(rod, end.y, c) for end in (ends[0], ends[-1]))
    length = sum(end.length for end in ends[1:])
    x, y = (last[i + 4] - first[i + 4] + rod.weight[i] * length for i in (0, 1))
    return direction[0] * x + direction[1] * y + force


def _drive(scene: Scene, layout: Layout, index: int, giving: int | None) -> Condition:
    """The condition of what drives a pulley."""
    pulley, on, transition = scene.pulleys[index], layout.on(index), layout.transition(index)
    drive, radius = pulley.drive, pulley.radius
    given_speed = None if giving is None else scene.pulleys[giving].surface_speed
    # Last, the ends where the stretch is that in stick on this pulley and on the one that gives the transport rate.
    speeds = ((transition, LAST), (transition if giving is None else layout.transition(giving), LAST))

    def speed(ends: Sequence[End], c: Array) -> Array:
        """The pulley's angular velocity."""
        if given_speed is not None:
            c = given_speed / (1.0 + ends[-1].y[STRAIN])
        return c * (1.0 + ends[-2].y[STRAIN]) / radius

    match drive.kind:
        case "x_trans":
            return Condition(((transition + 1, FIRST),), functools.partial(_placed, drive.by("x_trans")))
        case "slip_angle":
            ends = ((transition + 1, FIRST), (on[-1], LAST))
            return Condition(ends, functools.partial(_slides_along, pulley, drive.by("slip_angle")))
        case "omega":
            return Condition(speeds, lambda ends, c: speed(ends, c) - drive.by("omega"))
        case _:
            frictions = tuple((i, LAST) for i in on)

            def torque(ends: Sequence[End], c: Array) -> Array:
                given = drive.by("torque") + (drive.drag * speed(ends, c) if drive.drag else 0.0)
                return -radius * sum(end.y[FRICTION] for end in ends[:-2]) - given

            return Condition((*frictions, *speeds), torque)


def _placed(x: float, ends: Sequence[End], c: Array) -> Array:
    """Place of the touching fibre, less a given one."""
    (end,) = ends
    on = end.equations
    assert isinstance(on, OnPulleys)
    return on.center[0] - on.turn * on.radius * np.sin(end.y[PHI]) - x


def _slides_along(pulley: Pulley, angle: float, ends: Sequence[End], c: Array) -> Array:
    return pulley.turn * (ends[0].y[PHI] - ends[1].y[PHI]) - angle
