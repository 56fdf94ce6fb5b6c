"""Forms of the augmented-Lagrangian method, energy first, then `ufl.derivative`; and the state that they are for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from scipy.interpolate import CubicHermiteSpline

from belt_fenicsx.lagrangian.newton import Newton
from belt_fenicsx.lagrangian.nodes import map_slopes
from belt_fenicsx.lagrangian.space import CONTACT_DEGREE, HermiteSpace
from belt_fenicsx.lagrangian.state import State, slip_share
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.mechanics import contact, rod
from belt_fenicsx.scene.scene import Scene

# The strain energy is integrated with three Gauss points, which this degree takes, as in the source.
ROD_DEGREE = 5


class Problem:
    """Forms, function spaces and Newton solver for one number of elements; made once, serves every scene.

    Attributes:
        nodes: Material-length coordinates of this rank's nodes, from left to right ``(cells + 1,)``.
        slopes: d sigma/d eta there ``(cells + 1,)``.
        points: Material-length coordinates of the Gauss points between them ``(cells, points)``.
    """

    def __init__(self, elements: int, comm: MPI.Comm, options: Mapping[str, Any], *, frictional: bool) -> None:
        self.elements, self.frictional = elements, frictional
        self.space = space = HermiteSpace(elements, comm)
        self.stiffness = {name: fem.Constant(space.mesh, np.float64(1.0)) for name in ("a", "b1", "b2")}
        # One constant (R, xc, H): DOLFINx 0.5 numbers several in an expression by their hash, and compiles anew.
        self.circle = fem.Constant(space.mesh, np.ones(3))
        self.lambda_p, self.lambda_f, self.penalty = (fem.Function(space.gauss) for _ in range(3))

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
        self._state = fem.Expression(ufl.as_vector(components), space.points)
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
        belt, self.pulley = scene.belt, scene.pulleys[0]
        self.stiffness["a"].value = belt.bending_stiffness
        self.stiffness["b1"].value = belt.extensional_stiffness
        self.stiffness["b2"].value = belt.shear_stiffness
        self.circle.value[:] = (self.pulley.radius, *self.pulley.center)
        own = slice(self.space.first, self.space.first + len(self.space.eta) + 1)
        self.nodes, self.slopes = nodes[own], map_slopes(nodes)[own]
        self.space.set_map(self.nodes, self.slopes)
        eta = self.space.first + np.arange(len(self.nodes))
        self.points = CubicHermiteSpline(eta, self.nodes, self.slopes)(self.space.eta)
        self._clamps = [end for end, node in ((0, nodes[0]), (-1, nodes[-1])) if self.nodes[end] == node]

    def set_state(self, values: Array, slopes: Array) -> None:
        """Sets x, y, theta and their derivatives by sigma at this rank's nodes ``(cells + 1, 3)``."""
        self.space.set_state(values, slopes * self.slopes[:, np.newaxis])

    def set_penalty(self, penalty: Array) -> None:
        """Sets the penalty at the Gauss points of the owned cells, ``(cells, points)`` or ``(cells, 1)``."""
        self.space.set_gauss(self.penalty, penalty)

    def set_multipliers(self, lambda_p: Array, lambda_f: Array) -> None:
        """Sets the multipliers at the Gauss points of the owned cells ``(cells, points)``."""
        self.space.set_gauss(self.lambda_p, lambda_p)
        if self.frictional:
            self.space.set_gauss(self.lambda_f, lambda_f)

    def state(self) -> State:
        """The present state at the Gauss points of the owned cells ``(cells, points)``."""
        sigma, scale, x, y, theta, dx, dy, kappa, dD, g = np.moveaxis(self.space.at_gauss(self._state), -1, 0)
        weight = scale * self.space.weights
        share = slip_share(x, np.abs(dx) * weight, self.pulley)
        return State(sigma, weight, x, y, theta, dx, dy, kappa, dD, g, share)

    def clamps(self) -> State:
        """The present state at the clamps that this rank has, which are free and without weight ``(n,)``."""
        values, slopes = self.space.nodal()[:, self._clamps]
        (x, y, theta), (dx, dy, kappa) = values.T, (slopes / self.slopes[self._clamps, np.newaxis]).T
        g = self.pulley.radius - np.hypot(x - self.pulley.center[0], y - self.pulley.center[1])
        zero = np.zeros_like(x)
        return State(self.nodes[self._clamps], zero, x, y, theta, dx, dy, kappa, zero, g, zero)
