"""The augmented-Lagrangian method against reference numbers, limits and invariances."""

import dataclasses
import functools
import logging

import numpy as np
import pytest
from mpi4py import MPI

from belt_fenicsx import Belt, Pulley, Scene, SceneError, SolveError, Status, solve
from belt_fenicsx.lagrangian import method as augmented_lagrangian
from belt_fenicsx.lagrangian.multipliers import Penalties
from belt_fenicsx.lagrangian.tolerances import Tolerances

solve_fixed = functools.partial(solve, method="augmented-lagrangian")

OMEGA = 1.4807092526223


def scene(**pulley):
    return Scene(pulleys=(Pulley(**pulley),))


@pytest.fixture(scope="module")
def published():
    return solve_fixed(Scene())


def test_published_case(published):
    contact = published.contacts[0]
    assert published.status is Status.SOLVED
    assert published.omega == pytest.approx(OMEGA, rel=1e-5)
    assert contact.x_up == pytest.approx(-0.2373388667, abs=1e-3)
    assert contact.x_off == pytest.approx(0.2360980112, abs=1e-3)
    assert contact.torque == pytest.approx(610.315737, rel=1e-3)
    assert [(zone.kind, zone.slip) for zone in published.zones] == [
        ("free", None),
        ("stick", None),
        ("slip", "forward"),
        ("free", None),
    ]


def test_reports_what_the_updates_stopped_on(published):
    assert published.measures["multiplier_change"] <= 1e-5
    assert published.measures["penetration"] <= 1e-9
    assert set(published.timings) == {
        *(f"{stage}, {elements} elements" for stage in ("set-up", "frictional") for elements in (25, 50)),
        *("relaxed, 25 elements", "set-up", "frictional", "error estimate"),
    }


