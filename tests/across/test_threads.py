"""Solves from several threads are those from one, to the last bit."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from belt_fenicsx import solve
from belt_fenicsx.scene.belt import Belt
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene

pytestmark = pytest.mark.serial


def outcome(scene: Scene) -> tuple[str, bytes]:
    solution = solve(scene, throw=False)
    return solution.status.name, solution.fields.r.tobytes() + solution.fields.p.tobytes()


@pytest.mark.parametrize("threads", [2, 4, 8])
def test_fitted_zones_in_threads(threads):
    thicknesses = np.linspace(0.01, 0.05, 40)
    scenes = [Scene(belt=Belt(thickness=h), pulleys=(Pulley(x_trans=x),)) for h in thicknesses for x in (-0.05, 0.05)]
    alone = [outcome(scene) for scene in scenes]
    assert {status for status, _ in alone} == {"SOLVED"}
    with ThreadPoolExecutor(threads) as pool:
        assert list(pool.map(outcome, scenes)) == alone
