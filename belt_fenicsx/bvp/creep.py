"""Where the belt sticks and where it slides, from friction that grows with the speed of sliding.

Each pulley is one part then, and no joint has to be guessed. The width in which friction grows is made smaller, step by
step; at last, where it is nearly all of mu p, the belt slides, and sticks elsewhere. That is a first guess of the
layout and of all fields on it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from belt_fenicsx.bvp.equations import Creeping, OnPulleys
from belt_fenicsx.bvp.newton import NEWTON, Discrete, Work
from belt_fenicsx.bvp.problem import LAST, Condition, End, Problem, places
from belt_fenicsx.bvp.state import FRICTION, STRAIN, pose, take_up_conditions
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import Part, sliding
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered
from belt_fenicsx.scene.scene import Scene

SURFACE = 5  # Index of the strain that goes with the surface of a pulley.
WIDEST, NARROWEST, NARROWER = 1.0, 0.002, 0.25  # Widths over mu times the strain; the ratio of two of them.
VISCOUS = 0.02  # Part of mu p that friction grows by in usual sliding.
LEAST_RATIO = 0.8  # Widths fall by no less than this.
CELLS = 32  # Of each part, at least: a narrow width makes a stiff equation.
SLIDES = 0.95  # Friction of this part of mu p is that of sliding.
PIECES = 4  # Of each cell, for places of joints.
LEAST, SHORT = 1e-3, 0.02  # A part is at least as long, in parts of its contact; so is one that has to be there.


def creep_problem(scene: Scene, tension: float, winding: float, width: float) -> Problem:
    """The boundary-value problem with one creeping part on each pulley; ``width`` is relative to mu and the strain."""
    parts = [Part("slip", "forward", index) for index in range(len(scene.pulleys))]
    layout = ordered(scene, parts)
    problem = pose(scene, layout, tension, winding, conditions=tuple(_conditions(scene, layout)))
    equations, friction = problem.contacts.equations, np.array([[pulley.friction] for pulley in scene.pulleys])
    assert isinstance(equations, OnPulleys)
    # About what the stretch changes by in sliding.
    unit = tension / scene.belt.extensional_stiffness * np.minimum(friction, 1.0)
    creeping = Creeping(
        **{name: getattr(equations, name) for name in ("radius", "center", "turn", "slope", "slides")},
        friction=friction,
        width=width * unit,
        viscosity=VISCOUS / unit,
    )
    units = np.append(problem.contacts.units, problem.contacts.units[3])
    return replace(problem, contacts=replace(problem.contacts, equations=creeping, units=units))


def _giving(scene: Scene) -> int | None:
    """The pulley whose speed gives the transport rate where no force depends on it; None elsewhere."""
    if scene.transport_rate is not None or scene.has_inertia:
        return None
    return next(index for index, pulley in enumerate(scene.pulleys) if pulley.drive.kind == "omega")


def _conditions(scene: Scene, layout: Layout) -> Iterator[Condition]:
    """One condition for each pulley that is driven, and one for each take-up."""
    giving = _giving(scene)
    for index, pulley in enumerate(scene.pulleys):
        (part,) = layout.on(index)
        if index != giving and pulley.drive.kind in ("omega", "torque"):
            other = part if giving is None else layout.on(giving)[0]
            yield Condition(((part, LAST), (other, LAST)), _driven(scene, index, giving))
        yield from take_up_conditions(scene, layout, index)


def _driven(scene: Scene, index: int, giving: int | None) -> Callable[[Sequence[End], Array], Array]:
    """What drives a pulley, less what does in a state."""
    pulley = scene.pulleys[index]
    speed = None if giving is None else scene.pulleys[giving].surface_speed

    def missed(ends: Sequence[End], c: Array) -> Array:
        own, other = (end.y[SURFACE] for end in ends)
        rate = c if speed is None else speed / (1.0 + other)
        omega = rate * (1.0 + own) / pulley.radius
        if pulley.drive.kind == "omega":
            return omega - pulley.drive.by("omega")
        return -pulley.radius * ends[0].y[FRICTION] - pulley.drive.by("torque") - pulley.drag * omega

    return missed


def narrowed(
    make: Callable[[float], Problem], start: Discrete, work: Work, *, positive: bool = False
) -> list[tuple[Problem, Discrete]]:
    """States with narrower and narrower widths; none where Newton's iteration does not converge for the widest.

    Args:
        make: Makes the problem with a width.
        start: The first guess.
        work: What may still be spent.
        positive: Whether to solve for the logarithms of the lengths of parts.
    """
    width, ratio, states = WIDEST, NARROWER, list[tuple[Problem, Discrete]]()
    while width >= NARROWEST:
        problem = make(width)
        near = states[-1][1] if states else start
        found = work.newton(problem, near, NEWTON, "creep", positive=positive)
        if found.converged:
            states.append((problem, found))
        elif not states or ratio > LEAST_RATIO:
            break
        else:
            width, ratio = width / ratio, math.sqrt(ratio)
        width *= ratio
    return states


def zones(scene: Scene, problem: Problem, discrete: Discrete) -> tuple[list[Part], Array]:
    """Parts on the pulleys that a state with creep shows, and the ends of all parts of the belt."""
    mesh, xi, equations = discrete.mesh, np.linspace(0.0, 1.0, PIECES * discrete.cells + 1), problem.contacts.equations
    assert isinstance(equations, Creeping)
    # Means of neighbouring nodes: a stiff equation makes the nodes alternate about what they should be.
    z, middles = (((v[..., 1:] + v[..., :-1]) / 2.0) for v in (discrete.values.z[1], mesh))
    y, rod, c = problem.contacts.unscaled(z), problem.rod, np.asarray(discrete.values.c)
    bounds = equations.friction * equations.pressure(rod, y, c)
    ahead, spare = (
        np.array([np.interp(xi, middles, own) for own in values])
        for values in (y[STRAIN] - y[SURFACE], bounds - np.abs(equations.keeping(rod, y[:SURFACE], c)))
    )
    ratios, keeps = equations.friction_ratio(ahead), spare > 0.0
    inside, ends = places(discrete.widths, xi), discrete.ends
    parts: list[Part] = []
    found = [] if problem.clamps is None else [ends[:1]]
    driven = [index for index, pulley in enumerate(scene.pulleys) if pulley.drive.kind == "omega"]
    anchor = driven[0] if scene.transport_rate is None else None
    for ratio, keep, index in zip(ratios, keeps, problem.contacts.parts.tolist(), strict=True):
        pulley = problem.parts[index].pulley
        smooth, gives = scene.pulleys[pulley].friction == 0.0, pulley == anchor
        kinds, joints = ([1.0], [0.0, 1.0]) if smooth else _divided(ratio, keep, inside[index])
        if gives and len(kinds) == 1 and kinds[0] != 0.0:
            # What gives the transport rate sticks somewhere, and slides behind.
            kinds, joints = [0.0, *kinds], [0.0, SHORT * joints[1], *joints[1:]]
        elif gives and kinds[-1] == 0.0:
            end = joints[-2] + (1.0 - SHORT) * (1.0 - joints[-2])
            kinds, joints = [*kinds, math.copysign(1.0, ratio[-1])], [*joints[:-1], end, 1.0]
        parts += [sliding(kind, pulley) if kind else Part("stick", pulley=pulley) for kind in kinds]
        found.append(ends[index] + np.array(joints) * (ends[index + 1] - ends[index]))
    return parts, np.concatenate([*found, ends[-1:]])


def _divided(ratio: Array, keeps: Array, places: Array) -> tuple[list[float], list[float]]:
    """Senses of sliding one after another, zero for stick, and the ends of these parts in [0, 1].

    The belt sticks in the longest of the places with less friction than that of sliding, if friction holds the stretch
    there. Elsewhere sliding turns. Behind stick, it does so only where friction no longer holds the stretch: before, a
    stiff equation makes the belt seem to slide to and fro, and it sticks.
    """
    senses = np.where(np.abs(ratio) > SLIDES, np.sign(ratio), 0.0)
    runs = [list(group) for _, group in itertools.groupby(range(senses.size), key=lambda i: senses[i])]
    sticks = [run for run in runs if senses[run[0]] == 0.0 and keeps[run].any()]
    longest = max(sticks, key=lambda run: places[run[-1]] - places[run[0]], default=[])
    if longest:
        sliding_runs = [run for run in runs if run[0] > longest[-1] and senses[run[0]] != 0.0]
        for run, following in itertools.pairwise(sliding_runs):
            if senses[run[0]] == senses[following[0]] or not keeps[run[-1]]:
                break
            longest = [*range(longest[0], run[-1] + 1)]
        senses[longest] = 0.0
    turning = np.abs(senses) + np.isin(np.arange(senses.size), longest) == 0.0
    senses[turning] = np.sign(ratio[turning])
    changes = np.flatnonzero(np.diff(senses)) + 1
    joints = [0.0, *((places[changes - 1] + places[changes]) / 2.0).tolist(), 1.0]
    kinds = senses[[0, *changes]].tolist()
    while len(kinds) > 1 and min(np.diff(joints)) < LEAST:
        i = int(np.argmin(np.diff(joints)))
        del kinds[i], joints[i + (i < len(kinds))]
        if 0 < i < len(kinds) and kinds[i - 1] == kinds[i]:
            del kinds[i], joints[i]
    return kinds, joints
