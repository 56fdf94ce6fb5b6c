"""States of the fitted method, and where they come from. NumPy on each cell's dofs."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from belt_fenicsx.fitted.cells import Mesh, divided
from belt_fenicsx.fitted.dofs import local, width
from belt_fenicsx.fitted.elements import gauss_basis, gauss_weights, nodal_basis, points
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layers import bending_layer, shear_layer
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.mechanics.rod import Strains, tractions
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.fields import Fields, simpson_weights
from belt_fenicsx.taut_string.string import TautString

POINTS = 17  # of dense fields, in each cell, its ends among them
EVEN, ENDS = np.linspace(0.0, 1.0, POINTS), np.array([0.0, 1.0])
ROUNDING = 4.0 * float(np.finfo(float).eps)  # of a coordinate, in belt lengths


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
def prolongation(coarse: int, fine: int) -> Array:
    """Map of a cell's values from one degree to another ``(5 coarse + 6, 5 fine + 6)``."""
    old, new = local(coarse), local(fine)
    nodes, gauss = points(fine)
    nodal, traction = nodal_basis(coarse, nodes)[0].T, gauss_basis(coarse, gauss).T
    result = np.zeros((width(coarse), width(fine)))
    result[old.r, new.r] = np.kron(nodal, np.eye(2))
    result[old.theta, new.theta] = nodal
    result[old.p, new.p] = result[old.f, new.f] = traction
    result[old.sigma, new.sigma], result[old.D, new.D] = np.eye(2), 1.0
    return result


@functools.cache
def tables(degree: int) -> tuple[Array, Array, Array, Array]:
    """At even points of the reference cell: polynomials through the nodes, their slopes, polynomials through the Gauss
    points; and weights of Simpson's rule."""
    return *nodal_basis(degree, EVEN), gauss_basis(degree, EVEN), simpson_weights(EVEN)


@functools.cache
def at_gauss(degree: int) -> tuple[Array, Array]:
    """At the Gauss points of the reference cell: polynomials through the nodes, and their slopes."""
    return nodal_basis(degree, points(degree)[1])


