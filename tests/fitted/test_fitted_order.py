"""The fitted method on scenes whose zones are hard to find, beside the boundary-value problem."""

from __future__ import annotations

import functools
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from belt_fenicsx import bvp, solve
from belt_fenicsx.fitted.dofs import local
from belt_fenicsx.fitted.elimination import Condensed
from belt_fenicsx.fitted.guess import drive_guess
from belt_fenicsx.fitted.newton import newton
from belt_fenicsx.fitted.reading import fields_in
from belt_fenicsx.fitted.transfer import from_fields
from belt_fenicsx.layout.kind import STICK, Part
from belt_fenicsx.layout.posed import ordered
from belt_fenicsx.scene.belt import Belt
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.drive import string_drive

STUDIES = Path(__file__).parents[2] / "demos" / "studies"

pytestmark = pytest.mark.serial


@pytest.fixture
def stress(monkeypatch):
    monkeypatch.syspath_prepend(str(STUDIES))
    return load()


@functools.cache
def load():
    return runpy.run_path(str(STUDIES / "stress.py"))


@functools.cache
def drawn(seed):
    return list(load()["scenes"](500, seed))


def driven(scene, **drive):
    return replace(scene, pulleys=(replace(scene.pulleys[0], **{"x_trans": None, "slip": None, **drive}),))


def order(solution):
    return [(zone.kind, zone.slip) for zone in solution.contacts[0].zones]


@pytest.mark.parametrize(
    ("seed", "number"),
    [(18, 151), (18, 179), (18, 256), (18, 129), (18, 216), (18, 314), (2026, 76), (18, 145), (18, 322), (18, 379)]
    + [(18, 138), (18, 234), (4, 305), (77, 157), (18, 28), (18, 74)],
    ids=["short sliding at the run-up"] * 3
    + ["and turning at the run-off", "stick holds nowhere", "and turning"] + ["a short turn at the run-off"]
    + ["contact that grows by sliding", "tiny contact", "tiny contact"]
    + ["a clamp on the pulley"] * 4
    + ["a thin belt"] * 2,
)  # fmt: skip
def test_agrees_with_the_boundary_value_problem(stress, seed, number):
    assert stress["outcome"](number, drawn(seed)[number]).cause == stress["AGREED"]


def test_sliding_in_a_thousandth_of_the_contact_is_found(stress):
    scene = drawn(77)[463]
    solution, reference = solve(scene), bvp.solve(scene)
    assert order(solution) == order(reference) == [("slip", "forward"), ("stick", None), ("slip", "forward")]
    assert solution.omega == pytest.approx(reference.omega, rel=1e-8)


@pytest.mark.parametrize(("seed", "number"), [(18, 101), (18, 193), (18, 296), (18, 434), (77, 241)])
def test_a_transition_where_stick_cannot_end_is_refused_by_both(stress, seed, number):
    scene = drawn(seed)[number]
    messages = []
    for method in ("fitted", "bvp"):
        with pytest.raises(SceneError, match="where stick can end") as error:
            solve(scene, method=method)
        messages.append(str(error.value).split("in (")[0])
    assert messages[0] == messages[1]


@pytest.mark.parametrize("number", [193, 246])
def test_sliding_all_along_is_measured_where_it_is_slowest(stress, number):
    scene = driven(drawn(18)[number], x_trans="run-up", slip="forward")
    solution, reference = solve(scene, rtol=1e-9), bvp.solve(scene, rtol=1e-10)
    assert solution.omega == pytest.approx(reference.omega, rel=1e-9)
    sliding = solution.fields.v_rel[solution.fields.zone == 1]
    assert 0 < np.argmin(sliding) < sliding.size - 1
    assert np.all(sliding > -1e-8)


@pytest.mark.parametrize(("seed", "number"), [(18, 8), (18, 129), (18, 167), (18, 168), (77, 232), (31, 8)])
@pytest.mark.parametrize("drive", ["omega", "torque"])
def test_a_drive_gives_the_same_state_back(stress, seed, number, drive):
    placed = solve(drawn(seed)[number], rtol=1e-9)
    (wanted,) = placed.contacts
    solution = solve(driven(placed.scene, **{drive: getattr(wanted, drive)}), rtol=1e-9)
    (contact,) = solution.contacts
    assert order(solution) == order(placed)
    assert contact.omega == pytest.approx(wanted.omega, rel=1e-8)
    assert contact.x_up == pytest.approx(wanted.x_up, abs=1e-7)
    assert contact.x_off == pytest.approx(wanted.x_off, abs=1e-7)


def test_zones_that_slide_both_ways_meet_at_the_transition():
    layout = ordered(Scene(), [Part("slip", "forward"), Part("slip", "backward")])
    assert [joint.equation for joint in layout.joints] == ["tangent", "x", "tangent"]
    assert (layout.transition(0), layout.speeds[0].joint) == (1, 1)
    layout = ordered(Scene(), [Part("slip", "forward"), STICK, Part("slip", "backward")])
    assert (layout.transition(0), layout.speeds[0].joint) == (2, 1)


@pytest.mark.parametrize(("length", "thickness"), [(1.1, 0.08), (1.2, 0.1)])
def test_a_slack_and_stiff_belt_would_lift_off(length, thickness):
    scene = Scene(belt=Belt(length=length, thickness=thickness))
    solution, reference = (method(scene, throw=False) for method in (solve, bvp.solve))
    assert solution.status is reference.status is Status.NOT_ADMISSIBLE
    assert "would lift off" in solution.message and "would lift off" in reference.message


def test_states_pass_on_without_loss():
    old = solve(Scene()).state
    scene, _ = Scene().dimensionless()
    new = from_fields(scene, old, old.mesh.layout, old.ends, old.degree)
    exact = fields_in(scene, old, *old.located(new.nodes[1:-1, 0]))
    np.testing.assert_allclose(new.nodes[1:-1, 1], exact.x, atol=1e-14)
    np.testing.assert_allclose(new.values[1:, local(new.degree).theta.start], exact.theta, atol=1e-14)


def test_nodes_in_contact_stay_on_the_pulley_and_held_borders_where_they_are():
    scene, _ = Scene().dimensionless()
    start = drive_guess(scene, string_drive(scene), 4)
    one_step = newton((("snes_max_it", 1),))
    bent, _ = one_step.solve(scene, start, 1e-3, fixed_joints=True)
    state, _ = one_step.solve(scene, start, 1e-3)
    np.testing.assert_array_equal(bent.ends, start.ends)
    assert np.abs(state.ends - start.ends).max() > 1e-3
    arms = state.ends_r[state.mesh.touches] - complex(*scene.pulleys[0].center)
    np.testing.assert_allclose(np.abs(arms), scene.pulleys[0].radius, rtol=1e-14)


def test_a_singular_step_is_a_failure_and_no_crash(monkeypatch):
    def singular(*_, **__):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(Condensed, "step", singular)
    assert solve(Scene(), throw=False).status is Status.NEWTON_DIVERGED


def test_sliding_turns_by_way_of_a_short_stick_zone(stress):
    scene = list(stress["scenes"](134, 2, "wide"))[133]
    solution, reference = solve(scene), bvp.solve(scene, rtol=1e-11)
    assert order(solution) == order(reference)
    assert [kind for kind, _ in order(solution)] == ["slip", "stick", "slip", "slip"]
    assert solution.omega == pytest.approx(2.20037713018, rel=1e-9)
    assert stress["difference"](solution, reference) < 1e-8
