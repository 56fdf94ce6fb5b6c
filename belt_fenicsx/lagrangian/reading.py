"""From Gauss-point data on a fixed mesh to zones, borders and fields; plain arrays, the same on every rank."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.pulley import RUN_OFF, RUN_UP
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.contact import Contact, Zone
from belt_fenicsx.solution.fields import Fields

# Negative relative margin that the certificate allows: what unfinished updates of the multipliers leave. A coarse mesh
# that sees the wrong sense of sliding by more is told so, though a finer one may find the scene admissible.
TOLERANCE = 1e-6
# Negative margin of the balances, relative to the tension, that it allows: a fixed mesh meets them as well as it
# resolves the layers. In the chapter's scene it is a thousandth of the whole pressure.
BALANCE = 6.5e-4

# Contact states of points, as numbers: arrays of words take six times the memory, and four times as long.
FREE, STICK, FORWARD, BACKWARD, FRICTIONLESS = range(5)
SLIP = {"forward": FORWARD, "backward": BACKWARD}

# A run of points inside the belt counts as a zone when it is longer than one element, which has two of them.
SHORTEST_RUN = 3


@dataclass(frozen=True)
class GaussData:
    """Converged data at all Gauss points, sorted along the belt, arrays ``(n,)`` and ``(n, 2)``.

    Attributes:
        sigma: Material-length coordinate.
        weight: Gauss weight, a material length.
        r: Position.
        dr: r' = D t.
        theta: Angle of the cross-section.
        kappa: theta'.
        g: Penetration.
        p: Pressure.
        f: Friction traction.
        share: Share of the point's part of its cell that lies after the transition.
    """

    sigma: Array
    weight: Array
    r: Array
    dr: Array
    theta: Array
    kappa: Array
    g: Array
    p: Array
    f: Array
    share: Array

    @property
    def D(self) -> Array:
        """Stretch ``(n,)``."""
        return np.hypot(*self.dr.T)


def recognise(scene: Scene, data: GaussData) -> tuple[Fields, tuple[Zone, ...], Contact]:
    """Reads fields, zones and contact of a dimensionless scene from its converged Gauss-point data."""
    pulley = scene.pulleys[0]
    kinds = _without_short_runs(_kinds(data, pulley.friction, pulley.slip))
    starts = np.flatnonzero(kinds[1:] != kinds[:-1]) + 1

    half = scene.belt.length / 2
    sigma = np.array([-half, *(_border(data, kinds, start, pulley.x_trans) for start in starts), half])
    places = _r(data, sigma[1:-1])
    x = np.array([-scene.span / 2, *places[:, 0], scene.span / 2])
    zones = tuple(_zone(kind, sigma[i : i + 2], x[i : i + 2]) for i, kind in enumerate(kinds[np.append(0, starts)]))

    touching = [zone for zone in zones if zone.kind != "free"]
    sigma_trans, x_trans = _transition(data, pulley.x_trans, touching)
    stuck = (kinds == STICK) & (data.share == 0.0) & (np.abs(data.f) < pulley.friction * data.p)
    D_trans = (
        np.average(data.D[stuck], weights=data.weight[stuck]) if stuck.any() else np.hypot(*_r(data, sigma_trans, 1).T)
    )
    omega = scene.transport_rate * float(D_trans) / pulley.radius
    contact = Contact.from_zones(
        tuple(touching),
        pulley,
        omega=omega,
        torque=float(-pulley.radius * np.sum(data.weight * data.f)),
        y=tuple(places[[0, -1], 1].tolist()),
        x_trans=x_trans,
    )
    # Contiguous: of columns of a table NumPy 1 rounds the angle in one of two ways, by the place of its result.
    dx, dy = np.ascontiguousarray(data.dr.T)
    fields = Fields.from_state(
        scene.belt,
        zone=np.searchsorted(starts, np.arange(len(kinds)), side="right"),
        weight=data.weight,
        sigma=data.sigma,
        r=data.r,
        theta=data.theta,
        phi=np.arctan2(dy, dx),
        D=data.D,
        kappa=data.kappa,
        p=data.p,
        f=data.f,
        v_rel=scene.transport_rate * data.D - pulley.radius * omega,
    )
    return fields, zones, contact


def _kinds(data: GaussData, friction: float, slip: str | None) -> Array:
    """Contact state of each point; where the stick friction was clipped to its bound, the belt slides."""
    if friction == 0.0:
        return np.where(data.p > 0.0, FRICTIONLESS, FREE)
    clipped = np.abs(data.f) >= friction * data.p
    before = np.where(clipped, np.where(data.f < 0.0, FORWARD, BACKWARD), STICK)
    return np.where(data.p > 0.0, np.where(data.share < 0.5, before, SLIP.get(slip, STICK)), FREE)


def _without_short_runs(kinds: Array) -> Array:
    """Gives short runs to a neighbour in contact: at a border one odd point is the mesh's doing, not a zone."""
    kinds = kinds.copy()
    bounds = np.concatenate([[0], np.flatnonzero(kinds[1:] != kinds[:-1]) + 1, [len(kinds)]])
    for start, end in zip(bounds[1:-2], bounds[2:-1], strict=True):
        neighbours = [kind for kind in (kinds[start - 1], kinds[end]) if kind != FREE]
        if end - start < SHORTEST_RUN and neighbours:
            kinds[start:end] = neighbours[0]
    return kinds


