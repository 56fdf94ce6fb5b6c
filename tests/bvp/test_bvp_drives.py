"""The boundary-value problem of any drive: reference answers, limits, invariances, loops that were hard."""

import itertools
import math
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import NAMES, REFERENCE, differences, drive, senses

from belt_fenicsx import bvp, solve
from belt_fenicsx.bvp.reading import known_ends
from belt_fenicsx.scene.belt import Belt
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.status import Status

pytestmark = pytest.mark.serial


@pytest.fixture(scope="module")
def solved():
    """Reference drives, each solved once."""
    known = {}

    def solve(name):
        if name not in known:
            known[name] = bvp.solve(drive(name), rtol=1e-10)
        return known[name]

    return solve


@pytest.mark.parametrize("name", NAMES)
def test_reference(name, solved):
    solution = solved(name)
    assert [[zone.slip for zone in contact.zones] for contact in solution.contacts] == [
        senses(name, index) for index in range(len(solution.contacts))
    ]
    for what, difference in differences(name, solution).items():
        assert abs(difference) < 1e-8, what
    assert solution.error_estimate < 1e-10


@pytest.mark.parametrize(("name", "index"), [("serpentine", 1), ("serpentine", 3), ("serpentine-stiff", 3)])
def test_a_free_idler_has_no_torque(name, index, solved):
    solution = solved(name)
    friction, radius = solution.scene.pulleys[index].friction, solution.scene.pulleys[index].radius
    fields, zones = solution.fields, [i for i, zone in enumerate(solution.zones) if zone.pulley == index]
    on = np.isin(fields.zone, zones)
    assert abs(solution.contacts[index].torque) < 1e-9 * friction * radius * (fields.weight[on] @ fields.p[on])


@pytest.mark.parametrize(
    "name", ["two-fast", "two-gravity", "three-idler", "thread-dynamic", "open-S", "chapter-surface"]
)
def test_balances(name, solved):
    """Power is lost by sliding alone, and loads on the hubs hold the weight, to rounding of the quadrature."""
    solution = solved(name)
    if solution.scene.closed:
        through = sum(abs(contact.power) for contact in solution.contacts)
        assert sum(contact.power for contact in solution.contacts) == pytest.approx(
            -solution.losses, abs=1e-10 * through
        )
        weight = np.array(solution.scene.gravity) * solution.scene.belt.line_density * solution.scene.belt.length
        hubs = np.sum([contact.hub_force for contact in solution.contacts], axis=0)
        np.testing.assert_allclose(hubs, weight, atol=1e-9 * max(span.tension[1] for span in solution.spans))
    assert solution.losses == pytest.approx(
        solution.fields.weight @ np.abs(solution.fields.f * solution.fields.v_rel), rel=1e-12
    )
    assert 0.0 < solution.efficiency < 1.0 or not solution.scene.closed


def turned(scene, angle, shift):
    """The whole drive rotated and moved."""
    c, s = math.cos(angle), math.sin(angle)

    def place(x, y):
        return c * x - s * y + shift[0], s * x + c * y + shift[1]

    pulleys = tuple(replace(p, center=place(*p.center), x_trans=None) for p in scene.pulleys)
    gravity = (c * scene.gravity[0] - s * scene.gravity[1], s * scene.gravity[0] + c * scene.gravity[1])
    return replace(scene, pulleys=pulleys, gravity=gravity)


def numbers(solution, order=None):
    """What does not depend on where a drive stands: speeds, torques, wraps, and tensions."""
    indices = order or range(len(solution.contacts))
    return [
        value
        for i in indices
        for contact, span in [(solution.contacts[i], solution.spans[i])]
        for value in (contact.omega, contact.torque, contact.wrap_angle, *span.tension, span.sag)
    ]


