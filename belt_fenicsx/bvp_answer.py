"""What a discrete solution of the boundary-value problem says: is it plausible, its contact, zones and fields."""

from __future__ import annotations

import math

import numpy as np

from belt_fenicsx.bvp_collocation import Discrete
from belt_fenicsx.bvp_problem import FIRST, LAST, Problem, moment
from belt_fenicsx.bvp_zones import Slip
from belt_fenicsx.scene import Scene
from belt_fenicsx.solution import Contact, Fields, Zone

DENSE = 100  # intervals of each zone at least, for the fields


def plausible(problem: Problem, discrete: Discrete) -> bool:
    """Whether a solution converged, with its borders in order and the belt pressed onto the pulley.

    The equations have solutions without any mechanical sense, too.
    """
    if not discrete.converged or np.any(np.diff(problem.borders(discrete.p)) <= 0.0):
        return False
    parts = problem.parts(discrete.y, discrete.p)
    return all(np.all(zone.tractions(problem.rod, y, c)[0] > 0.0) for zone, y, c in parts if zone.kind != "free")


def speed(problem: Problem, discrete: Discrete, end: int = FIRST) -> float:
    """Angular velocity at which the pulley's surface moves with the belt at the run-up, or the run-off."""
    parts = problem.parts(discrete.y[:, end], discrete.p)
    zone, y, c = parts[1] if end == FIRST else parts[-2]
    return float(zone.state(problem.rod, y, c)[5] / problem.rod.radius)


def answer(
    problem: Problem, scene: Scene, discrete: Discrete, omega: float | None = None
) -> tuple[Contact, tuple[Zone, ...], Fields]:
    """Contact, zones and fields of a dimensionless solution, at the pulley's speed at the run-up if not another."""
    mesh, p, borders = discrete.mesh, discrete.p, problem.borders(discrete.p)
    pieces = math.ceil(DENSE / (mesh.size - 1))
    xi = np.interp(np.arange(pieces * (mesh.size - 1) + 1) / pieces, np.arange(mesh.size), mesh)
    zones, columns = [], []
    for i, (zone, y, c) in enumerate(problem.parts(discrete.between(xi), p)):
        sigma = (1.0 - xi) * borders[i] + xi * borders[i + 1]
        state = zone.state(problem.rod, y, c)
        columns.append(np.vstack([np.full_like(xi, i), sigma, state, *zone.tractions(problem.rod, y, c)]))
        sense = ("forward" if zone.friction >= 0.0 else "backward") if isinstance(zone, Slip) else None
        ends = (float(borders[i]), float(borders[i + 1])), (float(state[0, FIRST]), float(state[0, LAST]))
        zones.append(Zone(kind=zone.kind, slip=sense, sigma=ends[0], x=ends[1]))
    index, sigma, x, y, phi, theta, kappa, D, pressure, friction = np.hstack(columns)
    omega = speed(problem, discrete) if omega is None else omega
    fields = Fields.from_state(
        scene.belt,
        zone=index.astype(int),
        sigma=sigma,
        r=np.column_stack([x, y]),
        theta=theta,
        phi=phi,
        D=D,
        kappa=kappa,
        p=pressure,
        f=friction,
        v_rel=D - problem.rod.radius * omega,
    )
    up, off = columns[1][2:8, FIRST], columns[-2][2:8, LAST]
    moment_up, moment_off = (moment(problem.rod, 1.0)(state)[0] for state in (up, off))
    stuck = [zone for zone in zones if zone.kind == "stick"]
    contact = Contact(
        omega=omega,
        x_up=float(up[0]),
        x_trans=stuck[-1].x[1] if stuck else float(up[0]),
        x_off=float(off[0]),
        torque=float(moment_up - moment_off),
        wrap_angle=float(up[2] - off[2]),
        zones=tuple(zones[1:-1]),
    )
    return contact, tuple(zones), fields
