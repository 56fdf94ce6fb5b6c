"""Drives next to what friction can transmit: solved just below it, refused just above it, by its right number."""

import re
from dataclasses import replace

import pytest
from drives import drive

from belt_fenicsx import Status, bvp, slip_safety, solve

pytestmark = pytest.mark.serial
# What the belt transmits to pulley 1; fast and thick, it is not what the string transmits.
DRIVES = {"the driven pulley slips": (0.5, 161.3021), "the driver slips": (0.4, 135.364)}


def loaded(friction, torque):
    scene = drive("two-fast")
    first, second = scene.pulleys
    return replace(scene, pulleys=(replace(first, friction=friction), second.driven(torque=torque)))


@pytest.mark.parametrize("method", ["bvp", "fitted"])
@pytest.mark.parametrize("name", DRIVES)
def test_a_drive_next_to_its_limit(name, method):
    friction, capacity = DRIVES[name]
    for part in (0.99, 0.9999):
        solution = solve(loaded(friction, part * capacity), method=method)
        assert solution.contacts[1].torque == pytest.approx(part * capacity, rel=1e-9)
    beyond = solve(loaded(friction, 1.0001 * capacity), method=method, throw=False)
    assert beyond.status is Status.CAPACITY_EXCEEDED
    told = re.search(r"transmits ([\d.]+) N m to pulley 1", beyond.message)
    assert float(told[1]) == pytest.approx(capacity, rel=1e-5)


@pytest.mark.parametrize("name", DRIVES)
def test_slip_safety_is_one_at_the_limit(name):
    friction, capacity = DRIVES[name]
    solution = bvp.solve(loaded(friction, capacity / 2.0))
    assert slip_safety(solution, 1) == pytest.approx(2.0, rel=1e-5)
    string = solve(loaded(friction, capacity / 2.0), method="string")
    assert abs(slip_safety(string, 1) / 2.0 - 1.0) > 1e-3
