"""The fitted method in UFL: one set of forms for each degree and kind of scene, which serves every list of zones.

All cells are unit cells (eta). Their map to the belt is an unknown like the others: sigma(eta), piecewise linear, whose
values at the joints of zones are free. So are the stretch in stick, one for each pulley, and in contact the pressure p
and the friction f; with loads, the transport rate c and the displacements of pulleys. Everything that tells zones,
pulleys and scenes apart is data: the belt's stiffnesses are constants, what a cell lies on are values of this cell, and
one-sided values at its nodes switch equations on. The derivative of the residual in the direction of sigma is what
moves the joints.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, NamedTuple

import ufl

from belt_fenicsx.backend import compat
from belt_fenicsx.fitted import elements
from belt_fenicsx.fitted.dofs import Terms
from belt_fenicsx.fitted.kernels import Kernel, compiled
from belt_fenicsx.mechanics import contact, rod

Expr = Any

STIFFNESS = ("a", "b1", "b2")
LOADS, OFFSET = ("density", "inertia", "weight_x", "weight_y"), ("offset",)
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
# With loads, also what the last one loses with the speed of the belt in stick, and the direction and the force of a
# take-up.
PULLEY = ("R", "mu", "side", "given")
MORE = ("drag", "way_x", "way_y", "force_along")
SWITCHES = ("touch", "stick", "sense", "tangent", "x", "speed", "coulomb", "stretch", "surface", "force")
MORE_SWITCHES = ("behind", "angle", "take_up", "runs")


def constants_of(terms: Terms) -> tuple[str, ...]:
    """Names of the constants of forms."""
    return STIFFNESS + LOADS * terms.loads + OFFSET * terms.offset


def pulley_data(terms: Terms) -> tuple[str, ...]:
    """Names of what a cell knows of its pulley."""
    return PULLEY + MORE * terms.loads


def switches_of(terms: Terms) -> tuple[str, ...]:
    """Names of the switches of equations."""
    return SWITCHES + MORE_SWITCHES * terms.loads


@dataclass(frozen=True)
class Forms:
    """Compiled forms of one cell.

    Their coefficients are the cell's unknowns, in the order r (x, y of each node), theta, p, f, sigma, elongation D - 1
    in stick, and with loads transport rate and take-up; each field's in the order left node, right node, inner nodes;
    p and f live at the Gauss points. Then the values of `switches_of` on both sides of the cell; then those of
    ``CHORD``, from which r and theta deviate, and of `pulley_data`. Their constants are `constants_of`.

    Attributes:
        F: Residual ``(dofs,)``.
        J: Its derivative ``(dofs, dofs)``.
    """

    F: Kernel
    J: Kernel


class Unknowns(NamedTuple):
    """The unknown fields of a cell, or their variations; what there is not is zero, and the transport rate one."""

    r: Expr
    theta: Expr
    p: Expr
    f: Expr
    sigma: Expr
    e: Expr
    rate: Expr
    move: Expr


@dataclass(frozen=True)
class Belt:
    """The belt in a cell, from its unknowns.

    Attributes:
        place: Points of the parabola over the chord, as seen from the pulley's centre.
        deviation: What the middle line's position is more than that.
        excess: Square of the radius on which the middle line runs, less that of the place's distance from the centre.
        strains: eps, Gamma and kappa (18.6).
        e: Elongation D - 1 of the touching fibre.
        t: Unit tangent of the touching fibre.
        n: Unit normal, to the left of it (18.2).
        length: Material length of the cell, sigma' in eta.
        offset: Distance d of the touching fibre from the middle line, along -e2.
        e1: First axis of the cross-section.
    """

    place: Expr
    deviation: Expr
    excess: Expr
    strains: rod.Strains
    e: Expr
    t: Expr
    n: Expr
    length: Expr
    offset: Expr
    e1: Expr

    @property
    def e2(self) -> Expr:
        """Second axis of the cross-section."""
        return ufl.as_vector([-self.e1[1], self.e1[0]])

    def traction(self, u: Unknowns, cell: SimpleNamespace) -> Expr:
        """f t + s p n, what the belt gets of the pulley per material length."""
        return u.f * self.t + cell.side * u.p * self.n

    @property
    def r(self) -> Expr:
        """Position of the touching fibre, as seen from the pulley's centre."""
        return self.place + self.deviation - self.offset * self.e2


@functools.cache
def forms(degree: int, terms: Terms) -> Forms:
    """The forms of one degree, with these terms; made once in a process."""
    F, J = residual_and_jacobian(degree, terms)
    return Forms(*compiled(F, J))


