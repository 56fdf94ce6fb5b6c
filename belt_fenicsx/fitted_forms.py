"""The fitted method in UFL: one set of forms for each degree, which serves every scene and every list of zones.

The mesh is of unit cells (eta). Its map to the belt is an unknown like the others: sigma(eta), piecewise linear, whose
values at the borders of zones are free. So are the stretch in stick, constant along the belt, and on the pulley the
pressure p and the friction f. Everything that tells zones and scenes apart is data: constants, and one-sided values
at the nodes of each cell that switch equations on. The derivative of the residual in the direction of sigma is what
moves the borders.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI

from belt_fenicsx import compat, contact, elements, rod
from belt_fenicsx.fields import Array

CONSTANTS = ("a", "b1", "b2", "R", "xc", "H", "mu", "x_trans", "D_given", "force_given")
SWITCHES = ("touch", "stick", "sense", "tangent", "x", "speed", "coulomb", "hold", "grip", "force")


@dataclass(frozen=True)
class Forms:
    """Compiled forms on a mesh of unit cells, the functions they read, and where their dofs are.

    Each cell's dofs stand in the order r (x, y of each node), theta, p, f, sigma, stretch in stick; each field's in
    the order left node, right node, inner nodes. p and f live at the Gauss points.

    Attributes:
        degree: Degree k of r and theta.
        unknown: The function of all unknowns.
        switches: Values of ``SWITCHES`` on both sides of each cell ``(cells, 2, len(SWITCHES))``.
        constants: Values of ``CONSTANTS``.
        F: Residual.
        J: Its derivative.
        dofs: Dofs of each cell, from left to right ``(cells, 5 k + 7)``.
    """

    degree: int
    unknown: fem.Function
    switches: fem.Function
    constants: fem.Constant
    F: fem.Form
    J: fem.Form
    dofs: Array

    def residual(self, b: Array) -> None:
        """Assembles F into ``b``."""
        b[:] = 0.0
        fem.assemble_vector(b, self.F)

    def jacobians(self, stack: Array) -> None:
        """Puts each cell's Jacobian into ``stack`` ``(cells, 5 k + 7, 5 k + 7)``.

        A matrix of PETSc would take several times as long to fill as the Jacobians to compute.
        """
        rows = iter(stack.reshape(len(stack), -1))

        def insert(_rows: Array, _columns: Array, values: Array) -> int:
            next(rows)[:] = values.ravel()
            return 0

        elements.assemble_cells(insert, self.J)


@functools.cache
def forms(degree: int, cells: int) -> Forms:
    """The forms of one degree on a mesh of so many cells; made once in a process.

    A scene is small, so each rank has a mesh of its own and solves all of it.
    """
    domain = mesh.create_interval(MPI.COMM_SELF, cells, [0.0, float(cells)])
    node, traction, linear = elements.lagrange(degree), elements.gauss(degree), elements.lagrange(1)
    V = compat.function_space(
        domain, compat.mixed(elements.lagrange(degree, size=2), node, traction, traction, linear, linear)
    )
    W = compat.function_space(domain, elements.one_sided(len(SWITCHES)))
    unknown, switches = fem.Function(V), fem.Function(W)
    constants = fem.Constant(domain, np.zeros(len(CONSTANTS)))
    F = residual(unknown, switches, constants, degree)
    J = ufl.derivative(F, unknown, ufl.TrialFunction(V))
    # In UFL 2022 the signature of a form, by which its compiled code is found again, depends on what was compiled
    # before in the same process; unless it was asked for by then.
    for form in (F, J):
        form.signature()
    return Forms(
        degree=degree, unknown=unknown, switches=switches, constants=constants,
        F=fem.form(F), J=fem.form(J), dofs=compat.table(V.dofmap.list),
    )  # fmt: skip


def residual(unknown: fem.Function, switches: fem.Function, constants: fem.Constant, degree: int) -> Any:
    """Weak equilibrium, the pulley's conditions at the Gauss points, and the conditions at the borders."""
    r, theta, p, f, sigma, D_stick = ufl.split(unknown)
    v_r, v_theta, v_p, v_f, v_sigma, v_D = ufl.TestFunctions(unknown.function_space)
    given = dict(zip(CONSTANTS, (constants[i] for i in range(len(CONSTANTS))), strict=True))
    on = dict(zip(SWITCHES, (switches[i] for i in range(len(SWITCHES))), strict=True))
    center = ufl.as_vector([given["xc"], given["H"]])
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
    D, t = rod.stretch(r, d_sigma), rod.tangent(r, d_sigma)
    n = ufl.as_vector([-t[1], t[0]])
    energy = rod.strain_energy(rod.strains(r, theta, d_sigma), a=given["a"], b1=given["b1"], b2=given["b2"])
    # Few integrals, each with one integrand: UFL's work for each of them is what a first solve waits for.
    elastic = ufl.derivative(
        energy * sigma.dx(0) * at_gauss_points, unknown, ufl.as_vector([v_r[0], v_r[1], v_theta, 0, 0, 0, 0])
    )
    gap = contact.penetration(r, radius=given["R"], center=center)
    coulomb = f + on["sense"] * given["mu"] * p
    pulley = (
        v_p * on["touch"] * gap
        + v_f * (on["stick"] * (D - D_stick) + (on["touch"] - on["stick"]) * coulomb)
        - ufl.dot(f * t + p * n, v_r) * sigma.dx(0)
        + v_D * on["force"] * on["touch"] * f * sigma.dx(0)
    ) * at_gauss_points
    borders = (
        v_sigma
        * (
            on["tangent"] * ufl.dot(r - center, t)
            + on["x"] * (r[0] - given["x_trans"])
            + on["speed"] * (D_stick - given["D_given"])
            + on["coulomb"] * coulomb
            + on["hold"] * (D - D_stick)
        )
        + v_D * on["grip"] * ((1 - on["force"]) * (D - D_stick) - on["force"] * given["force_given"])
    ) * at_nodes
    return elastic + pulley + borders


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
    # In Chebyshev polynomials, which keeps the conversion well-conditioned for all degrees in use.
    chebyshev = np.polynomial.chebyshev
    to_coefficients = np.linalg.inv(chebyshev.chebvander(2 * nodes - 1, nodes.size - 1))
    values = chebyshev.chebvander(2 * at - 1, nodes.size - 1) @ to_coefficients
    slopes = chebyshev.chebder(to_coefficients, scl=2) if nodes.size > 1 else np.zeros((1, 1))
    return values, chebyshev.chebvander(2 * at - 1, max(nodes.size - 2, 0)) @ slopes


@functools.cache
def prolongation(coarse: int, fine: int) -> tuple[Array, Array]:
    """Maps from one degree to another: of values at the nodes, and of values at the Gauss points."""
    (nodes, gauss), (fine_nodes, fine_gauss) = points(coarse), points(fine)
    return lagrange_basis(nodes, fine_nodes)[0], lagrange_basis(gauss, fine_gauss)[0]
