"""The fitted method on any drive: reference answers, agreement with the collocation, and what it leaves out."""

import itertools
import math
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import NAMES, REFERENCE, differences, drive, senses

from belt_fenicsx import Belt, Pulley, Scene, Solution, Status, bvp, solve, sweep
from belt_fenicsx.fitted import method as fitted
from belt_fenicsx.fitted.dofs import Terms, local, table, terms_of, width
from belt_fenicsx.fitted.elimination import levels
from belt_fenicsx.fitted.forms import constants_of, residual_and_jacobian, switches_of
from belt_fenicsx.fitted.guess import drive_guess
from belt_fenicsx.fitted.newton import iteration_on, newton
from belt_fenicsx.taut_string.drive import string_drive


@pytest.fixture(scope="module")
def solved():
    """Reference drives, each solved once."""
    known = {}

    def solution(name):
        if name not in known:
            known[name] = solve(drive(name), method="fitted", rtol=1e-9)
        return known[name]

    return solution


def ring(count):
    """So many pulleys on a circle, with the belt around all of them."""
    angles = [2.0 * math.pi * i / count for i in range(count)]
    driven = [{"omega": 10.0}, *({"torque": (4.0 if i % 2 else -2.0) / count} for i in range(1, count))]
    pulleys = tuple(
        Pulley(radius=0.05, center=(0.06 * count * math.cos(a), -0.06 * count * math.sin(a)), friction=0.5, **kind)
        for a, kind in zip(angles, driven, strict=True)
    )
    belt = Belt(youngs_modulus=5e7, thickness=0.003, width=0.03)
    return Scene(belt=belt, pulleys=pulleys, closed=True, elongation=0.03)


@pytest.mark.parametrize("name", NAMES)
def test_an_answer_of_another_method_is_a_step_away(name):
    scene = drive(name)
    solution = solve(scene, initial=bvp.solve(scene))
    first, *others = [stage.iterations for stage in solution.stages if stage.iterations]
    # One step is the difference of both methods, and one for each degree after.
    assert first == 1 and set(others) == {1} and len(others) <= 2


def with_last(scene, **changed):
    """The scene with other values of its last pulley."""
    return replace(scene, pulleys=(*scene.pulleys[:-1], replace(scene.pulleys[-1], **changed)))


def iterated(scene, degree=4):
    """A first guess, and an iteration on it."""
    plain, _ = scene.dimensionless()
    state = drive_guess(plain, string_drive(plain), degree)
    moving = tuple(i for i, pulley in enumerate(plain.pulleys) if pulley.take_up)
    return plain, state, iteration_on(state.mesh, degree, state.terms, moving)


@pytest.mark.parametrize("name", NAMES)
def test_reference(name, solved):
    solution = solved(name)
    assert [[zone.slip for zone in contact.zones] for contact in solution.contacts] == [
        senses(name, index) for index in range(len(solution.contacts))
    ]
    assert solution.method == "fitted" and not any(stage.name.startswith("method") for stage in solution.stages)
    for what, difference in differences(name, solution).items():
        assert abs(difference) < 1e-8, what
    assert solution.error_estimate < 1e-9
    known = REFERENCE[name]["answer"]
    omegas = [
        contact.omega / pulley["omega"] - 1.0
        for contact, pulley in zip(solution.contacts, known["pulleys"], strict=True)
    ]
    # The references are good to a few units of 1e-12.
    assert max(map(abs, omegas)) < solution.error_estimate + 1e-11


