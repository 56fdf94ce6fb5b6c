"""The string where clamps press the belt onto a pulley, and that of a belt which is longer than its path."""

import math
from dataclasses import replace

import numpy as np
import pytest

from belt_fenicsx.layout.kind import Part
from belt_fenicsx.layout.layers import LEAST_STRAIN
from belt_fenicsx.scene.belt import Belt
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.taut_string.drive import string_drive
from belt_fenicsx.taut_string.pressed import pressed

pytestmark = pytest.mark.serial

# The pulley is wide, and reaches up next to the second clamp.
BELT = Belt(length=0.99, thickness=0.05)
PULLEY = Pulley(radius=0.8, center=(0.1, -0.7), friction=0.3)
NEAR = Scene(belt=BELT, pulleys=(PULLEY,))


def strings(scene):
    dimensionless, _ = scene.dimensionless()
    string = string_drive(dimensionless, slack=True)
    return dimensionless, string, pressed(dimensionless, string)


def test_a_clamp_presses_the_belt_onto_the_pulley_next_to_it():
    scene, string, found = strings(NEAR)
    (x, y), radius = scene.pulleys[0].center, scene.pulleys[0].radius
    (first, last), (touched, left) = ((own.on(0)[0].angles[0], own.on(0)[-1].angles[1]) for own in (string, found))
    assert found.pressed and not string.pressed
    assert touched >= first and left < last
    for own in found.on(0):
        assert math.dist(own.start, (x, y)) == pytest.approx(radius, rel=1e-12)
    for before, after in zip(found.parts, found.parts[1:], strict=False):
        assert before.end == pytest.approx(after.start, abs=1e-14)
    ends = [own.at(np.array([0.0, 1.0]))[:2] for own in (found.parts[0], found.parts[-1])]
    places = [(ends[0][0][0], ends[0][1][0]), (ends[1][0][1], ends[1][1][1])]
    np.testing.assert_allclose(places, [clamp[:2] for clamp in scene.ends], atol=1e-14)


@pytest.mark.parametrize(("turn", "side"), [(0.0, "left"), (math.pi, "right"), (1.0, "left"), (2.5, "right")])
def test_wherever_the_clamps_are(turn, side):
    """Turned, and mirrored at the line between the clamps, it is the same."""
    sign = 1.0 if side == "right" else -1.0
    way = complex(math.cos(turn), math.sin(turn))
    center = complex(PULLEY.center[0], sign * PULLEY.center[1]) * way
    pulley = replace(PULLEY, center=(center.real, center.imag), side=side, x_trans="run-off")
    clamps = tuple((x * way.real, x * way.imag, turn) for x in (-0.5, 0.5))
    seen = []
    sticking = replace(NEAR, pulleys=(replace(PULLEY, x_trans="run-off"),))
    for scene in (sticking, Scene(belt=BELT, pulleys=(pulley,), clamps=clamps)):
        _, _, found = strings(scene)
        assert found.pressed
        seen.append([own.length for own in found.parts])
    assert seen[0] == pytest.approx(seen[1], rel=1e-12)


def test_a_clamp_far_away_leaves_the_string_as_it_is():
    _, string, found = strings(replace(NEAR, belt=replace(BELT, thickness=0.002)))
    assert found is string


def test_a_belt_that_is_longer_than_its_path_has_a_small_force():
    scene, _ = replace(NEAR, belt=replace(BELT, length=1.2)).dimensionless()
    with pytest.raises(Stopped, match="longer than its path"):
        string_drive(scene)
    string = string_drive(scene, slack=True)
    assert string.parts[-1].force[1] == pytest.approx(LEAST_STRAIN, rel=1e-12)
    assert sum(own.length for own in string.parts) < 1.0


@pytest.mark.parametrize("place", [-0.5, 0.5])
@pytest.mark.parametrize("sense", ["forward", "backward"])
def test_a_place_outside_of_the_contact_is_kept(place, sense):
    string = string_drive(Scene(pulleys=(Pulley(x_trans=place, slip=sense),)).dimensionless()[0])
    assert [own.part for own in string.on(0)] == [Part("stick"), Part("slip", sense)]


@pytest.mark.parametrize("friction", [1e-9, 1e-6, 1e-3])
@pytest.mark.parametrize("drive", ["torque", "x_trans", "slip_angle"])
def test_forces_with_little_friction(friction, drive):
    """The length knows an angle of sliding by rounding over friction alone."""
    given = {"torque": 1000.0 * friction, "x_trans": 0.05, "slip_angle": 0.1}[drive]
    scene, _ = Scene(pulleys=(Pulley(friction=friction, **{drive: given}),)).dimensionless()
    string = string_drive(scene)
    before, after = (string.parts[i].force[0] for i in (0, -1))
    assert after / before - 1.0 == pytest.approx(friction * string.slip_angles[0], rel=1e-2, abs=1e-14)
