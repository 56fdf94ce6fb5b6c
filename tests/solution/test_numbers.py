"""What a belt engineer asks: tensions, hub loads, creep, frequencies, stress and safety, against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from drives import drive

from belt_fenicsx import Belt, Pulley, Scene, SceneError, StiffnessBelt, Sweep, bvp, slip_safety, solve
from belt_fenicsx.solution.files import columns
from belt_fenicsx.solution.summary import summary

pytestmark = pytest.mark.serial
RADIUS, DISTANCE, STATIC, TORQUE = 0.0508, 0.5, 250.4, 3.39
BAND = Belt(
    thickness=0.0762e-3, width=19.05e-3, youngs_modulus=193e9, poisson_ratio=0.285, density=7800.0,
    contact_offset=0.0381e-3,
)  # fmt: skip


def steel_band(**changes):
    """A steel band on two equal pulleys, of which the first drives."""
    first = Pulley(radius=RADIUS, center=(0.0, 0.0), friction=0.35, omega=20.0)
    second = Pulley(radius=RADIUS, center=(DISTANCE, 0.0), friction=0.35, torque=TORQUE)
    return Scene(**{"belt": BAND, "pulleys": (first, second), "closed": True, "tension": STATIC, **changes})


@pytest.fixture(scope="module", params=["string", "bvp", "fitted"])
def band(request):
    return solve(steel_band(), method=request.param)


def test_tensions_of_a_steel_band(band):
    """The textbook's string: the static tension, and half of the torque over the radius more and less."""
    half = TORQUE / RADIUS / 2.0
    for contact in band.contacts:
        assert contact.tight == pytest.approx(STATIC + half, rel=2e-3)
        assert contact.slack == pytest.approx(STATIC - half, rel=2e-3)
        assert contact.hub_load == pytest.approx(math.hypot(*contact.hub_force), rel=1e-15)
        # Both spans pull at the pulley, along its axis of symmetry, towards the other one.
        assert contact.hub_load == pytest.approx(contact.tight + contact.slack, rel=1e-3)
        assert abs(math.remainder(contact.hub_angle - math.pi * contact.pulley, 2 * math.pi)) < 1e-3
    assert (band.contacts[0].tension_up > band.contacts[0].tension_off) == (band.contacts[0].torque < 0.0)
    assert band.scene.static_tension == pytest.approx(STATIC, rel=1e-12)
    assert band.geometric_wraps == pytest.approx((math.pi, math.pi), rel=1e-12)


def test_stress_of_a_steel_band(band):
    """E h / (2 (R + h / 2)), which the textbook has over 1 - nu^2, and R for the radius: 157.6 MPa."""
    stress = BAND.youngs_modulus * BAND.thickness / (2.0 * RADIUS)
    assert stress / (1.0 - BAND.poisson_ratio**2) == pytest.approx(157.6e6, rel=1e-3)
    assert band.bending_stress == pytest.approx(stress, rel=3e-3)
    axial = max(contact.tight for contact in band.contacts) / BAND.extensional_stiffness
    bending = BAND.thickness / (2.0 * RADIUS)
    assert band.surface_strain == pytest.approx(axial + bending, rel=5e-3)


def test_creep_of_a_steel_band(band):
    """The driven pulley creeps by the difference of the spans' strains and gets what the loss leaves."""
    first, second = band.contacts
    strain = (second.tight - second.slack) / BAND.extensional_stiffness
    assert first.creep == 0.0 and second.creep == pytest.approx(strain, rel=1e-2)
    assert band.losses == pytest.approx(-first.power - second.power, rel=1e-5)
    assert band.efficiency == pytest.approx(-second.power / first.power, rel=1e-8)


def test_frequency_of_a_span(band):
    """Waves run at sqrt(T / m) against the belt, which moves itself: (w^2 - v^2) / (2 l w) with all of the band."""
    for span in band.spans:
        mass = BAND.line_density / (1.0 + span.tension[1] / BAND.extensional_stiffness)
        wave = math.sqrt(span.tension[1] / mass)
        expected = (wave**2 - span.speed**2) / (2.0 * DISTANCE * wave)
        assert span.frequency == pytest.approx(expected, rel=2e-2)
        assert span.speed == pytest.approx(20.0 * RADIUS, rel=2e-3)


def test_speed_and_tension_along_the_belt(band):
    fields, table = band.fields, columns(band)
    assert np.array_equal(table["speed"][1], fields.speed) and table["speed"][0] == "m/s"
    assert np.array_equal(table["tension"][1], fields.tension) and table["tension"][0] == "N"
    assert np.allclose(fields.speed, band.transport_rate * fields.D, rtol=1e-13)
    for contact in band.contacts:
        on = np.isin(fields.zone, [i for i, zone in enumerate(band.zones) if zone.pulley == contact.pulley])
        surface = band.scene.pulleys[contact.pulley].radius * contact.omega
        assert np.allclose(fields.speed[on], fields.v_rel[on] + surface, rtol=1e-12)