@pytest.mark.parametrize("name", ["two-fast", "two-gravity", "three-idler", "thread-dynamic", "chapter-surface"])
def test_fields_agree_with_the_collocation(name, solved):
    """At the points of the other method, which are none of its own; rtol 1e-9 goes with fields to 3e-5."""
    one, others = solved(name), bvp.solve(drive(name), rtol=1e-9).fields
    # A border is known to each method by its own rounding.
    inner = np.flatnonzero((np.diff(others.zone, prepend=-1) == 0) & (np.diff(others.zone, append=99) == 0))
    fields = one.evaluate(others.sigma[inner])
    for key, rel in {"r": 1e-7, "theta": 1e-6, "phi": 1e-6, "D": 1e-8, "kappa": 1e-4, "p": 1e-4, "f": 1e-4}.items():
        known = getattr(others, key)
        assert np.abs(getattr(fields, key) - known[inner]).max() < rel * np.abs(known).max(), key
    on_pulleys = np.array([zone.pulley is not None for zone in one.zones])[fields.zone]
    apart = np.abs(fields.v_rel - others.v_rel[inner])[on_pulleys]
    assert apart.max() < 1e-8 * one.transport_rate


@pytest.mark.parametrize("name", ["two-fast", "two-gravity", "three-idler", "thread-dynamic", "open-S"])
def test_balances(name, solved):
    """Power is lost by sliding alone, and loads on the hubs hold the weight."""
    solution = solved(name)
    through = sum(abs(contact.power) for contact in solution.contacts)
    if solution.scene.closed:
        assert sum(c.power for c in solution.contacts) == pytest.approx(-solution.losses, abs=2e-9 * through)
        weight = np.array(solution.scene.gravity) * solution.scene.belt.line_density * solution.scene.belt.length
        hubs = np.sum([contact.hub_force for contact in solution.contacts], axis=0)
        np.testing.assert_allclose(hubs, weight, atol=1e-7 * max(span.tension[1] for span in solution.spans))


@pytest.mark.parametrize("force", [2000.0, 4000.0])
def test_a_take_up_holds_its_force(force):
    pushed = with_last(drive("two-equal"), take_up=(1.0, 0.0), force=force)
    solution = solve(pushed, method="fitted", rtol=1e-9)
    known = bvp.solve(pushed, rtol=1e-10)
    assert solution.contacts[1].hub_force[0] == pytest.approx(-force, rel=1e-8)
    assert solution.contacts[1].take_up == pytest.approx(known.contacts[1].take_up, rel=1e-8)
    assert solution.transport_rate == pytest.approx(known.transport_rate, rel=1e-9)


def test_two_take_ups_with_gravity_and_inertia_agree_with_the_collocation():
    scene = drive("two-gravity")
    fixed = solve(scene, method="fitted")
    loads = [np.array(contact.hub_force) for contact in fixed.contacts]
    ways = [(-0.8, 0.6), (0.6, 0.8)]
    pushed = [
        replace(p, take_up=way, force=float(-1.1 * np.array(way) @ load))
        for p, way, load in zip(scene.pulleys, ways, loads, strict=True)
    ]
    moved = replace(scene, pulleys=tuple(pushed))
    one, two = solve(moved, method="fitted", rtol=1e-9), bvp.solve(moved, rtol=1e-10)
    assert [c.take_up for c in one.contacts] == pytest.approx([c.take_up for c in two.contacts], rel=1e-7)
    assert one.contacts[0].torque == pytest.approx(two.contacts[0].torque, rel=1e-7)


def test_slip_angle_says_the_same_as_the_torque_it_leads_to(solved):
    known = solved("two-equal").contacts[1]
    by_angle = with_last(drive("two-equal"), torque=None, slip_angle=known.slip_angle, slip=known.zones[-1].slip)
    assert solve(by_angle, method="fitted", rtol=1e-9).contacts[1].torque == pytest.approx(20.0, rel=1e-7)


def test_drag_is_met(solved):
    (_, contact), (_, pulley) = solved("thread").contacts, drive("thread").pulleys
    assert contact.torque == pytest.approx(pulley.torque + pulley.drag * contact.omega, rel=1e-9)


def test_a_given_transport_rate_leaves_one_pulley_without_a_drive(solved):
    known, scene = solved("two-fast"), drive("two-fast")
    pulleys = (replace(scene.pulleys[0], omega=None), scene.pulleys[1])
    solution = solve(replace(scene, pulleys=pulleys, transport_rate=known.transport_rate), method="fitted", rtol=1e-9)
    assert [c.omega for c in solution.contacts] == pytest.approx([c.omega for c in known.contacts], rel=1e-9)
    assert solution.contacts[0].torque == pytest.approx(known.contacts[0].torque, rel=1e-7)


