"""Balances with everything that acts on a belt, on a contact whose equations are integrated here once more."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from belt_fenicsx import Pulley, Scene, Solution, Status, StiffnessBelt
from belt_fenicsx.layout.arrays import vectors
from belt_fenicsx.layout.kind import Part
from belt_fenicsx.solution.certificate import certify
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.reading import contacts_of, zones_of

pytestmark = pytest.mark.serial
RATE, LENGTH, POINTS = 3.0, 0.6, 401
BELT = StiffnessBelt(
    length=LENGTH, bending_stiffness=0.3, extensional_stiffness=40.0, shear_stiffness=15.0, line_density=0.7,
    rotary_inertia=0.004, contact_offset=0.03,
)  # fmt: skip
EXACT = {"rtol": 1e-12, "atol": 1e-12}


class Sliding:
    """A belt that slides forward on a pulley: phi, theta, kappa and D along it, with r - d e2 on the circle."""

    def __init__(self, scene: Scene) -> None:
        self.pulley, self.belt = scene.pulleys[0], scene.belt
        self.s, self.R, self.mu = self.pulley.turn, self.pulley.radius, self.pulley.friction
        self.d, self.weight = self.s * self.belt.contact_offset, self.belt.line_density * complex(*scene.gravity)

    def strains(self, phi, theta, kappa, D):
        return D * np.cos(theta - phi) - self.d * kappa - 1.0, -D * np.sin(theta - phi)

    def N(self, phi, theta, kappa, D):
        (eps, Gamma), mass = self.strains(phi, theta, kappa, D), self.belt.line_density * RATE**2
        N1 = self.belt.extensional_stiffness * eps - mass * (1.0 + eps)
        return (N1 + 1j * (self.belt.shear_stiffness - mass) * Gamma) * np.exp(1j * theta)

    def rates(self, state):
        """Derivatives of the state, and the pressure: three equations that are linear in D', kappa' and p."""
        phi, theta, kappa, D = state
        phi_rate, h = -self.s * D / self.R, 1e-6
        slopes = [(self.N(*(state + h * e)) - self.N(*(state - h * e))) / (2.0 * h) for e in np.eye(4)]
        t = np.exp(1j * phi)
        traction = (-self.mu + 1j * self.s) * t  # of unit pressure
        eps, Gamma = self.strains(*state)
        along = (1.0 + eps + 1j * Gamma) * np.exp(1j * theta)
        known = slopes[0] * phi_rate + slopes[1] * kappa + self.weight
        a = self.belt.bending_stiffness - self.belt.rotary_inertia * RATE**2
        q1 = (traction * np.exp(-1j * theta)).real
        twist = (along.conjugate() * self.N(*state)).imag
        matrix = [[slopes[3].real, slopes[2].real, traction.real], [slopes[3].imag, slopes[2].imag, traction.imag]]
        matrix.append([0.0, a, self.d * q1])
        D_rate, kappa_rate, p = np.linalg.solve(matrix, [-known.real, -known.imag, -twist])
        return np.array([phi_rate, kappa, kappa_rate, D_rate]), p


def contact(side, gravity):
    """A solution that is nothing but a contact, with its friction and pressure."""
    pulley = Pulley(radius=0.5, center=(0.1, -0.3), friction=0.3, side=side, slip_angle=0.1)
    scene = Scene(belt=BELT, pulleys=(pulley,), gravity=gravity, transport_rate=RATE, span=2.0)
    sliding, sigma = Sliding(scene), np.linspace(-LENGTH / 2, LENGTH / 2, POINTS)
    start = np.array([0.4 * pulley.turn, 0.38 * pulley.turn, -2.4 * pulley.turn, 1.3])
    run = solve_ivp(lambda _, y: sliding.rates(y)[0], sigma[[0, -1]], start, t_eval=sigma, method="DOP853", **EXACT)
    p = np.array([sliding.rates(y)[1] for y in run.y.T])
    phi, theta, kappa, D = run.y
    n, d = 1j * np.exp(1j * phi), sliding.d
    r = complex(*pulley.center) + pulley.turn * pulley.radius * n + d * 1j * np.exp(1j * theta)
    omega = 0.9 * RATE * D.min() / pulley.radius
    fields = Fields.from_state(
        BELT, zone=np.zeros(POINTS, dtype=int), sigma=sigma, r=vectors(r), theta=theta, phi=phi, D=D, kappa=kappa, p=p,
        f=-pulley.friction * p, rate=RATE, v_rel=RATE * D - pulley.radius * omega, offset=np.full(POINTS, d),
    )  # fmt: skip
    zones = zones_of(scene, [Part("slip", "forward", 0)], fields)
    torque = -pulley.radius * float(fields.weight @ fields.f)
    contacts = contacts_of(scene, zones, fields, rate=RATE, omegas=(omega,), torques=(torque,))
    return Solution(
        scene=scene, method="made up", status=Status.SOLVED, transport_rate=RATE, contacts=contacts, zones=zones,
        fields=fields,
    )  # fmt: skip


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("gravity", [(0.0, 0.0), (3.0, -9.81)])
def test_forces_moments_and_power_are_in_balance(side, gravity):
    """On its own, the contact has no spans beside it: both its ends are clamps."""
    solution = contact(side, gravity)
    fields, place, fibre = solution.fields, solution.contacts[0], fibre_of(solution)
    assert np.all(fields.p > 0.0)
    assert [complex(*place.run_up), complex(*place.run_off)] == pytest.approx(fibre[[0, -1]], abs=1e-14)
    assert np.abs(fibre - complex(*place.center)) == pytest.approx(0.5, rel=1e-12)
    assert (place.angle_up, place.angle_off) == pytest.approx(tuple(fields.phi[[0, -1]]), abs=1e-12)
    assert place.wrap_angle == pytest.approx(abs(fields.phi[0] - fields.phi[-1]), rel=1e-12)
    assert np.abs(np.gradient(fibre, fields.sigma))[1:-1] == pytest.approx(fields.D[1:-1], rel=1e-4)
    margins = {check.name: check.margin for check in certify(solution, tolerance=1e-9, balance=1e-8)}
    for name in ("balance of forces", "balance of moments", "balance of hub loads", "balance of power"):
        assert margins[name] == pytest.approx(0.0, abs=1e-8), name


def fibre_of(solution):
    """Places of the touching fibre."""
    d = solution.scene.pulleys[0].turn * solution.scene.belt.contact_offset
    return solution.fields.r @ (1.0, 1j) - 1j * d * np.exp(1j * solution.fields.theta)


@pytest.mark.parametrize(
    ("changed", "failed"),
    [
        ({"gravity": (3.0, -9.0)}, {"balance of forces", "balance of moments", "balance of power"}),
        ({"belt": replace(BELT, line_density=0.71)}, {"balance of forces", "balance of moments", "balance of power"}),
        ({"belt": replace(BELT, rotary_inertia=0.005)}, {"balance of moments", "balance of power"}),
        ({"belt": replace(BELT, contact_offset=0.031)}, {"balance of moments"}),
    ],
    ids=["gravity", "line density", "rotary inertia", "contact offset"],
)
def test_every_load_matters(changed, failed):
    solution = contact("right", (3.0, -9.81))
    checks = certify(replace(solution, scene=replace(solution.scene, **changed)), tolerance=1e-9, balance=1e-8)
    assert {check.name for check in checks if not check.holds and "balance of" in check.name} >= failed
    assert math.isfinite(sum(check.margin for check in checks))
