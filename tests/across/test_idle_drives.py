"""Closed loops that hardly transmit anything: the belt only turns, or slides along next to nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from drives import NAMES, REFERENCE, drive

from belt_fenicsx import bvp, solve

pytestmark = pytest.mark.serial

LOOPS = [name for name in NAMES if REFERENCE[name]["closed"]]
EXCUSED = 1e-9  # Torque over the radius times the tension that is as good as none.


def loaded(name, part=0.0, **changes):
    """A reference loop with a part of its torques, and one given speed."""
    scene = drive(name, **changes)
    first, *others = (
        p if p.torque is None else replace(p, torque=part * p.torque, drag=part * p.drag) for p in scene.pulleys
    )
    others = [p if p.omega is None else p.driven(torque=0.0) for p in others]
    return replace(scene, pulleys=(first, *others))


def missed(solution):
    """Largest error of a given torque, over the radius times the tension."""
    tension = max(span.tension[1] for span in solution.spans)
    return max(
        abs(contact.torque - pulley.torque - pulley.drag * contact.omega) / (pulley.radius * tension)
        for contact, pulley in zip(solution.contacts, solution.scene.pulleys, strict=True)
        if pulley.torque is not None
    )


def both(scene):
    """Answers of both methods, of which each finds its own zones."""
    ours, others = solve(scene), bvp.solve(scene)
    assert ours.success and others.success
    assert not any(stage.name == "method bvp" for stage in ours.stages)
    assert ours.transport_rate == pytest.approx(others.transport_rate, rel=1e-7)
    for one, other in zip(ours.contacts, others.contacts, strict=True):
        assert one.omega == pytest.approx(other.omega, rel=1e-7)
    return ours, others


@pytest.mark.parametrize("name", LOOPS)
def test_a_loop_without_torques_only_turns(name):
    scene = loaded(name)
    for solution in both(scene):
        assert missed(solution) < EXCUSED
        if not any(scene.gravity) and name != "two-entry-slip":
            assert [[zone.slip for zone in contact.zones] for contact in solution.contacts] == [[None]] * len(
                scene.pulleys
            )


@pytest.mark.parametrize("part", [1e-12, 1e-10, 1e-5, 1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("name", ["two-equal", "two-fast", "two-slack", "thread-dynamic", "serpentine", "three-idler"])
def test_small_torques_lead_to_a_loop_without_any(name, part):
    idle = bvp.solve(loaded(name))
    for solution in both(loaded(name, part)):
        assert missed(solution) < EXCUSED
        for one, other in zip(solution.contacts, idle.contacts, strict=True):
            # Speeds differ by the strain that the torques make, which is below a tenth.
            assert one.omega == pytest.approx(other.omega, rel=0.1 * part + 1e-9)


@pytest.mark.parametrize("method", [solve, bvp.solve])
@pytest.mark.parametrize("name", LOOPS)
def test_radii_that_are_not_quite_those(name, method):
    """What only turns does so with any radii."""
    scene, random = loaded(name), np.random.default_rng(LOOPS.index(name))
    known = bvp.solve(scene)
    for size in (1e-9, 1e-7, 1e-5):
        radii = [pulley.radius * (1.0 + size * random.uniform(-1.0, 1.0)) for pulley in scene.pulleys]
        pulleys = tuple(replace(p, radius=radius) for p, radius in zip(scene.pulleys, radii, strict=True))
        solution = method(replace(scene, pulleys=pulleys))
        assert solution.success and missed(solution) < EXCUSED
        for one, other in zip(solution.contacts, known.contacts, strict=True):
            assert one.omega == pytest.approx(other.omega, rel=100.0 * size)


@pytest.mark.parametrize("name", ["two-equal", "two-fast", "two-gravity", "two-unequal"])
def test_a_touching_fibre_slides_though_no_torque_asks_for_it(name):
    scene = loaded(name)
    offset = 0.1 * min(pulley.radius for pulley in scene.pulleys)
    touching = replace(scene, belt=replace(scene.belt, contact_offset=offset))
    for solution in both(touching):
        assert missed(solution) < EXCUSED
        for contact in solution.contacts:
            assert [zone.slip for zone in contact.zones][:2] == ["forward", None]


@pytest.mark.parametrize("angle", [0.0, 0.4, 2.0])
@pytest.mark.parametrize("name", ["two-equal", "two-unequal", "thread"])
def test_weight_makes_a_loop_slide_a_little(name, angle):
    """Where tensions differ by weight, a belt that transmits nothing slides before it leaves a pulley."""
    scene = loaded(name, gravity=(9.81 * math.sin(angle), -9.81 * math.cos(angle)))
    heavy = replace(scene, belt=replace(scene.belt, line_density=0.3))
    for solution in both(heavy):
        assert missed(solution) < EXCUSED
