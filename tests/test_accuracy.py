"""Is the accuracy that is asked for kept, and the error estimate honest? On scenes at random, against collocation."""

from __future__ import annotations

import itertools
import runpy
from pathlib import Path

import pytest

pytest.importorskip("dolfinx")

from belt_fenicsx import Scene, SceneError, bvp, solve  # noqa: E402

pytestmark = pytest.mark.serial
DEMOS = Path(__file__).parent.parent / "demos"
TOLERANCES = (1e-3, 1e-6, 1e-8, 1e-10, 1e-11)
REFERENCE = 1e-12  # rtol of the reference, which is then known to some tenths of this


def references(monkeypatch, count, seed):
    """Scenes with an answer, and their angular velocities."""
    monkeypatch.syspath_prepend(str(DEMOS))
    drawn = runpy.run_path(str(DEMOS / "stress.py"))["scenes"](2 * count, seed)
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


def check(cases, rtol):
    solved, errors, ratios = zip(*outcomes(cases, rtol), strict=True)
    reached = [(error, ratio) for ok, error, ratio in zip(solved, errors, ratios, strict=True) if ok]
    assert len(reached) >= 0.95 * len(cases)
    assert max(error for error, _ in reached) <= rtol
    # Where the error of the last degree happens to be small, the change by it says little of it.
    honest = [1.0 <= ratio <= 100.0 for _, ratio in reached]
    assert sum(honest) >= 0.9 * len(honest)
    assert min(ratio for _, ratio in reached) >= 0.3


def test_a_few_scenes(monkeypatch):
    cases = references(monkeypatch, 8, seed=3)
    for rtol in TOLERANCES:
        check(cases, rtol)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 7])
def test_many_scenes(monkeypatch, seed):
    cases = references(monkeypatch, 40, seed)
    for rtol in TOLERANCES:
        check(cases, rtol)