def test_a_torque_beyond_capacity_names_the_pulley_and_what_it_transmits():
    scene = drive("two-equal")
    weaker = tuple(replace(pulley, friction=0.2) for pulley in scene.pulleys)
    for torque, status in ((92.4, Status.SOLVED), (92.5, Status.CAPACITY_EXCEEDED), (300.0, Status.CAPACITY_EXCEEDED)):
        loaded = replace(scene, pulleys=(weaker[0], replace(weaker[1], torque=torque)))
        solution = solve(loaded, method="fitted", throw=False)
        assert solution.status is status
        if status is Status.CAPACITY_EXCEEDED:
            assert "92.417" in solution.message and "pulley" in solution.message


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize("name", ["two-unequal", "two-fast", "open-S"])
def test_rtol_is_kept_and_the_estimate_is_honest(name, rtol):
    solution, known = solve(drive(name), method="fitted", rtol=rtol), REFERENCE[name]["answer"]
    error = max(abs(c.omega / p["omega"] - 1.0) for c, p in zip(solution.contacts, known["pulleys"], strict=True))
    assert solution.success and error <= solution.error_estimate + 1e-11 <= rtol + 1e-11


def error_of_rate(name, **chosen):
    """Relative error of the transport rate with cells, or a degree, chosen."""
    solution = fitted.solve(drive(name), rtol=1e-4, **chosen)
    return abs(solution.transport_rate / REFERENCE[name]["answer"]["transport_rate"] - 1.0)


@pytest.mark.parametrize("name", ["two-equal", "two-fast"])
@pytest.mark.parametrize(("degree", "cells", "least"), [(6, (48, 64, 96, 128), 5.0), (8, (48, 64, 80, 96), 7.0)])
def test_order_in_the_size_of_cells(name, degree, cells, least):
    errors = [error_of_rate(name, degree=degree, elements=n) for n in cells]
    order = -np.polyfit(np.log(cells), np.log(errors), 1)[0]
    assert order > least, order


@pytest.mark.parametrize("name", ["two-equal", "two-fast", "three-idler"])
def test_the_error_falls_exponentially_with_the_degree(name):
    degrees = (6, 8, 10)
    errors = [error_of_rate(name, degree=degree, elements=32) for degree in degrees]
    # For each degree; it rises by two.
    factor = np.exp(-np.polyfit(degrees, np.log(errors), 1)[0])
    assert factor > 3.0, factor


@pytest.mark.parametrize("name", ["two-fast", "serpentine", "chapter-surface"])
def test_warm_start(name, solved):
    again = solve(drive(name), method="fitted", initial=solved(name), rtol=1e-9)
    from_other = solve(drive(name), method="fitted", initial=bvp.solve(drive(name)), rtol=1e-9)
    for solution in (again, from_other):
        assert not any(stage.name == "string" for stage in solution.stages)
        assert solution.transport_rate == pytest.approx(solved(name).transport_rate, rel=1e-9)


@pytest.mark.parametrize("name", ["two-equal", "two-fast", "three-idler"])
def test_warm_starts_over_the_torque(name, solved):
    """From each answer to the next: the same answers, with fewer iterations in all."""
    index, torque = next((i, p.torque) for i, p in enumerate(drive(name).pulleys) if p.torque)
    initial, iterations = solved(name), []
    for part in (0.97, 0.9, 0.8, 1.05):
        pulleys = list(drive(name).pulleys)
        pulleys[index] = replace(pulleys[index], torque=part * torque)
        scene = replace(drive(name), pulleys=tuple(pulleys))
        cold, warm = solve(scene, rtol=1e-9), solve(scene, rtol=1e-9, initial=initial)
        assert not any(stage.name == "string" for stage in warm.stages)
        iterations.append((warm.iterations, cold.iterations))
        assert warm.transport_rate == pytest.approx(cold.transport_rate, rel=1e-9)
        assert [c.omega for c in warm.contacts] == pytest.approx([c.omega for c in cold.contacts], rel=1e-9)
        initial = warm
    of_warm, of_cold = map(sum, zip(*iterations, strict=True))
    assert of_warm < of_cold