def test_contact_forces_near_the_borders_are_as_good_as_an_element(published):
    fields = published.fields
    touching = np.flatnonzero(fields.p > 0.0)
    # The pressure falls by its own size within a shear layer of 0.025 m: an element is 0.4 of it.
    assert np.max(fields.p[: len(fields.p) // 2]) == pytest.approx(49538.40, rel=0.15)
    assert np.max(fields.p[len(fields.p) // 2 :]) == pytest.approx(50996.57, rel=0.15)
    after = touching[fields.x[touching] > 0.01][0]
    assert fields.f[after] == pytest.approx(-2700.23, rel=0.02)


@pytest.mark.parametrize(
    ("pulley", "omega", "rel"),
    [
        ({"x_trans": "run-off"}, 1.4825151024971, 1e-5),
        ({"x_trans": "run-up"}, 1.4779052879917, 5e-5),
        ({"slip": "backward"}, 1.4841983139747, 1e-5),
        ({"x_trans": "run-up", "slip": "backward"}, 1.4874009496195, 5e-5),
    ],
)
def test_limits(pulley, omega, rel):
    assert solve_fixed(scene(**pulley)).omega == pytest.approx(omega, rel=rel)


def test_error_falls_with_the_number_of_elements():
    counts = np.array([50, 100, 200, 400, 800])
    errors = np.array([abs(solve_fixed(Scene(), elements=int(n)).omega / OMEGA - 1.0) for n in counts])
    assert np.all(errors < 1e-3 / counts)
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert order > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("elements", [20_000, 100_000])
def test_fine_meshes_come_to_rest_at_rounding(elements):
    solution = solve_fixed(Scene(), elements=elements)
    assert solution.omega == pytest.approx(OMEGA, rel=3e-8)
    assert solution.measures["multiplier_change"] <= max(1e-5, solution.measures["rounding"])


def test_entry_slip_zone_appears_where_stick_would_break_coulombs_bound():
    solution = solve_fixed(scene(friction=0.02), elements=400)
    kinds = [(zone.kind, zone.slip) for zone in solution.zones]
    assert kinds == [("free", None), ("slip", "forward"), ("stick", None), ("slip", "forward"), ("free", None)]
    assert solution.zones[1].x[1] == pytest.approx(-0.2115616953, abs=1.0 / 400)
    assert solution.omega == pytest.approx(1.482261967364, rel=1e-6)


def test_sliding_the_wrong_way_at_the_run_off_is_no_answer():
    """Stick up to the run-off would need more friction: the belt slides forward there, not as the clip has it."""
    solution = solve_fixed(scene(friction=0.03, x_trans="run-off"), elements=400, throw=False)
    assert solution.status is Status.NOT_ADMISSIBLE
    assert solution.violations[0].startswith("sense of sliding in slip: violated")


def test_frictionless_belt_transmits_no_moment():
    solution = solve_fixed(scene(friction=0.0))
    assert solution.contacts[0].torque == 0.0
    assert np.all(solution.fields.f == 0.0)
    assert [zone.kind for zone in solution.zones] == ["free", "slip", "free"]


BELT = Belt()


@pytest.mark.parametrize(
    ("changed", "factor"),
    [
        (Scene(belt=Belt(youngs_modulus=3e9)), 1.0),
        (Scene(belt=Belt(width=0.7)), 1.0),
        (Scene(transport_rate=12.5), 12.5),
        (
            Scene(
                belt=Belt(length=40.0, thickness=2.0, width=4.0),
                pulleys=(Pulley(radius=28.0, center=(0.0, -23.0)),),
                span=40.0,
            ),
            1 / 40.0,
        ),
    ],
    ids=["modulus", "width", "transport rate", "lengths"],
)
def test_invariance(published, changed, factor):
    assert solve_fixed(changed).omega == pytest.approx(factor * published.omega, rel=1e-10)


def test_mirror_with_reversed_travel_exchanges_the_senses_of_slip():
    right, left = (
        solve_fixed(scene(center=(xc, -0.575), x_trans="run-up", slip=slip)).contacts[0]
        for xc, slip in ((0.03, "forward"), (-0.03, "backward"))
    )
    assert (right.x_up, right.x_off) == pytest.approx((-left.x_off, -left.x_up), abs=1e-8)
    assert right.torque == pytest.approx(-left.torque, rel=1e-8)


@pytest.mark.parametrize("scale", [1e-1, 1e1, 1e2, 1e3, 1e4])
def test_answer_does_not_depend_on_the_penalty(published, scale):
    assert augmented_lagrangian.solve(Scene(), tolerances=Tolerances(penalty_scale=scale)).omega == pytest.approx(
        published.omega, rel=1e-8
    )


@pytest.mark.parametrize("scale", [1e-4, 1e-3, 1e-2])
def test_too_soft_a_penalty_is_no_answer(scale):
    solution = augmented_lagrangian.solve(Scene(), tolerances=Tolerances(penalty_scale=scale))
    assert solution.status is Status.MULTIPLIERS_DIVERGED
    assert "200 updates left" in solution.message


def test_penalties_scale_with_the_stiffness_and_the_mesh():
    one, other = Penalties.of(Scene(), 0.01), Penalties.of(Scene(belt=Belt(youngs_modulus=1e8)), 0.005)
    assert other.relaxed == pytest.approx(2 * one.relaxed)
    assert other.full == pytest.approx(8 * one.full)
    assert other.friction == pytest.approx(2 * one.friction)


def test_warm_start_skips_the_first_phase(published):
    again = solve_fixed(scene(x_trans=0.02), initial=published)
    cold = solve_fixed(scene(x_trans=0.02))
    assert again.omega == pytest.approx(cold.omega, rel=1e-8)
    assert again.iterations < cold.iterations
    skipped = [stage for stage in again.stages if stage.iterations is None]
    assert [stage.name for stage in skipped] == ["relaxed, 50 elements", "relaxed"]
    assert all("initial" in stage.why for stage in skipped)


def test_warm_start_from_another_mesh(published):
    finer = solve_fixed(Scene(), elements=200, initial=published)
    assert finer.omega == pytest.approx(solve_fixed(Scene(), elements=200).omega, rel=1e-8)


def test_transition_outside_contact_names_the_contact_zone():
    with pytest.raises(SceneError, match=r"`pulleys.0.x_trans` must lie in the contact zone \(-0.23.*, 0.23.*\) \[m\]"):
        solve_fixed(scene(x_trans=0.3))


@pytest.mark.parametrize(
    ("drive", "omega", "torque"), [({"omega": 1.48}, 1.48, 772.890001), ({"x_trans": 0.0}, OMEGA, 610.315737)]
)
def test_a_drive_by_speed_or_torque_is_that_by_its_transition(drive, omega, torque):
    by_drive, by_torque = (solve_fixed(scene(**given), elements=400) for given in (drive, {"torque": torque}))
    assert by_drive.omega == pytest.approx(omega, rel=1e-5)
    assert by_drive.contacts[0].torque == pytest.approx(torque, rel=1e-3)
    assert by_torque.omega == pytest.approx(omega, rel=1e-5)
    assert by_torque.contacts[0].torque == pytest.approx(torque, rel=1e-12)


def test_failure_names_its_stage_and_can_be_had_without_an_exception():
    options = {"pc_type": "none"}
    solution = solve_fixed(Scene(), options=options, throw=False)
    assert solution.status is Status.NEWTON_DIVERGED
    assert solution.message.startswith("Stage `relaxed`: SNES stopped with")
    assert not solution.success
    with pytest.raises(SolveError, match="Newton's iteration did not converge"):
        solve_fixed(Scene(), options=options)


@pytest.mark.parametrize("elements", [100, 200])
def test_same_omega_on_any_number_of_ranks(elements):
    together, alone = (solve_fixed(Scene(), elements=elements, comm=comm) for comm in (MPI.COMM_WORLD, MPI.COMM_SELF))
    assert together.omega == pytest.approx(alone.omega, rel=1e-12)
    assert together.contacts[0].torque == pytest.approx(alone.contacts[0].torque, rel=1e-11)
    assert together.fields.sigma == pytest.approx(alone.fields.sigma, abs=1e-15)
    assert together.fields.p == pytest.approx(alone.fields.p, abs=1e-3)
    assert MPI.COMM_WORLD.allgather(together.omega) == [together.omega] * MPI.COMM_WORLD.size


def test_ranks_share_the_large_meshes_only_and_say_so(caplog):
    caplog.set_level(logging.INFO, logger="belt_fenicsx")
    size, count = MPI.COMM_WORLD.size, 150 * MPI.COMM_WORLD.size
    small, large, alone = (
        augmented_lagrangian.solve(Scene(), elements=elements, comm=comm, tolerances=Tolerances(shared=150))
        for elements, comm in ((100, None), (2 * count, None), (2 * count, MPI.COMM_SELF))
    )
    assert [stage.why for stage in small.stages if stage.name == "sharing"] == (
        [f"100 elements are too few for {size} ranks: the first solves all"] if size > 1 else []
    )
    assert "sharing" not in [stage.name for stage in large.stages]
    assert any(stage.name.startswith("sharing, ") for stage in large.stages) == (size > 1)
    # On so many elements, rounding is some 1e-12.
    assert large.omega == pytest.approx(alone.omega, rel=1e-11)
    logged = [record for record in caplog.records if record.getMessage().startswith("100 elements")]
    assert bool(logged) == (MPI.COMM_WORLD.rank == 0)


def test_a_rank_that_solves_alone_forgets_nothing_that_the_others_have():
    first = solve_fixed(Scene(), elements=60)
    if MPI.COMM_WORLD.rank == 0:
        for elements in range(20, 37):
            solve_fixed(Scene(), elements=elements, comm=MPI.COMM_SELF, throw=False)
    assert solve_fixed(Scene(), elements=60).omega == first.omega


def test_an_error_of_the_rank_that_solves_reaches_all(monkeypatch):
    def fails(*_):
        raise ArithmeticError("no solve today")

    monkeypatch.setattr(augmented_lagrangian.Run, "solve", fails)
    with pytest.raises(ArithmeticError, match="no solve today"):
        augmented_lagrangian.solve(Scene(), tolerances=Tolerances(shared=1000))


@pytest.mark.serial
@pytest.mark.parametrize("elements", [378, 976, 991, 1157])
def test_kinks_where_contact_begins_and_ends_do_not_stop_newtons_iteration(elements):
    assert solve_fixed(Scene(), elements=elements).omega == pytest.approx(OMEGA, rel=3e-6)


@pytest.mark.parametrize("elements", [0, -3, 1, 2.5, True, "10", np.float64(100.0)])
def test_elements_that_make_no_mesh(elements):
    with pytest.raises(SceneError, match="`elements` must be a whole number of at least 2"):
        solve_fixed(Scene(), elements=elements)


@pytest.mark.parametrize("elements", [None, np.int64(100)])
def test_whole_numbers_of_any_kind_make_a_mesh(published, elements):
    assert solve_fixed(Scene(), elements=elements).omega == published.omega


def test_more_ranks_than_elements():
    solution = solve_fixed(Scene(), elements=2, throw=False)
    assert len(set(MPI.COMM_WORLD.allgather(solution.message))) == 1
    assert ("sharing" in [stage.name for stage in solution.stages]) == (MPI.COMM_WORLD.size > 2)


def test_pulley_below_the_straight_belt_costs_no_solve():
    below = dataclasses.replace(Scene(), pulleys=(Pulley(center=(0.0, -0.8)),))
    solution = solve(below, throw=False)
    assert solution.status is Status.NO_CONTACT
    assert not solution.success
    assert solution.contacts == ()
    assert [stage.iterations for stage in solution.stages] == [None]
