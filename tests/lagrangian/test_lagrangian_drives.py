"""The augmented-Lagrangian method on general drives: reference numbers, all kinds of drives, ranks, what it says."""

import functools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import REFERENCE, apart, differences, drive
from launched import told
from mpi4py import MPI

from belt_fenicsx import Pulley, Scene, SceneError, Status, solve
from belt_fenicsx.lagrangian.friction import Points, friction_on
from belt_fenicsx.lagrangian.mesh import unit_cells
from belt_fenicsx.lagrangian.taut import TautBelt

solve_fixed = functools.partial(solve, method="augmented-lagrangian")

ELEMENTS = 800
# Speeds are known to the first number, relative; torques to the second, relative to the largest.
RESOLVED = {
    "two-equal": (1e-5, 1e-4),
    "two-fast": (1e-5, 1e-4),
    "two-gravity": (1e-5, 1e-4),
    "two-slack": (1e-5, 1e-4),
    "two-speeds": (1e-5, 1e-3),
    "two-unequal": (2e-5, 1e-4),
    "two-entry-slip": (1e-5, 1e-3),
    "three-idler": (1e-5, 1e-4),
    "thread": (1e-5, 1e-4),
    "thread-dynamic": (1e-5, 1e-4),
    "flat-belt": (1e-5, 1e-4),
    "serpentine": (1e-5, 1e-4),
    "open-S": (1e-5, 1e-3),
    "chapter-fast": (1e-5, 1e-3),
    "chapter-gravity": (1e-5, 1e-3),
    "chapter-fast-gravity": (1e-5, 1e-3),
    "chapter-surface": (1e-5, 1e-3),
    "chapter-surface-mu06": (1e-5, 1e-3),
}


@functools.cache
def solved(name, elements=ELEMENTS):
    return solve_fixed(drive(name), elements=elements)


def test_every_reference_drive_is_solved():
    assert set(RESOLVED) >= set(REFERENCE) - {"serpentine-stiff"}


@pytest.mark.parametrize("name", RESOLVED)
def test_reference_numbers(name):
    solution, (speed, torque) = solved(name), RESOLVED[name]
    found = differences(name, solution)
    assert solution.status is Status.SOLVED
    assert max(abs(value) for key, value in found.items() if key.startswith(("transport", "omega"))) < speed
    assert max(abs(value) for key, value in found.items() if key.startswith("torque")) < torque
    assert max(abs(value) for key, value in found.items() if key.startswith("length of zone")) < 1.0 / ELEMENTS
    # In the middles of the spans; their ends lie in elements that are part in contact.
    assert max(abs(value) for key, value in found.items() if key.startswith("tension 1")) < 5e-4
    assert solution.measures["penetration"] < 1e-9
    assert solution.measures["multiplier_change"] < 1e-5


@pytest.mark.parametrize("name", ["two-equal", "two-fast", "two-unequal"])
def test_errors_fall_with_the_elements(name):
    rates = [abs(differences(name, solved(name, elements))["transport rate"]) for elements in (400, 1600, 6400)]
    # By the first order, with jumps: where contact begins is known to a part of an element.
    assert rates[2] < rates[0] / 3.0


@pytest.mark.parametrize("name", ["two-equal", "two-fast", "two-gravity", "two-unequal", "open-S", "chapter-surface"])
def test_few_newton_iterations_in_each_update(name, caplog):
    caplog.set_level("INFO", logger="belt_fenicsx")
    solve_fixed(drive(name), elements=400)
    updates = [record for record in caplog.records if "Newton iterations" in record.msg]
    if MPI.COMM_WORLD.rank == 0:
        assert updates
        assert max(record.args[2] for record in updates) < 5


# Those of two pulleys between which torque goes, and those whose sliding is given; loaded and not.
SHARED = (
    "two-equal", "two-fast", "two-gravity", "two-unequal",
    "open-S", "chapter-fast", "chapter-gravity", "chapter-surface",
)  # fmt: skip


@pytest.mark.parametrize("name", SHARED)
def test_same_speeds_and_torques_on_any_number_of_ranks(name):
    alone = solve_fixed(drive(name), elements=ELEMENTS, comm=MPI.COMM_SELF)
    assert apart(solved(name), alone) < 1e-11


@pytest.mark.serial
def test_same_speeds_and_torques_on_three_ranks():
    code = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parents[1])!r})
from drives import apart, drive
from belt_fenicsx.lagrangian import method
from belt_fenicsx.lagrangian.tolerances import Tolerances
for name in {SHARED}:
    shared, alone = (
        method.solve(drive(name), elements={ELEMENTS}, comm=comm, tolerances=Tolerances(shared=1))
        for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)
    )
    tell(name, apart(shared, alone) < 1e-11)
