"""The unknowns of the fitted method: of cells at their nodes, and scalars of pulleys. NumPy on all cells."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from belt_fenicsx.fitted.cells import Mesh
from belt_fenicsx.fitted.dofs import Terms, local, terms_of, width
from belt_fenicsx.fitted.elements import gauss_basis, gauss_weights, nodal_basis, points
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import gives_rate
from belt_fenicsx.scene.scene import Scene

ENDS = np.array([0.0, 1.0])
ROUNDING = 4.0 * float(np.finfo(float).eps)  # of a coordinate, in belt lengths


@functools.cache
def prolongation(coarse: int, fine: int, loads: bool) -> Array:
    """Map of a cell's values from one degree to another ``(dofs, finer dofs)``."""
    old, new = local(coarse), local(fine)
    nodes, gauss = points(fine)
    nodal, traction = nodal_basis(coarse, nodes)[0].T, gauss_basis(coarse, gauss).T
    # What cells share at their ends stays so to the last bit: rounding would bend the belt at its nodes.
    nodal[:, :2] = np.eye(coarse + 1, 2)
    result = np.zeros((width(coarse, loads), width(fine, loads)))
    result[old.r, new.r] = np.kron(nodal, np.eye(2))
    result[old.theta, new.theta] = nodal
    result[old.p, new.p] = result[old.f, new.f] = traction
    scalars = old.scalars(loads), new.scalars(loads)
    result[scalars] = 1.0
    return result


