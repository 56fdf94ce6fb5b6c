"""A sample of the stress test: scenes at random, none of which ends wrong and silent."""

import runpy
from collections import Counter
from pathlib import Path

import pytest

STUDIES = Path(__file__).parents[2] / "demos" / "studies"

pytestmark = pytest.mark.serial


@pytest.fixture
def stress(monkeypatch):
    monkeypatch.syspath_prepend(str(STUDIES))
    return runpy.run_path(str(STUDIES / "stress.py"))


def test_scenes_are_reproducible_and_cover_both_senses(stress):
    once, again = (list(stress["scenes"](30, seed=5)) for _ in range(2))
    assert once == again
    assert Counter(scene.pulleys[0].slip for scene in once).keys() == {"forward", "backward"}


def test_a_sample_agrees(stress):
    outcomes = [stress["outcome"](number, scene) for number, scene in enumerate(stress["scenes"](25, seed=18))]
    assert [failed.cause for failed in stress["failures"](outcomes)] == []
    assert sum(outcome.cause == stress["AGREED"] for outcome in outcomes) >= 20


# Contact of a few thousandths of the span: to the accuracy that the stress test asks for, rounding gets in the way.
INACCURATE = "pulley top 0.001 m"


def test_extremes(stress):
    scenes = {name: scene for name, scene in stress["extremes"]().items() if name != INACCURATE}
    causes = {name: stress["outcome"](0, scene).cause for name, scene in scenes.items()}
    assert {name: cause for name, cause in causes.items() if cause != stress["AGREED"]} == {}


def test_nearly_no_wrap_is_solved_as_far_as_rounding_allows(stress):
    scene = stress["extremes"]()[INACCURATE]
    solution = stress["solve"](scene, throw=False)
    reference = stress["bvp"].solve(scene)
    assert solution.status.name in ("SOLVED", "ACCURACY_NOT_REACHED")
    assert abs(solution.omega / reference.omega - 1.0) <= max(1e-8, solution.error_estimate)


def test_the_report_counts_every_scene(stress):
    outcomes = [stress["outcome"](0, scene) for scene in stress["scenes"](1, seed=18)]
    assert "| agreed | 1 |" in stress["report"](outcomes)


@pytest.mark.slow
def test_five_hundred_scenes(stress):
    outcomes = [stress["outcome"](number, scene) for number, scene in enumerate(stress["scenes"](500, seed=2026))]
    failures = stress["failures"](outcomes)
    assert not any("apart" in failed.cause for failed in failures)
    assert len(failures) <= 5
