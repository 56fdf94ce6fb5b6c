"""A state of the fitted method: its unknowns, and what follows from them between the nodes."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from belt_fenicsx.fitted.dofs import local
from belt_fenicsx.fitted.elements import gauss_basis, nodal_basis, points
from belt_fenicsx.fitted.nodes import Nodes, on_chords
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.mechanics.rod import Strains, tractions
from belt_fenicsx.solution.fields import simpson_weights

POINTS = 17  # of dense fields, in each cell, its ends among them
EVEN = np.linspace(0.0, 1.0, POINTS)


class Dense(NamedTuple):
    """Fields ``(n, POINTS)`` of all cells; positions, and strains eps + i Gamma, in the complex plane."""

    sigma: Array
    r: Array
    strain: Array
    D: Array
    theta: Array
    kappa: Array
    p: Array
    f: Array


@functools.cache
def tables(degree: int) -> tuple[Array, Array, Array, Array]:
    """At even points of the reference cell: polynomials through the nodes, their slopes, polynomials through the Gauss
    points; and weights of Simpson's rule."""
    return *nodal_basis(degree, EVEN), gauss_basis(degree, EVEN), simpson_weights(EVEN)


@functools.cache
def at_gauss(degree: int) -> tuple[Array, Array]:
    """At the Gauss points of the reference cell: polynomials through the nodes, and their slopes."""
    return nodal_basis(degree, points(degree)[1])


