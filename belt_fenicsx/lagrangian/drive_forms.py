"""Forms for general drives: any number of pulleys on either side, loops, loads, and a fibre that touches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from scipy.interpolate import CubicHermiteSpline

from belt_fenicsx.backend import compat
from belt_fenicsx.lagrangian.forms import ROD_DEGREE
from belt_fenicsx.lagrangian.newton import Newton
from belt_fenicsx.lagrangian.nodes import map_slopes
from belt_fenicsx.lagrangian.space import CONTACT_DEGREE, HermiteSpace
from belt_fenicsx.lagrangian.track import Track
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.mechanics import contact, rod
from belt_fenicsx.scene.scene import Scene


class DriveState(NamedTuple):
    """Kinematics at points of the belt, arrays of one shape.

    Attributes:
        sigma: Material-length coordinate; a loop begins in the middle of its last span.
        weight: Gauss weight, a material length.
        x: Global coordinate x.
        y: Global coordinate y.
        theta: Angle of the cross-section, counted on along the belt.
        dx: x'.
        dy: y'.
        kappa: theta'.
        stretch: Stretch of the fibre that would touch the nearest pulley; its mean at both ends of a cell, where it is
            the same all along in stick.
        dD: Its derivative.
        g: Penetration into the nearest pulley, negative outside.
        pulley: Index of the nearest pulley.
    """

    sigma: Array
    weight: Array
    x: Array
    y: Array
    theta: Array
    dx: Array
    dy: Array
    kappa: Array
    stretch: Array
    dD: Array
    g: Array
    pulley: Array


class DriveProblem:
    """Forms, function spaces and Newton solver for one number of elements; made once, serves every scene.

    The mesh of a loop is a ring, on which the angle is a deviation from a uniform winding, as sigma is one from a
    uniform mesh: so nothing jumps where it closes. Each element knows the pulley that it is nearest to.

    Attributes:
        nodes: Material-length coordinates of this rank's nodes, from left to right ``(cells + 1,)``.
        slopes: d sigma/d eta there ``(cells + 1,)``.
        points: Material-length coordinates of the Gauss points between them ``(cells, points)``.
    """

    def __init__(
        self, elements: int, comm: MPI.Comm, options: Mapping[str, Any], *, frictional: bool, closed: bool
    ) -> None:
        self.elements, self.frictional, self.closed = elements, frictional, closed
        self.space = space = HermiteSpace(elements, comm, closed=closed)
        names = ("a", "b1", "b2", "mass", "rotary")
        self.constants = {name: fem.Constant(space.mesh, np.float64(1.0)) for name in names}
        self.weight, self.winding = fem.Constant(space.mesh, np.ones(2)), fem.Constant(space.mesh, np.float64(0.0))
        # The share of the belt before a point, and the pulley next to it: radius, centre, offset of the fibre.
        self.share, self._share_dofs = space.cellwise(compat.broken(1))
        self.circle, self._circle_dofs = space.cellwise(compat.broken(0, size=4))
        self.lambda_p, self.lambda_f, self.penalty = (fem.Function(space.gauss) for _ in range(3))
        at = space.first + np.arange(len(space.eta))
        self._shares = np.column_stack([at, at + 1]) / elements
        self.share.x.array[self._share_dofs] = self._shares

        r, deviation = ufl.split(space.w)
        theta = deviation + self.winding * self.share
        # In the last cell of a ring the mesh's coordinate runs backwards.
        slope = space.sigma.dx(0) + self.share.dx(0)
        d_sigma = rod.along_slope(slope)
        e1 = ufl.as_vector([ufl.cos(theta), ufl.sin(theta)])
        d = self.circle[3]
        fibre_slope = d_sigma(r) + d * d_sigma(theta) * e1
        D = ufl.sqrt(ufl.dot(fibre_slope, fibre_slope))
        self.residual = self._residual(r, theta, d_sigma, abs(slope), fibre_slope / D)
        self.jacobian = ufl.derivative(self.residual, space.w)
        components = (r[0], r[1], theta, *d_sigma(r), d_sigma(theta), d_sigma(D))
        for form in (self.residual, self.jacobian):
            form.signature()
        self._state = fem.Expression(ufl.as_vector(components), space.points)
        self.newton = Newton(self.residual, self.jacobian, space.w, space.clamped, options)

    def _residual(self, r: Any, theta: Any, d_sigma: rod.Derivative, scale: Any, t: Any) -> Any:
        """First variation of strain energy, motion, weight, pressure and friction; the tangent t is not varied."""
        space, w, constants = self.space, self.space.w, self.constants
        dx_rod, dx_contact = space.dx(ROD_DEGREE), space.dx(CONTACT_DEGREE)
        stiffness = {name: constants[name] for name in ("a", "b1", "b2")}
        strains = rod.strains(r, theta, d_sigma)
        U = rod.strain_energy(strains, **stiffness)
        T = rod.kinetic_energy(strains, density=constants["mass"], inertia=constants["rotary"])
        energy = (U - T - ufl.dot(self.weight, r)) * scale * dx_rod
        touching = contact.fibre(r, theta, offset=self.circle[3])
        center = ufl.as_vector([self.circle[1], self.circle[2]])
        g = contact.penetration(touching, radius=self.circle[0], center=center)
        energy += contact.normal_potential(g, lambda_p=self.lambda_p, penalty=self.penalty) * scale * dx_contact
        F = ufl.derivative(energy, w)
        if self.frictional:
            moved = ufl.derivative(touching, w, ufl.TestFunction(w.function_space))
            F -= self.lambda_f * ufl.dot(t, moved) * scale * dx_contact
        return F

    def load(self, scene: Scene, nodes: Array) -> None:
        """Sets the parameters of a scene, the nodes' material-length coordinates ``(elements + 1,)`` and sigma(eta)."""
        belt, space = scene.belt, self.space
        self.scene, self.track = scene, Track.of(scene)
        for name, stiffness in (("a", "bending"), ("b1", "extensional"), ("b2", "shear")):
            self.constants[name].value = getattr(belt, f"{stiffness}_stiffness")
        self.weight.value[:] = belt.line_density * np.array(scene.gravity)
        self.winding.value = self.track.winding
        own = slice(space.first, space.first + len(space.eta) + 1)
        self.nodes, self.slopes = nodes[own], map_slopes(nodes, closed=self.closed)[own]
        self._share_at = (space.first + np.arange(len(self.nodes))) / self.elements
        space.set_map(self.nodes + 0.5 - self._share_at, self.slopes - 1.0 / self.elements)
        eta = space.first + np.arange(len(self.nodes))
        spline = CubicHermiteSpline(eta, self.nodes, self.slopes)
        self.points, self.weights = spline(space.eta), spline(space.eta, 1) * space.weights
        middles = (self.nodes[1:] + self.nodes[:-1]) / 2
        self.pulleys = np.clip(np.searchsorted(self.track.watersheds, middles) - 1, 0, len(scene.pulleys) - 1)
        self.circles = np.array([[p.radius, *p.center, p.turn * belt.contact_offset] for p in scene.pulleys])
        self.circle.x.array[self._circle_dofs] = self.circles[self.pulleys]
        for function in (self.circle, self.share):
            function.x.scatter_forward()
        if self.closed:
            # A loop is free to run round; one component of one place keeps it where it is.
            self.axis = int(abs(self.track.direction[1]) > abs(self.track.direction[0]))
            self.newton.fix(space.first_node(self.axis))

    def set_rate(self, rate: float) -> None:
        """Sets the transport rate, on which the forces of inertia depend."""
        belt = self.scene.belt
        self.constants["mass"].value = belt.line_density * rate**2
        self.constants["rotary"].value = belt.rotary_inertia * rate**2

    def set_state(self, values: Array, slopes: Array) -> None:
        """Sets x, y, theta and their derivatives by sigma at this rank's nodes ``(cells + 1, 3)``."""
        values, slopes = values.copy(), slopes * self.slopes[:, np.newaxis]
        values[:, 2] -= self.track.winding * self._share_at
        slopes[:, 2] -= self.track.winding / self.elements
        self.space.set_state(values, slopes)

    def set_penalty(self, penalty: Array) -> None:
        """Sets the penalty at the Gauss points of the owned cells, ``(cells, points)`` or ``(cells, 1)``."""
        self.space.set_gauss(self.penalty, penalty)

    def set_multipliers(self, lambda_p: Array, lambda_f: Array) -> None:
        """Sets the multipliers at the Gauss points of the owned cells ``(cells, points)``."""
        self.space.set_gauss(self.lambda_p, lambda_p)
        if self.frictional:
            self.space.set_gauss(self.lambda_f, lambda_f)

    def state(self) -> DriveState:
        """The present state at the Gauss points of the owned cells ``(cells, points)``."""
        *place, dD = np.moveaxis(self.space.at_gauss(self._state), -1, 0)
        # What D grows by in each cell is known better than from two points, whose errors would add up in stick.
        before, after = (self._at_nodes(at, self.pulleys).stretch for at in (slice(None, -1), slice(1, None)))
        grown = after - before - np.sum(self.weights * dD, axis=1)
        dD = dD + (grown / self.weights.sum(axis=1))[:, np.newaxis]
        state = self._state_at(self.points, self.weights, tuple(place), dD, self.pulleys[:, np.newaxis])
        return state._replace(stretch=np.broadcast_to((before + after)[:, np.newaxis] / 2.0, dD.shape))

    def ends(self) -> DriveState:
        """The present state at the belt's ends that this rank has, without weight ``(n,)``."""
        first, last = self.space.first == 0, self.space.first + len(self.nodes) - 1 == self.elements
        at = np.array([0] * first + [len(self.nodes) - 1] * last, dtype=int)
        return self._at_nodes(at, self.pulleys[at - (at > 0)])

    def _at_nodes(self, at: Any, pulley: Array) -> DriveState:
        """The present state at this rank's nodes, without weight, as seen from pulleys ``(n,)``."""
        values, slopes = self.space.nodal()[:, at]
        values[:, 2] += self.track.winding * self._share_at[at]
        slopes[:, 2] += self.track.winding / self.elements
        place, zero = (*values.T, *(slopes / self.slopes[at, np.newaxis]).T), np.zeros(len(pulley))
        return self._state_at(self.nodes[at], zero, place, zero, pulley)

    def _state_at(self, sigma: Array, weight: Array, place: tuple[Array, ...], dD: Array, pulley: Array) -> DriveState:
        """A state from x, y, theta and their derivatives by sigma."""
        x, y, theta, dx, dy, kappa = place
        radius, xc, yc, d = np.moveaxis(self.circles[pulley], -1, 0)
        cos, sin = np.cos(theta), np.sin(theta)
        g = radius - np.hypot(x + d * sin - xc, y - d * cos - yc)
        D = np.hypot(dx + d * kappa * cos, dy + d * kappa * sin)
        number = np.broadcast_to(pulley, x.shape).astype(float)
        return DriveState(sigma, weight, x, y, theta, dx, dy, kappa, D, dD, g, number)
