"""What a discrete solution of the boundary-value problem says: is it plausible, its contact, zones and fields."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import PPoly

from belt_fenicsx.bvp_collocation import Discrete
from belt_fenicsx.bvp_problem import FIRST, LAST, Problem, moment, places
from belt_fenicsx.bvp_zones import Slip
from belt_fenicsx.fields import Fields
from belt_fenicsx.scene import Scene
from belt_fenicsx.solution import Contact, Solution, Zone

DENSE = 100  # intervals of each zone at least, for the fields


def plausible(problem: Problem, discrete: Discrete) -> bool:
    """Whether a solution converged, with its borders in order and the belt pressed onto the pulley.

    The equations have solutions without any mechanical sense, too.
    """
    if not discrete.converged or np.any(np.diff(problem.borders(discrete.p)) <= 0.0):
        return False
    parts = problem.parts(discrete.y, discrete.p)
    return all(np.all(zone.tractions(problem.rod, y, c)[0] > 0.0) for zone, y, c in parts if zone.kind != "free")


def grip(problem: Problem, discrete: Discrete) -> tuple[float, float]:
    """Stretch D and place x at which the belt leaves the pulley's speed, or is nearest to it in pure slip."""
    kinds = [zone.kind for zone in problem.zones]
    if "stick" in kinds or len(kinds) > 3:
        end = problem.parts(discrete.y[:, LAST], discrete.p)[kinds.index("stick") if "stick" in kinds else 1]
        state = end[0].state(problem.rod, *end[1:])
        return float(state[5]), float(state[0])
    # Where the belt slides all along, its slowest or fastest point tells how the pulley may turn.
    slip, rows = problem.zones[1], problem.slices[1][0]
    places = np.array([0.0])
    if slip.friction != 0.0:
        stretch = PPoly(discrete.between.c[:, :, rows][:, :, 3], discrete.between.x)
        places = np.concatenate([[0.0, 1.0], stretch.derivative().roots(extrapolate=False)])
    y = discrete.between(places)[rows]
    nearest = int(np.argmin(np.copysign(1.0, slip.friction) * y[3]))
    x, _, _, _, _, D = slip.state(problem.rod, y[:, nearest], np.empty(0))
    return float(D), float(x)


def speed(problem: Problem, discrete: Discrete) -> float:
    """Angular velocity at which the pulley's surface moves with the belt in stick.

    Where nothing sticks, it is the one that is nearest to it.
    """
    return grip(problem, discrete)[0] / problem.rod.radius


def final_stretch(problem: Problem, discrete: Discrete) -> float:
    """Stretch D at the run-off."""
    zone, y, c = problem.parts(discrete.y[:, LAST], discrete.p)[-2]
    return float(zone.state(problem.rod, y, c)[5])


def torque(problem: Problem, discrete: Discrete) -> float:
    """Moment of the belt on the pulley."""
    ends = (
        (zone.state(problem.rod, y, c), sign)
        for end, index, sign in ((FIRST, 1, 1.0), (LAST, -2, -1.0))
        for zone, y, c in [problem.parts(discrete.y[:, end], discrete.p)[index]]
    )
    return float(sum(moment(problem.rod, sign)(state)[0] for state, sign in ends))


def answer(
    problem: Problem, scene: Scene, discrete: Discrete, omega: float | None = None
) -> tuple[Contact, tuple[Zone, ...], Fields]:
    """Contact, zones and fields of a dimensionless solution, at the speed of stick if not another."""
    p, borders = discrete.p, problem.borders(discrete.p)
    xi = discrete.finer(math.ceil(DENSE / (discrete.mesh.size - 1)))
    zones, columns, inside = [], [], places(discrete.widths, xi)
    for i, (zone, y, c) in enumerate(problem.parts(discrete.between(xi), p)):
        sigma = (1.0 - inside[i]) * borders[i] + inside[i] * borders[i + 1]
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
    stuck = [zone for zone in zones if zone.kind == "stick"] or zones[1:-2]
    contact = Contact(
        omega=omega,
        x_up=float(up[0]),
        x_trans=stuck[0].x[1] if stuck else float(up[0]),
        x_off=float(off[0]),
        torque=torque(problem, discrete),
        wrap_angle=float(up[2] - off[2]),
        zones=tuple(zones[1:-1]),
    )
    return contact, tuple(zones), fields


def seen(solution: Solution) -> str:
    """What a state that is not admissible looks like, and where."""
    failed = {check.name: check.x for check in solution.checks if not check.holds}
    (contact,), sentences = solution.contacts, []
    if "borders in order" in failed:
        clamp = solution.scene.span / 2
        if contact.x_up >= contact.x_off:
            return f"The contact shrinks to a point near x = {(contact.x_up + contact.x_off) / 2:.6g} m."
        reached = contact.x_up <= -clamp or contact.x_off >= clamp
        return (
            "The contact reaches a clamp."
            if reached
            else f"A zone shrinks to nothing at x = {failed['borders in order']:.6g} m."
        )
    if (x := failed.get("positive pressure in contact")) is not None:
        near = 0.01 * (contact.x_off - contact.x_up)
        side = "the run-up" if x < contact.x_up + near else "the run-off" if x > contact.x_off - near else None
        where = f"next to {side}" if side else "inside of the contact, which is not one arc"
        sentences.append(f"The belt would lift off {where}, at x = {x:.6g} m, where the pressure is negative.")
    if (x := failed.get("no penetration outside contact")) is not None:
        side = "before the run-up" if x < contact.x_up else "behind the run-off"
        sentences.append(f"The free span {side} would go through the pulley at x = {x:.6g} m.")
    if sentences:
        return " ".join(sentences)
    if (x := failed.get("Coulomb's bound in stick")) is not None:
        sentences.append(f"Friction does not suffice for stick at x = {x:.6g} m.")
    if (x := failed.get("sense of sliding in slip")) is not None:
        sentences.append(f"The belt would slide the other way at x = {x:.6g} m.")
    return " ".join(sentences)