class State(Nodes):
    """Where the iteration stands, dimensionless, as one field along the belt."""

    @functools.cached_property
    def force(self) -> Array:
        """Force Q in global axes at the Gauss points, in the complex plane ``(n, k)``.

        The energy is integrated by as many Gauss points as slopes have coefficients. So equilibrium holds at each of
        them, and Q is constant in a free span to rounding. Between them, slopes alternate around this force: the shear
        strain is the small difference of two angles, and the more of it is error the thinner the belt is.
        """
        at, values, (nodal, slopes) = local(self.degree), self.values, at_gauss(self.degree)
        dr = (self.complex_chords[:, 1:] + self.deviation @ slopes.T) / self.length[:, None]
        e1 = np.exp(1j * (values[:, at.theta] @ nodal.T))
        Q, belt = dr * e1.conj() - 1.0, self.scene.belt
        Q.real *= belt.extensional_stiffness
        Q.imag *= belt.shear_stiffness
        return Q * e1

    def strain(self, force: Array, theta: Array) -> Array:
        """Strains eps + i Gamma of a force in global axes (18.5); r' is (1 + eps + i Gamma) e1 (18.6)."""
        strain, belt = force * np.exp(-1j * theta), self.scene.belt
        strain.real /= belt.extensional_stiffness
        strain.imag /= belt.shear_stiffness
        return strain

    def tractions(
        self, cell: Array, strain: Array, kappa: Array, theta: Array, sense: Array | float | None = None
    ) -> tuple[Array, Array]:
        """Pressure and friction on the pulleys from equilibrium; D' is zero in stick, else what makes f = -s mu p.

        Args:
            cell: Cells of the points; of the shape of the others, or one that fits it.
            strain: Strains eps + i Gamma.
            kappa: Bending strain.
            theta: Angle of the cross-section.
            sense: Sense s of sliding, NaN in stick; by default, that of the cells.
        """
        belt, square = self.scene.belt, self.rate**2 if self.terms.loads else 0.0
        radius, friction, side = self.pulleys[:, cell]
        mass, offset = square * belt.line_density, side * belt.contact_offset if self.terms.offset else 0.0
        a, b1 = belt.bending_stiffness - square * belt.rotary_inertia, belt.extensional_stiffness
        weight = belt.line_density * complex(*self.scene.gravity) * np.exp(-1j * theta) if belt.line_density else 0j
        # Both are linear in D'; along the touching fibre, bending gives way, too.
        fibre = 1.0 + strain + offset * kappa if self.terms.offset else 1.0 + strain
        D = np.abs(fibre)
        p, f = tractions(
            Strains(strain.real, strain.imag, kappa), D, side=side, radius=radius, a=a, b1=b1, b2=belt.shear_stiffness,
            mass=mass, offset=offset, weight=(weight.real, weight.imag),
        )  # fmt: skip
        sense = self._senses[cell] if sense is None else sense
        b1, b2 = (b1 - mass) * a / (a + offset**2 * (b1 - mass)), belt.shear_stiffness - mass
        cos, sin, mu = fibre.real / D, -fibre.imag / D, sense * friction
        Qt_D, Qn_D = b2 + (b1 - b2) * cos**2, side * (b1 - b2) * cos * sin
        D_rate = np.where(np.isnan(sense), 0.0, (f + mu * p) / (Qt_D + mu * Qn_D))
        return p - Qn_D * D_rate, f - Qt_D * D_rate

    def fibre(self, cell: Array, strain: Array, kappa: Array) -> Array:
        """Derivative of the touching fibre, of the middle line in free spans, in the axes of the cross-section."""
        return 1.0 + strain + self.offsets[cell] * kappa if self.terms.offset else 1.0 + strain

    @functools.cached_property
    def offsets(self) -> Array:
        """Distance of the touching fibre from the middle line, towards -e2, on pulleys, in each cell ``(n,)``."""
        return self.mesh.touches * self.pulleys[2] * self.scene.belt.contact_offset

    @functools.cached_property
    def dense(self) -> Dense:
        """Fields at `POINTS` points of each cell, once for all that read them."""
        at, values, length = local(self.degree), self.values, self.length[:, None]
        nodal, slopes, gauss, _ = tables(self.degree)
        theta = values[:, at.theta] @ nodal.T
        strain = self.strain(self.force @ gauss.T, theta)
        kappa = values[:, at.theta] @ slopes.T / length
        p, f = np.zeros((2, *kappa.shape))
        contact = self.mesh.touches
        on = np.flatnonzero(contact)
        p[on], f[on] = self.tractions(on[:, None], strain[on], kappa[on], theta[on])
        return Dense(
            sigma=self.sigma[:, :1] + length * EVEN,
            r=self.r(EVEN, nodal),
            strain=strain,
            D=np.abs(self.fibre(np.arange(len(strain))[:, None], strain, kappa)),
            theta=theta,
            kappa=kappa,
            p=p,
            f=f,
        )

    def at(self, cell: Array, xi: Array) -> tuple[Array, Array]:
        """r in the complex plane and theta at points ``xi`` of cells ``(m,)``."""
        nodal, theta = nodal_basis(self.degree, xi)[0], self.values[cell][:, local(self.degree).theta]
        arm = on_chords(self.complex_chords[cell], xi[:, None])[:, 0] + np.einsum(
            "mi,mi->m", nodal, self.deviation[cell]
        )
        return self.center[cell] + arm, np.einsum("mi,mi->m", nodal, theta)

    def tractions_at(self, cell: Array, xi: Array) -> tuple[Array, Array]:
        """p and f at points ``xi`` of cells ``(m,)``."""
        p, f = np.zeros((2, cell.size))
        contact = self.mesh.touches[cell]
        cell, xi = cell[contact], xi[contact]
        p[contact], f[contact] = self.tractions(cell, *self._strained(cell, xi))
        return p, f

    @property
    def _senses(self) -> Array:
        """Sense of sliding of each cell ``(n,)``, NaN in stick."""
        return np.where(self.mesh.sticks, np.nan, self.mesh.senses)

    def strains_at(self, cell: Array, xi: Array) -> tuple[Array, Array]:
        """Strains eps + i Gamma and kappa at points ``xi`` of cells ``(m,)``."""
        return self._strained(cell, xi)[:2]

    def _strained(self, cell: Array, xi: Array) -> tuple[Array, Array, Array]:
        """The same, and theta."""
        (nodal, slopes), values = nodal_basis(self.degree, xi), self.values[cell, local(self.degree).theta]
        force, theta = (
            np.einsum("mi,mi->m", gauss_basis(self.degree, xi), self.force[cell]),
            np.einsum("mi,mi->m", nodal, values),
        )
        return self.strain(force, theta), np.einsum("mi,mi->m", slopes, values) / self.length[cell], theta