def test_safety_against_slip():
    """The textbook's string slips where exp(mu wrap) is the ratio of the tensions, with the static one as their mean.

    One of a given length has a larger mean, as its strain on the pulleys is not linear between those of the spans.
    """
    solution = solve(steel_band(belt=replace(BAND, contact_offset=0.0, density=0.0)), method="string")
    grip = math.exp(0.35 * math.pi)
    capacity = 2.0 * STATIC * RADIUS * (grip - 1.0) / (grip + 1.0)
    assert 1.0 < slip_safety(solution, 1) / (capacity / TORQUE) < 1.03
    assert slip_safety(solution, 1) == pytest.approx(solution.contacts[1].capacity / TORQUE, rel=1e-12)


@pytest.mark.parametrize("name", ["serpentine", "flat-belt"])
def test_safety_of_a_belt_is_near_that_of_its_string(name):
    scene = drive(name)
    string, belt = (solve(scene, method=method) for method in ("string", "fitted"))
    for index, pulley in enumerate(scene.pulleys):
        safety = slip_safety(belt, index)
        assert safety == pytest.approx(slip_safety(string, index), rel=5e-3)
        assert (safety == math.inf) == (pulley.torque == 0.0)


def test_at_its_limit_a_drive_has_the_safety_one():
    scene = drive("flat-belt")
    safety = slip_safety(bvp.solve(scene), 1)
    torque = scene.pulleys[1].torque * safety * (1.0 - 1e-4)
    loaded = replace(scene, pulleys=(scene.pulleys[0], scene.pulleys[1].driven(torque=torque)))
    assert slip_safety(bvp.solve(loaded), 1) == pytest.approx(1.0 + 1e-4, abs=1e-7)


def test_safety_of_what_is_not_there():
    solution = bvp.solve(drive("two-equal"))
    for pulley in (2, -1, "0", True):
        with pytest.raises(SceneError, match="`pulley` must be one that the belt touches, of 0, 1"):
            slip_safety(solution, pulley)
    with pytest.raises(SceneError, match="`solution` must be SOLVED"):
        slip_safety(replace(solution, status=type(solution.status).NOT_ADMISSIBLE), 0)


def test_what_cannot_be_told_is_not_a_number():
    stiffness = StiffnessBelt(
        length=1.0, bending_stiffness=1.0, extensional_stiffness=1e5, shear_stiffness=4e4
    )  # fmt: skip
    solution = bvp.solve(Scene(belt=stiffness))
    assert math.isnan(solution.bending_stress) and math.isnan(solution.surface_strain)
    assert all(math.isnan(span.frequency) for span in solution.spans)
    plain = summary(solution)
    assert plain["bending_stress"] is None and plain["spans"][0]["frequency"] is None
    tensioned = Pulley(radius=0.1, center=(1.0, 0.0), torque=0.0, take_up=(1.0, 0.0), force=100.0)
    scene = Scene(
        belt=Belt(length=2.6), pulleys=(Pulley(radius=0.1, center=(0.0, 0.0), omega=1.0), tensioned), closed=True
    )
    assert math.isnan(scene.static_tension)


def test_in_other_units(band):
    """Lengths of ten, forces of a thousand and speeds of seven times as much."""
    scene = steel_band()
    belt = replace(
        scene.belt, length=scene.belt.length * 10, thickness=BAND.thickness * 10, width=BAND.width * 10,
        contact_offset=BAND.contact_offset * 10, youngs_modulus=BAND.youngs_modulus * 10.0,
        density=BAND.density * 10.0 / 49.0,
    )  # fmt: skip
    first, second = scene.pulleys
    pulleys = (
        replace(first, radius=10 * RADIUS).driven(omega=14.0),
        replace(second, radius=10 * RADIUS, center=(10 * DISTANCE, 0.0)).driven(torque=1e4 * TORQUE),
    )
    scaled = solve(Scene(belt=belt, pulleys=pulleys, closed=True), method=band.method)
    for one, other in zip(band.contacts, scaled.contacts, strict=True):
        assert other.tight == pytest.approx(1e3 * one.tight, rel=1e-7)
        assert other.creep == pytest.approx(one.creep, rel=1e-6, abs=1e-12)
    assert scaled.bending_stress == pytest.approx(10 * band.bending_stress, rel=1e-6)
    assert scaled.spans[0].frequency == pytest.approx(0.7 * band.spans[0].frequency, rel=1e-6)


def test_columns_of_sweeps(band):
    table = Sweep(over="pulleys.1.torque", values=(1.0,), solutions=(band,))
    assert table["pulleys.1.tight"][0] == band.contacts[1].tight
    assert table["spans.1.tension"][0] == band.spans[1].tension[1]
    assert table["efficiency"][0] == band.efficiency
    assert math.isnan(table["spans.7.sag"][0]) and math.isnan(table["pulleys.5.omega"][0])
    for name in ("tight", "pulleys.tight", "pulleys.0.speed", "spans.x.tension", "spans.0.omega", "weather"):
        with pytest.raises(KeyError):
            table[name]
