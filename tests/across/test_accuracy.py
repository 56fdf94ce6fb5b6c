"""Is the accuracy that is asked for kept, and the error estimate honest? On scenes at random, against collocation."""

from __future__ import annotations

import itertools
import runpy
from pathlib import Path

import pytest

from belt_fenicsx import Scene, SceneError, bvp, solve

pytestmark = pytest.mark.serial
STUDIES = Path(__file__).parents[2] / "demos" / "studies"
TOLERANCES = (1e-3, 1e-6, 1e-8, 1e-10, 1e-11)
REFERENCE = 1e-12  # rtol of the reference, which is then known to some tenths of this


def references(monkeypatch, count, seed):
    """Scenes with an answer, and their angular velocities."""
    monkeypatch.syspath_prepend(str(STUDIES))
    drawn = runpy.run_path(str(STUDIES / "stress.py"))["scenes"](2 * count, seed)
    found = []
    for scene in itertools.chain([Scene()], drawn):
        try:
            answer = bvp.solve(scene, rtol=REFERENCE, throw=False)
        except SceneError:
            continue
        if answer.success:
            found.append((scene, answer.omega))
    return found[:count]


def outcomes(cases, rtol):
    """For each case, whether it was solved, the true error, and the ratio of the estimate to it."""
    for scene, omega in cases:
        solution = solve(scene, rtol=rtol, throw=False)
        error = abs(solution.omega / omega - 1.0)
        yield solution.success, error, solution.error_estimate / max(error, REFERENCE / 5)


def check(cases):
    ratios = []
    for rtol in TOLERANCES:
        reached = [(error, ratio) for solved, error, ratio in outcomes(cases, rtol) if solved]
        assert len(reached) >= 0.95 * len(cases)
        assert max(error for error, _ in reached) <= rtol
        ratios += [ratio for _, ratio in reached]
    # Where the error that a degree leaves happens to be small, the change by it says little of it.
    assert sum(1.0 <= ratio <= 100.0 for ratio in ratios) >= 0.9 * len(ratios)
    assert min(ratios) >= 0.5


def test_a_few_scenes(monkeypatch):
    check(references(monkeypatch, 8, seed=3))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 7])
def test_many_scenes(monkeypatch, seed):
    check(references(monkeypatch, 40, seed))
