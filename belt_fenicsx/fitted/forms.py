"""The fitted method in UFL: one set of forms for each degree, which serves every scene and every list of zones.

All cells are unit cells (eta). Their map to the belt is an unknown like the others: sigma(eta), piecewise linear, whose
values at the borders of zones are free. So are the stretch in stick, constant along the belt, and on the pulley the
pressure p and the friction f. Everything that tells zones and scenes apart is data: constants, and one-sided values
at the nodes of each cell that switch equations on. The derivative of the residual in the direction of sigma is what
moves the borders.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import basix
import numpy as np
import ufl

from belt_fenicsx.backend import compat
from belt_fenicsx.fitted import elements
from belt_fenicsx.fitted.kernels import Kernel, compiled
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.mechanics import contact, rod

CONSTANTS = ("a", "b1", "b2", "R", "mu", "x_trans", "elongation_given", "force_given")
# The chord of a cell: its left end as seen from the pulley's centre, and the vector to its right end; R^2 less the
# squares of both ends' distances from the centre; cosine and sine of the angle of its frame; the chord in this frame
# over the cell's length, less one along the first axis; and that length. Then the bulge of the parabola over it, about
# the arc of the pulley, from which r deviates, and the two small numbers that go with it.
CHORD = (
    "x", "y", "along_x", "along_y", "excess_left", "excess_right", "cos", "sin", "q1", "q2", "length",
    "bulge_x", "bulge_y", "flat", "skew",
)  # fmt: skip
SWITCHES = ("touch", "stick", "sense", "tangent", "x", "speed", "coulomb", "hold", "grip", "force")


@dataclass(frozen=True)
class Forms:
    """Compiled forms of one cell.

    Their coefficients are the cell's unknowns, in the order r (x, y of each node), theta, p, f, sigma, elongation D - 1
    in stick; each field's in the order left node, right node, inner nodes; p and f live at the Gauss points. Then the
    values of ``SWITCHES`` on both sides of the cell; then those of ``CHORD``, from which r and theta deviate. Their
    constants are ``CONSTANTS``, x_trans from the pulley's centre.

    Attributes:
        F: Residual ``(5 k + 6,)``.
        J: Its derivative ``(5 k + 6, 5 k + 6)``.
    """

    F: Kernel
    J: Kernel


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
    # Numbered here: UFL would count on in one process, and compiled code is found again by its form's numbers, too.
    unknown, switches, chord = (
        ufl.Coefficient(ufl.FunctionSpace(line, element), count=count)
        for count, element in enumerate((mixed, elements.one_sided(len(SWITCHES)), elements.gauss(1, size=len(CHORD))))
    )
    constants = ufl.Constant(line, shape=(len(CONSTANTS),), count=0)
    F = residual(unknown, switches, chord, constants, degree, friction)
    return F, ufl.derivative(F, unknown, ufl.TrialFunction(unknown.ufl_function_space()))


def residual(
    unknown: ufl.Coefficient,
    switches: ufl.Coefficient,
    chord: ufl.Coefficient,
    constants: ufl.Constant,
    degree: int,
    friction: bool,
) -> ufl.Form:
    """Weak equilibrium, the pulley's conditions at the Gauss points, and the conditions at the borders."""
    deviation, turn, p, f, sigma, e_stick = ufl.split(unknown)
    (eta,) = ufl.SpatialCoordinate(unknown.ufl_function_space().ufl_domain())
    cell = dict(zip(CHORD, (chord[i] for i in range(len(CHORD))), strict=True))
    arm, along, bulge = (
        ufl.as_vector([cell[x], cell[y]]) for x, y in (("x", "y"), ("along_x", "along_y"), ("bulge_x", "bulge_y"))
    )
    place = arm + eta * along + eta * (1 - eta) * bulge
    r = place + deviation
    v_r, v_theta, v_p, v_f, v_sigma, v_D = ufl.TestFunctions(unknown.ufl_function_space())
    given = dict(zip(CONSTANTS, (constants[i] for i in range(len(CONSTANTS))), strict=True))
    on = dict(zip(SWITCHES, (switches[i] for i in range(len(SWITCHES))), strict=True))
    at_gauss_points = ufl.dx(metadata={"quadrature_degree": 2 * degree - 1, "quadrature_rule": "default"})
    at_nodes = ufl.dx(
        metadata={
            "quadrature_degree": 1,
            "quadrature_rule": "custom",
            "quadrature_points": ((0.0,), (1.0,)),
            "quadrature_weights": (1.0, 1.0),
        }
    )

    d_sigma = rod.along(sigma)
    t = rod.tangent(r, d_sigma)
    n = ufl.as_vector([-t[1], t[0]])
    # The length in the chord's data is the value of sigma', which varies here.
    shorter, bent = cell["length"] / sigma.dx(0) - 1, d_sigma(deviation) + (1 - 2 * eta) / sigma.dx(0) * bulge
    q = (
        cell["q1"] + (1 + cell["q1"]) * shorter + cell["cos"] * bent[0] + cell["sin"] * bent[1],
        cell["q2"] + cell["q2"] * shorter + cell["cos"] * bent[1] - cell["sin"] * bent[0],
    )
    strains, e = rod.strains_in_frame(q, turn, d_sigma), rod.elongation(q)
    energy = rod.strain_energy(strains, a=given["a"], b1=given["b1"], b2=given["b2"])
    # Two integrals, each with one integrand: UFL's work for each of them is what a first solve waits for.
    elastic = ufl.derivative(
        energy * sigma.dx(0) * at_gauss_points, unknown, ufl.as_vector([v_r[0], v_r[1], v_theta, 0, 0, 0, 0])
    )
    ends = cell["excess_left"], cell["excess_right"]
    excess = contact.excess_on_parabola(eta, ends=ends, flat=cell["flat"], skew=cell["skew"], bulge=bulge)
    pulley = v_p * on["touch"] * contact.penetration_near(place, deviation, radius=given["R"], excess=excess)
    pulley -= ufl.dot(p * n, v_r) * sigma.dx(0)
    borders = v_sigma * on["tangent"] * ufl.dot(r, t)
    borders += v_D * on["grip"] * (1 - on["force"]) * (e - e_stick)
    if friction:
        coulomb = f + on["sense"] * given["mu"] * p
        pulley += v_f * (on["stick"] * (e - e_stick) + (on["touch"] - on["stick"]) * coulomb)
        pulley -= ufl.dot(f * t, v_r) * sigma.dx(0)
        pulley += v_D * on["force"] * on["touch"] * f * sigma.dx(0)
        p_stick, f_stick = rod.tractions(strains, 1 + e, radius=given["R"], b1=given["b1"], b2=given["b2"])
        borders += v_sigma * (
            on["x"] * (r[0] - given["x_trans"])
            + on["speed"] * (e_stick - given["elongation_given"])
            + on["coulomb"] * (f_stick + on["sense"] * given["mu"] * p_stick)
            + on["hold"] * (e - e_stick)
        )
        borders -= v_D * on["grip"] * on["force"] * given["force_given"]
    return elastic + pulley * at_gauss_points + borders * at_nodes


