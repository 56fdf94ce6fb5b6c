"""What the fixed mesh says of its own accuracy, against the truth."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

import belt_fenicsx
from belt_fenicsx import Belt, Pulley, Scene, SolveError, Status
from belt_fenicsx.lagrangian.accuracy import CLAMP_MOMENT, OMEGA, TORQUE, least_resolved

solve = functools.partial(belt_fenicsx.solve, method="augmented-lagrangian")

THIN = Scene(
    belt=Belt(length=0.396, youngs_modulus=5e8, poisson_ratio=0.4, thickness=1.2e-3, width=0.03),
    pulleys=(Pulley(radius=0.06, center=(0.0, -0.01), friction=0.3, x_trans=0.0),),
    span=0.4,
    transport_rate=10.0,
)
# By the boundary-value problem at rtol 1e-11: omega, torque, moments at the clamps, friction without its sign times R.
CASES = {
    "chapter": (Scene(), 1.4807092526223, 610.315737, (290.05771914, 296.50105481)),
    "little friction": (Scene(pulleys=(Pulley(friction=0.01),)), 1.4823292612664, 42.704552083, None),
}


def true_errors(solution, omega, torque, moments):
    """Errors relative to what `accuracy.errors` says."""
    fields, radius = solution.fields, solution.scene.pulleys[0].radius
    errors = {
        OMEGA: abs(solution.omega / omega - 1.0),
        TORQUE: abs(solution.contacts[0].torque - torque) / (radius * fields.weight @ np.abs(fields.f)),
    }
    if moments is not None:
        errors[CLAMP_MOMENT] = np.max(np.abs(fields.M[[0, -1]] - moments)) / max(moments)
    return errors


@pytest.mark.parametrize(
    ("name", "elements"),
    [*(("chapter", n) for n in (25, 50, 100, 200, 400, 800)), *(("little friction", n) for n in (100, 200, 400))],
)
def test_estimated_errors_are_honest(name, elements):
    scene, *exact = CASES[name]
    solution = solve(scene, elements=elements)
    assert solution.error_estimate == solution.measures[OMEGA]
    for quantity, error in true_errors(solution, *exact).items():
        assert error <= solution.measures[quantity] <= max(500.0 * error, 2e-6), quantity


def test_sliding_speeds_are_as_good_as_they_say():
    coarse, fine = (solve(Scene(), elements=elements).fields for elements in (100, 1600))
    speed = np.interp(coarse.sigma, fine.sigma, fine.v_rel)
    touching = np.flatnonzero(coarse.p > 0.0)[1:-1]
    error = np.max(np.abs(coarse.v_rel - speed)[touching]) / np.max(np.abs(fine.v_rel))
    assert error <= solve(Scene()).field_errors["v_rel"] <= 100.0 * error


def test_fields_reach_from_clamp_to_clamp():
    fields = solve(Scene()).fields
    assert fields.sigma[[0, -1]] == pytest.approx([-0.5, 0.5], abs=1e-14)
    assert fields.r[[0, -1]] == pytest.approx(np.array([[-0.5, 0.0], [0.5, 0.0]]), abs=1e-14)
    assert fields.M[[0, -1]] == pytest.approx([290.05771914, 296.50105481], rel=1e-4)
    assert np.sum(fields.weight) == pytest.approx(1.0, rel=1e-13)


def test_thin_belt_on_a_mesh_that_is_too_coarse_for_its_layers():
    solution = solve(THIN, throw=False)
    assert solution.status is Status.ACCURACY_NOT_REACHED
    assert "too coarse for the bending layer of 0.00162 m at x = 0.2 m" in solution.message
    assert "its element is 0.00396 m long" in solution.message
    assert "164 equal elements" in solution.message
    with pytest.raises(SolveError, match="too coarse for the bending layer"):
        solve(THIN)


def test_thin_belt_on_the_mesh_that_it_was_told_to_take():
    solution = solve(THIN, elements=164)
    assert solution.fields.M[0] == pytest.approx(0.310, rel=0.05)
    exact = solve(THIN, elements=1600)
    assert exact.fields.M[0] == pytest.approx(solution.fields.M[0], rel=solution.measures[CLAMP_MOMENT])
    assert exact.omega == pytest.approx(solution.omega, rel=solution.error_estimate)


def test_a_mesh_that_is_finer_at_the_layers_has_them_resolved():
    half = THIN.belt.length / 2
    nodes = half * np.sin(np.linspace(-math.pi / 2, math.pi / 2, 91))
    solution = solve(THIN, mesh=nodes, throw=False)
    layer = least_resolved(solution, nodes)
    assert abs(layer.x) < 0.9 * half
    assert layer.element == pytest.approx(np.diff(nodes).max(), rel=0.2)


def test_an_estimate_from_an_initial_solution_takes_less_than_half_of_the_iterations():
    cold, neighbour = solve(Scene()), solve(Scene(pulleys=(Pulley(x_trans=0.02),)))
    warm = solve(Scene(), initial=neighbour)
    assert 2 * warm.iterations < cold.iterations
    for quantity, error in true_errors(warm, *CASES["chapter"][1:]).items():
        assert error <= warm.measures[quantity], quantity


def test_no_estimate_without_a_coarser_mesh():
    solution = solve(Scene(), elements=12, throw=False)
    assert math.isnan(solution.error_estimate)
    (stage,) = [stage for stage in solution.stages if stage.name == "error estimate"]
    assert stage.iterations is None
    assert "no answer on a mesh of half as many elements" in stage.why


@pytest.mark.parametrize(
    ("friction", "omega", "torque", "stick"),
    [
        (3e-3, 1.4823695692988, 13.84155187, -0.15223),
        (1e-3, 1.4823790656557, 4.892648410, -0.12301),
        (3e-4, 1.4823817463022, 1.554526266, -0.09169),
        (1e-4, 1.4823823169751, 0.542480180, -0.06338),
    ],
)
def test_little_friction_holds_the_belt_too(friction, omega, torque, stick):
    """Held at both Gauss points of an element, D' took more friction than there was: no stick, torque 9 to 18 % off."""
    solution = solve(Scene(pulleys=(Pulley(friction=friction),)))
    assert [zone.kind for zone in solution.zones] == ["free", "slip", "stick", "slip", "free"]
    assert solution.zones[2].x[0] == pytest.approx(stick, abs=0.005)
    assert solution.omega == pytest.approx(omega, rel=1e-7)
    assert solution.contacts[0].torque == pytest.approx(torque, rel=1e-3)


def test_a_stick_zone_that_no_element_can_show_is_missed_by_name():
    solution = solve(Scene(pulleys=(Pulley(friction=1e-6),)), throw=False)
    assert solution.status is Status.ACCURACY_NOT_REACHED
    assert "No stick zone was found before the transition" in solution.message
