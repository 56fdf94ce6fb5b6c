"""The default method: zones bounded by nodes that move."""

from __future__ import annotations

import gc
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from belt_fenicsx import bvp, solve
from belt_fenicsx.fitted import forms as fitted_forms
from belt_fenicsx.fitted import method as fitted
from belt_fenicsx.fitted.dofs import Terms, local, table
from belt_fenicsx.fitted.elements import gauss_basis, nodal_basis, points
from belt_fenicsx.fitted.forms import SWITCHES
from belt_fenicsx.fitted.guess import drive_guess
from belt_fenicsx.fitted.newton import Newton, iteration_on, newton, switches
from belt_fenicsx.scene.belt import Belt
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.status import Status
from belt_fenicsx.sweeps.sweep import sweep
from belt_fenicsx.taut_string.drive import string_drive

OMEGA = 1.4807092526223  # by this method at degree 14 and by collocation of the boundary-value problem


def scene(belt=None, **pulley):
    return Scene(belt=Belt(**(belt or {})), pulleys=(Pulley(**pulley),))


def started(case=None, degree=3, elements=None):
    dimensionless, _ = (case or Scene()).dimensionless()
    return dimensionless, drive_guess(dimensionless, string_drive(dimensionless), degree, elements)


def iterated(dimensionless, state):
    """The iteration after it has converged from a state."""
    newton(()).solve(dimensionless, state, 1e-3)
    return iteration_on(state.mesh, state.degree, state.terms)


def test_sources_scene():
    solution = solve(Scene())
    (contact,) = solution.contacts
    assert solution.status is Status.SOLVED
    assert abs(solution.omega / OMEGA - 1) < 1e-8
    assert abs(solution.omega / OMEGA - 1) < solution.error_estimate < 1e-8
    assert contact.x_up == pytest.approx(-0.2373388667, rel=1e-8)
    assert contact.x_off == pytest.approx(0.2360980112, rel=1e-8)
    assert contact.x_trans == pytest.approx(0.0, abs=1e-12)
    assert contact.torque == pytest.approx(610.315737, rel=1e-5)
    assert [zone.kind for zone in solution.zones] == ["free", "stick", "slip", "free"]


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-8, 1e-10, 1e-11])
def test_rtol_is_kept_and_the_estimate_is_honest(rtol):
    solution = solve(Scene(), rtol=rtol)
    error = abs(solution.omega / OMEGA - 1)
    assert solution.error_estimate <= rtol
    assert error <= solution.error_estimate <= 100 * max(error, 1e-13)


@pytest.mark.parametrize(
    ("case", "omega", "x_up", "x_off", "torque"),
    [
        (scene(slip="backward"), 1.4841983139747, -0.2364358360, 0.2375975288, -553.722116),
        (scene(x_trans="run-off"), 1.4825151024971, -0.2368628975, 0.2368628975, 0.0),
        (scene(x_trans="run-up"), 1.4779052879917, -0.2380946437, 0.2356934661, 1162.868190),
        (scene(x_trans="run-up", slip="backward"), 1.4874009496195, -0.2356934661, 0.2380946437, -1162.868190),
        (scene(omega=1.48), 1.48, -0.2375310184, 0.2359498812, 772.890001),
        (scene(omega=1.4842), 1.4842, -0.236435416, 0.2375979834, -554.130974),
        (scene(torque=610.315737), OMEGA, -0.2373388667, 0.2360980112, 610.315737),
        (scene(torque=-553.722116), 1.4841983139747, -0.2364358360, 0.2375975288, -553.722116),
        (scene(torque=0.0), 1.4825151024971, -0.2368628975, 0.2368628975, 0.0),
        (scene(omega=1.475), 1.475, -0.2380946437, 0.2356934661, 1162.868190),
        (scene(omega=1.49), 1.49, -0.2356934661, 0.2380946437, -1162.868190),
        (scene(friction=0.02), 1.482261967364, -0.2369179552, 0.2367539036, 80.264825),
    ],
    ids=[
        "backward",
        "pure stick",
        "pure slip",
        "pure backward slip",
        "given omega",
        "given omega, backward",
        "given torque",
        "given torque, backward",
        "free pulley",
        "too slow to stick",
        "too fast to stick",
        "sliding at the run-up",
    ],  # fmt: skip
)
def test_other_drives(case, omega, x_up, x_off, torque):
    solution = solve(case, rtol=1e-10)
    (contact,) = solution.contacts
    assert solution.admissible
    assert contact.omega == pytest.approx(omega, rel=1e-10)
    assert contact.x_up == pytest.approx(x_up, abs=2e-9)
    assert contact.x_off == pytest.approx(x_off, abs=2e-9)
    assert contact.torque == pytest.approx(torque, abs=2e-4)