@functools.cache
def points(degree: int) -> tuple[Array, Array]:
    """The reference cell's nodes, left, right and inner, and its Gauss points."""
    return elements.points(degree), elements.points(degree - 1, elements.GAUSS)


@functools.cache
def gauss_weights(degree: int) -> Array:
    """Weights of the Gauss points."""
    return np.asarray(basix.make_quadrature(basix.CellType.interval, 2 * degree - 1)[1])


def lagrange_basis(nodes: Array, at: Array) -> tuple[Array, Array]:
    """Lagrange polynomials through ``nodes`` ``(n,)``, and their derivatives, at ``at`` ``(m,)``.

    Returns:
        Two arrays ``(m, n)``.
    """
    values, slopes = _in_chebyshev_polynomials(nodes.tobytes())
    chebyshev = np.polynomial.chebyshev.chebvander(2 * at - 1, nodes.size - 1)
    return chebyshev @ values, chebyshev[:, : len(slopes)] @ slopes


@functools.cache
def _in_chebyshev_polynomials(nodes: bytes) -> tuple[Array, Array]:
    """Coefficients of Lagrange polynomials, and of their derivatives: well-conditioned for all degrees in use."""
    at = np.frombuffer(nodes)
    chebyshev = np.polynomial.chebyshev
    values = np.linalg.inv(chebyshev.chebvander(2 * at - 1, at.size - 1))
    return values, chebyshev.chebder(values, scl=2) if at.size > 1 else np.zeros((1, 1))
