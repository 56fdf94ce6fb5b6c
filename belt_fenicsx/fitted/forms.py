"""The fitted method in UFL: one set of forms for each degree, which serves every scene and every list of zones.

All cells are unit cells (eta). Their map to the belt is an unknown like the others: sigma(eta), piecewise linear, whose
values at the borders of zones are free. So are the stretch in stick, one for each pulley, and in contact the pressure p
and the friction f. Everything that tells zones, pulleys and scenes apart is data: the belt's stiffnesses are constants,
what a cell lies on are values of this cell, and one-sided values at its nodes switch equations on. The derivative of
the residual in the direction of sigma is what moves the borders.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, NamedTuple

import ufl

from belt_fenicsx.backend import compat
from belt_fenicsx.fitted import elements
from belt_fenicsx.fitted.kernels import Kernel, compiled
from belt_fenicsx.mechanics import contact, rod

Expr = Any

CONSTANTS = ("a", "b1", "b2")
# The chord of a cell: its left end as seen from the pulley's centre, and the vector to its right end; R^2 less the
# squares of both ends' distances from the centre; cosine and sine of the angle of its frame; the chord in this frame
# over the cell's length, less one along the first axis; and that length. Then the bulge of the parabola over it, about
# the arc of the pulley, from which r deviates, and the two small numbers that go with it.
CHORD = (
    "x", "y", "along_x", "along_y", "excess_left", "excess_right", "cos", "sin", "q1", "q2", "length",
    "bulge_x", "bulge_y", "flat", "skew",
)  # fmt: skip
# The pulley on which a cell lies: its radius, its friction coefficient, its side of the belt (+1 on the right), and
# what its drive gives: the transition's x from the centre, the elongation D - 1 in stick, or the force of friction.
PULLEY = ("R", "mu", "side", "given")
SWITCHES = ("touch", "stick", "sense", "tangent", "x", "speed", "coulomb", "stretch", "grip", "force")


@dataclass(frozen=True)
class Forms:
    """Compiled forms of one cell.

    Their coefficients are the cell's unknowns, in the order r (x, y of each node), theta, p, f, sigma, elongation D - 1
    in stick; each field's in the order left node, right node, inner nodes; p and f live at the Gauss points. Then the
    values of ``SWITCHES`` on both sides of the cell; then those of ``CHORD``, from which r and theta deviate, and of
    ``PULLEY``. Their constants are ``CONSTANTS``.

    Attributes:
        F: Residual ``(5 k + 6,)``.
        J: Its derivative ``(5 k + 6, 5 k + 6)``.
    """

    F: Kernel
    J: Kernel


class Unknowns(NamedTuple):
    """The unknown fields of a cell, or their variations; without friction, f is zero."""

    r: Expr
    theta: Expr
    p: Expr
    f: Expr
    sigma: Expr
    e: Expr


@dataclass(frozen=True)
class Belt:
    """The belt in a cell, from its unknowns.

    Attributes:
        place: Points of the parabola over the chord, as seen from the pulley's centre.
        deviation: What r is more than that.
        excess: R^2 less the square of the place's distance from the centre.
        strains: eps, Gamma and kappa (18.6).
        e: Elongation D - 1.
        t: Unit tangent.
        n: Unit normal, to the left of it (18.2).
        length: Material length of the cell, sigma' in eta.
    """

    place: Expr
    deviation: Expr
    excess: Expr
    strains: rod.Strains
    e: Expr
    t: Expr
    n: Expr
    length: Expr

    @property
    def r(self) -> Expr:
        """Position, as seen from the pulley's centre."""
        return self.place + self.deviation


@functools.cache
def forms(degree: int, friction: bool) -> Forms:
    """The forms of one degree, with or without friction; made once in a process."""
    F, J = residual_and_jacobian(degree, friction)
    return Forms(*compiled(F, J))


def residual_and_jacobian(degree: int, friction: bool) -> tuple[ufl.Form, ufl.Form]:
    """Both forms in UFL."""
    line, node, traction = elements.line(), elements.lagrange(degree), elements.gauss(degree)
    mixed = compat.mixed(
        elements.lagrange(degree, size=2), node, traction, traction, elements.lagrange(1), elements.gauss(1)
    )
    values = elements.gauss(1, size=len(CHORD) + len(PULLEY))
    # Numbered here: UFL would count on in one process, and compiled code is found again by its form's numbers, too.
    unknown, switches, data = (
        ufl.Coefficient(ufl.FunctionSpace(line, element), count=count)
        for count, element in enumerate((mixed, elements.one_sided(len(SWITCHES)), values))
    )
    constants = ufl.Constant(line, shape=(len(CONSTANTS),), count=0)
    F = residual(unknown, switches, data, constants, degree, friction)
    return F, ufl.derivative(F, unknown, ufl.TrialFunction(unknown.ufl_function_space()))