def residual_and_jacobian(degree: int, terms: Terms) -> tuple[ufl.Form, ufl.Form]:
    """Both forms in UFL."""
    line, node, traction = elements.line(), elements.lagrange(degree), elements.gauss(degree)
    scalars = [elements.gauss(1)] * (3 if terms.loads else 1)
    mixed = compat.mixed(elements.lagrange(degree, size=2), node, traction, traction, elements.lagrange(1), *scalars)
    values = elements.gauss(1, size=len(CHORD) + len(pulley_data(terms)))
    # Numbered here: UFL would count on in one process, and compiled code is found again by its form's numbers, too.
    unknown, switches, data = (
        ufl.Coefficient(ufl.FunctionSpace(line, element), count=count)
        for count, element in enumerate((mixed, elements.one_sided(len(switches_of(terms))), values))
    )
    constants = ufl.Constant(line, shape=(len(constants_of(terms)),), count=0)
    F = residual(unknown, switches, data, constants, degree, terms)
    return F, ufl.derivative(F, unknown, ufl.TrialFunction(unknown.ufl_function_space()))


def residual(
    unknown: ufl.Coefficient,
    switches: ufl.Coefficient,
    data: ufl.Coefficient,
    constants: ufl.Constant,
    degree: int,
    terms: Terms,
) -> ufl.Form:
    """Equilibrium and the conditions of contact at the Gauss points, and those of the joints at the cell's ends."""
    at_gauss_points = ufl.dx(metadata={"quadrature_degree": 2 * degree - 1, "quadrature_rule": "default"})
    at_ends = ufl.dx(
        metadata={
            "quadrature_degree": 1,
            "quadrature_rule": "custom",
            "quadrature_points": ((0.0,), (1.0,)),
            "quadrature_weights": (1.0, 1.0),
        }
    )
    u, v = _unknowns(ufl.split(unknown)), _unknowns(ufl.TestFunctions(unknown.ufl_function_space()))
    # UFL leaves out what is multiplied by zero.
    if not terms.loads:
        u, v = u._replace(rate=ufl.as_ufl(1)), v._replace(rate=ufl.as_ufl(0))
    if not terms.friction:
        u, v = u._replace(f=ufl.as_ufl(0)), v._replace(f=ufl.as_ufl(0))
    on, cell = _named(switches_of(terms), switches), _named(CHORD + pulley_data(terms), data)
    for values, names in ((on, MORE_SWITCHES), (cell, MORE)):
        vars(values).update(dict.fromkeys(set(names) - vars(values).keys(), ufl.as_ufl(0)))
    rod_data = SimpleNamespace(**dict.fromkeys(LOADS + OFFSET, ufl.as_ufl(0)))
    vars(rod_data).update(vars(_named(constants_of(terms), constants)))
    belt = belt_of(unknown, u, cell, rod_data)
    # Two integrals, each with one integrand: UFL's work for each of them is what a first solve waits for.
    inside = equilibrium(unknown, u, v, belt, cell, rod_data) + contact_conditions(u, v, belt, on, cell)
    return inside * at_gauss_points + joint_conditions(u, v, belt, on, cell, rod_data, terms) * at_ends


def belt_of(unknown: ufl.Coefficient, u: Unknowns, cell: SimpleNamespace, rod_data: SimpleNamespace) -> Belt:
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
    strains = rod.strains_in_frame(q, u.theta, d_sigma)
    cos, sin = ufl.cos(u.theta), ufl.sin(u.theta)
    e1 = ufl.as_vector([cell.cos * cos - cell.sin * sin, cell.sin * cos + cell.cos * sin])
    # Towards -e2, where the pulley is on the right; its derivative has the direction of e1.
    offset = cell.side * rod_data.offset
    bending = offset * strains.kappa
    slope = d_sigma(place + u.r) + bending * e1
    t = slope / ufl.sqrt(ufl.dot(slope, slope))
    n, e = ufl.as_vector([-t[1], t[0]]), rod.elongation((q[0] + bending * cos, q[1] + bending * sin))
    deviation = u.r - u.move * _way(cell)
    return Belt(place, deviation, excess, strains, e, t, n, length, offset, e1)


def equilibrium(
    unknown: ufl.Coefficient, u: Unknowns, v: Unknowns, belt: Belt, cell: SimpleNamespace, rod_data: SimpleNamespace
) -> Expr:
    """Weak equilibrium, with the energy (18.9): for all variations of r and theta

    delta int 1/2 (a kappa^2 + b1 eps^2 + b2 Gamma^2) dsigma - int (f t + s p n).delta r dsigma = 0   (18.17),

    where r is that of the touching fibre. Inertia adds -1/2 c^2 (rho A |r'|^2 + rho I kappa^2) to the energy, of which
    c is not varied, and weight -rho A g.r. A pulley that moves is in equilibrium with the force on it.
    """
    energy = rod.strain_energy(belt.strains, a=rod_data.a, b1=rod_data.b1, b2=rod_data.b2)
    energy -= u.rate**2 * rod.kinetic_energy(belt.strains, density=rod_data.density, inertia=rod_data.inertia)
    variation = ufl.as_vector([v.r[0], v.r[1], v.theta, *[0] * (unknown.ufl_shape[0] - 3)])
    elastic = ufl.derivative(energy * belt.length, unknown, variation)
    traction = belt.traction(u, cell)
    work = ufl.dot(traction, v.r + belt.offset * v.theta * belt.e1) + ufl.dot(_weight(rod_data), v.r)
    return elastic - work * belt.length