@dataclass(frozen=True)
class Nodes:
    """Where the iteration stands, dimensionless.

    Positions are kept as a chord for each cell and what deviates from it. In a cell that is some thousandth of the belt
    long, the derivative of the positions themselves would know the stretch to 1e-12 only, and the strain, which is some
    hundredth, to 1e-10. What a sum of two numbers loses by rounding is a part of the deviation, so that cells meet at
    their nodes to far less than the rounding of a position: such steps would be a roughness of the pulley.

    Attributes:
        scene: The dimensionless scene.
        mesh: Layout and cells.
        cells: Both ends of each cell in its zone, which goes from 0 to 1 ``(n, 2)``.
        degree: Degree k.
        ends: Ends of the zones in the material-length coordinate ``(z + 1,)``.
        chords: Each cell's left end as seen from the centre of its pulley, and the vector from there to its right end
            ``(n, 4)``.
        values: Unknowns of each cell, with the deviations from the chord for positions, its ends 0 and length for
            sigma, and for the stretch in stick its elongation ``(n, dofs)``.
        missing: Force along the belt that is missing where a loop begins, of which no joint closes it.
    """

    scene: Scene
    mesh: Mesh
    cells: Array
    degree: int
    ends: Array
    chords: Array
    values: Array
    missing: float = 0.0

    @property
    def layout(self) -> Layout:
        """What the belt does part by part."""
        return self.mesh.layout

    @functools.cached_property
    def terms(self) -> Terms:
        """What there is to compute."""
        return terms_of(self.scene)

    @functools.cached_property
    def stretches(self) -> Array:
        """Stretch in stick on each pulley ``(pulleys,)``."""
        return 1.0 + self._of_pulleys(local(self.degree).D)

    @functools.cached_property
    def moves(self) -> Array:
        """Displacement of each pulley that moves ``(pulleys,)``; zero of others."""
        return self._of_pulleys(local(self.degree).move) if self.terms.loads else np.zeros(len(self.scene.pulleys))

    @functools.cached_property
    def rate(self) -> float:
        """Transport rate; where no force depends on it, the one that goes with the given speed of a pulley."""
        if self.terms.loads:
            return float(self.values[0, local(self.degree).rate][0])
        if self.scene.transport_rate is not None:
            return self.scene.transport_rate
        giving = gives_rate(self.scene, self.layout) or 0
        driven = next(i for i, p in enumerate(self.scene.pulleys) if p.drive.kind == "omega" and i >= giving)
        return float(self.scene.pulleys[driven].surface_speed / self.stretches[driven])

    @functools.cached_property
    def centers(self) -> Array:
        """Centre of each pulley where it has moved to, in the complex plane ``(pulleys,)``."""
        return np.array([complex(*p.center) for p in self.scene.pulleys]) + self.moves * ways(self.scene)

    def _of_pulleys(self, dof: slice) -> Array:
        """One of the scalars that each pulley has ``(pulleys,)``."""
        return self.values[self.mesh.firsts, dof.start]

    def on(self, pulley: int) -> Array:
        """Whether each cell lies on a pulley ``(n,)``."""
        return self.mesh.touches & (self.mesh.pulley == pulley)

    @functools.cached_property
    def pulleys(self) -> Array:
        """Radius, friction coefficient and side of the pulley to which each cell belongs ``(3, n)``."""
        each = [(pulley.radius, pulley.friction, pulley.turn) for pulley in self.scene.pulleys]
        return np.array(each).T[:, self.mesh.pulley]

    @property
    def length(self) -> Array:
        """Length of each cell ``(n,)``."""
        return self.values[:, local(self.degree).sigma.stop - 1]

    @property
    def sigma(self) -> Array:
        """Both ends of each cell in the material-length coordinate ``(n, 2)``."""
        zone, ends = self.mesh.zone[:, None], self.ends
        return ends[zone] + (ends[1:] - ends[:-1])[zone] * self.cells

    @property
    def complex_chords(self) -> Array:
        """The chords in the complex plane ``(n, 2)``."""
        return self.chords.view(complex)

    @property
    def deviation(self) -> Array:
        """Deviations of the nodes from the chords, in the complex plane ``(n, k + 1)``."""
        return self.values[:, local(self.degree).r].view(complex)

    @property
    def center(self) -> Array:
        """Centre of each cell's pulley in the complex plane ``(n,)``."""
        return self.centers[self.mesh.pulley]

    @property
    def ends_r(self) -> Array:
        """Positions of both ends of each cell, in the complex plane ``(n, 2)``."""
        return self.center[:, None] + on_chords(self.complex_chords, ENDS)

    @property
    def nodes(self) -> Array:
        """Material-length coordinate and x of the cells' ends ``(n + 1, 2)``."""
        both = np.stack([self.sigma, self.ends_r.real], axis=2)
        return np.vstack([both[:, 0], both[-1:, 1]])

    @property
    def at_nodes(self) -> tuple[Array, Array, Array, Array]:
        """r in the complex plane and theta at the nodes ``(n, k + 1)``, p and f at the Gauss points ``(n, k)``."""
        at, values = local(self.degree), self.values
        return (
            self.r(points(self.degree)[0], np.eye(self.degree + 1)),
            values[:, at.theta],
            values[:, at.p],
            values[:, at.f],
        )

    @functools.cached_property
    def friction_forces(self) -> Array:
        """Integral of the friction traction on each pulley ``(pulleys,)``."""
        return self._integrals(local(self.degree).f)

    @functools.cached_property
    def pressure_forces(self) -> Array:
        """Integral of the pressure on each pulley ``(pulleys,)``."""
        return self._integrals(local(self.degree).p)

    @functools.cached_property
    def doubts(self) -> Array:
        """What rounding may make of the friction on each pulley ``(pulleys,)``: that of a stretch in a short cell."""
        shortest = np.full_like(self.friction_forces, np.inf)
        np.minimum.at(shortest, self.mesh.pulley, self.length)
        return ROUNDING / shortest

    def _integrals(self, dofs: slice) -> Array:
        """Integrals of what has these dofs at the Gauss points ``(pulleys,)``."""
        return np.bincount(self.mesh.pulley, (self.values[:, dofs] @ gauss_weights(self.degree)) * self.length)

    def r(self, xi: Array, nodal: Array) -> Array:
        """Positions in the complex plane ``(n, m)``, at ``xi`` ``(m,)``, where the nodes' polynomials are ``nodal``."""
        return self.center[:, None] + (on_chords(self.complex_chords, xi) + self.deviation @ nodal.T)

    def of_degree(self, degree: int) -> Self:
        """The same fields in elements of another degree; exactly the same where it is higher."""
        if degree == self.degree:
            return self
        return replace(self, degree=degree, values=self.values @ prolongation(self.degree, degree, self.terms.loads))

    def located(self, sigma: Array, *, before: bool = False) -> tuple[Array, Array]:
        """Cell and reference coordinate of points; at a joint, those of the cell after it, or before it.

        A joint that was turned into other units and back is still that joint.
        """
        left = self.sigma[:, 0]
        same = -ROUNDING if before else ROUNDING
        cell = np.searchsorted(left[1:], sigma + same, side="left" if before else "right")
        return cell, (sigma - left[cell]) / self.length[cell]


def on_chords(chords: Array, xi: Array) -> Array:
    """Points ``(n, m)`` on chords ``(n, 2)``, at the same ``xi`` ``(m,)`` on each or others ``(n, m)``; all complex."""
    return chords[:, :1] + xi * chords[:, 1:]


def ways(scene: Scene) -> Array:
    """Directions in which pulleys move, in the complex plane ``(pulleys,)``; zero of those that do not."""
    return np.array([complex(*pulley.direction) for pulley in scene.pulleys])


def sum_error(a: Array, b: Array, rounded: Array) -> Array:
    """What ``rounded``, the floating-point sum of ``a`` and ``b``, is less than the exact one; itself exact.

    D. E. Knuth, "The Art of Computer Programming", volume 2, section 4.2.2.
    """
    of_b = rounded - a
    return (a - (rounded - of_b)) + (b - of_b)
