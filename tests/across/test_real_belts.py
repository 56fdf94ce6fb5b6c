"""Thin and stiff belts, little friction, drives next to their limits: by the default method, against right answers."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from belt_fenicsx import Belt, Pulley, Scene, SceneError, Solution, Status, bvp, solve
from belt_fenicsx.fitted.guess import ways
from belt_fenicsx.fitted.method import solved
from belt_fenicsx.fitted.newton import newton
from belt_fenicsx.fitted.run import Run
from belt_fenicsx.solution.certificate import certified

pytestmark = pytest.mark.serial
STUDIES = Path(__file__).parents[2] / "demos" / "studies"
CAPACITY = 1162.868190  # torque of pure slip in the chapter's scene [N m]


def scene(belt=None, span=1.0, **pulley):
    return Scene(belt=Belt(**(belt or {})), span=span, pulleys=(Pulley(**pulley),))


def flat(thickness, **pulley):
    belt = Belt(length=0.396, youngs_modulus=5e8, poisson_ratio=0.4, thickness=thickness, width=0.03)
    pulley = {"radius": 0.06, "center": (0.0, -0.01), "friction": 0.3, "x_trans": 0.0, **pulley}
    return Scene(belt=belt, span=0.4, transport_rate=10.0, pulleys=(Pulley(**pulley),))


def band(thickness):
    belt = {"length": 1.0448, "youngs_modulus": 210e9, "poisson_ratio": 0.3, "thickness": thickness, "width": 0.05}
    return scene(belt, radius=0.2, center=(0.0, -0.05), friction=0.15)


@pytest.fixture
def study(monkeypatch):
    monkeypatch.syspath_prepend(str(STUDIES))
    return runpy.run_path(str(STUDIES / "field_errors.py"))


# Ten scenes: the chapter's, thick and thin ones, a steel band, little friction, other drives.
FIELDS = {
    "chapter": Scene(),
    "thick": scene({"thickness": 0.1}),
    "thin": scene({"thickness": 0.002}),
    "flat belt": flat(1.2e-3),
    "flat belt, backward": flat(0.6e-3, slip="backward"),
    "steel band": band(1e-3),
    "thin steel band": band(1e-4),
    "little friction": scene(friction=0.02),
    "torque": scene(torque=100.0),
    "speed": scene(omega=1.48),
}


@pytest.mark.parametrize("name", FIELDS)
def test_all_fields_are_as_accurate_as_they_say(study, name):
    solution, reference = solve(FIELDS[name]), bvp.solve(FIELDS[name], rtol=1e-12)
    truth = study["true_errors"](solution, reference)
    assert set(truth) == {"r", "theta", "D", "eps", "Gamma", "kappa", "Q", "M", "p", "f", "v_rel"}
    assert max(truth.values()) <= 1e-4
    assert max(solution.field_errors.values()) <= 1e-4
    # The reference has errors of its own.
    low = {name: error for name, error in truth.items() if error > solution.field_errors[name]}
    assert all(error <= solution.field_errors[name] + reference.field_errors[name] for name, error in low.items()), low


def test_field_errors_fall_with_rtol():
    coarse, fine = (solve(flat(1.2e-3), rtol=rtol).field_errors for rtol in (1e-6, 1e-10))
    assert all(fine[name] < 0.1 * coarse[name] for name in ("r", "theta", "Gamma", "kappa", "M"))
    assert max(fine.values()) <= 1e-5


def test_a_field_that_is_not_known_is_named(monkeypatch):
    monkeypatch.setattr("belt_fenicsx.fitted.accuracy.of_fields", lambda rtol: 1e-12)
    solution = solve(Scene(), throw=False)
    worst = max(solution.field_errors, key=solution.field_errors.get)
    assert solution.status is Status.ACCURACY_NOT_REACHED
    assert solution.message.startswith(f"The field {worst} is known to")


def test_a_free_spans_force_is_constant_to_rounding():
    fields = solve(band(1e-3)).fields
    for zone in (0, fields.zone[-1]):
        on = fields.zone == zone
        force = (fields.Q[on, 0] + 1j * fields.Q[on, 1]) * np.exp(1j * fields.theta[on])
        assert np.abs(force - force[0]).max() < 1e-9 * np.abs(force[0])


@pytest.mark.parametrize(
    ("case", "omega", "torque"),
    [
        (band(1e-4), 5.00501205, 10.029331),
        (scene(friction=1e-3, torque=0.0), 1.4823968214, 0.0),
        (scene(friction=1e-6), 1.482382469674, 0.00581002379),
        (scene(friction=1e-7), 1.482382469702, 0.00058162956),
        (scene(torque=1e-3), 1.482515100271, 1e-3),
        (scene(torque=0.0), 1.4825151024971, 0.0),
        (
            scene(
                {"length": 1.3106, "poisson_ratio": 0.3, "thickness": 0.0034},
                radius=0.27, center=(-0.22, 0.08), friction=0.3, x_trans=-0.489,
            ),
            3.71623022, 12.6814869,
        ),
        (scene(friction=1.0, x_trans=-0.2442), 1.4602505905, 5751.89158),
        (scene({"thickness": 0.0007, "length": 1.03}), 1.436206236265, 0.8441578),
        (
            scene(
                {"length": 1.492 / 1.0253, "youngs_modulus": 4.6e8, "poisson_ratio": 0.4, "thickness": 0.00077},
                span=1.492, radius=0.0424, center=(0.0, 0.1052), friction=0.373,
            ),
            24.61325413516, 5.0001276,
        ),
        (scene(friction=0.0002, torque=0.348860457), 1.482384710746, 0.348860457),
        (scene(friction=0.0002, omega=1.482513323479), 1.482513323479, -0.875380207),
        (scene(friction=0.0, omega=0.0), 0.0, 0.0),
    ],
    ids=[
        "thin steel band", "free idler, little friction", "friction 1e-6", "friction 1e-7",
        "torque next to pure stick", "free idler",
        "transition past the vertical", "transition next to the run-up", "very thin", "small pulley",
        "little friction, torque", "little friction, speed", "smooth pulley that stands still",
    ],
)  # fmt: skip
def test_right_answers(case, omega, torque):
    solution = solve(case)
    (contact,) = solution.contacts
    assert solution.success and solution.admissible
    assert contact.omega == pytest.approx(omega, rel=1e-8, abs=1e-12)
    capacity = case.pulleys[0].friction * case.pulleys[0].radius * float(solution.fields.weight @ solution.fields.p)
    assert contact.torque == pytest.approx(torque, rel=1e-6, abs=1e-9 * capacity)


def test_a_torque_next_to_pure_stick_is_not_pure_stick():
    solution = solve(scene(torque=1e-3))
    assert [zone.kind for zone in solution.contacts[0].zones] == ["stick", "slip"]
    assert solution.omega == pytest.approx(1.482515100271, rel=1e-11)


@pytest.mark.parametrize("torque", 3e-4 * np.linspace(1.0, 1.02, 6))
def test_short_slip_zones_are_known_well(torque):
    solution = solve(scene(torque=torque))
    assert solution.contacts[0].torque == pytest.approx(torque, abs=1e-9 * CAPACITY)
    assert max(solution.field_errors.values()) < 1e-5


@pytest.mark.parametrize("friction", [1e-6, 1e-3, 0.02])
def test_friction_in_stick_is_as_well_known_as_it_is_said_to_be(friction):
    solution, fine = solve(scene(friction=friction)), solve(scene(friction=friction), rtol=1e-10)
    (start, end) = next(zone.sigma for zone in solution.contacts[0].zones if zone.kind == "stick")
    sigma = start + (end - start) * np.linspace(0.02, 0.98, 201)
    f, exact = solution.evaluate(sigma).f, fine.evaluate(sigma).f
    assert np.abs(f - exact).max() < solution.field_errors["f"] * np.abs(solution.fields.f).max()
    assert solution.field_errors["f"] < 1e-4


def test_a_friction_too_little_for_its_field_says_so():
    solution = solve(scene(friction=3e-8), throw=False)
    assert solution.admissible and solution.omega == pytest.approx(1.482382469705, rel=1e-10)
    assert solution.contacts[0].torque == pytest.approx(5816.8 * 3e-8, rel=1e-4)
    assert solution.success or (solution.status is Status.ACCURACY_NOT_REACHED and "field f" in solution.message)


@pytest.mark.parametrize("part", [1e-2, 1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("limit", ["pure stick", "pure stick, backward", "pure slip"])
def test_torques_next_to_their_limits(limit, part):
    torque = {"pure stick": part, "pure stick, backward": -part, "pure slip": 1.0 - part}[limit] * CAPACITY
    solution, reference = solve(scene(torque=torque)), bvp.solve(scene(torque=torque), rtol=1e-10)
    assert solution.omega == pytest.approx(reference.omega, rel=1e-9)
    assert solution.contacts[0].torque == pytest.approx(torque, abs=1e-9 * CAPACITY)


def test_the_wrap_of_more_than_half_a_turn():
    around = scene({"length": 3.8, "thickness": 0.01}, radius=0.7, center=(0.0, 1.0))
    assert solve(around).contacts[0].wrap_angle == pytest.approx(3.58269, abs=1e-5)


@pytest.mark.parametrize("method", ["fitted", "augmented-lagrangian"])
@pytest.mark.parametrize("elements", [0, -3, 1, 2.5, True, "10", np.float64(100.0)])
def test_numbers_of_elements_that_are_none(method, elements):
    with pytest.raises(SceneError, match="`elements` must be a whole number of at least 2"):
        solve(Scene(), method=method, elements=elements)


def test_numpys_whole_numbers_are_numbers_of_elements():
    assert solve(Scene(), elements=np.int64(24)).success


def test_a_transition_outside_of_the_contact_is_told_its_interval_in_order():
    with pytest.raises(SceneError) as caught:
        solve(replace(flat(1.2e-3, center=(0.0, -0.05)), belt=replace(flat(1.2e-3).belt, length=0.4)))
    low, high = (float(text) for text in str(caught.value).split("(")[1].split(")")[0].split(", "))
    assert low < high < 2e-5


def test_the_budget_of_iterations_ends_a_solve_and_says_where():
    dimensionless, units = Scene().dimensionless()
    run = Run(Scene(), dimensionless, units, newton(()), most=3)
    solution = solved(run, ways(run, None))
    assert solution.status is Status.NEWTON_DIVERGED
    assert solution.message.startswith(
        "At degree 6, from the degree before: 3 iterations are spent, tried were the taut"
    )


def test_a_rescue_is_named():
    solution = solve(scene(torque=(1.0 - 1e-5) * CAPACITY))
    stages = {stage.name: stage.why for stage in solution.stages}
    assert stages["method bvp"].endswith("it may find the zones")


def test_where_a_rescue_leads_nowhere_the_other_method_that_solves_the_scene_is_named(monkeypatch):
    failed = Solution(scene=Scene(), method="fitted", status=Status.NEWTON_DIVERGED, message="Nothing.")
    monkeypatch.setattr("belt_fenicsx.fitted.method.solve", lambda *_, **__: failed)
    solution = solve(Scene(), throw=False)
    assert solution.status is Status.NEWTON_DIVERGED
    assert solution.message == "Nothing. The method bvp solves it: `solve(scene, method='bvp')` gives its answer."


@pytest.mark.parametrize("friction", [200.0, 1e3, 1e9])
@pytest.mark.parametrize("method", [solve, bvp.solve])
def test_friction_that_leaves_the_belt_slack_is_named(method, friction):
    solution = method(scene(friction=friction), throw=False)
    assert solution.status is Status.CONTACT_LOST
    assert "the belt is slack at one end of the contact" in solution.message


@pytest.mark.parametrize(("drive", "omega", "torque"), [("torque", 1.4824928086, 10.0), ("omega", 1.48, 1128.92007)])
def test_no_friction_is_large_enough_to_excuse_a_drive_that_is_missed(drive, omega, torque):
    given = {"torque": torque, "omega": omega}[drive]
    solution = solve(scene(friction=1e9, **{drive: given}))
    (contact,) = solution.contacts
    assert (contact.omega, contact.torque) == (pytest.approx(omega, rel=1e-9), pytest.approx(torque, rel=1e-7))
    missed = replace(solution, contacts=(replace(contact, **{drive: given * (1.0 + 1e-6)}),))
    assert certified(missed, tolerance=1e-6).status is Status.NOT_ADMISSIBLE


def test_more_and_more_friction_holds_the_belt_up_to_its_run_off():
    frictions = [1e2, 1e3, 1e4]
    torques = [solve(scene(friction=friction, omega=1.48)).contacts[0].torque for friction in frictions]
    assert torques == pytest.approx([1128.92007 - 63.8 / friction for friction in frictions], abs=2e-3)


@pytest.mark.parametrize("omega", [-5.0, 0.0, 1e6])
def test_speeds_far_from_the_belts_slide_all_along(omega):
    (contact,) = solve(scene(omega=omega)).contacts
    assert contact.omega == pytest.approx(omega, rel=1e-14, abs=0.0)
    assert abs(contact.torque) == pytest.approx(CAPACITY, rel=1e-8)