def contact_conditions(u: Unknowns, v: Unknowns, belt: Belt, on: SimpleNamespace, cell: SimpleNamespace) -> Expr:
    """What holds at each Gauss point on a pulley: the belt lies on it, and sticks or slides,

        |r - C| = R,    D = D_stick (18.15)  or  f = -s mu p (18.16);

    and the parts of equations of a pulley that are integrals: of friction, int f dsigma; of the angle along which it
    slides, int D / R dsigma; and of the force along the way of a pulley that moves.
    """
    g = contact.penetration_near(
        belt.place, belt.deviation, radius=cell.R, excess=belt.excess, offset=belt.offset, side=cell.side, e2=belt.e2
    )
    lies = v.p * on.touch * g
    slides = (on.touch - on.stick) * (u.f + on.sense * cell.mu * u.p)
    resultant = (on.force * on.touch * u.f + on.behind * (1 + belt.e) / cell.R) * belt.length
    pushed = on.touch * ufl.dot(belt.traction(u, cell), _way(cell)) * belt.length
    return lies + v.f * (on.stick * (belt.e - u.e) + slides) + v.e * resultant + v.move * pushed


def joint_conditions(
    u: Unknowns,
    v: Unknowns,
    belt: Belt,
    on: SimpleNamespace,
    cell: SimpleNamespace,
    rod_data: SimpleNamespace,
    terms: Terms,
) -> Expr:
    """What places each joint, and what the stretch in stick follows from: one equation for each scalar.

    run-up, run-off   (r - C).t = 0: no concentrated force
    other joints     x = x_trans,  c D_stick = R omega,  D = D_stick  or  f = -s mu p, of the stick next to it
    stretch in stick  D = D_stick  where the belt has the pulley's speed,  int f dsigma = -(torque + drag omega) / R
                      or  int D / R dsigma = slip angle
    transport rate    c D_stick = R omega, in a loop where no joint has this condition
    take-up           the force along its way
    """
    joints = v.sigma * on.tangent * ufl.dot(belt.r, belt.t)
    stretch = v.e * on.surface * (1 - on.force) * (belt.e - u.e)
    if not terms.friction:
        return joints + stretch - v.move * on.take_up * cell.force_along
    weight, square = _weight(rod_data), u.rate**2
    a, b1, b2, mass = rod_data.a - square * rod_data.inertia, rod_data.b1, rod_data.b2, square * rod_data.density
    own_weight = ufl.dot(belt.e1, weight), ufl.dot(belt.e2, weight)
    p, f = rod.tractions(
        belt.strains,
        1 + belt.e,
        side=cell.side,
        radius=cell.R,
        a=a,
        b1=b1,
        b2=b2,
        mass=mass,
        offset=belt.offset,
        weight=own_weight,
    )
    ahead = u.e + (u.rate - 1) * (1 + u.e) - cell.given
    joints += v.rate * on.runs * ahead + v.sigma * (
        on.x * (belt.r[0] - cell.given)
        + on.speed * ahead
        + on.coulomb * (f + on.sense * cell.mu * p)
        + on.stretch * (belt.e - u.e)
    )
    by_integral = v.e * (on.surface * on.force * (cell.given - cell.drag * u.rate * (1 + u.e)) + on.angle * cell.given)
    return joints + stretch - by_integral - v.move * on.take_up * cell.force_along


def _weight(rod_data: SimpleNamespace) -> Expr:
    return ufl.as_vector([rod_data.weight_x, rod_data.weight_y])


def _way(cell: SimpleNamespace) -> Expr:
    return ufl.as_vector([cell.way_x, cell.way_y])


def _unknowns(parts: Sequence[Expr]) -> Unknowns:
    """Parts of the mixed element; those that it has not are zero."""
    none = ufl.as_ufl(0)
    return Unknowns(*parts, *[none] * (len(Unknowns._fields) - len(parts)))


def _named(names: tuple[str, ...], values: Expr) -> SimpleNamespace:
    """Components by name."""
    return SimpleNamespace(**{name: values[i] for i, name in enumerate(names)})
