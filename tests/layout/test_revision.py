"""Which layout made-up tractions call for: the rule alone, without a method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from belt_fenicsx.layout.kind import STICK, Part
from belt_fenicsx.layout.posed import ordered
from belt_fenicsx.layout.revision import Resultants, Sample, Samples, Tolerances, revise
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene

FORWARD, BACKWARD = Part("slip", "forward"), Part("slip", "backward")
TOLERANCES = Tolerances(shrunk=1e-12, bound=1e-8, sense=1e-8)
PLACE = np.linspace(0.0, 1.0, 101)
OFF = {"x_trans": "run-off"}


def scene(**drive):
    return Scene(pulleys=(Pulley(friction=0.5, **drive),))


def revised(contact, fields, drive=None, ends=None, **tolerances):
    """The parts that are called for, and the ends of the contact's parts, from one field of each part.

    The pressure is one, so that friction in stick may be 0.5; the pulley's speed goes with the stretch one. The field
    of a stick part is its friction, that of a slip part its stretch less one, both over the part from 0 to 1.
    """
    asked = scene(**(drive or {}))
    layout = ordered(asked, contact)
    ends = np.array([-0.5, *(ends or np.linspace(-0.2, 0.2, len(contact) + 1)), 0.5])
    parts: list[Sample | None] = [None]
    for part, field, start, end in zip(contact, fields, ends[1:-2], ends[2:-1], strict=True):
        values, one = np.broadcast_to(field(PLACE), PLACE.shape), np.ones(PLACE.size)
        f, D = (values, one) if part == STICK else (-0.5 * part.sense * one, 1.0 + values)
        sigma = start + (end - start) * PLACE
        parts.append(Sample(sigma=sigma, x=sigma, p=one, f=f, D=D, keeping=f.copy))
    samples = Samples(ends, (*parts, None), (Resultants(1.0, float(ends[2]), 0.4, 0.0),))
    revision = revise(asked, layout, samples, replace(TOLERANCES, **tolerances))
    if revision is None:
        return None
    return "impossible" if revision.layout is None else (list(revision.layout.contact), revision.ends[1:-1])


def right(x):
    return 0.01 * x


def wrong(x):
    return -0.01 * x


def still(x):
    return 0.0 * x


def test_nothing_is_called_for_where_all_bounds_hold():
    assert revised([STICK, FORWARD], [still, right]) is None
    assert revised([STICK, BACKWARD], [still, wrong], {"x_trans": 0.0, "slip": "backward"}) is None


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_sliding_before_stick(sign):
    contact, ends = revised([STICK], [lambda x: sign * (x - 0.6)], OFF)
    assert contact == [BACKWARD if sign < 0.0 else FORWARD, STICK]
    assert ends == pytest.approx([-0.2, -0.2 + 0.4 * 0.1, 0.2], abs=0.004)


@pytest.mark.parametrize("keeping", [0.6, 0.2, -0.2])
def test_sliding_turns_by_way_of_stick_where_friction_could_keep_the_stretch(keeping):
    asked = scene(omega=1.0)
    layout = ordered(asked, [FORWARD, BACKWARD, FORWARD])
    ends = np.array([-0.5, -0.2, -0.1, 0.0, 0.2, 0.5])
    parts = []
    for part, start, end in zip(layout.contact, ends[1:-2], ends[2:-1], strict=True):
        sigma = start + (end - start) * PLACE
        f, one = np.full(PLACE.size, -0.5 * part.sense), np.ones(PLACE.size)
        D = 1.0 + 0.01 * part.sense * (1.0 - PLACE if part == FORWARD else PLACE)
        parts.append(Sample(sigma, sigma, one, f, D, (-1.0 + (keeping + 1.0) * PLACE).copy))
    samples = Samples(ends, (None, *parts, None), (Resultants(1.0, -0.1, 0.4, 0.0),))
    revision = revise(asked, layout, samples, TOLERANCES)
    if keeping == 0.6:
        assert revision is None
    else:
        assert revision.layout.contact == (FORWARD, STICK, BACKWARD, FORWARD)
        assert revision.ends[2] == pytest.approx(-0.2 + 0.1 * 0.5 / (keeping + 1.0), abs=0.002)


def test_the_longest_stick_ends_where_friction_reaches_its_bound():
    contact, ends = revised([STICK], [lambda x: x - 0.2], OFF)
    assert contact == [STICK, FORWARD]
    assert ends == pytest.approx([-0.2, -0.2 + 0.4 * 0.7, 0.2], abs=0.004)
    assert revised([STICK, FORWARD], [lambda x: x - 0.2, right], OFF) is None


def test_stick_that_ends_too_late_turns_under_a_given_speed_and_is_impossible_at_a_given_place():
    contact, ends = revised([STICK, BACKWARD], [lambda x: x - 0.2, wrong], {"omega": 1.48})
    assert contact == [STICK, BACKWARD, FORWARD]
    assert np.all(np.diff(ends) > 0.0)
    assert revised([STICK, FORWARD], [lambda x: x - 0.2, right]) == "impossible"


def test_stick_that_holds_nowhere_gives_way_to_the_sliding_before_it():
    contact, ends = revised([STICK, BACKWARD], [lambda x: x - 2.0, wrong], {"x_trans": 0.0, "slip": "backward"})
    assert contact == [FORWARD, BACKWARD]
    assert ends == pytest.approx([-0.2, 0.0, 0.2])
    contact, ends = revised([FORWARD, STICK, BACKWARD], [right, lambda x: x - 2.0, wrong], {"omega": 1.48})
    assert contact == [FORWARD, BACKWARD]
    assert ends == pytest.approx([-0.2, 0.2 - 0.4 / 3, 0.2])


@pytest.mark.parametrize("drive", [{"omega": 1.48}, {"torque": 1.0}])
def test_sliding_that_is_wrong_turns(drive):
    contact, ends = revised([STICK, FORWARD], [still, lambda x: 0.01 * x * (0.75 - x)], drive)
    assert contact == [STICK, FORWARD, BACKWARD]
    assert ends[2] == pytest.approx(0.15, abs=0.002)
    contact, _ = revised([STICK, FORWARD], [still, wrong], drive)
    assert contact == [STICK, BACKWARD]


def test_short_parts_in_which_sliding_turns_are_left_as_they_are():
    assert revised([STICK, FORWARD], [still, lambda x: np.minimum(x, 0.999 - x)], ends=[-0.2, 0.195, 0.2]) is None


def test_parts_that_have_shrunk_to_nothing_are_left_out():
    contact, ends = revised([FORWARD, STICK, FORWARD], [right, still, right], ends=[-0.2, -0.2, 0.0, 0.2])
    assert (contact, list(ends)) == ([STICK, FORWARD], [-0.2, 0.0, 0.2])
    contact, ends = revised([STICK, FORWARD], [still, right], {"torque": -1.0}, ends=[-0.2, 0.21, 0.2])
    assert (contact, ends.tolist()) == ([STICK, BACKWARD], pytest.approx([-0.2, 0.19, 0.2]))
    assert revised([STICK, FORWARD], [still, right], ends=[-0.2, 0.201, 0.2], shrunk=-0.01) is None


def test_a_transition_without_sliding_behind_it_is_impossible():
    assert revised([STICK, FORWARD], [still, right], ends=[-0.2, 0.2, 0.2]) == "impossible"


def test_new_joints_are_read_from_the_densest_samples():
    asked = scene(**OFF)
    layout, ends, on_pulley = (
        ordered(asked, [STICK]),
        np.array([-0.5, 0.0, 1.0, 0.5]),
        (Resultants(1.0, 0.2, 1.0, 0.0),),
    )

    def samples(count, finer=None):
        x = np.linspace(0.0, 1.0, count)
        return Samples(
            ends, (None, Sample(x, x, x * 0.0 + 1.0, x - 0.6, x * 0.0 + 1.0, lambda: x - 0.6), None), on_pulley, finer
        )

    revision = revise(asked, layout, samples(3, lambda: samples(1001)), TOLERANCES)
    assert revision.ends[2] == pytest.approx(0.1, abs=1e-3)
