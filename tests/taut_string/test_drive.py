"""The exact string of any drive: published numbers, invariances, balances, limits, loops at random."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
import pytest
from drives import REFERENCE, drive
from loops import driven, loops, speeder

from belt_fenicsx import Pulley, Scene, SolveError, Status, StiffnessBelt, solve
from belt_fenicsx.taut_string.capacity import capacities
from belt_fenicsx.taut_string.drive import string_drive
from belt_fenicsx.taut_string.standing import BeyondCapacity

pytestmark = pytest.mark.serial

THREAD_MASS = 0.8288 / 0.95  # The published mass counts from a length of which the belt's own is 0.95 times as long.

THIN = ("two-equal", "two-fast", "two-speeds", "thread", "thread-dynamic", "flat-belt", "serpentine", "three-idler")
LOOPS = ("two-fast", "two-unequal", "two-speeds", "flat-belt", "serpentine", "three-idler", "thread-dynamic")


def string(scene, **given):
    return solve(scene, method="string", **given)


def thread(radius=0.1, friction=0.5, line_density=THREAD_MASS, omega=12.0, **torque):
    """The published two-pulley drive."""
    known = drive("thread")
    first, second = (replace(pulley, radius=radius, friction=friction) for pulley in known.pulleys)
    second = replace(second, **torque) if torque else second
    belt = replace(known.belt, line_density=line_density)
    return replace(known, belt=belt, pulleys=(replace(first, omega=omega), second))


def tensions(solution):
    return [span.tension[1] for span in solution.spans]


@pytest.mark.parametrize(
    ("friction", "tight", "slack", "omega"), [(0.5, 663.170, 186.936, 11.3084), (1.0, 654.683, 178.462, 11.30771)]
)
def test_published_thread(friction, tight, slack, omega):
    solution = string(thread(friction=friction))
    assert tensions(solution) == pytest.approx([slack, tight], abs=6e-4)
    assert solution.contacts[1].omega == pytest.approx(omega, abs=6e-6 if friction == 1.0 else 6e-5)
    assert solution.contacts[1].torque == pytest.approx(25.0 + 2.0 * solution.contacts[1].omega, rel=1e-13)


def test_thread_with_inertia():
    solution = string(thread(0.09995, omega=120.0, torque=40.0, drag=0.0))
    assert tensions(solution) == pytest.approx([222.46785, 628.38639], abs=1e-5)
    assert solution.contacts[1].omega / 120.0 == pytest.approx(0.950669, abs=1e-6)


@pytest.mark.parametrize(("omega", "mass", "capacity"), [(120, 1, 41.32352), (12, 1, 57.70540), (12, 0, 57.86794)])
def test_thread_capacity(omega, mass, capacity):
    scene = thread(0.09995, line_density=mass * THREAD_MASS, omega=omega, torque=40.0, drag=0.0)
    solution = string(scene)
    assert [contact.capacity for contact in solution.contacts] == pytest.approx([-capacity, capacity], abs=1e-5)
    beyond = string(driven(scene, 1, torque=1.001 * capacity), throw=False)
    assert beyond.status is Status.CAPACITY_EXCEEDED
    assert f"transmits {capacity:.4f}" in beyond.message and "pulley 1" in beyond.message


@pytest.mark.parametrize("name", THIN)
def test_thin_belts_are_near(name):
    solution, known = string(drive(name)), REFERENCE[name]["answer"]
    assert solution.success
    assert solution.transport_rate == pytest.approx(known["transport_rate"], rel=3e-4)
    largest = max(abs(pulley["torque"]) for pulley in known["pulleys"])
    for contact, pulley in zip(solution.contacts, known["pulleys"], strict=True):
        assert contact.omega == pytest.approx(pulley["omega"], rel=3e-4)
        assert contact.torque == pytest.approx(pulley["torque"], abs=3e-3 * largest)
    for span, other in zip(solution.spans, known["free_spans"], strict=True):
        assert span.tension[1] == pytest.approx(other["tension"][1], rel=0.02)


@pytest.mark.parametrize("name", ["two-equal", "three-idler"])
def test_a_belt_that_hardly_bends_comes_close(name):
    """Tensions differ by what is about proportional to the bending stiffness."""
    scene, apart = drive(name), []
    expected = np.array(tensions(string(scene)))
    for share in (1 / 16, 1 / 64):
        belt = replace(scene.belt, bending_stiffness=share * scene.belt.bending_stiffness)
        bent = solve(replace(scene, belt=belt), method="bvp", rtol=1e-10)
        apart.append(np.array(tensions(bent)) - expected)
    assert np.all(apart[1] / expected < 1e-4)
    np.testing.assert_allclose(apart[0] / apart[1], 4.5, atol=0.5)


def numbers(solution, order=None):
    """What does not depend on where the drive stands."""
    indices = list(order or range(len(solution.contacts)))
    on = [solution.contacts[i] for i in indices]
    return np.array(
        [
            *(
                [contact.omega, contact.torque, contact.wrap_angle, contact.slip_angle, contact.capacity]
                for contact in on
            ),
            *([*solution.spans[i].tension, solution.spans[i].length, solution.transport_rate] for i in indices),
        ]
    ).ravel()


def viewed(scene, turn=0.0, shift=0j, mirrored=False):
    """The drive rotated, moved, or with reversed travel in a mirror, where sides stay as they are seen."""

    def place(center):
        z = complex(*center)
        z = (z.conjugate() if mirrored else z) * np.exp(1j * turn) + shift
        return z.real, z.imag

    other = {"right": "left", "left": "right"}
    return replace(
        scene,
        pulleys=tuple(
            replace(p, center=place(p.center), side=other[p.side] if mirrored else p.side) for p in scene.pulleys
        ),
    )


@pytest.mark.parametrize("name", LOOPS)
@pytest.mark.parametrize(("turn", "shift", "mirrored"), [(0.7, 3 - 2j, False), (-2.5, 0j, True), (math.pi, 1j, False)])
def test_the_place_of_a_drive_does_not_matter(name, turn, shift, mirrored):
    scene = drive(name, gravity=(0.0, 0.0))
    there = string(viewed(scene, turn, shift, mirrored))
    np.testing.assert_allclose(numbers(there), numbers(string(scene)), rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("name", LOOPS)
def test_pulleys_may_be_counted_from_any(name):
    scene, expected = drive(name), numbers(string(drive(name)))
    for first in range(1, len(scene.pulleys)):
        pulleys = (*scene.pulleys[first:], *scene.pulleys[:first])
        order = [(i - first) % len(pulleys) for i in range(len(pulleys))]
        np.testing.assert_allclose(
            numbers(string(replace(scene, pulleys=pulleys)), order), expected, rtol=1e-9, atol=1e-11
        )


def test_mirror_with_reversed_travel_exchanges_the_senses():
    """Sliding all along all pulleys, a belt that runs the other way in a mirror has the same shape and forces."""
    known = drive("open-S")
    none = {"omega": None, "torque": None}
    first, second = (replace(pulley, **none, x_trans="run-up") for pulley in known.pulleys)
    there = [replace(first, slip="forward"), replace(second, slip="backward")]
    other = {"forward": "backward", "backward": "forward"}
    back = [
        replace(p, center=(-p.center[0], p.center[1]), slip=other[p.slip], x_trans="run-up") for p in reversed(there)
    ]
    one, mirrored = (string(replace(known, pulleys=tuple(pulleys))) for pulleys in (there, back))
    assert tensions(mirrored) == pytest.approx(tensions(one)[::-1], rel=1e-12)
    assert [c.torque for c in mirrored.contacts] == pytest.approx(
        [-c.torque for c in reversed(one.contacts)], rel=1e-12
    )


@pytest.mark.parametrize("name", ["flat-belt", "serpentine"])
def test_units_do_not_matter(name):
    scene, length, force, t = drive(name), 3.7, 0.02, 11.0
    belt = scene.belt
    pulleys = tuple(
        replace(
            p,
            radius=length * p.radius,
            center=(length * p.center[0], length * p.center[1]),
            **{"omega": p.omega / t} if p.omega is not None else {},
            **{"torque": p.torque * force * length, "drag": p.drag * force * length * t}
            if p.torque is not None
            else {},
        )
        for p in scene.pulleys
    )
    belt = StiffnessBelt(
        length=length * belt.length,
        bending_stiffness=force * length**2 * belt.bending_stiffness,
        extensional_stiffness=force * belt.extensional_stiffness,
        shear_stiffness=force * belt.shear_stiffness,
        line_density=force * (t / length) ** 2 * belt.line_density,
        rotary_inertia=force * t**2 * belt.rotary_inertia,
    )
    rate = scene.transport_rate and scene.transport_rate * length / t
    other, same = (
        string(replace(scene, belt=belt, pulleys=pulleys, transport_rate=rate, gravity=(0.0, 0.0))),
        string(scene),
    )
    for contact, expected in zip(other.contacts, same.contacts, strict=True):
        assert contact.omega * t == pytest.approx(expected.omega, rel=1e-11)
        assert contact.torque / (force * length) == pytest.approx(expected.torque, rel=1e-9, abs=1e-12)
        assert contact.capacity / (force * length) == pytest.approx(expected.capacity, rel=1e-9)
    assert np.array(tensions(other)) / force == pytest.approx(tensions(same), rel=1e-11)


def test_loops_at_random():
    """All are solved up to their capacity, and none beyond it; power goes into sliding alone."""
    random, seconds = np.random.default_rng(5), []
    for number, scene in enumerate(loops(300, seed=4)):
        lead = speeder(scene)
        others = [i for i in range(len(scene.pulleys)) if i != lead]
        load, part, sign = int(random.choice(others)), random.uniform(0.05, 0.95), random.choice((-1.0, 1.0))
        dimensionless, units = driven(scene, load, torque=sign * 1e-6).dimensionless()
        capacity = capacities(dimensionless, string_drive(dimensionless))[load] * units.of(length=1, force=1)
        assert capacity * sign > 0.0, number
        solution = string(driven(scene, load, torque=part * capacity))
        assert solution.success, number
        through = sum(abs(contact.power) for contact in solution.contacts)
        assert abs(sum(contact.power for contact in solution.contacts) + solution.losses) <= 1e-10 * through, number
        assert solution.contacts[load].capacity == pytest.approx(capacity, rel=1e-9), number
        near = string(driven(scene, load, torque=(1.0 - 1e-7) * capacity))
        wraps = [contact.slip_angle / contact.wrap_angle for contact in near.contacts]
        assert max(wraps[load], wraps[lead]) > 1.0 - 1e-4, number
        beyond = string(driven(scene, load, torque=(1.0 + 1e-7) * capacity), throw=False)
        assert beyond.status is Status.CAPACITY_EXCEEDED, number
        assert any(f"pulley {i}" in beyond.message for i in (load, lead)), number
        dimensionless, _ = driven(scene, load, torque=part * capacity).dimensionless()
        began = time.perf_counter()
        string_drive(dimensionless)
        seconds.append(time.perf_counter() - began)
    assert np.median(seconds) < 2e-3


def with_take_up(scene, index, direction, force, shift=0.0):
    """The scene with a take-up on a pulley, that stands aside by a part of the direction."""
    pulley = scene.pulleys[index]
    center = (pulley.center[0] - shift * direction[0], pulley.center[1] - shift * direction[1])
    pulleys = list(scene.pulleys)
    pulleys[index] = replace(pulley, center=center, take_up=direction, force=force)
    return replace(scene, pulleys=tuple(pulleys))


@pytest.mark.parametrize(
    ("name", "index", "direction"),
    [
        ("two-fast", 1, (2.0, 0.0)),
        ("flat-belt", 0, (-1.0, 0.3)),
        ("serpentine", 1, None),
        ("thread-dynamic", 1, (1.0, 0.1)),
    ],
)
@pytest.mark.parametrize("shift", [0.0, 0.004, -0.004])
def test_take_up_with_the_hub_load_of_a_fixed_drive(name, index, direction, shift):
    scene = drive(name, gravity=(0.0, 0.0))
    fixed = string(scene)
    load = np.array(fixed.contacts[index].hub_force)
    direction = tuple(-load / 100.0) if direction is None else direction
    force = -float(load @ direction) / math.hypot(*direction)
    moved = string(with_take_up(scene, index, direction, force, shift))
    assert moved.contacts[index].take_up == pytest.approx(shift * math.hypot(*direction), abs=1e-10)
    np.testing.assert_allclose(numbers(moved)[: 4 * index], numbers(fixed)[: 4 * index], rtol=1e-8, atol=1e-10)
    assert tensions(moved) == pytest.approx(tensions(fixed), rel=1e-9)


def test_two_take_ups():
    scene = drive("serpentine", gravity=(0.0, 0.0))
    loads = [np.array(contact.hub_force) for contact in string(scene).contacts]
    for index in (1, 3):
        load = loads[index]
        scene = with_take_up(scene, index, tuple(-load / np.hypot(*load)), float(np.hypot(*load)), 2e-3)
    moved = string(scene)
    assert [moved.contacts[i].take_up for i in (1, 3)] == pytest.approx([2e-3, 2e-3], abs=1e-9)


def test_take_up_makes_a_slack_belt_taut():
    scene = drive("two-equal")
    belt = replace(scene.belt, length=1.2 * scene.belt.length)
    pulleys = (scene.pulleys[0], replace(scene.pulleys[1], take_up=(1.0, 0.0), force=3000.0))
    solution = string(replace(scene, belt=belt, pulleys=pulleys))
    assert solution.success
    assert solution.contacts[1].hub_force[0] == pytest.approx(-3000.0, rel=1e-9)
    assert sum(tensions(solution)) == pytest.approx(3000.0, rel=1e-9)


def test_a_second_speed_brakes_until_it_slides():
    """A pulley that turns slowly slides all along, forward; one that turns fast, backward; in between, it sticks."""
    scene = drive("two-equal")
    slow, fast = (string(driven(scene, 1, omega=omega)) for omega in (1.0, 20.0))
    for solution, sense in ((slow, "forward"), (fast, "backward")):
        assert solution.success
        assert [zone.name for zone in solution.contacts[1].zones] == [f"{sense} slip"]
    stopped = string(driven(scene, 1, omega=0.0))
    assert tensions(stopped) == pytest.approx(tensions(slow), rel=1e-12)
    capacity = string(scene).contacts[1].capacity
    assert slow.contacts[1].torque == pytest.approx(capacity, rel=1e-12)
    assert fast.contacts[1].torque == pytest.approx(-capacity, rel=1e-12)


def undriven(scene, index, rate):
    """The scene with a given transport rate, and a pulley that nothing drives."""
    pulley = replace(scene.pulleys[index], omega=None, torque=None)
    return replace(scene, pulleys=(*scene.pulleys[:index], pulley, *scene.pulleys[index + 1 :]), transport_rate=rate)


@pytest.mark.parametrize("name", ["two-fast", "two-unequal", "three-idler", "serpentine"])
def test_equivalent_drives(name):
    """A speed, a torque, the angle that slides or the transport rate: whatever is given, the others follow."""
    scene = drive(name, gravity=(0.0, 0.0))
    expected = string(scene)
    contact = expected.contacts[2 if name == "serpentine" else 1]
    index, sense = contact.pulley, contact.zones[-1].slip
    for given in (
        driven(scene, index, omega=contact.omega),
        driven(scene, index, slip_angle=contact.slip_angle, slip=sense),
        driven(scene, index, torque=0.5 * contact.torque, drag=0.5 * contact.torque / contact.omega),
        undriven(scene, index, expected.transport_rate),
        undriven(scene, 0, expected.transport_rate),
    ):
        other = string(given)
        np.testing.assert_allclose(numbers(other)[:4], numbers(expected)[:4], rtol=1e-8)
        assert tensions(other) == pytest.approx(tensions(expected), rel=1e-9)


def test_nothing_slides_where_nothing_is_driven():
    solution = string(driven(drive("two-fast"), 1, torque=0.0))
    assert [zone.name for zone in solution.zones] == ["stick", "free", "stick", "free"]
    assert [contact.torque for contact in solution.contacts] == [0.0, 0.0]


def test_pulley_without_friction():
    scene = drive("three-idler")
    smooth = [*scene.pulleys[:2], replace(scene.pulleys[2], friction=0.0, torque=0.0)]
    solution = string(replace(scene, pulleys=tuple(smooth)))
    assert solution.contacts[2].torque == 0.0 and math.isnan(solution.contacts[2].capacity)
    smooth[2] = replace(smooth[2], torque=0.1)
    refused = string(replace(scene, pulleys=tuple(smooth)), throw=False)
    assert refused.status is Status.CAPACITY_EXCEEDED


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("turn", [0.0, math.pi])
@pytest.mark.parametrize("place", [-0.05, 0.0, 0.08])
def test_transition_between_clamps(side, turn, place):
    """It lies at its place on a pulley on either side, whichever way the belt travels."""
    sign, way = (1.0 if side == "right" else -1.0), math.cos(turn)
    pulley = Pulley(radius=0.7, center=(0.0, -0.575 * sign * way), side=side, x_trans=place)
    scene = Scene(pulleys=(pulley,), clamps=((-0.5 * way, 0.0, turn), (0.5 * way, 0.0, turn)))
    solution = string(scene)
    assert solution.contacts[0].x_trans == pytest.approx(place, abs=1e-12)
    rest = string(Scene(pulleys=(Pulley(x_trans=place * way),)))
    assert solution.contacts[0].torque == pytest.approx(rest.contacts[0].torque, rel=1e-12)


def test_published_scene():
    assert string(Scene()).contacts[0].omega == pytest.approx(1.47806, abs=1e-5)


@pytest.mark.parametrize("name", ["two-fast", "flat-belt", "open-S", "chapter-surface"])
def test_parts_are_exact(name):
    """Fractions of the length lead from end to end, with D = dr/dsigma and the law of friction in between."""
    scene, _ = drive(name).dimensionless()
    found, step = string_drive(scene), 1e-6
    assert sum(part.length for part in found.parts) == pytest.approx(1.0, abs=1e-13)
    for part in found.parts:
        x, y, phi, D = part.at(np.array([0.0, 1.0]))
        assert [*x, *y] == pytest.approx([part.start[0], part.end[0], part.start[1], part.end[1]], abs=1e-13)
        assert [*phi, *D] == pytest.approx([*part.angles, *part.stretches], abs=1e-12)
        x, y, phi, D = part.at(np.array([0.3, 0.3 + step]))
        length = np.hypot(x[1] - x[0], y[1] - y[0])
        assert length == pytest.approx(step * part.length * D.mean(), rel=1e-7)
        b1, shifted = part.stiffnesses
        F = shifted * D - b1
        assert np.log(F[1] / F[0]) == pytest.approx(part.rate * abs(phi[1] - phi[0]), abs=1e-12)


def test_speed_of_a_touching_fibre():
    """It is shorter than the middle line by R / (R + e), and has the pulley's speed where it sticks."""
    scene = drive("two-equal")
    belt = replace(scene.belt, contact_offset=0.005)
    solution = string(replace(scene, belt=belt))
    contact, (slack, tight) = solution.contacts[0], tensions(solution)
    assert solution.success
    assert contact.omega * 0.105 == pytest.approx(solution.spans[-1].speed, rel=1e-12)
    assert contact.torque == pytest.approx(0.105 * (slack - tight), rel=1e-12)
    assert contact.slip_angle == pytest.approx(math.log(tight / slack) / 0.5 * 0.105 / 0.1, rel=1e-9)


