"""The layers of a belt that touches with its surface, in a first guess: against answers, and in order."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from drives import drive

from belt_fenicsx import bvp
from belt_fenicsx.taut_string.bent import bent
from belt_fenicsx.taut_string.drive import string_drive


def touching(name, e=None, **changes):
    """A reference drive whose belt touches with its surface, with what is changed of its pulleys."""
    scene = drive(name)
    a, b1 = scene.belt.bending_stiffness, scene.belt.extensional_stiffness
    half = math.sqrt(3.0 * a / b1)  # half of the thickness of a rectangle
    belt = replace(scene.belt, contact_offset=half if e is None else e)
    return replace(scene, belt=belt, pulleys=tuple(replace(pulley, **changes) for pulley in scene.pulleys))


def guess(scene):
    dimensionless, _ = scene.dimensionless()
    return bent(dimensionless, string_drive(dimensionless))


def test_without_an_offset_it_is_the_string():
    scene, _ = drive("two-equal").dimensionless()
    string = string_drive(scene)
    assert bent(scene, string) is string


@pytest.mark.parametrize("name", ["two-equal", "two-unequal", "three-idler"])
def test_contacts_and_entries_are_about_as_long_as_those_of_the_answer(name):
    scene, compared = touching(name), 0
    answer, first = bvp.solve(scene), guess(scene)
    for contact in answer.contacts:
        on, zones = first.on(contact.pulley), contact.zones
        lengths = [(zone.sigma[1] - zone.sigma[0]) / scene.belt.length for zone in zones]
        assert sum(own.length for own in on) == pytest.approx(sum(lengths), rel=0.1)
        if on[1].part.kind == zones[1].kind == "stick":
            assert on[0].part.slip == zones[0].slip == "forward"
            assert on[0].length == pytest.approx(lengths[0], rel=0.25)
            compared += 1
    assert compared >= 2


@pytest.mark.parametrize("name", ["two-equal", "three-idler", "serpentine"])
def test_the_belt_is_continuous_and_closed(name):
    parts = guess(touching(name)).parts
    for before, after in itertools.pairwise([*parts, parts[0]]):
        np.testing.assert_allclose(before.end, after.start, atol=1e-12)
        turns = (before.angles[1] - after.angles[0]) / (2.0 * math.pi)
        assert turns == pytest.approx(round(turns), abs=1e-12)
        for place, end in ((0.0, before.start), (1.0, before.end)):
            np.testing.assert_allclose([float(x[0]) for x in before.at(np.array([place]))[:2]], end, atol=1e-12)
    assert all(own.length > 0.0 for own in parts)
