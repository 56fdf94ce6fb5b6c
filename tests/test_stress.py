"""A sample of the stress test: scenes at random, none of which ends wrong and silent."""

import runpy
from collections import Counter
from pathlib import Path

import pytest

DEMOS = Path(__file__).parent.parent / "demos"

pytestmark = pytest.mark.serial


@pytest.fixture
def stress(monkeypatch):
    monkeypatch.syspath_prepend(str(DEMOS))
    return runpy.run_path(str(DEMOS / "stress.py"))


def test_scenes_are_reproducible_and_cover_both_senses(stress):
    once, again = (list(stress["scenes"](30, seed=5)) for _ in range(2))
    assert once == again
    assert Counter(scene.pulleys[0].slip for scene in once).keys() == {"forward", "backward"}


def test_a_sample_agrees(stress):
    outcomes = [stress["outcome"](number, scene) for number, scene in enumerate(stress["scenes"](25, seed=18))]
    assert [failed.cause for failed in stress["failures"](outcomes)] == []
    assert sum(outcome.cause == stress["AGREED"] for outcome in outcomes) >= 20


# Contact of a hundredth of the span: the fitted method names a failure, the boundary-value problem has the answer.
UNSOLVED = {"pulley top 0.001 m", "pulley top 0.01 m"}
ESTIMATED_TOO_LOW = "pure stick, friction 0.03"


def test_extremes(stress):
    scenes = {name: scene for name, scene in stress["extremes"]().items() if name != ESTIMATED_TOO_LOW}
    causes = {name: stress["outcome"](0, scene).cause for name, scene in scenes.items()}
    failed = {name: cause for name, cause in causes.items() if cause != stress["AGREED"]}
    assert set(failed) <= UNSOLVED
    assert all(cause.endswith("BVP: SOLVED") for cause in failed.values())


@pytest.mark.xfail(
    reason="the fitted method's estimate says 1e-10 where omega is 3e-9 off; on some platforms it refuses instead"
)
def test_pure_stick_with_little_friction_agrees(stress):
    assert stress["outcome"](0, stress["extremes"]()[ESTIMATED_TOO_LOW]).cause == stress["AGREED"]


def test_the_report_counts_every_scene(stress):
    outcomes = [stress["outcome"](0, scene) for scene in stress["scenes"](1, seed=18)]
    assert "| agreed | 1 |" in stress["report"](outcomes)


@pytest.mark.slow
def test_five_hundred_scenes(stress):
    outcomes = [stress["outcome"](number, scene) for number, scene in enumerate(stress["scenes"](500, seed=2026))]
    failures = stress["failures"](outcomes)
    assert not any("apart" in failed.cause for failed in failures)
    assert len(failures) <= 5
