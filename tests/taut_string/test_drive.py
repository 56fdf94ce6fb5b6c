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
from belt_fenicsx.scene.path import taut_path
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.taut_string.drive import BeyondCapacity, capacities, string_drive

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


def test_a_belt_that_hardly_bends_comes_close():
    """A quarter of the bending changes a quarter as much."""
    scene, apart = drive("two-equal"), []
    for share in (1.0, 0.25):
        belt = replace(scene.belt, bending_stiffness=share * scene.belt.bending_stiffness)
        bent = solve(replace(scene, belt=belt), method="bvp", rtol=1e-10)
        apart.append(bent.transport_rate - string(scene).transport_rate)
    assert 3.0 < apart[0] / apart[1] < 5.0


def numbers(solution, order=None):
    """What does not depend on where the drive stands."""
    indices = list(order or range(len(solution.contacts)))
    on = [solution.contacts[i] for i in indices]
    return np.array(
        [
            *([contact.omega, contact.torque, contact.wrap_angle, contact.slip_angle, contact.capacity] for contact in on),
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
        np.testing.assert_allclose(numbers(string(replace(scene, pulleys=pulleys)), order), expected, rtol=1e-9, atol=1e-11)


def test_mirror_with_reversed_travel_exchanges_the_senses():
    """Sliding all along all pulleys, a belt that runs the other way in a mirror has the same shape and forces."""
    known = drive("open-S")
    none = {"omega": None, "torque": None}
    there = [replace(p, **none, x_trans="run-up", slip=slip) for p, slip in zip(known.pulleys, ("forward", "backward"))]
    other = {"forward": "backward", "backward": "forward"}
    back = [
        replace(p, center=(-p.center[0], p.center[1]), slip=other[p.slip], x_trans="run-up") for p in reversed(there)
    ]
    one, mirrored = (string(replace(known, pulleys=tuple(pulleys))) for pulleys in (there, back))
    assert tensions(mirrored) == pytest.approx(tensions(one)[::-1], rel=1e-12)
    assert [c.torque for c in mirrored.contacts] == pytest.approx([-c.torque for c in reversed(one.contacts)], rel=1e-12)


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
            **{"torque": p.torque * force * length, "drag": p.drag * force * length * t} if p.torque is not None else {},
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
    other, same = string(replace(scene, belt=belt, pulleys=pulleys, transport_rate=rate, gravity=(0.0, 0.0))), string(scene)
    for contact, expected in zip(other.contacts, same.contacts, strict=True):
        assert contact.omega * t == pytest.approx(expected.omega, rel=1e-11)
        assert contact.torque / (force * length) == pytest.approx(expected.torque, rel=1e-9, abs=1e-12)
        assert contact.capacity / (force * length) == pytest.approx(expected.capacity, rel=1e-9)
    assert np.array(tensions(other)) / force == pytest.approx(tensions(same), rel=1e-11)


def test_loops_at_random():
    """All are solved up to their capacity, and beyond it none is; in each, power goes into sliding alone."""
    random, slowest = np.random.default_rng(5), 0.0
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
        slowest = max(slowest, time.perf_counter() - began)
    assert slowest < 0.02
