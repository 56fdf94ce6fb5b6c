"""States of the fitted method, and where they come from. NumPy on each cell's dofs."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from belt_fenicsx.fitted.cells import Mesh, divided
from belt_fenicsx.fitted.dofs import Terms, local, terms_of, width
from belt_fenicsx.fitted.elements import gauss_basis, gauss_weights, nodal_basis, points
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layers import LEAST_STRAIN, bending_layer, shear_layer
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import gives_rate, ordered
from belt_fenicsx.mechanics.rod import Strains, tractions
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.fields import Fields, simpson_weights
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.shape import StringDrive
from belt_fenicsx.taut_string.string import TautString

POINTS = 17  # of dense fields, in each cell, its ends among them
EVEN, ENDS = np.linspace(0.0, 1.0, POINTS), np.array([0.0, 1.0])
LEAST = 0.02  # A part on a pulley takes at least this part of the contact in a first guess.
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


class Driven(NamedTuple):
    """Elongation D - 1 in stick of each pulley ``(pulleys,)``, transport rate, displacement of each ``(pulleys,)``."""

    elongations: Array
    rate: float
    moves: Array


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
        chords: Each cell's left end as seen from the centre of its pulley, and the vector from there to its right end
            ``(n, 4)``.
        values: Unknowns of each cell, with the deviations from the chord for positions, its ends 0 and length for
            sigma, and for the stretch in stick its elongation ``(n, dofs)``.
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
    def _chords(self) -> Array:
        """The chords in the complex plane ``(n, 2)``."""
        return self.chords.view(complex)

    @property
    def _deviation(self) -> Array:
        """Deviations of the nodes from the chords, in the complex plane ``(n, k + 1)``."""
        return self.values[:, local(self.degree).r].view(complex)

    @property
    def _center(self) -> Array:
        """Centre of each cell's pulley in the complex plane ``(n,)``."""
        return self.centers[self.mesh.pulley]

    @property
    def ends_r(self) -> Array:
        """Positions of both ends of each cell, in the complex plane ``(n, 2)``."""
        return self._center[:, None] + on_chords(self._chords, ENDS)

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
        return self._center[:, None] + (on_chords(self._chords, xi) + self._deviation @ nodal.T)

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

    def of_degree(self, degree: int) -> State:
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

    def at(self, cell: Array, xi: Array) -> tuple[Array, Array]:
        """r in the complex plane and theta at points ``xi`` of cells ``(m,)``."""
        nodal, theta = nodal_basis(self.degree, xi)[0], self.values[cell][:, local(self.degree).theta]
        arm = on_chords(self._chords[cell], xi[:, None])[:, 0] + np.einsum("mi,mi->m", nodal, self._deviation[cell])
        return self._center[cell] + arm, np.einsum("mi,mi->m", nodal, theta)

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


def on_chords(chords: Array, xi: Array) -> Array:
    """Points ``(n, m)`` on chords ``(n, 2)``, at the same ``xi`` ``(m,)`` on each or others ``(n, m)``; all complex."""
    return chords[:, :1] + xi * chords[:, 1:]


def ways(scene: Scene) -> Array:
    """Directions in which pulleys move, in the complex plane ``(pulleys,)``; zero of those that do not."""
    return np.array([complex(*pulley.direction) for pulley in scene.pulleys])


def _blank(scene: Scene, layout: Layout, ends: Array, strain: float, degree: int, elements: int | None) -> State:
    """Layout divided into cells, without fields."""
    layers = {"bending": bending_layer(scene, strain), "shear": shear_layer(scene, strain)}
    mesh, cells = divided(layout, ends, **layers, elements=elements)
    values = np.zeros((len(cells), width(degree, terms_of(scene).loads)))
    values[:, local(degree).sigma.stop - 1] = (ends[1:] - ends[:-1])[mesh.zone] * (cells[:, 1] - cells[:, 0])
    return State(scene, mesh, cells, degree, ends, np.zeros((len(cells), 4)), values)


def _drive(state: State, driven: Driven) -> None:
    """Sets the scalars that are no joints."""
    at, pulley, rate = local(state.degree), state.mesh.pulley, state.scene.transport_rate
    state.values[:, at.D] = driven.elongations[pulley, None]
    if state.terms.loads:
        state.values[:, at.rate] = driven.rate if rate is None else rate
        state.values[:, at.move] = driven.moves[pulley, None]


def _placed(state: State, r: Array, theta: Array) -> State:
    """Puts the nodes to ``r``, in the complex plane, and ``theta`` ``(n, k + 1)``, and the ends where they belong."""
    theta[:-1, 1] = theta[1:, 0]
    if state.layout.closed:
        turn = 2.0 * math.pi * round((theta[-1, 1] - theta[0, 0]) / (2.0 * math.pi))
        r[-1, 1], theta[-1, 1] = r[0, 0], theta[0, 0] + turn
    else:
        for (x, y, angle), end in zip(state.scene.ends, ((0, 0), (-1, 1)), strict=True):
            r[end], theta[end] = complex(x, y), angle
    state.values[:, local(state.degree).theta] = theta
    arm, chords, deviation = r - state._center[:, None], state._chords, state._deviation
    same = state.mesh.pulley[1:] == state.mesh.pulley[:-1]
    arm[1:, 0][same] = arm[:-1, 1][same]
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
    joints = string.joints if len(layout.joints) == 3 else string.joints[[0, 2]]
    ends = np.array([-half, *joints, half])
    state = _blank(scene, layout, ends, float(np.mean(string.strain)), degree, elements)
    nodes, sigma = points(degree)[0], state.sigma
    inside = (sigma[:, :1] + state.length[:, None] * nodes).ravel()
    n = len(sigma)
    _drive(state, Driven(string.strain[:1], 1.0, np.zeros(1)))
    D = string.D((sigma[:, 0] + sigma[:, 1]) / 2)
    tension = scene.belt.extensional_stiffness * np.maximum(D - 1.0, string.strain.min())
    _pressed(state, tension * D)
    return _placed(state, string.r(inside).view(complex).reshape(n, -1), string.phi(inside).reshape(n, -1))


