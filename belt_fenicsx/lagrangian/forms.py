"""Forms of the augmented-Lagrangian method: energy first, then `ufl.derivative`; and the state at the Gauss points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from scipy.interpolate import CubicHermiteSpline

from belt_fenicsx.lagrangian.newton import Newton
from belt_fenicsx.lagrangian.nodes import map_slopes
from belt_fenicsx.lagrangian.space import CONTACT_DEGREE, HermiteSpace
from belt_fenicsx.mechanics import contact, rod
from belt_fenicsx.scene.scene import Scene

Array = np.ndarray

# Three Gauss points for the strain energy, as in the source.
ROD_DEGREE = 5


@dataclass(frozen=True)
class State:
    """Kinematics at the Gauss points of the owned cells, arrays ``(cells, points, ...)``.

    Attributes:
        sigma: Material-length coordinate.
        weights: Gauss weights times d sigma/d eta.
        r: Position.
        theta: Angle of the cross-section.
        dr: r' = D t.
        kappa: theta'.
        dD: D'.
        g: Penetration, negative outside the pulley.
    """

    sigma: Array
    weights: Array
    r: Array
    theta: Array
    dr: Array
    kappa: Array
    dD: Array
    g: Array

    @property
    def D(self) -> Array:
        """Stretch."""
        return np.hypot(self.dr[..., 0], self.dr[..., 1])


class Problem:
    """Forms, function spaces and Newton solver for one number of elements; made once, serves every scene.

    Attributes:
        nodes: Material-length coordinates of this rank's nodes, from left to right ``(cells + 1,)``.
        slopes: d sigma/d eta there ``(cells + 1,)``.
    """

    def __init__(self, elements: int, comm: MPI.Comm, options: Mapping[str, Any], *, frictional: bool) -> None:
        self.elements, self.frictional = elements, frictional
        self.space = space = HermiteSpace(elements, comm)
        self.stiffness = {name: fem.Constant(space.mesh, np.float64(1.0)) for name in ("a", "b1", "b2")}
        # One constant (R, xc, H): DOLFINx 0.5 numbers several in an expression by their hash, and compiles anew.
        self.circle = fem.Constant(space.mesh, np.ones(3))
        self.lambda_p, self.lambda_f, self.penalty = (space.gauss_function() for _ in range(3))

        r, theta = ufl.split(space.w)
        d_sigma = rod.along(space.sigma)
        g = contact.penetration(r, radius=self.circle[0], center=ufl.as_vector([self.circle[1], self.circle[2]]))
        self.residual = self._residual(r, theta, d_sigma, g)
        self.jacobian = ufl.derivative(self.residual, space.w)
        sigma, D = space.sigma, rod.stretch(r, d_sigma)
        components = (sigma, sigma.dx(0), r[0], r[1], theta, *d_sigma(r), d_sigma(theta), d_sigma(D), g)
        # UFL 2022 names forms by the numbers of their indices, which compiling counts up. So all names come first, lest
        # a form is compiled twice.
        for form in (self.residual, self.jacobian):
            form.signature()
        self._state = space.expression(ufl.as_vector(components))
        self.newton = Newton(self.residual, self.jacobian, space.w, space.clamped, options)

    def _residual(self, r: Any, theta: Any, d_sigma: rod.Derivative, g: Any) -> Any:
        """First variation (18.8) of strain energy, pressure and friction; in the last the tangent is not varied.

        Contact is integrated along the whole belt. On the half of it that is near the pulley alone, the Jacobian took
        9 % less time, the residual 14 %, and the state after it 60 %: 7 % of an update, for a zone that has to be
        guessed and watched.
        """
        space, w = self.space, self.space.w
        scale, dx_rod, dx_contact = space.sigma.dx(0), space.dx(ROD_DEGREE), space.dx(CONTACT_DEGREE)
        U = rod.strain_energy(rod.strains(r, theta, d_sigma), **self.stiffness) * scale * dx_rod
        V = contact.normal_potential(g, lambda_p=self.lambda_p, penalty=self.penalty) * scale * dx_contact
        if not self.frictional:
            return ufl.derivative(U + V, w)
        frozen = fem.Function(w.function_space)
        t = rod.tangent(ufl.split(frozen)[0], d_sigma)
        V_f = contact.friction_potential(r, lambda_f=self.lambda_f, t=t) * scale * dx_contact
        return ufl.replace(ufl.derivative(U + V + V_f, w), {frozen: w})

    def load(self, scene: Scene, nodes: Array) -> None:
        """Sets the parameters of a scene, the nodes' material-length coordinates ``(elements + 1,)`` and sigma(eta)."""
        belt, pulley = scene.belt, scene.pulleys[0]
        self.stiffness["a"].value = belt.bending_stiffness
        self.stiffness["b1"].value = belt.extensional_stiffness
        self.stiffness["b2"].value = belt.shear_stiffness
        self.circle.value[:] = (pulley.radius, *pulley.center)
        own = slice(self.space.first, self.space.first + len(self.space.eta) + 1)
        self.nodes, self.slopes = nodes[own], map_slopes(nodes)[own]
        self.space.set_map(self.nodes, self.slopes)

    def gauss_points(self) -> Array:
        """Material-length coordinates of the owned cells' Gauss points ``(cells, points)``."""
        eta = self.space.first + np.arange(len(self.nodes))
        return CubicHermiteSpline(eta, self.nodes, self.slopes)(self.space.eta)

    def sizes(self) -> Array:
        """Sizes of the owned cells ``(cells,)``."""
        return np.diff(self.nodes)

    def set_penalty(self, penalty: Array) -> None:
        """Sets the penalty at the Gauss points of the owned cells ``(cells, points)``."""
        self.space.set_gauss(self.penalty, penalty)

    def set_multipliers(self, lambda_p: Array, lambda_f: Array) -> None:
        """Sets the multipliers at the Gauss points of the owned cells ``(cells, points)``."""
        self.space.set_gauss(self.lambda_p, lambda_p)
        if self.frictional:
            self.space.set_gauss(self.lambda_f, lambda_f)

    def state(self) -> State:
        """The present state at the Gauss points of the owned cells."""
        sigma, scale, x, y, theta, dx, dy, kappa, dD, g = np.moveaxis(self.space.at_gauss(self._state), -1, 0)
        return State(
            sigma=sigma,
            weights=scale * self.space.weights,
            r=np.stack([x, y], axis=-1),
            theta=theta,
            dr=np.stack([dx, dy], axis=-1),
            kappa=kappa,
            dD=dD,
            g=g,
        )

    def destroy(self) -> None:
        """Frees what PETSc holds; collective."""
        self.newton.destroy()