@pytest.mark.parametrize(
    ("case", "omega", "x_up"),
    [
        (scene({"thickness": 0.005}), 1.478489840725, -0.2132399418),
        (scene({"thickness": 0.002}), 1.478236163997, None),
        (scene(friction=1.0), 1.473890161990, None),
        (scene({"poisson_ratio": 0.0}), 1.481024986520, None),
    ],
    ids=["h = 0.005", "h = 0.002", "mu = 1", "nu = 0"],
)
def test_other_belts(case, omega, x_up):
    solution = solve(case)
    assert solution.omega == pytest.approx(omega, rel=1e-8)
    if x_up is not None:
        assert solution.contacts[0].x_up == pytest.approx(x_up, abs=1e-8)


@pytest.mark.parametrize(
    ("friction", "omega", "border"),
    [
        (0.02, 1.482261967364, -0.2115616953),
        (0.03, 1.482185403515, -0.2287401336),
        (0.001, 1.482379065653, -0.1230078604),
    ],
)
def test_sliding_zone_at_the_run_up(friction, omega, border):
    solution = solve(scene(friction=friction), rtol=1e-10)
    assert solution.omega == pytest.approx(omega, rel=1e-10)
    assert [(zone.kind, zone.slip) for zone in solution.contacts[0].zones] == [
        ("slip", "forward"),
        ("stick", None),
        ("slip", "forward"),
    ]
    assert solution.zones[1].x[1] == pytest.approx(border, abs=2e-6)


@pytest.mark.parametrize("torque", [1163.0, -1163.0])
def test_torque_beyond_capacity_states_the_capacity(torque):
    solution = solve(scene(torque=torque), throw=False)
    assert solution.status is Status.CAPACITY_EXCEEDED
    assert "1162.87 N m" in solution.message
    solution = solve(scene(friction=0.0, torque=1.0), throw=False)
    assert solution.status is Status.CAPACITY_EXCEEDED


def test_sliding_all_along_has_the_excess_speed():
    fields = solve(scene(omega=1.475)).fields
    assert np.all(fields.v_rel[fields.zone == 1] > 0.0)
    np.testing.assert_allclose(fields.v_rel, fields.D - 0.7 * 1.475, atol=1e-12)


def test_accuracy_out_of_reach_is_no_success():
    solution = solve(Scene(), rtol=1e-13, throw=False)
    assert solution.status is Status.ACCURACY_NOT_REACHED
    assert 1e-13 < solution.error_estimate < 1e-10
    assert abs(solution.omega / OMEGA - 1) < solution.error_estimate


def test_given_speed_finds_the_transition():
    (contact,) = solve(scene(omega=1.48), rtol=1e-10).contacts
    assert contact.x_trans == pytest.approx(-0.08622586, abs=2e-8)


def test_tractions_on_both_sides_of_the_borders():
    fields = solve(Scene(), rtol=1e-11).fields
    stick, slip = fields.zone == 1, fields.zone == 2
    assert fields.p[stick][0] == pytest.approx(49538.39977, rel=1e-7)
    assert fields.p[slip][-1] == pytest.approx(50996.57215, rel=1e-7)
    assert fields.f[slip][0] == pytest.approx(-2700.23166, rel=1e-7)
    assert fields.f[slip][-1] == pytest.approx(-10199.31, abs=0.01)
    assert np.all(fields.p[fields.zone == 0] == 0.0)


def test_fields_at_any_point():
    solution = solve(Scene(), rtol=1e-11)
    dense = solution.fields
    # p and f have two values where cells meet.
    inside = np.abs(dense.sigma[:, None] - solution.state.sigma[:, 0]).min(axis=1) > 1e-9
    inside[-1] = False
    again = solution.evaluate(dense.sigma[inside])
    for name in ("r", "theta", "phi", "D", "eps", "Gamma", "kappa", "p", "f", "M", "v_rel"):
        a, b = getattr(again, name), getattr(dense, name)[inside]
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-11 * np.abs(b).max(), err_msg=name)