def from_drive(scene: Scene, string: StringDrive, degree: int, elements: int | None = None) -> State:
    """The exact string of a drive, with its parts, its pressure and its friction in sliding.

    Args:
        scene: The dimensionless scene.
        string: The string.
        degree: Degree k.
        elements: Number of cells; by default, as many as the layers call for.
    """
    layout = ordered(scene, [own.part for own in string.parts if own.part.touches])
    lengths = np.array([own.length for own in string.parts])
    # Scaled, the last end is where the belt ends to the last bit.
    true = np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum() - 0.5
    ends = scene.belt.length * _apart(layout, true)
    strain = float(np.mean([own.stretches for own in string.parts])) - 1.0
    state = _blank(scene, layout, ends, strain, degree, elements)
    nodes = points(degree)[0]
    inside = (state.sigma[:, :1] + state.length[:, None] * nodes) / scene.belt.length
    radius = np.array([pulley.radius for pulley in scene.pulleys])
    elongations = np.zeros(radius.size)
    r, theta, along = np.empty(inside.shape, dtype=complex), np.empty(inside.shape), np.empty(inside.shape)
    part = np.clip(np.searchsorted(true, inside, side="right") - 1, 0, len(lengths) - 1)
    for i, own in enumerate(string.parts):
        here = part == i
        fraction = np.clip((inside[here] - true[i]) / (true[i + 1] - true[i]), 0.0, 1.0)
        x, y, theta[here], D = own.at(fraction)
        r[here] = x + 1j * y
        force = own.force[0] + fraction * (own.force[1] - own.force[0])
        along[here] = np.maximum(force, LEAST_STRAIN * scene.belt.extensional_stiffness) * D
        if own.part.touches and (own.part.kind == "stick" or elongations[own.part.pulley] == 0.0):
            on = own.part.pulley
            # The touching fibre's stretch is as much smaller as its radius is.
            elongations[on] = own.stretches[0] * radius[on] / (radius[on] + scene.belt.contact_offset) - 1.0
    _drive(state, Driven(elongations, string.rate, np.array(string.take_ups)))
    _pressed(state, along[:, :2].mean(axis=1))
    return _placed(state, r, theta)


def _apart(layout: Layout, ends: Array) -> Array:
    """Ends of parts, of which none takes less than a part `LEAST` of the contact that it is in."""
    ends = ends.copy()
    for pulley in layout.pulleys:
        on = layout.on(pulley)
        lengths = np.diff(ends[on[0] : on[-1] + 2])
        lengths = (
            np.maximum(lengths, LEAST * lengths.sum())
            / np.maximum(lengths, LEAST * lengths.sum()).sum()
            * lengths.sum()
        )
        ends[on[0] + 1 : on[-1] + 1] = ends[on[0]] + np.cumsum(lengths)[:-1]
    return ends


def _pressed(state: State, tension: Array) -> None:
    """Sets the pressure of a string of so much tension in each cell, and its friction where it slides."""
    at, (radius, friction, _), touches = local(state.degree), state.pulleys, state.mesh.touches
    p = np.where(touches, tension / (radius + state.scene.belt.contact_offset), 0.0)
    state.values[:, at.p] = p[:, None]
    state.values[:, at.f] = (-state.mesh.senses * friction * p)[:, None]


def from_fields(
    scene: Scene,
    old: Fields | State,
    layout: Layout,
    ends: Array,
    degree: int,
    elements: int | None = None,
    driven: Driven | None = None,
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
        driven: What there is to know of the pulleys besides the fields; that of a state is known.

    Raises:
        Stopped: A zone has no length.
    """
    if np.any(np.diff(ends) <= 0.0):
        raise Stopped(Status.NEWTON_DIVERGED, f"In {layout}, there is a zone of no length.")
    if driven is None:
        assert isinstance(old, State), "fields alone do not tell how the pulleys turn"
        driven = Driven(old.stretches - 1.0, old.rate, old.moves)
    state = _blank(scene, layout, ends, float(np.mean(driven.elongations)), degree, elements)
    if isinstance(old, State) and (old.mesh, old.terms) == (state.mesh, state.terms) and np.array_equal(old.ends, ends):
        kept = old.of_degree(degree)
        state = replace(kept, scene=scene, ends=ends, chords=kept.chords.copy(), values=kept.values.copy())
        r, theta, p, f = state.at_nodes
    else:
        nodes, gauss = (state.sigma[:, :1] + state.length[:, None] * inside for inside in points(degree))
        (r, theta), (p, f) = _read(old, nodes, gauss)
    at, mesh = local(degree), state.mesh
    state.values[:, at.p] = mesh.touches[:, None] * p
    slides = -(mesh.senses * state.pulleys[1])[:, None] * p
    state.values[:, at.f] = np.where(mesh.sticks[:, None], f, slides)
    _drive(state, driven)
    return _placed(state, r, theta)


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
