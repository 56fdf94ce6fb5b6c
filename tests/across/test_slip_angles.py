"""Drives by a slip angle: loops at random in which the string leads nowhere, and more than there is to slide."""

import re
import runpy
from dataclasses import replace
from pathlib import Path

import pytest
from drives import drive

from belt_fenicsx import Status, bvp, solve
from belt_fenicsx.solution.certificate import certify

pytestmark = pytest.mark.serial
STUDIES = Path(__file__).parents[2] / "demos" / "studies"
BY_TORQUES = (0, 22, 47)


@pytest.fixture
def loops(monkeypatch):
    """The loops of the stress study that slip angles drive."""
    monkeypatch.syspath_prepend(str(STUDIES))
    return [*runpy.run_path(str(STUDIES / "stress_drives.py"))["loads"](max(BY_TORQUES) + 1, 1, "slip angle")]


@pytest.mark.parametrize("number", BY_TORQUES)
def test_a_slip_angle_is_reached_by_way_of_torques(loops, number):
    scene = loops[number]
    index = next(i for i, pulley in enumerate(scene.pulleys) if pulley.slip_angle)
    one, other = bvp.solve(scene), solve(scene)
    assert "torques" in {stage.name for stage in one.stages}
    for solution in (one, other):
        assert solution.contacts[index].slip_angle == pytest.approx(scene.pulleys[index].slip_angle, rel=1e-9)
    for contact, known in zip(one.contacts, other.contacts, strict=True):
        assert contact.omega == pytest.approx(known.omega, rel=1e-7)


@pytest.mark.parametrize("method", ["bvp", "fitted"])
@pytest.mark.parametrize("friction", [0.4, 0.6], ids=["another pulley slides first", "the wrap is shorter"])
def test_a_slip_angle_next_to_its_limit(friction, method):
    scene = drive("two-fast")
    first, second = scene.pulleys

    def by_angle(angle):
        pulleys = (replace(first, friction=friction), second.driven(slip_angle=angle, slip="forward"))
        return replace(scene, pulleys=pulleys)

    beyond = solve(by_angle(3.1), method=method, throw=False)
    assert beyond.status is Status.CAPACITY_EXCEEDED
    slides, angle = re.search(r"along pulley (\d), the slip angle of pulley 1 is ([\d.]+) rad", beyond.message).groups()
    assert int(slides) == (0 if friction < 0.5 else 1)
    below = solve(by_angle(0.999 * float(angle)), method=method)
    assert below.contacts[1].slip_angle == pytest.approx(0.999 * float(angle), rel=1e-9)
    assert below.contacts[int(slides)].slip_angle > 0.95 * below.contacts[int(slides)].wrap_angle


def test_sliding_behind_stick_has_the_sense_that_is_given():
    scene = drive("two-equal")
    solution = bvp.solve(scene)
    first, second = scene.pulleys
    angle = solution.contacts[1].slip_angle
    for slip, holds in (("forward", True), ("backward", False)):
        asked = replace(scene, pulleys=(first, second.driven(slip_angle=angle, slip=slip)))
        checks = certify(replace(solution, scene=asked), tolerance=1e-6)
        assert [check.holds for check in checks if check.title == "drive met, pulley 1"] == [holds]
