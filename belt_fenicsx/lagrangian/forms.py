"""Forms of the augmented-Lagrangian method, energy first, then `ufl.derivative`; and the state that they are for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import basix
import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from belt_fenicsx.backend import compat
from belt_fenicsx.lagrangian.newton import Newton
from belt_fenicsx.lagrangian.nodes import map_slopes
from belt_fenicsx.lagrangian.space import CONTACT_DEGREE, HermiteSpace
from belt_fenicsx.lagrangian.state import State
from belt_fenicsx.lagrangian.taut import TautBelt
from belt_fenicsx.layout.arrays import Array, places
from belt_fenicsx.layout.hermite import basis, in_unit_cells
from belt_fenicsx.mechanics import contact, rod
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.reading import directions

# The strain energy is integrated with three Gauss points, which this degree takes, as in the source.
ROD_DEGREE = 5


class Terms(NamedTuple):
    """What the forms of a scene have, beside numbers.

    Attributes:
        frictional: Whether some pulley has friction.
        closed: Whether the belt is a loop.
        offset: Whether another fibre than the middle line touches the pulleys.
    """

    frictional: bool = True
    closed: bool = False
    offset: bool = False

    @classmethod
    def of(cls, scene: Scene) -> Terms:
        """Those of a scene."""
        return cls(any(p.friction > 0.0 for p in scene.pulleys), scene.closed, scene.belt.contact_offset != 0.0)


class Kinematics(NamedTuple):
    """What energy and pressure follow from.

    Attributes:
        strains: Strains of the middle line.
        g: Penetration.
    """

    strains: rod.Strains
    g: Any


class Problem:
    """Forms, function spaces and Newton solver for one number of elements; made once, serves every scene.

    The mesh of a loop is a ring, on which the angle is a deviation from a uniform winding, as sigma is one from a
    uniform mesh: so nothing jumps where it closes. Each element knows the pulley that it is nearest to.

    The unknown is by how much r and theta deviate from those that were set. Positions alone would not do, as their
    rounding errors grow: a penetration R - |r - C| has one of eps R, at each point another, of which the penalty makes
    P eps R of pressure, and a strain r' - 1 one of eps r/size. On 800 elements the former is 2e-8 of the pressure. A
    torque, where the sliding is given, is a sum of pressures; with positions alone it differed by 5e-11 from one number
    of ranks to another, and by 4e-12 with a better penetration. So both start from what is known of the state that was
    set, with more digits, and the deviation adds the rest.

    Attributes:
        nodes: Material-length coordinates of this rank's nodes, from left to right ``(cells + 1,)``.
        slopes: d sigma/d eta there ``(cells + 1,)``.
        points: Material-length coordinates of the Gauss points of all ranks ``(elements, points)``.
        weights: Their Gauss weights ``(elements, points)``.
        near: Which elements are nearest to each pulley.
        edges: Ends of the Gauss points' parts of those elements ``(cells points + 1,)`` for each pulley.
        own: Which elements are this rank's.
    """

    def __init__(self, elements: int, comm: MPI.Comm, options: Mapping[str, Any], terms: Terms) -> None:
        self.elements, self.terms = elements, terms
        self.space = space = HermiteSpace(elements, comm, closed=terms.closed)
        self.stiffness, self.motion = (
            {name: fem.Constant(space.mesh, np.float64(1.0)) for name in names}
            for names in (("a", "b1", "b2"), ("density", "inertia"))
        )
        self.weight, self.winding = fem.Constant(space.mesh, np.ones(2)), fem.Constant(space.mesh, np.float64(0.0))
        # The share of the belt before a point, and the pulley next to it: radius, centre, side, offset of the fibre.
        self.share, self._share_dofs = space.cellwise(compat.broken(1))
        self.circle, self._circle_dofs = space.cellwise(compat.broken(0, size=5))
        self.lambda_p, self.lambda_f, self.penalty = (fem.Function(space.gauss) for _ in range(3))
        # Of the state that was set: (R + s d)^2 - |r - C|^2 at the Gauss points of contact, r' at those of the rod.
        self.excess, self._excess_dofs = space.cellwise(compat.quadrature(CONTACT_DEGREE))
        (self.slope_x, self._slope_dofs), (self.slope_y, _) = (
            space.cellwise(compat.quadrature(ROD_DEGREE)) for _ in range(2)
        )
        # Of a cell's functions, the first one is that of its first node's value, from which ways are counted.
        self._ways = basis(space.points.ravel())[0][1:]
        self._rates = basis(basix.make_quadrature(basix.CellType.interval, ROD_DEGREE)[0].ravel())[1][1:]
        self.own = slice(space.first, space.first + len(space.eta))
        shares = np.arange(space.first, self.own.stop + 1) / elements
        self.share.x.array[self._share_dofs] = np.column_stack([shares[:-1], shares[1:]])
        self.share.x.scatter_forward()
        self._shares = shares if terms.closed else 0.0 * shares

        r, theta = ufl.split(space.w)
        slope = space.sigma.dx(0)
        if terms.closed:
            # In the last cell of a ring the mesh's coordinate runs backwards.
            theta, slope = theta + self.winding * self.share, slope + self.share.dx(0)
        d_sigma = rod.along_slope(slope)
        self.fibre = contact.fibre(r, theta, offset=self.circle[4]) if terms.offset else r
        D = rod.stretch(self.fibre, d_sigma)
        plain, known = self._kinematics(r, theta, d_sigma)
        scale = abs(slope) if terms.closed else slope
        self.residual = self._residual(r, d_sigma, scale, plain.g, known)
        # The matrix needs no last digits; without them it takes 5 % less time.
        self.jacobian = ufl.derivative(self._residual(r, d_sigma, scale, plain.g, plain), space.w)
        components = (r[0], r[1], theta, *d_sigma(r), d_sigma(theta), d_sigma(D), known.g, self.fibre[0])
        # UFL 2022 names forms by the numbers of their indices, which compiling counts up. So all names come first, lest
        # a form is compiled twice.
        for form in (self.residual, self.jacobian):
            form.signature()
        self._state = fem.Expression(ufl.as_vector(components), space.points)
        self.newton = Newton(self.residual, self.jacobian, space.deviation, space.move, space.clamped, options)

    def _kinematics(self, r: Any, theta: Any, d_sigma: rod.Derivative) -> tuple[Kinematics, Kinematics]:
        """Strains and penetration as functions of r and theta alone, and the same with little rounding error."""
        radius, xc, yc, side, offset = self.circle
        center, deviation = ufl.as_vector([xc, yc]), ufl.as_vector([self.space.deviation[0], self.space.deviation[1]])
        slope = ufl.as_vector([self.slope_x, self.slope_y]) + d_sigma(deviation)
        g = contact.penetration_near(
            r - center - deviation,
            deviation,
            radius=radius,
            excess=self.excess,
            offset=offset if self.terms.offset else 0.0,
            side=side,
            e2=ufl.as_vector([-ufl.sin(theta), ufl.cos(theta)]),
        )
        plain = contact.penetration(self.fibre, radius=radius, center=center)
        known = Kinematics(rod.strains_of_slope(slope, theta, d_sigma), g)
        return Kinematics(rod.strains(r, theta, d_sigma), plain), known

    def _residual(self, r: Any, d_sigma: rod.Derivative, scale: Any, g: Any, known: Kinematics) -> Any:
        """First variation (18.8) of strain energy, motion, weight, pressure and friction, whose tangent is not varied.

        Contact is integrated along the whole belt. On the half of it that is near the pulley alone, the Jacobian took
        9 % less time, the residual 14 %, and the state after it 60 %: 7 % of an update, for a zone that has to be
        guessed and watched.

        Args:
            r: Place of the middle line.
            d_sigma: Derivative by sigma.
            scale: d sigma/d eta, positive.
            g: Penetration as a function of r and theta alone, on whose variation the pressure works.
            known: Strains and penetration from which forces and pressure follow.
        """
        space, w = self.space, self.space.w
        dx_rod, dx_contact = space.dx(ROD_DEGREE), space.dx(CONTACT_DEGREE)
        U = rod.strain_energy(known.strains, **self.stiffness)
        T = rod.kinetic_energy(known.strains, **self.motion)
        pressed = ufl.variable(known.g)
        V = contact.normal_potential(pressed, lambda_p=self.lambda_p, penalty=self.penalty)
        energy = (U - T - ufl.dot(self.weight, r)) * scale * dx_rod
        # The deviation varies as w does. A penetration of w alone has the same variation, in less time.
        F = ufl.derivative(energy, w) + ufl.derivative(energy, space.deviation)
        F += ufl.diff(V, pressed) * ufl.derivative(g, w) * scale * dx_contact
        if self.terms.frictional:
            t, moved = (
                rod.tangent(self.fibre, d_sigma),
                ufl.derivative(self.fibre, w, ufl.TestFunction(w.function_space)),
            )
            F += contact.friction_potential(moved, lambda_f=self.lambda_f, t=t) * scale * dx_contact
        return F

    def load(self, scene: Scene, taut: TautBelt, nodes: Array) -> None:
        """Sets the parameters of a scene, the nodes' material-length coordinates ``(elements + 1,)`` and sigma(eta).

        Args:
            scene: The dimensionless scene.
            taut: Its taut belt.
            nodes: The coordinates of all nodes.
        """
        belt, space = scene.belt, self.space
        self.belt = belt
        for name, stiffness in (("a", "bending"), ("b1", "extensional"), ("b2", "shear")):
            self.stiffness[name].value = getattr(belt, f"{stiffness}_stiffness")
        self.weight.value[:] = belt.line_density * np.array(scene.gravity)
        self.winding.value = self._winding = taut.winding
        slopes = map_slopes(nodes, closed=scene.closed)
        self.points, rates = in_unit_cells(nodes, slopes, space.points.ravel())
        self.weights = rates * space.weights
        here = slice(self.own.start, self.own.stop + 1)
        self.nodes, self.slopes = nodes[here], slopes[here]
        self._sizes = np.diff(self.nodes)
        # Friction makes D the same at the nodes in stick. Between them D is better by far, but not the same in cells of
        # different sizes. On 400 equal cells the speed of a belt with little friction is off by 3e-8 at the nodes, by
        # 1e-9 between. On graded ones, 53 of 105 drives with little friction slide in the right sense against the D of
        # the nodes, 26 against the one between.
        self._level_at_nodes = not scene.is_published
        uniform = (self._shares - 0.5, 1.0 / self.elements) if scene.closed else (0.0, 0.0)
        space.set_map(self.nodes - uniform[0], self.slopes - uniform[1])
        bounds = np.searchsorted((nodes[1:] + nodes[:-1]) / 2.0, taut.watersheds).tolist()
        self.near = [slice(*ends) for ends in zip(bounds[:-1], bounds[1:], strict=True)]
        self.edges = [nodes[at.start] + np.append(0.0, np.cumsum(self.weights[at])) for at in self.near]
        pulley = np.searchsorted(bounds[1:-1], np.arange(self.own.start, self.own.stop), side="right")
        circles = np.array([[p.radius, *p.center, p.turn, p.turn * belt.contact_offset] for p in scene.pulleys])
        self._circles = circles[pulley]
        self.circle.x.array[self._circle_dofs] = self._circles
        self.circle.x.scatter_forward()
        if scene.closed:
            # A loop is free to run round; one component of one place keeps it where it is.
            axis = int(abs(taut.direction[1]) > abs(taut.direction[0]))
            self._along = taut.direction[axis]
            self.newton.fix(space.first_node(axis))

    def set_rate(self, rate: float) -> None:
        """Sets the transport rate, on which the forces of inertia depend."""
        self.motion["density"].value = self.belt.line_density * rate**2
        self.motion["inertia"].value = self.belt.rotary_inertia * rate**2

    def set_state(self, values: Array, slopes: Array) -> None:
        """Sets x, y, theta and their derivatives by sigma at this rank's nodes ``(cells + 1, 3)``."""
        values, slopes = values.copy(), slopes * self.slopes[:, np.newaxis]
        values[:, 2] -= self._winding * self._shares
        slopes[:, 2] -= self._winding / self.elements
        self.space.set_state(values, slopes)
        self._set_known()

    def _set_known(self) -> None:
        """Finds what is known of the state that was set: differences within a cell have small rounding errors.

        With E = (R + s d)^2 - |r - C|^2 at the cell's first node, from more digits, and the way u from there,
        it is E - u.(2 (r - C) + u) at its other points.
        """
        values, slopes = (places(table[:, :2]) for table in self.space.nodal())
        radius, xc, yc, side, d = self._circles.T.astype(np.longdouble)
        arm, reach = values[:-1] - places(self._circles[:, 1:3]), radius + side * d
        first = reach**2 - (values.real[:-1] - xc) ** 2 - (values.imag[:-1] - yc) ** 2
        ways = np.column_stack([slopes[:-1], np.diff(values), slopes[1:]])
        sizes = np.column_stack([self.slopes[:-1], self._sizes, self.slopes[1:]])
        way, slope = ways @ self._ways, (ways @ self._rates) / (sizes @ self._rates)
        excess = first[:, np.newaxis] - (way.conj() * (2.0 * arm[:, np.newaxis] + way)).real
        self.excess.x.array[self._excess_dofs] = excess
        self.slope_x.x.array[self._slope_dofs], self.slope_y.x.array[self._slope_dofs] = slope.real, slope.imag

    def set_penalty(self, penalty: Array) -> None:
        """Sets the penalty at the Gauss points of the owned cells, ``(cells, points)`` or ``(cells, 1)``."""
        self.space.set_gauss(self.penalty, penalty)

    def set_multipliers(self, lambda_p: Array, lambda_f: Array) -> None:
        """Sets the multipliers at the Gauss points of the owned cells ``(cells, points)``."""
        self.space.set_gauss(self.lambda_p, lambda_p)
        if self.terms.frictional:
            self.space.set_gauss(self.lambda_f, lambda_f)

    def growth_at_support(self) -> float:
        """By what the belt's force grows where a loop is held, which is nothing in the end; collective."""
        if not self.terms.closed:
            return 0.0
        return -float(self.space.comm.allreduce(self.newton.reaction)) * self._along

    def state(self) -> State:
        """The present state at the Gauss points of the owned cells ``(cells, points)``."""
        # A copy, as columns of a table take longer, all together.
        x, y, theta, dx, dy, kappa, dD, g, fibre_x = self.space.at_gauss(self._state).transpose(2, 0, 1).copy()
        weights, (values, slopes), d = self.weights[self.own], self._nodal(), self._circles[:, 4]
        slope, slope_inside = places(slopes[:, :2]), dx + 1j * dy
        before, after = slope[:-1], slope[1:]
        if self.terms.offset:
            spin = slopes[:, 2] * directions(values[:, 2])
            before, after = before + d * spin[:-1], after + d * spin[1:]
            slope_inside += d[:, np.newaxis] * kappa * directions(theta)
        before, after, stretch = np.abs(before), np.abs(after), np.abs(slope_inside)
        # What D grows by in each cell is known better than from two points, whose errors would add up in stick.
        dD = dD + ((after - before - sum((weights * dD).T)) / self._sizes)[:, np.newaxis]
        level = stretch
        if self._level_at_nodes:
            level = ((before + after) / 2.0)[:, np.newaxis] + np.zeros_like(stretch)
        return State(self.points[self.own], weights, x, y, theta, dx, dy, kappa, dD, g, fibre_x, stretch, level)

    def ends(self) -> State:
        """The present state at the belt's ends that this rank has, without weight ``(n,)``."""
        ends = ((0, self.own.start == 0), (-1, self.own.stop == self.elements))
        at = np.array([end for end, here in ends if here], dtype=int)
        values, slopes = self._nodal()[:, at]
        (x, y, theta), (dx, dy, kappa), (radius, xc, yc, _, d) = values.T, slopes.T, self._circles[at].T
        fibre = x + 1j * y - 1j * d * directions(theta)
        g, zero = radius - np.abs(fibre - xc - 1j * yc), np.zeros_like(x)
        D = np.abs(dx + 1j * dy + d * kappa * directions(theta))
        return State(self.nodes[at], zero, x, y, theta, dx, dy, kappa, zero, g, fibre.real, D, D)

    def _nodal(self) -> Array:
        """x, y, theta ``[0]`` and their derivatives by sigma ``[1]`` at this rank's nodes ``(2, cells + 1, 3)``."""
        nodal = self.space.nodal()
        if self.terms.closed:
            nodal[0, :, 2] += self._winding * self._shares
            nodal[1, :, 2] += self._winding / self.elements
        nodal[1] /= self.slopes[:, np.newaxis]
        return nodal
