"""Zones and contact from made-up data at points, of which the exact reading is known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from belt_fenicsx import Scene
from belt_fenicsx.lagrangian import reading
from belt_fenicsx.lagrangian.drives import Drives
from belt_fenicsx.lagrangian.friction import Friction, Points
from belt_fenicsx.lagrangian.multipliers import Multipliers
from belt_fenicsx.lagrangian.state import State
from belt_fenicsx.lagrangian.taut import TautBelt

BORDER, STRETCH = 0.2013, 1.01


def made_up(scene: Scene, odd: list[int], f: float = 0.0) -> dict[str, Any]:
    """What is read from a straight belt with a gap that grows quadratically from both borders.

    It sticks before its middle, but for odd points at which friction is another part of its bound.
    """
    edges = np.linspace(-0.5, 0.5, 101)
    sigma = np.concatenate([[-0.5], (edges[1:] + edges[:-1]) / 2, [0.5]])
    zero, inside = np.zeros_like(sigma), slice(1, -1)
    p = (np.abs(sigma) < BORDER).astype(float)
    share = (sigma > 0.0).astype(float)
    friction = scene.pulleys[0].friction * p * (0.5 - 1.5 * share)
    friction[odd] = f * scene.pulleys[0].friction
    state = State(
        sigma=sigma, weight=np.concatenate([[0.0], np.diff(edges), [0.0]]), x=STRETCH * sigma, y=zero, theta=zero,
        dx=zero + STRETCH, dy=zero, kappa=zero, dD=zero, g=-(np.maximum(np.abs(sigma) - BORDER, 0.0) ** 2),
        fibre_x=STRETCH * sigma, stretch=zero + STRETCH, level=zero + STRETCH,
    )  # fmt: skip
    cells = {name: getattr(state, name)[inside].reshape(-1, 2) for name in ("sigma", "weight", "g", "stretch", "level")}
    p_in, f_in, share_in = (values[inside].reshape(-1, 2) for values in (p, friction, share))
    at = Points(**cells, edges=edges, x=STRETCH * cells["sigma"], p=p_in, trial=f_in)
    drives = Drives(scene, 1.0, [0.0])
    drives.frictions = [Friction(at, f_in, scene.pulleys[0].friction * p_in, share_in, 1.0)]
    drives.growths = np.array([drives.frictions[0].growth])
    return reading.answer(scene, TautBelt.of(scene), state, Multipliers(p, friction), drives)


@pytest.mark.parametrize("odd", [[], [40], [40, 41]])
def test_reads_borders_where_a_quadratic_gap_begins_whatever_odd_points_there_are(odd):
    scene = Scene().dimensionless()[0]
    answer = made_up(scene, odd, -1.0)
    assert [(zone.kind, zone.slip) for zone in answer["zones"]] == [
        ("free", None), ("stick", None), ("slip", "forward"), ("free", None)
    ]  # fmt: skip
    assert [zone.sigma[1] for zone in answer["zones"]] == pytest.approx([-BORDER, 0.0, BORDER, 0.5], abs=1e-12)
    (contact,) = answer["contacts"]
    ends = (contact.x_up, contact.x_trans, contact.x_off)
    assert ends == pytest.approx((-STRETCH * BORDER, 0.0, STRETCH * BORDER), abs=1e-12)
    assert contact.omega == pytest.approx(STRETCH / scene.pulleys[0].radius, rel=1e-14)
    assert contact.torque == pytest.approx(-scene.pulleys[0].radius * 0.01 * np.sum(answer["fields"].f), rel=1e-14)


def test_three_points_that_slide_are_a_zone():
    zones = made_up(Scene().dimensionless()[0], [40, 41, 42], 1.0)["zones"]
    assert [zone.name for zone in zones] == ["free", "stick", "backward slip", "stick", "forward slip", "free"]