@dataclass(frozen=True)
class State:
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
        chords: Each cell's left end as seen from the pulley's centre, and the vector from there to its right end
            ``(n, 4)``.
        values: Unknowns of each cell, with the deviations from the chord for positions, its ends 0 and length for
            sigma, and for the stretch in stick its elongation ``(n, 5 k + 6)``.
    """

    scene: Scene
    mesh: Mesh
    cells: Array
    degree: int
    ends: Array
    chords: Array
    values: Array

    @property
    def layout(self) -> Layout:
        """What the belt does part by part."""
        return self.mesh.layout

    @property
    def D_stick(self) -> float:
        """Stretch in stick."""
        return 1.0 + float(self.values[0, -1])

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
    def _chords(self) -> Array:
        """The chords in the complex plane ``(n, 2)``."""
        return self.chords.view(complex)

    @property
    def _deviation(self) -> Array:
        """Deviations of the nodes from the chords, in the complex plane ``(n, k + 1)``."""
        return self.values[:, local(self.degree).r].view(complex)

    @property
    def _center(self) -> complex:
        """The pulley's centre in the complex plane."""
        return complex(*self.scene.pulleys[0].center)

    @property
    def ends_r(self) -> Array:
        """Positions of both ends of each cell, in the complex plane ``(n, 2)``."""
        return self._center + on_chords(self._chords, ENDS)

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

    @property
    def friction_force(self) -> float:
        """Integral of the friction traction."""
        return self._integral(local(self.degree).f)

    @property
    def pressure_force(self) -> float:
        """Integral of the pressure."""
        return self._integral(local(self.degree).p)

    def _integral(self, dofs: slice) -> float:
        """Integral along the belt of what has these dofs at the Gauss points."""
        return float((self.values[:, dofs] @ gauss_weights(self.degree)) @ self.length)

    def r(self, xi: Array, nodal: Array) -> Array:
        """Positions in the complex plane ``(n, m)``, at ``xi`` ``(m,)``, where the nodes' polynomials are ``nodal``."""
        return self._center + (on_chords(self._chords, xi) + self._deviation @ nodal.T)

    @functools.cached_property
    def force(self) -> Array:
        """Force Q in global axes at the Gauss points, in the complex plane ``(n, k)``.

        The energy is integrated by as many Gauss points as slopes have coefficients. So equilibrium holds at each of
        them, and Q is constant in a free span to rounding. Between them, slopes alternate around this force: the shear
        strain is the small difference of two angles, and the more of it is error the thinner the belt is.
        """
        at, values, (nodal, slopes) = local(self.degree), self.values, at_gauss(self.degree)
        dr = (self._chords[:, 1:] + self._deviation @ slopes.T) / self.length[:, None]
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

    def tractions(self, sense: Array, strain: Array, kappa: Array) -> tuple[Array, Array]:
        """Pressure and friction on the pulley from equilibrium; D' is zero in stick, else what makes f = -s mu p.

        Args:
            sense: Sense s of sliding, NaN in stick; of the shape of the others, or one that fits it.
            strain: Strains eps + i Gamma.
            kappa: Bending strain.
        """
        belt, pulley, D = self.scene.belt, self.scene.pulleys[0], np.abs(1.0 + strain)
        b1, b2 = belt.extensional_stiffness, belt.shear_stiffness
        p, f = tractions(Strains(strain.real, strain.imag, kappa), D, radius=pulley.radius, b1=b1, b2=b2)
        cos, sin, mu = (1.0 + strain.real) / D, -strain.imag / D, sense * pulley.friction
        Qt_D, Qn_D = b2 + (b1 - b2) * cos**2, (b1 - b2) * cos * sin
        D_rate = np.where(np.isnan(sense), 0.0, (f + mu * p) / (Qt_D + mu * Qn_D))
        return p - Qn_D * D_rate, f - Qt_D * D_rate

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
        p[contact], f[contact] = self.tractions(self._senses[contact, None], strain[contact], kappa[contact])
        return Dense(
            sigma=self.sigma[:, :1] + length * EVEN,
            r=self.r(EVEN, nodal),
            strain=strain,
            D=np.abs(1.0 + strain),
            theta=theta,
            kappa=kappa,
            p=p,
            f=f,
        )

    def of_degree(self, degree: int) -> State:
        """The same fields in elements of another degree; exactly the same where it is higher."""
        if degree == self.degree:
            return self
        return replace(self, degree=degree, values=self.values @ prolongation(self.degree, degree))

    def located(self, sigma: Array, *, before: bool = False) -> tuple[Array, Array]:
        """Cell and reference coordinate of points; at a border, those of the cell after it, or before it.

        A border that was turned into other units and back is still that border.
        """
        left = self.sigma[:, 0]
        same = -ROUNDING if before else ROUNDING
        cell = np.searchsorted(left[1:], sigma + same, side="left" if before else "right")
        return cell, (sigma - left[cell]) / self.length[cell]

    def at(self, cell: Array, xi: Array) -> tuple[Array, Array]:
        """r in the complex plane and theta at points ``xi`` of cells ``(m,)``."""
        nodal, theta = nodal_basis(self.degree, xi)[0], self.values[cell][:, local(self.degree).theta]
        arm = on_chords(self._chords[cell], xi[:, None])[:, 0] + np.einsum("mi,mi->m", nodal, self._deviation[cell])
        return self._center + arm, np.einsum("mi,mi->m", nodal, theta)

    def tractions_at(self, cell: Array, xi: Array) -> tuple[Array, Array]:
        """p and f at points ``xi`` of cells ``(m,)``."""
        p, f = np.zeros((2, cell.size))
        contact = self.mesh.touches[cell]
        cell, xi = cell[contact], xi[contact]
        p[contact], f[contact] = self.tractions(self._senses[cell], *self.strains_at(cell, xi))
        return p, f

    @property
    def _senses(self) -> Array:
        """Sense of sliding of each cell ``(n,)``, NaN in stick."""
        return np.where(self.mesh.sticks, np.nan, self.mesh.senses)

    def strains_at(self, cell: Array, xi: Array) -> tuple[Array, Array]:
        """Strains eps + i Gamma and kappa at points ``xi`` of cells ``(m,)``."""
        (nodal, slopes), theta = nodal_basis(self.degree, xi), self.values[cell][:, local(self.degree).theta]
        force = np.einsum("mi,mi->m", gauss_basis(self.degree, xi), self.force[cell])
        strain = self.strain(force, np.einsum("mi,mi->m", nodal, theta))
        return strain, np.einsum("mi,mi->m", slopes, theta) / self.length[cell]


def on_chords(chords: Array, xi: Array) -> Array:
    """Points ``(n, m)`` on chords ``(n, 2)``, at the same ``xi`` ``(m,)`` on each or others ``(n, m)``; all complex."""
    return chords[:, :1] + xi * chords[:, 1:]


def _blank(scene: Scene, layout: Layout, ends: Array, strain: float, degree: int, elements: int | None) -> State:
    """Layout divided into cells, without fields."""
    layers = {"bending": bending_layer(scene, strain), "shear": shear_layer(scene, strain)}
    mesh, cells = divided(layout, ends, **layers, elements=elements)
    values = np.zeros((len(cells), width(degree)))
    values[:, local(degree).sigma.stop - 1] = (ends[1:] - ends[:-1])[mesh.zone] * (cells[:, 1] - cells[:, 0])
    return State(scene, mesh, cells, degree, ends, np.zeros((len(cells), 4)), values)