# What a scene does not need


@pytest.mark.parametrize(
    ("name", "terms"),
    [
        ("two-equal", Terms()),
        ("serpentine", Terms()),
        ("open-S", Terms()),
        ("two-speeds", Terms(loads=True)),
        ("two-fast", Terms(loads=True)),
        ("chapter-fast", Terms(loads=True)),
        ("thread", Terms(loads=True)),
        ("chapter-surface", Terms(offset=True)),
    ],
)
def test_forms_have_no_terms_that_a_scene_does_not_need(name, terms):
    assert terms_of(drive(name).dimensionless()[0]) == terms


def test_unknowns_data_and_switches_of_forms_are_those_that_a_scene_needs():
    """The plain form knows neither loads nor an offset, and has no transport rate and take-ups among its unknowns."""
    sizes = {}
    for terms in (Terms(), Terms(offset=True), Terms(loads=True)):
        F, J = residual_and_jacobian(6, terms)
        unknown, *_ = (coefficient.ufl_shape[0] for coefficient in F.coefficients())
        (constants,) = F.constants()
        assert constants.ufl_shape == (len(constants_of(terms)),)
        assert F.coefficients()[1].ufl_shape == (len(switches_of(terms)),)
        assert len(J.arguments()) == 2
        sizes[terms] = unknown, constants.ufl_shape[0]
    plain, offset, loads = sizes.values()
    assert plain[0] == offset[0] == loads[0] - 2 and width(6, True) - width(6, False) == 2
    assert (plain[1], offset[1], loads[1]) == (3, 4, 7)


def test_the_transport_rate_is_an_unknown_only_where_something_depends_on_it():
    for name, rated in (("two-equal", False), ("two-speeds", True), ("two-fast", True), ("chapter-fast", False)):
        _, state, iteration = iterated(drive(name))
        numbers, fixed = iteration.condensed.table.numbers, iteration.condensed.table.fixed
        assert bool((numbers[:, local(4).rate] < fixed).any()) == rated


def test_an_idler_in_pure_stick_has_no_transition(solved):
    stages = solved("serpentine").stages
    assert not any("run-off" in stage.why for stage in stages)
    assert [len(contact.zones) for contact in solved("serpentine").contacts] == [2, 1, 2, 1]


def test_pure_stick_that_meets_the_torque_needs_no_equation_of_a_transition(solved):
    """The idler's run-up and run-off are all of its borders, and its torque is met though nothing asks for it."""
    layout = solved("serpentine").state.layout
    for index in (1, 3):
        (only,) = layout.on(index)
        assert [joint.equation for joint in layout.joints[only - 1 : only + 1]] == ["tangent", "tangent"]
        assert not layout.slides_behind(index)
    assert abs(solved("serpentine").contacts[1].torque - drive("serpentine").pulleys[1].torque) < 1e-8


def test_smooth_pulleys_need_no_friction_unknowns():
    scene = drive("open-S")
    smooth = replace(scene, pulleys=tuple(replace(p, friction=0.0, x_trans="run-up") for p in scene.pulleys))
    assert terms_of(smooth.dimensionless()[0]) == Terms(friction=False)
    solution = solve(smooth, method="fitted")
    assert not solution.fields.f.any() and [contact.torque for contact in solution.contacts] == [0.0, 0.0]
    sizes = []
    for each in (smooth, replace(smooth, pulleys=tuple(replace(p, friction=0.1) for p in smooth.pulleys))):
        _, state, iteration = iterated(each)
        sizes.append(iteration.condensed.table.count)
        assert state.degree == 4
    # One friction for each cell is shared, those at the other Gauss points are eliminated with the cell.
    assert sizes[0] < sizes[1]


