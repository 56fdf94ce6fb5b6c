"""States of the fitted method: where they come from, and what can be read from them. NumPy on each cell's dofs."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from belt_fenicsx.condensed import local
from belt_fenicsx.fields import Array, Fields, simpson_weights
from belt_fenicsx.fitted_forms import gauss_weights, lagrange_basis, points, prolongation
from belt_fenicsx.scene import Scene
from belt_fenicsx.solution import Contact, Zone
from belt_fenicsx.taut_string import TautString
from belt_fenicsx.zones import STICK, Mesh, Zones, bending_layer, divided, shear_layer

POINTS = 17  # of the fields, in each cell
CLOSE = 1e-4  # belt lengths, within which a stretch is at its extremum


@dataclass(frozen=True)
class State:
    """Where the iteration stands, dimensionless.

    Attributes:
        mesh: Zones and cells.
        cells: Both ends of each cell in its zone, which goes from 0 to 1 ``(n, 2)``.
        degree: Degree k.
        values: Unknowns of each cell ``(n, 5 k + 7)``.
    """

    mesh: Mesh
    cells: Array
    degree: int
    values: Array

    @property
    def D_stick(self) -> float:
        """Stretch in stick."""
        return float(self.values[0, local(self.degree).D[0]])

    @property
    def sigma(self) -> Array:
        """Both ends of each cell in the material-length coordinate ``(n, 2)``."""
        return self.values[:, local(self.degree).sigma]

    @property
    def ends(self) -> Array:
        """Ends of the zones ``(z + 1,)``."""
        sigma = self.sigma
        return np.concatenate([sigma[:1, 0], sigma[self.mesh.ends, 0], sigma[-1:, 1]])

    @property
    def nodes(self) -> Array:
        """Material-length coordinate and x of the cells' ends ``(n + 1, 2)``."""
        at = local(self.degree)
        left, right = (np.column_stack([self.values[:, at.sigma[i]], self.values[:, at.r[i, 0]]]) for i in (0, 1))
        return np.vstack([left, right[-1:]])

    @property
    def friction_force(self) -> float:
        """Integral of the friction traction."""
        f, sigma = self.values[:, local(self.degree).f], self.sigma
        return float((f @ gauss_weights(self.degree)) @ (sigma[:, 1] - sigma[:, 0]))

    def of_degree(self, degree: int) -> State:
        """The same fields in elements of another degree; exactly the same where it is higher."""
        if degree == self.degree:
            return self
        old, new = local(self.degree), local(degree)
        nodal, gauss = prolongation(self.degree, degree)
        values = np.empty((len(self.values), 5 * degree + 7))
        values[:, new.r] = nodal @ self.values[:, old.r]
        values[:, new.theta] = self.values[:, old.theta] @ nodal.T
        values[:, new.p] = self.values[:, old.p] @ gauss.T
        values[:, new.f] = self.values[:, old.f] @ gauss.T
        values[:, new.sigma], values[:, new.D] = self.values[:, old.sigma], self.values[:, old.D]
        return replace(self, degree=degree, values=values)


def _blank(scene: Scene, zones: Zones, ends: Array, strain: float, degree: int, elements: int | None) -> State:
    """Zones divided into cells, without fields."""
    layers = {"bending": bending_layer(scene, strain), "shear": shear_layer(scene, strain)}
    mesh, cells = divided(zones, ends, **layers, elements=elements)
    values = np.zeros((len(cells), 5 * degree + 7))
    sigma = ends[mesh.zone, None] + np.diff(ends)[mesh.zone, None] * cells
    sigma[1:, 0] = sigma[:-1, 1]
    values[:, local(degree).sigma] = sigma
    return State(mesh, cells, degree, values)