def _border(data: GaussData, kinds: Array, start: int, x_trans: float | str | None) -> float:
    """Material coordinate of the border between the points ``start - 1`` and ``start``."""
    before, after = start - 1, start
    if kinds[before] == FREE:
        return _lift_off(data, before, -1)
    if kinds[after] == FREE:
        return _lift_off(data, after, 1)
    if data.share[before] < 0.5 <= data.share[after]:
        return _sigma_at(data, before, x_trans)
    return float(data.sigma[before] + data.sigma[after]) / 2


def _lift_off(data: GaussData, near: int, outwards: int) -> float:
    """Border of contact, seen from the free side, where the gap grows with the square of the distance."""
    far, touching = near + outwards, near - outwards
    gaps = np.sqrt(np.maximum(-data.g.take([far, near], mode="clip"), 0.0))
    if gaps[0] <= gaps[1]:
        return float(data.sigma[near] + data.sigma[touching]) / 2
    return float(data.sigma[near] + (data.sigma[near] - data.sigma[far]) * gaps[1] / (gaps[0] - gaps[1]))


def _r(data: GaussData, sigma: Array, derivative: int = 0) -> Array:
    """Positions ``(n, 2)``, or their derivatives, by cubics between the points."""
    return CubicHermiteSpline(data.sigma, data.r, data.dr)(sigma, derivative)


def _sigma_at(data: GaussData, near: int, x: float) -> float:
    return float(data.sigma[near] + (x - data.r[near, 0]) / data.dr[near, 0])


def _transition(data: GaussData, x_trans: float | str | None, touching: list[Zone]) -> tuple[float, float]:
    """Material and global coordinate of the place whose stretch gives omega."""
    if x_trans == RUN_UP:
        return touching[0].sigma[0], touching[0].x[0]
    if x_trans == RUN_OFF:
        return touching[-1].sigma[1], touching[-1].x[1]
    return _sigma_at(data, int(np.argmin(np.abs(data.r[:, 0] - x_trans))), x_trans), x_trans


def _zone(kind: int, sigma: Array, x: Array) -> Zone:
    ends = {"sigma": (float(sigma[0]), float(sigma[1])), "x": (float(x[0]), float(x[1]))}
    if kind in (FREE, STICK):
        return Zone(kind="free" if kind == FREE else "stick", **ends)
    return Zone(kind="slip", slip=next((slip for slip, number in SLIP.items() if number == kind), None), **ends)