def residual(
    unknown: ufl.Coefficient,
    switches: ufl.Coefficient,
    data: ufl.Coefficient,
    constants: ufl.Constant,
    degree: int,
    friction: bool,
) -> ufl.Form:
    """Equilibrium and the conditions of contact at the Gauss points, and those of the borders at the cell's ends."""
    at_gauss_points = ufl.dx(metadata={"quadrature_degree": 2 * degree - 1, "quadrature_rule": "default"})
    at_ends = ufl.dx(
        metadata={
            "quadrature_degree": 1,
            "quadrature_rule": "custom",
            "quadrature_points": ((0.0,), (1.0,)),
            "quadrature_weights": (1.0, 1.0),
        }
    )
    u, v = Unknowns(*ufl.split(unknown)), Unknowns(*ufl.TestFunctions(unknown.ufl_function_space()))
    if not friction:
        # UFL leaves out what is multiplied by zero.
        u, v = u._replace(f=ufl.as_ufl(0)), v._replace(f=ufl.as_ufl(0))
    on, cell, stiffness = _named(SWITCHES, switches), _named(CHORD + PULLEY, data), _named(CONSTANTS, constants)
    belt = belt_of(unknown, u, cell)
    # Two integrals, each with one integrand: UFL's work for each of them is what a first solve waits for.
    inside = equilibrium(unknown, u, v, belt, cell, stiffness) + contact_conditions(u, v, belt, on, cell)
    return inside * at_gauss_points + border_conditions(u, v, belt, on, cell, stiffness, friction) * at_ends


def belt_of(unknown: ufl.Coefficient, u: Unknowns, cell: SimpleNamespace) -> Belt:
    """The belt in a cell; small differences are taken from the cell's chord, which knows them better."""
    (eta,) = ufl.SpatialCoordinate(unknown.ufl_function_space().ufl_domain())
    arm, along, bulge = (
        ufl.as_vector(vector)
        for vector in ((cell.x, cell.y), (cell.along_x, cell.along_y), (cell.bulge_x, cell.bulge_y))
    )
    place = arm + eta * along + eta * (1 - eta) * bulge
    ends = cell.excess_left, cell.excess_right
    excess = contact.excess_on_parabola(eta, ends=ends, flat=cell.flat, skew=cell.skew, bulge=bulge)
    length, d_sigma = u.sigma.dx(0), rod.along(u.sigma)
    # The length in the chord's data is the value of sigma', which varies here.
    shorter, bent = cell.length / length - 1, d_sigma(u.r) + (1 - 2 * eta) / length * bulge
    q = (
        cell.q1 + (1 + cell.q1) * shorter + cell.cos * bent[0] + cell.sin * bent[1],
        cell.q2 + cell.q2 * shorter + cell.cos * bent[1] - cell.sin * bent[0],
    )
    t = rod.tangent(place + u.r, d_sigma)
    strains, n = rod.strains_in_frame(q, u.theta, d_sigma), ufl.as_vector([-t[1], t[0]])
    return Belt(place, u.r, excess, strains, rod.elongation(q), t, n, length)


def equilibrium(
    unknown: ufl.Coefficient, u: Unknowns, v: Unknowns, belt: Belt, cell: SimpleNamespace, stiffness: SimpleNamespace
) -> Expr:
    """Weak equilibrium, with the energy (18.9): for all variations of r and theta

    delta int 1/2 (a kappa^2 + b1 eps^2 + b2 Gamma^2) dsigma - int (f t + s p n).delta r dsigma = 0   (18.17).
    """
    energy = rod.strain_energy(belt.strains, a=stiffness.a, b1=stiffness.b1, b2=stiffness.b2)
    variation = ufl.as_vector([v.r[0], v.r[1], v.theta, 0, 0, 0, 0])
    elastic = ufl.derivative(energy * belt.length, unknown, variation)
    return elastic - ufl.dot(u.f * belt.t + cell.side * u.p * belt.n, v.r) * belt.length


def contact_conditions(u: Unknowns, v: Unknowns, belt: Belt, on: SimpleNamespace, cell: SimpleNamespace) -> Expr:
    """What holds at each Gauss point on a pulley: the belt lies on it, and sticks or slides,

        |r - C| = R,    D = D_stick (18.15)  or  f = -s mu p (18.16);

    and the part of the equation for the resultant of friction that is an integral, int f dsigma.
    """
    lies = v.p * on.touch * contact.penetration_near(belt.place, belt.deviation, radius=cell.R, excess=belt.excess)
    slides = (on.touch - on.stick) * (u.f + on.sense * cell.mu * u.p)
    return lies + v.f * (on.stick * (belt.e - u.e) + slides) + v.e * on.force * on.touch * u.f * belt.length


def border_conditions(
    u: Unknowns,
    v: Unknowns,
    belt: Belt,
    on: SimpleNamespace,
    cell: SimpleNamespace,
    stiffness: SimpleNamespace,
    friction: bool,
) -> Expr:
    """What places each border, and what the stretch in stick follows from: one equation for each scalar.

    run-up, run-off   (r - C).t = 0: no concentrated force
    other borders     x = x_trans,  D_stick = R omega / c,  D = D_stick  or  f = -s mu p, of the stick next to it
    stretch in stick  D = D_stick  where the belt grips the pulley  or  int f dsigma = -torque / R
    """
    borders = v.sigma * on.tangent * ufl.dot(belt.r, belt.t)
    stretch = v.e * on.grip * (1 - on.force) * (belt.e - u.e)
    if not friction:
        return borders + stretch
    p, f = rod.tractions(belt.strains, 1 + belt.e, radius=cell.R, b1=stiffness.b1, b2=stiffness.b2)
    borders += v.sigma * (
        on.x * (belt.r[0] - cell.given)
        + on.speed * (u.e - cell.given)
        + on.coulomb * (f + on.sense * cell.mu * p)
        + on.stretch * (belt.e - u.e)
    )
    return borders + stretch - v.e * on.grip * on.force * cell.given


def _named(names: tuple[str, ...], values: Expr) -> SimpleNamespace:
    """Components by name."""
    return SimpleNamespace(**{name: values[i] for i, name in enumerate(names)})