def test_fields_on_both_sides_of_a_border():
    solution = solve(Scene(), rtol=1e-11)
    up, trans, off = (zone.sigma[1] for zone in solution.zones[:-1])
    before, after = solution.evaluate(up, "left"), solution.evaluate(up)
    assert (before.zone[0], after.zone[0]) == (0, 1)
    assert before.p[0] == 0.0
    assert after.p[0] == pytest.approx(49538.39977, rel=1e-7)
    np.testing.assert_allclose(before.D, after.D, rtol=1e-9)
    assert solution.evaluate(off, "left").p[0] == pytest.approx(50996.57215, rel=1e-7)
    assert solution.evaluate([trans]).f[0] == pytest.approx(-2700.23166, rel=1e-7)
    with pytest.raises(SceneError, match="belt"):
        solution.evaluate([0.0, 0.51])
    with pytest.raises(SceneError, match="side"):
        solution.evaluate(0.0, side="up")
    with pytest.raises(SceneError, match="fitted"):
        replace(solution, evaluator=None).evaluate(0.0)


def test_fields_satisfy_equilibrium_and_coulombs_law():
    fields = solve(Scene(), rtol=1e-11).fields
    slip = fields.zone == 2
    np.testing.assert_allclose(fields.f[slip], -0.2 * fields.p[slip], rtol=1e-12)
    free = fields.zone == 0
    e1 = np.column_stack([np.cos(fields.theta), np.sin(fields.theta)])
    e2 = np.column_stack([-np.sin(fields.theta), np.cos(fields.theta)])
    force = (fields.Q[:, :1] * e1 + fields.Q[:, 1:] * e2)[free]
    np.testing.assert_allclose(force, np.broadcast_to(force[0], force.shape), atol=1e-7 * np.abs(force).max())


@pytest.mark.parametrize(("degree", "cells", "least"), [(6, (16, 24, 32, 48, 64), 5.0), (8, (12, 16, 20, 24), 7.0)])
def test_order_in_the_size_of_cells(degree, cells, least):
    errors = [abs(fitted.solve(Scene(), degree=degree, elements=n).omega / OMEGA - 1) for n in cells]
    order = -np.polyfit(np.log(cells), np.log(errors), 1)[0]
    assert order > least, order


def test_the_error_falls_exponentially_with_the_degree():
    degrees = (6, 8, 10)
    errors = [abs(fitted.solve(Scene(), degree=k).omega / OMEGA - 1) for k in degrees]
    factor = np.exp(-np.polyfit(degrees, np.log(errors), 1)[0])
    assert factor > 8.0, factor


def test_warm_start_leaves_out_the_string():
    first = solve(Scene())
    warm = solve(scene(x_trans=0.05), initial=first)
    cold = solve(scene(x_trans=0.05))
    assert warm.omega == pytest.approx(cold.omega, rel=1e-8)
    assert {stage.name: stage.iterations for stage in warm.stages}["taut string"] is None
    assert {stage.name: stage.iterations for stage in cold.stages}["taut string"] == 0


@pytest.mark.parametrize("step", [2e-4, 0.01])
def test_warm_start_spares_the_way_from_the_string(step):
    first = solve(Scene())
    warm, cold = (solve(scene(x_trans=step), initial=initial) for initial in (first, None))
    assert warm.iterations <= cold.iterations - 2
    assert abs(warm.omega / cold.omega - 1.0) < warm.error_estimate + cold.error_estimate


def test_warm_start_from_a_file(tmp_path):
    solve(Scene()).save(tmp_path / "first.npz")
    warm = solve(scene(x_trans=0.05), initial=Solution.load(tmp_path / "first.npz"))
    assert warm.omega == pytest.approx(solve(scene(x_trans=0.05)).omega, rel=1e-8)
    assert "the given solution" in [stage.why for stage in warm.stages]


def test_warm_start_from_other_zones_starts_afresh():
    first = solve(scene(x_trans="run-off"))
    assert solve(Scene(), initial=first).omega == pytest.approx(OMEGA, rel=1e-8)


def test_sweep_compiles_nothing_after_its_first_scene(monkeypatch):
    solve(Scene())
    made = []
    monkeypatch.setattr(fitted_forms, "compiled", lambda *forms: made.append(forms))
    table = sweep(Scene(), over="pulleys.0.x_trans", values=np.linspace(-0.2, 0.2, 5))
    assert table.success and not made
    assert np.all(table["error_estimate"] <= 1e-8)
    assert table["omega"][2] == pytest.approx(OMEGA, rel=1e-8)


