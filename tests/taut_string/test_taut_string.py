"""The taut string: geometry, length and friction law."""

import math
from dataclasses import replace

import numpy as np
import pytest

from belt_fenicsx.layout.layers import LEAST_STRAIN
from belt_fenicsx.scene.belt import Belt
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.taut_string.string import taut_string

pytestmark = pytest.mark.serial

SCENES = {
    "source": Scene(),
    "backward": Scene(pulleys=(Pulley(slip="backward", x_trans=0.1),)),
    "shifted": Scene(pulleys=(Pulley(center=(0.1, -0.6)),)),
    "above the clamps": Scene(pulleys=(Pulley(radius=0.25, center=(-0.05, 0.1)),)),
    "pure stick": Scene(pulleys=(Pulley(x_trans="run-off"),)),
    "pure slip": Scene(pulleys=(Pulley(x_trans="run-up"),)),
    "slack": Scene(belt=Belt(length=1.05)),
    "given speed": Scene(pulleys=(Pulley(omega=1.48),)),
}


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())
def test_string_spans_the_clamps_along_the_pulley(scene):
    string, pulley = taut_string(scene), scene.pulleys[0]
    half = scene.belt.length / 2
    ends = string.r(np.array([-half, half]))
    np.testing.assert_allclose(ends, [[-scene.span / 2, 0], [scene.span / 2, 0]], atol=1e-14)
    sigma = np.linspace(string.joints[0], string.joints[2], 50)
    np.testing.assert_allclose(np.hypot(*(string.r(sigma) - pulley.center).T), pulley.radius, rtol=1e-14)
    np.testing.assert_allclose(string.r(string.joints)[:, 0], string.x, atol=1e-14)
    np.testing.assert_allclose(string.phi(string.joints), string.angles, atol=1e-14)
    outside = np.concatenate([np.linspace(-half, string.joints[0], 20), np.linspace(string.joints[2], half, 20)])
    assert np.min(np.hypot(*(string.r(outside) - pulley.center).T)) >= pulley.radius * (1 - 1e-14)


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())
def test_string_has_the_length_of_the_belt(scene):
    string = taut_string(scene)
    assert string.sigma[[0, -1]] == pytest.approx([-scene.belt.length / 2, scene.belt.length / 2], abs=1e-15)
    assert np.all(np.diff(string.sigma) >= 0.0)
    assert np.all(np.diff(string.joints) >= 0.0)


def test_string_is_tangent_to_the_pulley():
    string = taut_string(SCENES["shifted"])
    for border, side in ((0, -1.0), (2, 1.0)):
        span = string.r(string.joints)[border] - [0.5 * side, 0.0]
        assert abs(math.remainder(math.atan2(span[1], span[0]) - string.angles[border], math.pi)) < 1e-14


@pytest.mark.parametrize("sense", ["forward", "backward"])
def test_strain_follows_euler_and_eytelwein(sense):
    string = taut_string(Scene(pulleys=(Pulley(slip=sense, friction=0.3),)))
    sign = 1.0 if sense == "forward" else -1.0
    wrapped = string.angles[1] - string.angles[2]
    assert string.strain[1] / string.strain[0] == pytest.approx(math.exp(sign * 0.3 * wrapped), rel=1e-12)
    sigma = np.linspace(string.joints[1], string.joints[2], 20)[1:-1]
    expected = string.strain[0] * np.exp(sign * 0.3 * (string.angles[1] - string.phi(sigma)))
    np.testing.assert_allclose(string.D(sigma) - 1.0, expected, rtol=1e-2)


def test_string_without_contact():
    assert taut_string(Scene(pulleys=(Pulley(center=(0.0, -0.75)),))) is None


def test_slack_string_keeps_a_little_force():
    string = taut_string(SCENES["slack"])
    assert np.min(string.strain) == pytest.approx(LEAST_STRAIN, rel=1e-12)
    assert np.max(string.stretches) < 1.0


def test_transition_outside_of_the_contact_is_moved_into_it():
    source = Scene()
    pulley = replace(source.pulleys[0], x_trans=0.5)
    string = taut_string(replace(source, pulleys=(pulley,)))
    assert string.angles[0] > string.angles[1] > string.angles[2]