def test_slack_as_fast_as_it_runs():
    scene = drive("two-equal")
    belt = replace(scene.belt, line_density=1.0)
    with pytest.raises(SolveError, match="slack, as fast as it runs"):
        string(replace(driven(scene, 0, omega=4000.0), belt=belt))


def test_where_another_pulley_slides_first():
    """The smaller pulley slides before the larger one, whose capacity is what it has then."""
    solution = string(drive("two-unequal"))
    small, large = (abs(contact.capacity) for contact in solution.contacts)
    assert large / small == pytest.approx(0.12 / 0.06, rel=1e-9)
    scene, _ = driven(drive("two-unequal"), 1, torque=1.001 * large).dimensionless()
    with pytest.raises(BeyondCapacity) as beyond:
        string_drive(scene)
    assert (beyond.value.pulley, beyond.value.sense) == (0, "backward")


def test_much_friction():
    """The less of the belt slides; sliding all along would leave nothing of the force at one end."""
    scene = drive("two-equal")
    grips = [replace(pulley, friction=1e4) for pulley in scene.pulleys]
    solution = string(replace(scene, pulleys=tuple(grips)))
    assert solution.success
    assert 0.0 < solution.contacts[1].slip_angle < 1e-3
    grips[1] = replace(grips[1], torque=None, slip_angle=0.5)
    with pytest.raises(SolveError, match="slack"):
        string(replace(scene, pulleys=tuple(grips)))