def test_a_second_drive_of_the_same_layout_sets_up_nothing(monkeypatch, solved):
    made = []
    solve(with_last(drive("two-equal"), torque=20.1), method="fitted", rtol=1e-9)
    monkeypatch.setattr("belt_fenicsx.fitted.newton.Iteration.__init__", lambda *_: made.append("iteration"))
    monkeypatch.setattr("belt_fenicsx.fitted.kernels.Kernel.__init__", lambda *_: made.append("forms"))
    monkeypatch.setattr("belt_fenicsx.fitted.forms.compiled", lambda *_: made.append("compiled"))
    monkeypatch.setattr("belt_fenicsx.fitted.cells.Mesh.__init__", lambda *_: made.append("mesh"))
    assert solve(with_last(drive("two-equal"), torque=20.2), method="fitted", rtol=1e-9).success and not made


def test_another_layout_of_the_same_kind_compiles_nothing(monkeypatch, solved):
    compiled = []
    assert solved("three-idler").success
    monkeypatch.setattr("belt_fenicsx.fitted.forms.compiled", lambda *_: compiled.append("forms"))
    other = solve(drive("three-idler"), method="fitted", rtol=1e-9, elements=100)
    assert other.state.mesh != solved("three-idler").state.mesh and not compiled


# Linear algebra


MOVING = {"take_up": (1.0, 0.5), "force": 3000.0}


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("two-equal", {}),
        ("two-equal", MOVING),
        ("two-gravity", MOVING),
        ("three-idler", {}),
        ("serpentine", {}),
        ("open-S", {}),
        ("chapter-surface", {}),
    ],
)
def test_step_solves_the_linearised_equations(name, more):
    plain, state, iteration = iterated(with_last(drive(name), **more))
    iteration.load(plain, state, 1e-2)
    iteration.residuals()
    iteration.jacobians()
    condensed, dofs = iteration.condensed, iteration.condensed.table
    step, _ = iteration.linear_step(False)
    jacobians, residuals = condensed.cells
    numbers, solution = np.append(dofs.numbers.ravel(), dofs.scalars), np.zeros(dofs.count)
    solution[numbers] = np.append(step.ravel(), condensed.step()[1])
    unsolved = np.bincount(
        dofs.numbers.ravel(),
        ((jacobians @ solution[dofs.numbers][..., None])[..., 0] + residuals).ravel(),
        dofs.count,
    )
    unsolved[[dofs.fixed, *([dofs.loose] if dofs.loose is not None else [])]] = 0.0
    assert np.abs(unsolved).max() < 1e-8 * np.abs(jacobians).max() * np.abs(solution).max()
    if state.layout.closed:
        assert abs(solution[dofs.joints[-1]]) < 1e-14


@pytest.mark.parametrize("name", ["two-gravity", "chapter-surface", "thread-dynamic"])
def test_jacobian_is_the_residuals_derivative(name):
    plain, state, iteration = iterated(drive(name))
    newton(()).solve(plain, state, 1e-2)
    iteration.jacobians()
    (jacobians, residuals), u, h = iteration.condensed.cells, iteration.values, 1e-7
    direction = np.cos(np.arange(u.size)).reshape(u.shape) * state.length[:, None]
    exact, start, both = (jacobians @ direction[..., None])[..., 0], u.copy(), []
    for sign in (1.0, -1.0):
        u[:] = start + sign * h * direction
        iteration.residuals()
        both.append(residuals.copy())
    np.testing.assert_allclose((both[0] - both[1]) / (2 * h), exact, atol=1e-5 * np.abs(exact).max())


def test_work_of_the_elimination_grows_with_the_number_of_pulleys_alone():
    work = []
    for count in (4, 8, 16):
        _, state, _ = iterated(ring(count))
        *eliminated, last = levels(table(state.mesh, 4, state.terms))
        inside = sum(len(g.hidden) * g.ends[-1] ** 2 * g.block.shape[2] for level in eliminated for g in level.groups)
        dense = last.groups[0].hidden.size
        work.append(inside + dense**3 / 3.0)
        assert dense <= 6 * count
    for one, two in itertools.pairwise(work):
        assert two < 2.3 * one


