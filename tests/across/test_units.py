"""The same scene in other units has the same answer, by every method."""

from dataclasses import replace

import pytest

from belt_fenicsx import Belt, Pulley, Scene, bvp, solve

METHODS = {
    "bvp": lambda scene: bvp.solve(scene, rtol=1e-8),
    "fitted": lambda scene: solve(scene, rtol=1e-8),
    "augmented-lagrangian": lambda scene: solve(scene, method="augmented-lagrangian"),
}


def scaled(factor: float) -> Scene:
    """The source's scene with all lengths multiplied."""
    return Scene(
        belt=Belt(length=factor, thickness=0.05 * factor, width=0.1 * factor),
        pulleys=(Pulley(radius=0.7 * factor, center=(0.0, -0.575 * factor)),),
        span=factor,
    )


CHANGES = {
    **{f"E = {E:g}": (Scene(belt=Belt(youngs_modulus=E)), 1.0, E / 5e7, 1.0) for E in (1e0, 1e12)},
    **{f"c = {c:g}": (Scene(transport_rate=c), c, 1.0, 1.0) for c in (1e-6, 1e6)},
    **{f"lengths times {k:g}": (scaled(k), 1.0 / k, k**2, k) for k in (1e-4, 1e4)},
}


@pytest.fixture(scope="module", params=METHODS)
def method(request):
    return METHODS[request.param]


@pytest.fixture(scope="module")
def usual(method):
    return method(Scene())


@pytest.mark.parametrize("change", CHANGES)
def test_answer_does_not_depend_on_units(change, method, usual):
    scene, speed, force, length = CHANGES[change]
    answer, contact = method(scene), usual.contacts[0]
    assert answer.omega == pytest.approx(speed * contact.omega, rel=1e-9)
    assert answer.contacts[0].x_up == pytest.approx(length * contact.x_up, rel=1e-9)
    assert answer.contacts[0].torque == pytest.approx(force * length * contact.torque, rel=1e-6)
    assert answer.fields.p.max() == pytest.approx(force / length * usual.fields.p.max(), rel=1e-6)


def test_dimensionless_scene_is_the_same_in_all_units():
    plain = Scene().dimensionless()[0]
    for scene, *_ in CHANGES.values():
        other = scene.dimensionless()[0]
        assert other.belt.bending_stiffness == pytest.approx(plain.belt.bending_stiffness, rel=1e-14)
        assert replace(other, belt=plain.belt).pulleys[0].radius == pytest.approx(plain.pulleys[0].radius, rel=1e-14)