def test_frictionless_belt_has_no_friction_unknowns_and_no_friction_in_its_forms():
    dimensionless, state = started(scene(friction=0.0))
    without, with_friction = (table(state.mesh, 3, Terms(friction)) for friction in (False, True))
    assert without.count < with_friction.count
    assert np.all(without.numbers[:, local(3).f] == without.fixed)
    iteration = iterated(dimensionless, state)
    iteration.jacobians()
    jacobians, _ = iteration.condensed.cells
    assert not jacobians[:, local(3).f].any() and not jacobians[:, :, local(3).f].any()
    solution = solve(scene(friction=0.0))
    assert np.all(solution.fields.f == 0.0) and solution.contacts[0].torque == 0.0


def test_pure_stick_and_pure_slip_have_one_contact_zone():
    for end in ("run-up", "run-off"):
        assert len(solve(scene(x_trans=end)).contacts[0].zones) == 1


@pytest.mark.parametrize("x_trans", [-0.5, -0.25, 0.25, 0.3, 0.6])
def test_transition_outside_of_the_contact_is_an_error(x_trans):
    with pytest.raises(SceneError, match="contact zone"):
        solve(scene(x_trans=x_trans))


@pytest.mark.parametrize(
    ("x_trans", "slip"), [(-0.235, "forward"), (0.235, "forward"), (-0.2, "backward"), (0.235, "backward")]
)
def test_transition_close_to_the_ends_of_the_contact(x_trans, slip):
    assert solve(scene(x_trans=x_trans, slip=slip)).contacts[0].x_trans == pytest.approx(x_trans, abs=1e-10)


def test_clamps_next_to_the_pulley_press_a_thin_belt_onto_it():
    belt = {"length": 1.22151406260858, "poisson_ratio": 0.43329321137659643, "thickness": 0.004012664014004557}
    pulley = {"radius": 0.5452584360146776, "center": (-0.0007619316719060104, -0.23871140252588818)}
    case = scene(belt, friction=0.027616105627906912, x_trans=0.16181237382147046, slip="backward", **pulley)
    solution = solve(case)
    assert solution.iterations < 15
    assert solution.omega == pytest.approx(bvp.solve(case).omega, rel=2e-8)


def test_sliding_turns_before_the_run_off():
    belt = {"length": 1.0046, "poisson_ratio": 0.12, "thickness": 0.056}
    pulley = {"radius": 0.368, "center": (-0.027, -0.199), "friction": 0.015}
    case = scene(belt, x_trans=-0.02, slip="backward", **pulley)
    solution = solve(case)
    assert [zone.slip for zone in solution.contacts[0].zones] == ["forward", None, "backward", "forward"]
    assert solution.omega == pytest.approx(bvp.solve(case).omega, rel=2e-8)


def test_arguments():
    for degree in (4, 7):
        with pytest.raises(SceneError, match="degree"):
            fitted.solve(Scene(), degree=degree)


def test_petsc_options_reach_snes():
    plain, limited = (solve(Scene(), options=options, throw=False) for options in (None, {"snes_max_it": 1}))
    assert max(stage.iterations or 0 for stage in plain.stages) > 1
    assert max(stage.iterations or 0 for stage in limited.stages if stage.name.startswith("degree")) == 1


def test_no_step_lets_borders_cross(monkeypatch):
    dimensionless, state = started(scene(x_trans=0.2), degree=3)
    iteration = iteration_on(state.mesh, 3, Terms())
    seen, residuals = [], iteration.residuals

    def watched():
        seen.append(np.diff(iteration.values[:, local(3).sigma]).min())
        residuals()

    monkeypatch.setattr(iteration, "residuals", watched)
    newton(()).solve(dimensionless, state, 1e-6)
    assert min(seen) > 0.0