"""
    assert told(code, ranks=3) == [f"rank {rank}: {name} True" for rank in range(3) for name in SHARED]


def test_a_ring_has_as_many_nodes_as_cells():
    ring, cells = unit_cells(24, MPI.COMM_WORLD, closed=True)
    assert MPI.COMM_WORLD.allreduce(len(cells)) == 24
    assert ring.topology.index_map(0).size_global == 24
    if MPI.COMM_WORLD.size > 1:
        with pytest.raises(SceneError, match="`elements` must be at least .*, 2 for each rank"):
            unit_cells(2 * MPI.COMM_WORLD.size - 1, MPI.COMM_WORLD, closed=True)


def test_torque_and_speed_are_met_exactly():
    motor, load = solved("two-equal").contacts
    assert motor.omega == 10.0
    assert load.torque == pytest.approx(20.0, rel=1e-12)


@pytest.mark.parametrize("name", ["two-equal", "three-idler", "two-fast"])
def test_a_loop_ends_where_it_begins(name):
    fields = solved(name).fields
    assert fields.r[-1] == pytest.approx(fields.r[0], abs=1e-12)
    assert fields.theta[-1] - fields.theta[0] == pytest.approx(-2.0 * math.pi, abs=1e-12)
    assert np.all(np.diff(fields.sigma) >= 0.0)
    assert np.sum(fields.weight) == pytest.approx(drive(name).belt.length, rel=1e-12)


def load(**driven):
    return Pulley(radius=0.1, center=(0.4, 0.0), friction=0.5, **driven)


@pytest.mark.parametrize(
    ("other", "rate"),
    [
        ({"torque": 20.0}, None),
        ({"torque": 15.0, "drag": 5.0 / 9.96113908276}, None),
        ({"omega": 9.96113908276}, None),
        ({"slip_angle": 0.1361974}, None),
    ],
)
def test_equivalent_drives(other, rate):
    scene = drive("two-equal", pulleys=(drive("two-equal").pulleys[0], load(slip=None, **other)), transport_rate=rate)
    found = differences("two-equal", solve_fixed(scene, elements=ELEMENTS))
    assert abs(found["transport rate"]) < 1e-4
    assert abs(found["omega 1"]) < 1e-4
    assert abs(found["torque 1"]) < (0.02 if "slip_angle" in other else 2e-3)


def test_a_given_transport_rate_leaves_one_pulley_without_a_drive():
    motor = replace(drive("two-equal").pulleys[0], omega=None)
    rate = REFERENCE["two-equal"]["answer"]["transport_rate"]
    solution = solve_fixed(drive("two-equal", pulleys=(motor, load(torque=20.0)), transport_rate=rate), elements=400)
    assert solution.transport_rate == rate
    assert solution.contacts[0].omega == pytest.approx(10.0, rel=1e-4)


def test_a_free_idler_sticks_all_along():
    solution = solve_fixed(drive("two-equal", pulleys=(drive("two-equal").pulleys[0], load(torque=0.0))), elements=400)
    assert solution.status is Status.SOLVED
    assert [[zone.name for zone in contact.zones] for contact in solution.contacts] == [["stick"], ["stick"]]
    assert solution.losses < 1e-2


def test_from_another_solution_and_on_given_nodes():
    scene, known = drive("two-equal"), solved("two-equal")
    half = scene.belt.length / 2.0
    for given in ({"elements": 600, "initial": known}, {"mesh": np.linspace(-half, half, 601)}):
        solution = solve_fixed(scene, **given)
        assert solution.status is Status.SOLVED
        assert abs(differences("two-equal", solution)["transport rate"]) < 2e-5
    collocated = solve(scene, method="bvp")
    assert solve_fixed(scene, elements=600, initial=collocated).transport_rate == pytest.approx(
        collocated.transport_rate, rel=2e-5
    )


@pytest.mark.parametrize(("omega", "torque"), [(1.47, 1162.868190), (1.4775, 1162.868190), (1.49, -1162.868190)])
def test_a_pulley_whose_speed_is_beyond_all_stick_slides_all_along(omega, torque):
    (contact,) = solve_fixed(Scene(pulleys=(Pulley(omega=omega),)), elements=400).contacts
    assert [zone.kind for zone in contact.zones] == ["slip"]
    assert contact.omega == omega
    assert contact.torque == pytest.approx(torque, rel=1e-4)


@pytest.mark.parametrize(
    "driven", [{"friction": 0.0}, {"x_trans": "run-off"}, {"x_trans": "run-up", "slip": "backward"}]
)
def test_a_heavy_belt_that_sticks_or_slides_all_along(driven):
    scene = drive("chapter-gravity", pulleys=(Pulley(**driven),))
    solution, expected = solve_fixed(scene, elements=400), solve(scene, method="bvp")
    assert solution.omega == pytest.approx(expected.omega, rel=1e-5)
    assert solution.contacts[0].torque == pytest.approx(expected.contacts[0].torque, abs=0.1)


def test_a_third_pulley_of_a_loop_may_slide_all_along():
    scene = drive("three-idler")
    *others, last = scene.pulleys
    scene = replace(scene, pulleys=(*others, replace(last, torque=None, omega=26.0)))
    solution, expected = solve_fixed(scene), solve(scene, method="bvp")
    assert [zone.name for zone in solution.contacts[2].zones] == ["backward slip"]
    assert solution.transport_rate == pytest.approx(expected.transport_rate, rel=1e-5)
    for one, other in zip(solution.contacts, expected.contacts, strict=True):
        assert one.torque == pytest.approx(other.torque, abs=2e-3)


def test_more_torque_than_friction_transmits():
    scene = drive("two-equal", pulleys=(drive("two-equal").pulleys[0], load(torque=400.0)))
    solution = solve_fixed(scene, elements=400, throw=False)
    assert solution.status is Status.CAPACITY_EXCEEDED
    assert "slides all along pulley" in solution.message


def test_a_contact_of_few_elements_names_the_number_that_would_do():
    solution = solve_fixed(drive("serpentine"), elements=100, throw=False)
    assert not solution.success
    assert "elements" in solution.message


@pytest.mark.parametrize("force", [2000.0, 4000.0])
def test_a_take_up_holds_its_force(force):
    scene = drive("two-equal")
    pulleys = (scene.pulleys[0], replace(scene.pulleys[1], take_up=(1.0, 0.0), force=force))
    solution, reference = (
        solve(drive("two-equal", pulleys=pulleys), method=method, rtol=rtol)
        for method, rtol in (("augmented-lagrangian", 1e-8), ("bvp", 1e-10))
    )
    contact, other = solution.contacts[1], reference.contacts[1]
    tension = max(span.tension[1] for span in reference.spans)
    assert contact.hub_force[0] == pytest.approx(-force, abs=6.5e-4 * tension)
    assert contact.take_up == pytest.approx(other.take_up, rel=1e-3)
    assert contact.center == pytest.approx(other.center, abs=1e-5)
    assert contact.omega == pytest.approx(other.omega, rel=1e-4)
    assert solution.scene.pulleys[1].take_up == (1.0, 0.0)
    assert any(check.name == "force of the take-up" and check.holds for check in solution.checks)


def test_a_take_up_beyond_what_the_mesh_can_do_says_why():
    """Too few elements, and a force with which not even the string has its torque."""
    scene = drive("two-equal")
    for force, elements, said in ((2000.0, 30, "elements"), (1.0, 60, "places of the take-ups were not found")):
        pulleys = (scene.pulleys[0], replace(scene.pulleys[1], take_up=(1.0, 0.0), force=force))
        solution = solve_fixed(drive("two-equal", pulleys=pulleys), elements=elements, throw=False)
        assert not solution.success and said in solution.message


def points(p, trial):
    p, trial, cells = (np.outer(values, [1.0, 1.0]) for values in (p, trial, np.ones(len(p))))
    sigma = np.arange(len(p))[:, np.newaxis] + np.array([0.2, 0.8])
    edges = np.arange(2 * len(p) + 1) / 2.0
    return Points(
        sigma, cells / 2.0, edges, x=sigma, g=0.0 * p, stretch=1.03 * cells, level=1.03 * cells, p=p, trial=trial
    )


@pytest.mark.parametrize("growth", [-3.1, -1.0, -0.2, 0.0, 0.3, 2.2])
def test_sliding_gives_the_force_that_is_asked_for(growth):
    at = points(p=[0.0, 4.0, 8.0, 4.0, 0.0], trial=[0.0, -0.4, 0.1, 0.3, 0.0])
    friction = friction_on(Pulley(friction=0.25), at, growth)
    assert friction.growth == pytest.approx(growth, abs=1e-14)
    assert friction.shortfall == 0.0
    assert np.all(np.abs(friction.f) <= 0.25 * at.p + 1e-15)
    # What slides is what lies before the run-off.
    assert np.all(np.diff(friction.share.ravel()[2:8]) >= 0.0)


def test_friction_falls_short_of_what_is_beyond_its_bound():
    at = points(p=[4.0, 8.0, 4.0], trial=[0.0, 0.0, 0.0])
    assert friction_on(Pulley(friction=0.25), at, 5.0).shortfall == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["two-equal", "serpentine", "open-S"])
def test_the_taut_belt_is_a_path(name):
    scene, _ = drive(name).dimensionless()
    taut = TautBelt.of(scene)
    sigma = np.linspace(-0.5, 0.5, 20_001)
    values, slopes = taut.state(sigma)
    assert np.hypot(slopes[:, 0], slopes[:, 1]) == pytest.approx(taut.stretch, rel=1e-13)
    middle = (values[1:, :2] - values[:-1, :2]) / np.diff(sigma)[:, None]
    assert np.max(np.abs(middle - (slopes[1:, :2] + slopes[:-1, :2]) / 2.0)) < 1e-3
    if scene.closed:
        assert values[-1, :2] == pytest.approx(values[0, :2], abs=1e-13)
        assert values[-1, 2] - values[0, 2] == pytest.approx(taut.winding)
    nodes = taut.nodes(scene, 100)
    assert nodes[[0, -1]].tolist() == [-0.5, 0.5]
    assert np.all(np.diff(nodes) > 0.0)