def _clamped(scene: Scene, state: State) -> State:
    """Puts the ends of the belt into the clamps."""
    at, values = local(state.degree), state.values
    values[0, at.r[0]], values[-1, at.r[1]] = (-scene.span / 2, 0.0), (scene.span / 2, 0.0)
    values[0, at.theta[0]] = values[-1, at.theta[1]] = 0.0
    return state


def from_string(scene: Scene, string: TautString, zones: Zones, degree: int, elements: int | None = None) -> State:
    """The taut string, with its pressure and its friction in sliding.

    Args:
        scene: The dimensionless scene.
        string: The string over its pulley.
        zones: The zones, of which the string has one or two in contact.
        degree: Degree k.
        elements: Number of cells; by default, as many as the layers call for.
    """
    half = scene.belt.length / 2
    borders = string.borders if len(zones.borders) == 3 else string.borders[[0, 2]]
    ends = np.array([-half, *borders, half])
    state = _blank(scene, zones, ends, float(np.mean(string.strain)), degree, elements)
    at, (nodes, _), sigma = local(degree), points(degree), state.sigma
    inside = (sigma[:, :1] + np.diff(sigma) * nodes).ravel()
    n = len(sigma)
    state.values[:, at.r] = string.r(inside).reshape(n, -1, 2)
    state.values[:, at.theta] = string.phi(inside).reshape(n, -1)
    state.values[:, at.D] = 1.0 + string.strain[0]
    D = string.D(sigma.mean(axis=1))
    tension = scene.belt.extensional_stiffness * np.maximum(D - 1.0, string.strain.min())
    p = np.where(state.mesh.touches, tension * D / scene.pulleys[0].radius, 0.0)
    sense = np.array([part.sense for part in zones.parts])[state.mesh.zone]
    state.values[:, at.p] = p[:, None]
    state.values[:, at.f] = (-sense * scene.pulleys[0].friction * p)[:, None]
    return _clamped(scene, state)


def from_fields(
    scene: Scene, old: Fields | State, zones: Zones, ends: Array, degree: int, elements: int | None = None
) -> State:
    """The fields of another solution on other zones, for a scene that may be another one.

    Args:
        scene: The dimensionless scene.
        old: The dimensionless fields of the other solution; its state where it is one of this method, so that nothing
            is lost between points.
        zones: The zones.
        ends: Ends of the zones ``(z + 1,)``.
        degree: Degree k.
        elements: Number of cells; by default, as many as the layers call for.
    """
    D_stick = old.D_stick if isinstance(old, State) else float(old.D[0] - old.v_rel[0])
    state = _blank(scene, zones, ends, D_stick - 1.0, degree, elements)
    at, (nodes, gauss), sigma = local(degree), points(degree), state.sigma
    values, parts, zone = state.values, zones.parts, state.mesh.zone
    at_nodes, at_gauss = (sigma[:, :1] + np.diff(sigma) * inside for inside in (nodes, gauss))
    values[:, at.r], values[:, at.theta] = _read(old, at_nodes)[:2]
    p, f = _read(old, at_gauss)[2:]
    sense = np.array([part.sense for part in parts])[zone, None]
    sticks = np.array([part == STICK for part in parts])[zone, None]
    values[:, at.p] = state.mesh.touches[:, None] * p
    values[:, at.f] = np.where(sticks, f, -sense * scene.pulleys[0].friction * p)
    values[:, at.D] = D_stick
    return _clamped(scene, state)


def _read(old: Fields | State, sigma: Array) -> tuple[Array, Array, Array, Array]:
    """r, theta, p and f at points ``(n, m)``."""
    if isinstance(old, State):
        columns = nodal_and_tractions(old, *_located(old, sigma.ravel()))
        r, theta, p, f = (column.reshape(*sigma.shape, *column.shape[1:]) for column in columns)
        return r, theta, p, f
    r = np.stack([np.interp(sigma, old.sigma, x) for x in old.r.T], axis=2)
    return r, *(np.interp(sigma, old.sigma, field) for field in (old.theta, old.p, old.f))