@pytest.mark.parametrize("name", ["two-gravity", "three-idler", "serpentine"])
def test_rotation_and_translation(name, solved):
    moved = bvp.solve(turned(drive(name), 1.1, (0.3, -2.0)), rtol=1e-10)
    np.testing.assert_allclose(numbers(moved), numbers(solved(name)), rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", ["two-gravity", "three-idler", "serpentine"])
def test_cyclic_renumbering(name, solved):
    scene = drive(name)
    count = len(scene.pulleys)
    shifted = bvp.solve(replace(scene, pulleys=scene.pulleys[1:] + scene.pulleys[:1]), rtol=1e-10)
    order = [(i - 1) % count for i in range(count)]
    np.testing.assert_allclose(numbers(shifted, order), numbers(solved(name)), rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", ["two-unequal", "three-idler"])
def test_mirror_image(name, solved):
    """In a mirror, pulleys are on the other side of the belt; nothing else changes."""
    scene = drive(name)
    sides = {"right": "left", "left": "right"}
    mirrored = tuple(replace(p, center=(p.center[0], -p.center[1]), side=sides[p.side]) for p in scene.pulleys)
    image = bvp.solve(replace(scene, pulleys=mirrored), rtol=1e-10)
    np.testing.assert_allclose(numbers(image), numbers(solved(name)), rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", ["two-speeds", "two-entry-slip"])
def test_reversed_travel(name, solved):
    """Travelling the other way, driving pulleys are driven: senses of sliding and torques change their signs."""
    scene, forth = drive(name), solved(name)
    sides = {"right": "left", "left": "right"}
    backwards = [
        replace(p, side=sides[p.side], torque=None, omega=contact.omega)
        for p, contact in zip(scene.pulleys, forth.contacts, strict=True)
    ]
    # With all speeds as they were, the loop runs the same way on the other side of each pulley.
    back = bvp.solve(replace(scene, pulleys=(backwards[0], *reversed(backwards[1:]))), rtol=1e-10)
    assert [c.torque for c in back.contacts] == pytest.approx([c.torque for c in forth.contacts], rel=1e-6)


@pytest.mark.parametrize(
    ("length", "force", "time"), [(1e3, 1.0, 1.0), (1.0, 1e-3, 1.0), (1.0, 1.0, 60.0), (25.4, 4.45, 1e-3)]
)
def test_units(length, force, time, solved):
    """An answer in other units is the same one."""
    scene, known = drive("thread-dynamic"), solved("thread-dynamic")
    belt = scene.belt
    other = replace(
        belt,
        length=belt.length * length,
        bending_stiffness=belt.bending_stiffness * force * length**2,
        extensional_stiffness=belt.extensional_stiffness * force,
        shear_stiffness=belt.shear_stiffness * force,
        line_density=belt.line_density * force * (time / length) ** 2,
    )
    first, last = (
        replace(p, radius=p.radius * length, center=(p.center[0] * length, p.center[1] * length)) for p in scene.pulleys
    )
    pulleys = (
        replace(first, omega=first.omega / time),
        replace(last, torque=last.torque * force * length, drag=last.drag * force * length * time),
    )
    gravity = (0.0, scene.gravity[1] * length / time**2)
    solution = bvp.solve(replace(scene, belt=other, pulleys=pulleys, gravity=gravity), rtol=1e-10)
    assert solution.transport_rate * time / length == pytest.approx(known.transport_rate, rel=1e-9)
    for one, two in zip(solution.contacts, known.contacts, strict=True):
        assert one.omega * time == pytest.approx(two.omega, rel=1e-9)
        assert one.torque / (force * length) == pytest.approx(two.torque, rel=1e-9)


@pytest.mark.parametrize("more", [{}, {"gravity": (0.0, -9.81)}], ids=["plain", "gravity"])
def test_a_take_up_with_the_hub_load_of_a_fixed_pulley_stays_there(more):
    scene = drive("two-gravity", **more)
    fixed = bvp.solve(scene, rtol=1e-10)
    direction, load = np.array([0.6, 0.8]), np.array(fixed.contacts[1].hub_force)
    pushed = replace(scene.pulleys[1], take_up=(3.0, 4.0), force=float(-direction @ load))
    if float(-direction @ load) <= 0.0:
        pytest.fail("the take-up has to be pushed")
    taken = bvp.solve(replace(scene, pulleys=(scene.pulleys[0], pushed)), rtol=1e-10)
    assert taken.contacts[1].take_up == pytest.approx(0.0, abs=1e-10)
    assert taken.contacts[1].center == pytest.approx(scene.pulleys[1].center, abs=1e-10)
    assert taken.transport_rate == pytest.approx(fixed.transport_rate, rel=1e-10)


@pytest.mark.parametrize("force", [2000.0, 4000.0])
def test_a_take_up_holds_its_force(force):
    scene = drive("two-equal")
    pushed = replace(scene.pulleys[1], take_up=(1.0, 0.0), force=force)
    solution = bvp.solve(replace(scene, pulleys=(scene.pulleys[0], pushed)), rtol=1e-10)
    assert solution.contacts[1].hub_force[0] == pytest.approx(-force, rel=1e-10)
    assert np.sign(solution.contacts[1].take_up) == np.sign(force - 3020.7669353621573)
    assert solution.contacts[1].center[0] == pytest.approx(0.4 + solution.contacts[1].take_up)


def test_slip_angle_says_the_same_as_the_torque_it_leads_to(solved):
    known = solved("two-equal")
    scene = drive("two-equal")
    by_angle = replace(
        scene.pulleys[1], torque=None, slip_angle=known.contacts[1].slip_angle, slip=known.contacts[1].zones[-1].slip
    )
    solution = bvp.solve(replace(scene, pulleys=(scene.pulleys[0], by_angle)), rtol=1e-10)
    assert solution.contacts[1].torque == pytest.approx(20.0, rel=1e-8)


def test_a_given_transport_rate_leaves_one_pulley_without_a_drive(solved):
    known, scene = solved("two-fast"), drive("two-fast")
    pulleys = (replace(scene.pulleys[0], omega=None), scene.pulleys[1])
    rate = REFERENCE["two-fast"]["answer"]["transport_rate"]
    solution = bvp.solve(replace(scene, pulleys=pulleys, transport_rate=rate), rtol=1e-10)
    assert [c.omega for c in solution.contacts] == pytest.approx([c.omega for c in known.contacts], rel=1e-9)
    assert solution.contacts[0].torque == pytest.approx(known.contacts[0].torque, rel=1e-8)


@pytest.mark.parametrize("name", ["two-gravity", "open-S"])
def test_a_stress_free_curvature_changes_the_bending_moment_alone(name, solved):
    scene, plain = drive(name), solved(name)
    curved = bvp.solve(replace(scene, belt=replace(scene.belt, curvature=-3.0)), rtol=1e-10)
    assert curved.success
    moment = curved.fields.M - plain.fields.M
    np.testing.assert_allclose(moment, 3.0 * scene.belt.bending_stiffness, rtol=1e-8)
    np.testing.assert_allclose(numbers(curved), numbers(plain), rtol=1e-12)
    np.testing.assert_allclose(curved.fields.kappa, plain.fields.kappa, rtol=1e-9, atol=1e-9)


def test_euler_bernoulli_limit_where_a_belt_leaves_a_pulley():
    """Without shear, the force F of a span turns by acos(1 - a / (2 F R^2)) where the belt leaves a pulley.

    The tension on the pulley is F - a / (2 R^2), and its pressure has a line force F sin(angle) there.
    """
    scene, a, R, missed = drive("thread"), 0.05, 0.1, []
    for stiffer in (1.0, 10.0, 100.0):
        belt = replace(scene.belt, shear_stiffness=stiffer * scene.belt.shear_stiffness, bending_stiffness=a)
        solution = bvp.solve(replace(scene, belt=belt), rtol=1e-10)
        fields, contact = solution.fields, solution.contacts[0]
        # The last span runs up to the first pulley, on which the belt first sticks.
        before = fields.zone == len(solution.zones) - 1
        force = (fields.Q[before, 0] + 1j * fields.Q[before, 1]) * np.exp(1j * fields.theta[before])
        F = abs(force[0])
        angle = math.acos(1.0 - a / (2.0 * F * R**2))
        on = np.flatnonzero(fields.zone == 0)
        middle, near = on[on.size // 2], on[: on.size // 2]
        line_force = fields.weight[near] @ (fields.p[near] - fields.p[middle])
        turn = abs(math.remainder(contact.angle_up - float(np.angle(force[0])), 2.0 * math.pi))
        missed.append(
            (
                turn / angle - 1.0,
                (F - fields.Q[middle, 0]) / (a / (2.0 * R**2)) - 1.0,
                line_force / (F * math.sin(angle)) - 1.0,
            )
        )
    sizes = np.abs(missed)
    assert np.all(sizes[1] < 0.6 * sizes[0]) and np.all(sizes[2] < 0.2 * sizes[1])
    assert np.all(sizes[2] < 2e-2)


@pytest.mark.parametrize("smooth", [0.0, 0.4], ids=["smooth", "rough"])
def test_a_loop_without_loads_only_turns(smooth):
    """Idlers alone, one of them without friction: the drive has nothing to do but to make up for what sliding takes."""
    scene = drive("serpentine")
    pulleys = [replace(p, torque=0.0) if p.torque is not None else p for p in scene.pulleys]
    pulleys[1] = replace(pulleys[1], friction=smooth)
    solution = bvp.solve(replace(scene, pulleys=tuple(pulleys)), throw=False)
    assert solution.success, solution.message
    largest = max(span.tension[1] for span in solution.spans) * scene.pulleys[0].radius
    assert max(abs(contact.torque) for contact in solution.contacts) < 1e-6 * largest


@pytest.mark.parametrize(("missed", "last"), [(2e-11, 0.0), (2e-12, -1.3e-11)])
def test_a_part_that_is_negative_by_what_an_iteration_leaves_is_a_point(missed, last):
    state = bvp.solve(drive("two-equal")).state
    lengths = state.discrete.values.lengths.copy()
    lengths[1] = -1.3e-11
    discrete = replace(state.discrete, values=replace(state.discrete.values, lengths=lengths), missed=missed)
    assert np.diff(known_ends(discrete))[1] == pytest.approx(last, abs=1e-15)


@pytest.mark.parametrize("method", ["fitted", "bvp"])
def test_speeds_that_are_too_far_apart(method):
    scene = drive("two-equal")
    apart = replace(scene, pulleys=(scene.pulleys[0], scene.pulleys[1].driven(omega=9.0)))
    solution = solve(apart, method=method, throw=False)
    assert solution.status is Status.CAPACITY_EXCEEDED
    assert "nothing says how fast it runs" in solution.message


def test_growth_of_a_chain_of_pulleys_leaves_the_iterations(solved):
    """Rings of ever more pulleys take no more Newton iterations."""
    counts = []
    for count in (2, 4, 8):
        pulleys = tuple(
            Pulley(
                radius=0.05,
                center=(
                    0.06 * count * math.cos(2.0 * math.pi * i / count),
                    -0.06 * count * math.sin(2.0 * math.pi * i / count),
                ),
                friction=0.5,
                **({"omega": 10.0} if i == 0 else {"torque": (4.0 if i % 2 else -2.0) / count}),
            )
            for i in range(count)
        )
        belt = Belt(youngs_modulus=5e7, thickness=0.003, width=0.03)
        counts.append(bvp.solve(Scene(belt=belt, pulleys=pulleys, closed=True, elongation=0.03)).iterations)
    assert max(counts) <= min(counts) + 3


def test_a_torque_beyond_capacity_names_the_pulley_and_what_it_transmits():
    scene = drive("two-equal")
    weaker = tuple(replace(pulley, friction=0.2) for pulley in scene.pulleys)
    for torque, status in ((92.4, Status.SOLVED), (92.5, Status.CAPACITY_EXCEEDED), (300.0, Status.CAPACITY_EXCEEDED)):
        loaded = replace(scene, pulleys=(weaker[0], replace(weaker[1], torque=torque)))
        solution = bvp.solve(loaded, throw=False)
        assert solution.status is status
        if status is Status.CAPACITY_EXCEEDED:
            assert "92.417" in solution.message and "pulley" in solution.message


@pytest.fixture(scope="module")
def loops():
    studies = Path(__file__).parents[2] / "demos/studies"
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(studies))
        return runpy.run_path(str(studies / "stress_drives.py"))["loops"]


@pytest.mark.parametrize(
    ("seed", "number"),
    [(3, 46), (3, 45), (1, 39), (4, 5), (1, 17), (7, 9)],
    ids=["sliding that turns back in next to nothing"] * 2
    + ["sliding in both senses all along an idler", "creep that alternates", "creep that is too narrow"]
    + ["a contact so short that creep finds it negative"],
)
def test_loops_of_which_the_string_tells_too_little(seed, number, loops):
    scene = next(itertools.islice(loops(number + 1, seed), number, None))
    assert bvp.solve(scene, throw=False).status is Status.SOLVED
