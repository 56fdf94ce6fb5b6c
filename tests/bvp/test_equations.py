"""The differential equations, their discretisation by collocation, and the derivatives of both."""

import numpy as np
import pytest

from belt_fenicsx.bvp.collocation import INSIDE, POINTS, STAGES, WEIGHTS, increments, inner, integrals
from belt_fenicsx.bvp.equations import Free, OnPulleys, Rod, linearised
from belt_fenicsx.bvp.guess import from_drive
from belt_fenicsx.bvp.newton import newton
from belt_fenicsx.bvp.state import pose
from belt_fenicsx.bvp.system import System, Values
from belt_fenicsx.layout.kind import Part
from belt_fenicsx.layout.posed import ordered
from belt_fenicsx.scene.belt import StiffnessBelt
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.taut_string.drive import string_drive

PLAIN = Rod(a=2e-4, b1=1.0, b2=0.34)
LOADED = Rod(a=2e-4, b1=1.0, b2=0.34, density=0.02, inertia=3e-6, weight=(0.004, -0.01), offset=0.03)


def on_pulley(slope, slides, turn=1.0):
    """One part on a pulley."""
    values = {"radius": 0.7, "turn": turn, "slope": slope, "slides": slides}
    return OnPulleys(center=np.array([[[0.02]], [[-0.57]]]), **{k: np.array([[v]]) for k, v in values.items()})


@pytest.mark.parametrize("rod", [PLAIN, LOADED], ids=["plain", "loaded"])
@pytest.mark.parametrize("turn", [1.0, -1.0], ids=["right", "left"])
@pytest.mark.parametrize(
    ("slope", "slides"), [(0.0, 0.0), (0.3, 1.0), (-0.3, 1.0)], ids=["stick", "forward", "backward"]
)
def test_tractions_balance_force_and_moment(rod, turn, slope, slides):
    equations, c = on_pulley(slope, slides, turn), np.asarray(1.3)
    y = np.random.default_rng(2).uniform(-0.3, 0.3, (5, 1, 20))
    rates, (p, f) = equations.rate(rod, y, c), equations.tractions(rod, y, c)
    _, by = linearised(lambda s: equations.joined(rod, y[:, None] + rates[:, None] * s[0], c), np.zeros((1, 1, 20)))
    x_rate, y_rate, _, kappa_rate, X_rate, Y_rate = by[:, 0]
    theta, X, Y = equations.joined(rod, y, c)[[2, 4, 5]]
    phi, psi = y[0], y[1]
    q = np.array([f * np.cos(phi) - turn * p * np.sin(phi), f * np.sin(phi) + turn * p * np.cos(phi)])
    np.testing.assert_allclose(X_rate, -q[0] - rod.weight[0], atol=2e-14)
    np.testing.assert_allclose(Y_rate, -q[1] - rod.weight[1], atol=2e-14)
    # M*' + r' x N + d q1 = 0, with q1 along the axis e1 of the cross-section.
    moment = (rod.a - rod.inertia * 1.3**2) * kappa_rate + x_rate * Y - y_rate * X
    q1 = q[0] * np.cos(theta) + q[1] * np.sin(theta)
    np.testing.assert_allclose(moment, -turn * rod.offset * q1, atol=2e-14)
    if slides:
        np.testing.assert_allclose(f, -slope * p, rtol=1e-14)
    np.testing.assert_allclose(psi, theta - phi, atol=1e-15)


@pytest.mark.parametrize("rod", [PLAIN, LOADED], ids=["plain", "loaded"])
def test_a_free_span_is_in_balance(rod):
    y, c = np.random.default_rng(3).uniform(-0.3, 0.3, (6, 1, 20)), np.asarray(1.3)
    x_rate, y_rate, _, kappa_rate, X_rate, Y_rate = Free().rate(rod, y, c)
    moment = (rod.a - rod.inertia * 1.3**2) * kappa_rate + x_rate * y[5] - y_rate * y[4]
    np.testing.assert_allclose(moment, 0.0, atol=1e-15)
    np.testing.assert_allclose([X_rate, Y_rate], np.broadcast_to(-np.array(rod.weight)[:, None, None], (2, 1, 20)))