def _placed(scene: Scene, state: State, r: Array, theta: Array) -> State:
    """Puts the nodes to ``r``, in the complex plane, and ``theta`` ``(n, k + 1)``, and the ends into the clamps."""
    r[0, 0], r[-1, 1] = -scene.span / 2, scene.span / 2
    theta[0, 0] = theta[-1, 1] = 0.0
    state.values[:, local(state.degree).theta] = theta
    arm, chords, deviation = r - state._center, state._chords, state._deviation
    arm[1:, 0] = arm[:-1, 1]
    left, right = arm[:, 0], arm[:, 1]
    chords[:, 0], chords[:, 1] = left, right - left
    deviation[:] = arm - on_chords(chords, points(state.degree)[0])
    deviation[:, 0], deviation[:, 1] = 0.0, sum_error(right, -left, right - left)
    return state


def sum_error(a: Array, b: Array, rounded: Array) -> Array:
    """What ``rounded``, the floating-point sum of ``a`` and ``b``, is less than the exact one; itself exact.

    D. E. Knuth, "The Art of Computer Programming", volume 2, section 4.2.2.
    """
    of_b = rounded - a
    return (a - (rounded - of_b)) + (b - of_b)


def from_string(scene: Scene, string: TautString, layout: Layout, degree: int, elements: int | None = None) -> State:
    """The taut string, with its pressure and its friction in sliding.

    Args:
        scene: The dimensionless scene.
        string: The string over its pulley.
        layout: The zones, of which the string has one or two in contact.
        degree: Degree k.
        elements: Number of cells; by default, as many as the layers call for.
    """
    half = scene.belt.length / 2
    borders = string.borders if len(layout.joints) == 3 else string.borders[[0, 2]]
    ends = np.array([-half, *borders, half])
    state = _blank(scene, layout, ends, float(np.mean(string.strain)), degree, elements)
    at, (nodes, _), sigma = local(degree), points(degree), state.sigma
    inside = (sigma[:, :1] + state.length[:, None] * nodes).ravel()
    n = len(sigma)
    state.values[:, at.D] = string.strain[0]
    D = string.D((sigma[:, 0] + sigma[:, 1]) / 2)
    tension = scene.belt.extensional_stiffness * np.maximum(D - 1.0, string.strain.min())
    p = np.where(state.mesh.touches, tension * D / scene.pulleys[0].radius, 0.0)
    state.values[:, at.p] = p[:, None]
    state.values[:, at.f] = (-state.mesh.senses * scene.pulleys[0].friction * p)[:, None]
    return _placed(scene, state, string.r(inside).view(complex).reshape(n, -1), string.phi(inside).reshape(n, -1))


def from_fields(
    scene: Scene, old: Fields | State, layout: Layout, ends: Array, degree: int, elements: int | None = None
) -> State:
    """The fields of another solution on other zones, for a scene that may be another one.

    Args:
        scene: The dimensionless scene.
        old: The dimensionless fields of the other solution; its state where it is one of this method, so that nothing
            is lost between points.
        layout: The zones.
        ends: Ends of the zones ``(z + 1,)``.
        degree: Degree k.
        elements: Number of cells; by default, as many as the layers call for.
    """
    elongation = old.values[0, -1] if isinstance(old, State) else float(old.D[0] - old.v_rel[0]) - 1.0
    state = _blank(scene, layout, ends, elongation, degree, elements)
    if isinstance(old, State) and old.mesh == state.mesh and np.array_equal(old.ends, ends):
        same = old.of_degree(degree)
        state = replace(same, scene=scene, ends=ends, chords=same.chords.copy(), values=same.values.copy())
        r, theta, p, f = state.at_nodes
    else:
        nodes, gauss = (state.sigma[:, :1] + state.length[:, None] * inside for inside in points(degree))
        (r, theta), (p, f) = _read(old, nodes, gauss)
    at, mesh = local(degree), state.mesh
    state.values[:, at.p] = mesh.touches[:, None] * p
    state.values[:, at.f] = np.where(mesh.sticks[:, None], f, -mesh.senses[:, None] * scene.pulleys[0].friction * p)
    state.values[:, at.D] = elongation
    return _placed(scene, state, r, theta)


def _read(old: Fields | State, nodes: Array, gauss: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """r in the complex plane and theta at the nodes ``(n, k + 1)``, p and f at the Gauss points ``(n, k)``."""
    if isinstance(old, State):
        r, theta = old.at(*old.located(nodes.ravel()))
        p, f = old.tractions_at(*old.located(gauss.ravel()))
        return (r.reshape(nodes.shape), theta.reshape(nodes.shape)), (
            p.reshape(gauss.shape),
            f.reshape(gauss.shape),
        )
    r = np.interp(nodes, old.sigma, old.r[:, 0] + 1j * old.r[:, 1])
    p, f = (np.interp(gauss, old.sigma, field) for field in (old.p, old.f))
    return (r, np.interp(nodes, old.sigma, old.theta)), (p, f)