def _located(state: State, sigma: Array, *, before: bool = False) -> tuple[Array, Array]:
    """Cell and reference coordinate of points; at a border, those of the cell after it, or before it."""
    ends = state.sigma
    side = "left" if before else "right"
    cell = np.clip(np.searchsorted(ends[1:, 0], sigma, side=side), 0, len(ends) - 1)
    return cell, (sigma - ends[cell, 0]) / (ends[cell, 1] - ends[cell, 0])


def nodal_and_tractions(state: State, cell: Array, xi: Array) -> tuple[Array, Array, Array, Array]:
    """r, theta, p and f at points ``xi`` of cells."""
    at, (nodes, gauss) = local(state.degree), points(state.degree)
    nodal, traction = lagrange_basis(nodes, xi)[0], lagrange_basis(gauss, xi)[0]
    values = state.values[cell]
    r = np.einsum("mi,mic->mc", nodal, values[:, at.r])
    theta, p, f = (
        np.einsum("mi,mi->m", basis, values[:, dofs])
        for basis, dofs in ((nodal, at.theta), (traction, at.p), (traction, at.f))
    )
    return r, theta, p, f


def _slopes(state: State, cell: Array, xi: Array) -> tuple[Array, Array]:
    """Derivatives of r and theta at points ``xi`` of cells."""
    at, slopes = local(state.degree), lagrange_basis(points(state.degree)[0], xi)[1]
    length, values = (state.sigma[:, 1] - state.sigma[:, 0])[cell], state.values[cell]
    dr = np.einsum("mi,mic->mc", slopes, values[:, at.r]) / length[:, None]
    return dr, np.einsum("mi,mi->m", slopes, values[:, at.theta]) / length


def fields_at(scene: Scene, state: State, sigma: Array, before: bool = False) -> Fields:
    """Fields at any points, with the accuracy of the method.

    Args:
        scene: The dimensionless scene.
        state: The state.
        sigma: Coordinates in the belt ``(m,)``.
        before: Whether a border between zones belongs to the zone before it instead of the zone after it.
    """
    sigma = np.asarray(sigma, dtype=float)
    cell, xi = _located(state, sigma, before=before)
    r, theta, p, f = nodal_and_tractions(state, cell, xi)
    dr, kappa = _slopes(state, cell, xi)
    D = np.hypot(*dr.T)
    return Fields.from_state(
        scene.belt, zone=state.mesh.zone[cell], sigma=sigma, r=r, theta=theta, phi=np.arctan2(dr[:, 1], dr[:, 0]),
        D=D, kappa=kappa, p=p, f=f, v_rel=D - pulley_speed(scene, state),
    )  # fmt: skip


def pulley_speed(scene: Scene, state: State) -> float:
    """Speed of the pulley's surface: that of the belt in stick, or a given one, also where nothing sticks.

    Where the belt slides all along, it is that of the belt where it is nearest to stick.
    """
    pulley = scene.pulleys[0]
    if pulley.drive == "omega":
        return pulley.omega * pulley.radius
    if state.mesh.zones.transition or pulley.friction == 0.0:
        return state.D_stick
    sense, (sigma, _, _, D) = state.mesh.zones.parts[1].sense, along(state, 1)
    while (i := int(np.argmin(sense * D))) not in (0, D.size - 1) and sigma[i + 1] - sigma[i - 1] > CLOSE:
        sigma = np.linspace(sigma[i - 1], sigma[i + 1], POINTS)
        D = np.hypot(*_slopes(state, *_located(state, sigma))[0].T)
    return float(D[i])


@functools.cache
def uniform(count: int) -> Array:
    """``count`` points in the reference cell, its ends among them."""
    return np.linspace(0.0, 1.0, count)