def test_complex_steps_are_exact():
    z = np.random.default_rng(1).uniform(-2.0, 2.0, (2, 50)) * np.logspace(-12, 0, 50)
    x, y = z
    (values,), by = linearised(lambda z: np.array([np.arctan(z[0] / (3.0 + z[1])) * np.sqrt(1.0 + z[1] ** 2)]), z)
    ratio, root = x / (3.0 + y), np.sqrt(1.0 + y**2)
    turn = root / (1.0 + ratio**2) / (3.0 + y)
    np.testing.assert_allclose(values, np.arctan(ratio) * root, rtol=5e-15)
    np.testing.assert_allclose(by[0, 0], turn, rtol=5e-15)
    np.testing.assert_allclose(by[0, 1], np.arctan(ratio) * y / root - ratio * turn, rtol=5e-15)


def test_gauss_rule():
    powers = np.arange(2 * STAGES)
    np.testing.assert_allclose(WEIGHTS @ POINTS[:, None] ** powers, 1.0 / (powers + 1), rtol=1e-14)
    integrals_of_powers = POINTS[:, None] ** (powers[:STAGES] + 1) / (powers[:STAGES] + 1)
    np.testing.assert_allclose(INSIDE @ POINTS[:, None] ** powers[:STAGES], integrals_of_powers, atol=2e-15)
    np.testing.assert_allclose(integrals(np.array(1.0)), WEIGHTS, rtol=1e-13)


def test_increments_are_the_inverse_of_what_they_add_up_to():
    rng = np.random.default_rng(5)
    z, points = rng.normal(size=(6, 2, 4)), rng.normal(size=(6, 2, 3, STAGES))
    np.testing.assert_allclose(inner(z, increments(z, points)), points, atol=1e-13)


LAYOUTS = {
    "stick | slip": (Part("stick"), Part("slip", "forward")),
    "slip | stick | slip": (Part("slip", "forward"), Part("stick"), Part("slip", "backward")),
    "slip | slip": (Part("slip", "backward"), Part("slip", "forward")),
}
DRIVES = {"place": {"x_trans": 0.02}, "torque": {"torque": 3e-3, "drag": 1e-3}, "omega": {"omega": 1.48}}
MORE = {"take_up": (0.3, 1.0), "force": 0.02}


@pytest.mark.parametrize("parts", LAYOUTS.values(), ids=LAYOUTS.keys())
@pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES.keys())
@pytest.mark.parametrize("more", [{}, MORE], ids=["fixed", "take-up"])
def test_a_newton_step_solves_the_linearised_equations(parts, drive, more):
    """The eliminated, factorised derivatives against differences of the residual, in the direction of the step."""
    belt = StiffnessBelt(
        bending_stiffness=2e-4, extensional_stiffness=1.0, shear_stiffness=0.34, line_density=0.01, rotary_inertia=1e-6,
        contact_offset=0.01,
    )  # fmt: skip
    scene = Scene(belt=belt, pulleys=(Pulley(**drive, **more),), gravity=(0.1, -0.4))
    problem = pose(scene, ordered(scene, parts), 0.04)
    rng, lengths = np.random.default_rng(4), np.full(len(parts) + 2, 1.0 / (len(parts) + 2))
    mesh, widths = np.linspace(0.0, 1.0, 6), problem.widths(lengths)
    system = System(problem, mesh, widths)

    def random(shape):
        return rng.uniform(0.1, 0.4, shape)

    z = tuple(random((group.equations.size, group.parts.size, 6)) for group in problem.groups)
    K = tuple(random((group.equations.size, group.parts.size, 5, STAGES)) for group in problem.groups)
    values = Values(z, K, lengths, 1.0, random(len(problem.take_ups)))
    residual = system.residual(values)
    step = system.step(system.linearised(values), residual)
    small = 1e-6
    ahead, behind = (system.residual(values.plus(step, part, positive=False)) for part in (small, -small))
    for now, after, before in zip(
        (*residual.increments, residual.rows),
        (*ahead.increments, ahead.rows),
        (*behind.increments, behind.rows),
        strict=True,
    ):
        np.testing.assert_allclose((after - before) / (2.0 * small), -now, atol=2e-6 * max(np.abs(now).max(), 1.0))


def test_newton_says_that_it_did_not_converge():
    scene, _ = Scene().dimensionless()
    problem = pose(scene, ordered(scene, LAYOUTS["stick | slip"]), 0.04)
    start = from_drive(problem, string_drive(scene))
    assert not newton(problem, start, most=1).converged
    assert newton(problem, start).converged