@pytest.mark.parametrize("friction", [0.5, 0.0])
@pytest.mark.parametrize(("degree", "elements"), [(3, None), (6, None), (8, None), (3, 17), (4, 33), (4, 63)])
def test_step_solves_the_linearised_equations(degree, elements, friction):
    dimensionless, state = started(scene(friction=friction), degree, elements)
    iteration = iterated(dimensionless, state)
    condensed, dofs, at = iteration.condensed, iteration.condensed.table, local(degree)
    iteration.values += 1e-4 * np.sin(np.arange(dofs.count))[dofs.numbers]
    iteration.residuals()
    iteration.jacobians()
    jacobians, residuals = (cells.copy() for cells in condensed.cells)
    zone = state.mesh.zone[:, None]
    step, scalars = iteration.linear_step(False)
    ends = np.concatenate([[0.0], scalars[:-1], [0.0]])
    step[:, at.sigma] = (1.0 - state.cells) * ends[zone] + state.cells * ends[zone + 1]
    unsolved = np.zeros(dofs.count)
    np.add.at(unsolved, dofs.numbers, (jacobians @ step[..., None])[..., 0] + residuals)
    unsolved[dofs.fixed] = 0.0
    assert np.abs(unsolved).max() < 1e-9 * max(1.0, np.abs(jacobians).max() * np.abs(step).max())
    left, right = at.nodal[:2]
    assert not step[0, left].any() and not step[-1, right].any()


@pytest.mark.parametrize("thickness", [0.05, 0.005])
def test_estimate_knows_the_rounding_error_of_many_short_cells(thickness):
    case = scene({"thickness": thickness})
    exact, solution = solve(case, rtol=1e-10).omega, fitted.solve(case, elements=1000, degree=6)
    assert abs(solution.omega / exact - 1.0) < solution.error_estimate < 1e-8


def test_jacobian_is_the_residuals_derivative():
    dimensionless, state = started()
    iteration = iterated(dimensionless, state)
    iteration.jacobians()
    (jacobians, residuals), u, h = iteration.condensed.cells, iteration.values, 1e-6
    direction = np.cos(np.arange(u.size)).reshape(u.shape)
    exact, start, both = (jacobians @ direction[..., None])[..., 0], u.copy(), []
    for sign in (1.0, -1.0):
        u[:] = start + sign * h * direction
        iteration.residuals()
        both.append(residuals.copy())
    np.testing.assert_allclose((both[0] - both[1]) / (2 * h), exact, atol=1e-6 * np.abs(exact).max())


def test_neighbours_share_their_node():
    _, state = started()
    left, right = local(3).nodal[:2]
    numbers = table(state.mesh, 3, Terms()).numbers
    np.testing.assert_array_equal(numbers[1:, left], numbers[:-1, right])


def test_switches_say_where_each_joint_condition_holds():
    _, state = started()
    on = switches(state.mesh, Terms())
    up, trans, off = state.mesh.ends
    column = {name: on[..., index] for index, name in enumerate(SWITCHES)}
    assert np.argwhere(column["tangent"]).tolist() == [[up - 1, 1], [off, 0]]
    assert np.argwhere(column["x"]).tolist() == [[trans, 0]]
    assert np.argwhere(column["surface"]).tolist() == [[up - 1, 1]]
    assert np.all(column["sense"][trans:off] == 1.0) and not column["sense"][:trans].any()


@pytest.mark.parametrize("degree", [3, 7, 13])
def test_lagrange_polynomials(degree):
    nodes, gauss = points(degree)
    assert (nodes[0], nodes[1], gauss.size) == (0.0, 1.0, degree)
    at = np.linspace(0.0, 1.0, 7)
    values, slopes = nodal_basis(degree, at)
    np.testing.assert_allclose(values @ nodes**degree, at**degree, atol=1e-12)
    np.testing.assert_allclose(slopes @ nodes**degree, degree * at ** (degree - 1), atol=1e-10)
    np.testing.assert_allclose(gauss_basis(degree, gauss), np.eye(degree), atol=1e-11)
    assert gauss_basis(degree, gauss[:0]).shape == (0, degree)


@pytest.mark.serial
def test_nothing_is_loaded_that_is_not_needed():
    code = (
        "import sys, ufl, basix, ffcx.codegeneration.jit, petsc4py.PETSc; before = 'scipy' in sys.modules\n"
        "from belt_fenicsx import Scene, solve; solve(Scene())\n"
        "assert before or 'scipy' not in sys.modules; assert not {'matplotlib', 'dolfinx'} & {*sys.modules}"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_solvers_that_are_no_longer_kept_free_petscs_objects():
    solver = Newton({"snes_max_it": 7})
    snes = solver.snes
    assert snes
    del solver
    gc.collect()
    assert not snes