@functools.cache
def tables(degree: int, count: int) -> tuple[Array, Array, Array, Array]:
    """At ``count`` points of the reference cell: polynomials through the nodes, their slopes, polynomials through the
    Gauss points; and weights of Simpson's rule."""
    at = uniform(count)
    nodes, gauss = points(degree)
    return *lagrange_basis(nodes, at), lagrange_basis(gauss, at)[0], simpson_weights(at)


def along(state: State, index: int) -> tuple[Array, Array, Array, Array]:
    """sigma, p, f and D densely along a zone."""
    at, cells = local(state.degree), state.mesh.zone == index
    _, slopes, gauss, _ = tables(state.degree, POINTS)
    values, ends = state.values[cells], state.sigma[cells]
    length = ends[:, 1:] - ends[:, :1]
    dr = slopes @ values[:, at.r] / length[..., None]
    D = np.sqrt(dr[..., 0] ** 2 + dr[..., 1] ** 2)
    sigma = ends[:, :1] + length * uniform(POINTS)
    return sigma.ravel(), (values[:, at.p] @ gauss.T).ravel(), (values[:, at.f] @ gauss.T).ravel(), D.ravel()


def fields(scene: Scene, state: State, count: int = POINTS) -> Fields:
    """Fields at ``count`` points of each cell; the borders between zones appear once for each side."""
    at, mesh, ends = local(state.degree), state.mesh, state.sigma
    nodal, slopes, gauss, _ = tables(state.degree, count)
    values = state.values
    length = ends[:, 1:] - ends[:, :1]
    dr, kappa = slopes @ values[:, at.r] / length[..., None], values[:, at.theta] @ slopes.T / length
    D = np.sqrt(dr[..., 0] ** 2 + dr[..., 1] ** 2)
    once = mesh.once(count)
    weight = length * tables(state.degree, count)[3]
    weight[:-1, -1] += np.where(mesh.zone[1:] == mesh.zone[:-1], weight[1:, 0], 0.0)
    everywhere = {
        "zone": np.repeat(mesh.zone, count).reshape(-1, count),
        "weight": weight,
        "sigma": ends[:, :1] + length * uniform(count),
        "r": nodal @ values[:, at.r],
        "theta": values[:, at.theta] @ nodal.T,
        "phi": np.arctan2(dr[..., 1], dr[..., 0]),
        "D": D,
        "kappa": kappa,
        "p": values[:, at.p] @ gauss.T,
        "f": values[:, at.f] @ gauss.T,
        "v_rel": D - pulley_speed(scene, state),
    }
    return Fields.from_state(scene.belt, **{name: field[once] for name, field in everywhere.items()})


def answer(scene: Scene, state: State) -> dict[str, Any]:
    """Contact, zones and fields of a state, as arguments of a solution."""
    at, mesh, pulley = local(state.degree), state.mesh, scene.pulleys[0]
    sigma, values = state.sigma, state.values
    first, last = np.array([0, *mesh.ends]), np.array([*mesh.ends, len(values)]) - 1
    x = values[:, at.r[:2, 0]]
    zones = tuple(
        Zone(kind=part.kind, slip=part.slip, sigma=(float(a), float(b)), x=(float(xa), float(xb)))
        for part, a, b, xa, xb in zip(
            mesh.zones.parts, sigma[first, 0], sigma[last, 1], x[first, 0], x[last, 1], strict=True
        )
    )
    up, off = (values[cell, at.r[end]] - pulley.center for cell, end in ((first[1], 0), (last[-2], 1)))
    contact = Contact(
        omega=pulley_speed(scene, state) / pulley.radius,
        x_up=zones[1].x[0],
        x_trans=zones[mesh.zones.transition].x[1],
        x_off=zones[-1].x[0],
        torque=-pulley.radius * state.friction_force,
        wrap_angle=math.atan2(up[1], up[0]) - math.atan2(off[1], off[0]),
        zones=zones[1:-1],
    )
    return {"contacts": (contact,), "zones": zones, "fields": fields(scene, state)}
