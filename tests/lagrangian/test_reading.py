"""Zones and contact from made-up data at points, of which the exact reading is known."""

from __future__ import annotations

import numpy as np
import pytest

from belt_fenicsx import Scene
from belt_fenicsx.lagrangian import reading
from belt_fenicsx.lagrangian.multipliers import Multipliers
from belt_fenicsx.lagrangian.state import State

BORDER, STRETCH = 0.2013, 1.01


def made_up(scene: Scene) -> tuple[State, Multipliers]:
    """A straight belt with a gap that grows quadratically from both borders, and stick before its middle."""
    sigma = np.linspace(-0.5, 0.5, 100)
    distance, zero = np.abs(sigma) - BORDER, np.zeros_like(sigma)
    state = State(
        sigma=sigma, weight=np.full_like(sigma, 0.01), x=STRETCH * sigma, y=zero, theta=zero,
        dx=np.full_like(sigma, STRETCH), dy=zero, kappa=zero, dD=zero, g=-(np.maximum(distance, 0.0) ** 2),
        share=(sigma > 0.0).astype(float),
    )  # fmt: skip
    p = (distance < 0.0).astype(float)
    return state, Multipliers(p=p, f=scene.pulleys[0].friction * p * np.where(sigma < 0.0, 0.5, -1.0))


@pytest.mark.parametrize("odd", [[], [40], [40, 41]])
def test_reads_borders_where_a_quadratic_gap_begins_whatever_odd_points_there_are(odd):
    scene = Scene().dimensionless()[0]
    state, multipliers = made_up(scene)
    multipliers.f[odd] = -scene.pulleys[0].friction
    answer = reading.answer(scene, state, multipliers)
    assert [(zone.kind, zone.slip) for zone in answer["zones"]] == [
        ("free", None), ("stick", None), ("slip", "forward"), ("free", None)
    ]  # fmt: skip
    assert [zone.sigma[1] for zone in answer["zones"]] == pytest.approx([-BORDER, 0.0, BORDER, 0.5], abs=1e-12)
    (contact,) = answer["contacts"]
    ends = (contact.x_up, contact.x_trans, contact.x_off)
    assert ends == pytest.approx((-STRETCH * BORDER, 0.0, STRETCH * BORDER), abs=1e-12)
    assert contact.omega == pytest.approx(STRETCH / scene.pulleys[0].radius, rel=1e-14)
    assert contact.torque == pytest.approx(-scene.pulleys[0].radius * 0.01 * np.sum(multipliers.f), rel=1e-14)


def test_three_points_that_slide_are_a_zone():
    scene = Scene().dimensionless()[0]
    state, multipliers = made_up(scene)
    multipliers.f[40:43] = scene.pulleys[0].friction
    zones = reading.answer(scene, state, multipliers)["zones"]
    assert [zone.name for zone in zones] == ["free", "stick", "backward slip", "stick", "forward slip", "free"]
