"""The differential equations and their derivatives."""

import numpy as np
import pytest

from belt_fenicsx.bvp.equations import Free, Rod, Slip, Stick
from belt_fenicsx.bvp.newton import Lengths
from belt_fenicsx.bvp.problem import FIRST, LAST, Condition, Problem, component, linearised, moment, onset

ROD = Rod(a=2e-4, b1=1.0, b2=0.34, radius=0.7, center=(0.02, -0.57))
ZONE_LISTS = {
    "stick | slip": ((Free(), Stick(), Slip(0.2), Free()), (Condition(((1, LAST, component(0)),), 0.1),)),
    "slip | stick | slip": (
        (Free(), Slip(0.02), Stick(), Slip(-0.4), Free()),
        (
            Condition(((1, LAST, onset(ROD, Slip(0.02))),)),
            Condition(((1, FIRST, moment(ROD, 1.0)), (3, LAST, moment(ROD, -1.0))), 0.01),
        ),
    ),
}  # fmt: skip


@pytest.mark.parametrize(("zones", "conditions"), ZONE_LISTS.values(), ids=ZONE_LISTS.keys())
def test_jacobians_against_differences(zones, conditions):
    problem = Problem(ROD, 1.0, zones, conditions)
    n, k = problem.size
    rng = np.random.default_rng(7)
    y, p = rng.uniform(0.2, 1.2, (n, 2)), rng.uniform(0.1, 0.5, k)
    point = np.concatenate([y[:, 0], y[:, 1], p])
    xi, widths = np.array([0.3]), rng.uniform(0.05, 0.5, len(zones))

    def split(z):
        return z[:n], z[n : 2 * n], z[2 * n :]

    def rate(z):
        first, _, parameters = split(z)
        return problem.rate(xi, first[:, None], parameters, widths)[:, 0]

    def residual(z):
        return problem.residual(*split(z))

    assert residual(point).shape == (n + k,)
    dy, dp = problem.rate_jacobian(xi, y[:, :1], p, widths)
    exact_rate = np.hstack([dy[:, :, 0], np.zeros((n, n)), dp[:, :, 0]])
    exact_residual = np.hstack(problem.residual_jacobian(y[:, 0], y[:, 1], p))
    for function, exact in ((rate, exact_rate), (residual, exact_residual)):
        step = 1e-6
        differences = [(function(point + d) - function(point - d)) / (2 * step) for d in step * np.eye(point.size)]
        np.testing.assert_allclose(exact, np.transpose(differences), atol=1e-8 * np.max(np.abs(exact)))


def test_complex_steps_are_exact():
    x, y = np.random.default_rng(1).uniform(-2.0, 2.0, (2, 1, 50)) * np.logspace(-12, 0, 50)
    (values,), by_x, by_y = linearised(lambda x, y: np.arctan(x / (3.0 + y)) * np.sqrt(1.0 + y**2) + np.sin(x), x, y)
    ratio, root = x / (3.0 + y), np.sqrt(1.0 + y**2)
    turn = root / (1.0 + ratio**2) / (3.0 + y)
    np.testing.assert_allclose(values, (np.arctan(ratio) * root + np.sin(x))[0], rtol=5e-15)
    np.testing.assert_allclose(by_x[0], turn + np.cos(x), rtol=5e-15)
    np.testing.assert_allclose(by_y[0], np.arctan(ratio) * y / root - ratio * turn, rtol=5e-15)


@pytest.mark.parametrize("zone", [Stick(), Slip(0.3), Slip(-0.3)], ids=["stick", "forward", "backward"])
def test_tractions_balance_the_rate_of_the_force(zone):
    unknowns = np.random.default_rng(2).uniform(-0.3, 0.3, (4, 20)) + [[0.0], [0.0], [0.0], [1.1]]
    y, c = unknowns[: zone.unknowns], unknowns[zone.unknowns :]
    rates = np.concatenate([zone.rate(ROD, y, c), np.zeros_like(c)])

    def force(sigma):
        """In global axes, along the belt."""
        phi, theta, _, D = unknowns[:, None] + rates[:, None] * sigma[0]
        t, n = ROD.force(theta - phi, D)
        return np.array([t * np.cos(phi) - n * np.sin(phi), t * np.sin(phi) + n * np.cos(phi)])

    _, force_rate = linearised(force, np.zeros((1, 20)))
    (p, f), phi = zone.tractions(ROD, y, c), unknowns[0]
    contact = np.array([f * np.cos(phi) - p * np.sin(phi), f * np.sin(phi) + p * np.cos(phi)])
    np.testing.assert_allclose(force_rate[:, 0], -contact, atol=5e-15)


def test_logarithms_of_lengths():
    p = np.array([-0.2, 0.1, 0.25, 3.0, 1.5])
    _, gradient = linearised(Lengths(3).borders, Lengths(3).logarithms(p))
    by_lengths = np.array([[1, 0, 0], [1, 0.3, 0], [1, 0.3, 0.15]])
    np.testing.assert_allclose(Lengths(3).borders(Lengths(3).logarithms(p)), p, rtol=5e-15)
    np.testing.assert_allclose(
        gradient, np.block([[by_lengths, np.zeros((3, 2))], [np.zeros((2, 3)), np.eye(2)]]), atol=1e-15
    )
    np.testing.assert_array_equal(Lengths(1).borders(Lengths(1).logarithms(p)), p)