def test_neighbours_share_their_nodes_all_around():
    _, state, iteration = iterated(drive("two-equal"))
    numbers, (left, right) = iteration.condensed.table.numbers, local(4).nodal[:2]
    np.testing.assert_array_equal(np.roll(numbers[:, left], -1, axis=0), numbers[:, right])
    finer = state.of_degree(12)
    theta = finer.values[:, local(12).theta]
    np.testing.assert_array_equal(theta[1:, 0], theta[:-1, 1])
    assert theta[-1, 1] == theta[0, 0] - 2.0 * math.pi


# What comes after a solve


@pytest.mark.parametrize("name", ["two-fast", "chapter-surface", "take-up"])
def test_a_file_knows_the_fields_between_points(name, tmp_path):
    pushed = with_last(drive("two-equal"), take_up=(1.0, 0.0), force=2500.0)
    solution = solve(pushed if name == "take-up" else drive(name), method="fitted")
    solution.save(tmp_path / "drive.npz")
    half = solution.scene.belt.length / 2
    sigma = np.linspace(-half, half, 101)
    assert Solution.load(tmp_path / "drive.npz").evaluate(sigma) == solution.evaluate(sigma)


def test_sweep_of_a_torque_goes_on_from_the_drive_before():
    torques = [10.0, 15.0, 20.0]
    table = sweep(drive("two-equal"), over="pulleys.1.torque", values=torques)
    alone = [solve(with_last(drive("two-equal"), torque=torque), method="fitted") for torque in torques]
    assert table.success
    rates = [solution.transport_rate for solution in alone]
    assert [row.transport_rate for row in table.solutions] == pytest.approx(rates, rel=1e-8)


def test_sweep_over_drives_of_all_kinds_gives_the_answers_of_single_solves():
    """Layouts change from drive to drive, and come back; what is kept for one of them must not reach another."""
    names = ["two-equal", "two-fast", "two-equal", "serpentine", "open-S", "chapter-surface", "two-fast", "serpentine"]
    table = sweep([drive(name) for name in names], rtol=1e-9)
    assert table.success
    for name, solution in zip(names, table.solutions, strict=True):
        assert max(map(abs, differences(name, solution).values())) < 1e-8, name


def test_answers_do_not_depend_on_the_number_of_elements():
    rates = [solve(drive("two-fast"), method="fitted", elements=n, rtol=1e-9).transport_rate for n in (40, 90)]
    assert rates[0] == pytest.approx(rates[1], rel=1e-9)


def test_a_thin_belts_idler_is_met_to_what_rounding_leaves():
    """An idler that sticks all along, under a belt of a thousandth of its radius: but for rounding, which the
    certificate tells beside its margin, friction on it sums up to zero."""
    studies = Path(__file__).parents[2] / "demos" / "studies"
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(studies))
        loops = runpy.run_path(str(studies / "stress_drives.py"))["loops"]
    *_, scene = loops(12, 1)
    assert scene.belt.thickness < 2e-3 * scene.pulleys[0].radius and scene.pulleys[0].torque == 0.0
    solution, reference = solve(scene), bvp.solve(scene, rtol=1e-10)
    assert not any(stage.name == "method bvp" for stage in solution.stages)
    (met,) = (check for check in solution.checks if check.name == "drive met" and check.pulley == 0)
    assert 1e-9 < met.tolerance < 1.1e-7 and -met.tolerance < met.margin
    tension = max(span.tension[1] for span in reference.spans)
    for contact, other, pulley in zip(solution.contacts, reference.contacts, scene.pulleys, strict=True):
        assert contact.torque == pytest.approx(other.torque, abs=1e-8 * pulley.radius * tension)
        assert contact.omega == pytest.approx(other.omega, rel=1e-8)
