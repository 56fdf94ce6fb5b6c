"""What a discrete solution of the boundary-value problem says: is it plausible, its contact, zones and fields."""

from __future__ import annotations

import functools
import math
from itertools import pairwise

import numpy as np
from scipy.integrate import trapezoid
from scipy.interpolate import PPoly

from belt_fenicsx.bvp.equations import Slip, Stick
from belt_fenicsx.bvp.newton import Discrete
from belt_fenicsx.bvp.problem import FIRST, LAST, Problem, moment, placed_at, places
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.revision import Resultants, Sample, Samples
from belt_fenicsx.scene.pulley import Slip as Sense
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.contact import Contact, Zone
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.reading import contacts_of
from belt_fenicsx.solution.solution import Solution

DENSE = 100  # intervals of each zone at least, for the fields
SAMPLES = 97  # places in each zone at which the fields of two meshes are compared
FIELDS = ("r", "theta", "D", "eps", "Gamma", "kappa", "Q", "p", "f", "v_rel")
NO_FIELD = 1e-15  # largest value below which a field is nothing but rounding
FINER = 16  # Pieces of each interval of the mesh in which a new joint is looked for.
SAME_PLACE = 1e-12  # of coordinates that are the same but for rounding


def plausible(problem: Problem, discrete: Discrete, doubt: float | None = None) -> bool:
    """Whether a solution converged, with its borders in order and the belt pressed onto the pulley.

    The equations have solutions without any mechanical sense, too. Borders may be out of order by what is in doubt, by
    default what the mesh leaves.
    """
    doubt, borders = discrete.doubt if doubt is None else doubt, problem.borders(discrete.p)
    contact = borders[-2] - borders[1]
    if not discrete.converged or contact <= 0.0 or np.any(np.diff(borders) <= -doubt * contact):
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
    assert isinstance(slip, Slip), "what does not stick slides"
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


def torque(problem: Problem, discrete: Discrete) -> float:
    """Moment of the belt on the pulley."""
    ends = (
        (zone.state(problem.rod, y, c), sign)
        for end, index, sign in ((FIRST, 1, 1.0), (LAST, -2, -1.0))
        for zone, y, c in [problem.parts(discrete.y[:, end], discrete.p)[index]]
    )
    return float(sum(moment(problem.rod, sign)(state) for state, sign in ends))


def columns(problem: Problem, discrete: Discrete, inside: Array) -> Array:
    """Coordinate, state, pressure and friction at places inside of each zone.

    Args:
        problem: The problem.
        discrete: Its solution.
        inside: Places in the zones, as parts of them ``(len(zones), m)``.

    Returns:
        Rows sigma, x, y, phi, theta, kappa, D, p, f ``(9, len(zones), m)``.
    """
    borders, rows = problem.borders(discrete.p), []
    coordinates = placed_at(discrete.widths, inside)
    same = np.ptp(coordinates, axis=0).max() < SAME_PLACE
    values = discrete.between(coordinates[0]) if same else None
    for i, xi in enumerate(coordinates):
        zone, y, c = problem.parts(discrete.between(xi) if values is None else values, discrete.p)[i]
        sigma = (1.0 - inside[i]) * borders[i] + inside[i] * borders[i + 1]
        rows.append(np.vstack([sigma, zone.state(problem.rod, y, c), *zone.tractions(problem.rod, y, c)]))
    return np.stack(rows, axis=1)


def samples(problem: Problem, discrete: Discrete, pieces: int = 1) -> Samples:
    """What a solution says about its layout, from the nodes of its mesh or, if more than one, so many pieces of it."""
    xi, ends = discrete.finer(pieces), problem.borders(discrete.p)
    parts: list[Sample | None] = []
    values = discrete.y if pieces == 1 else discrete.between(xi)
    inside = zip(pairwise(ends), places(discrete.widths, xi), strict=True)
    for (zone, y, c), ((start, end), part) in zip(problem.parts(values, discrete.p), inside, strict=True):
        if zone.kind == "free":
            parts.append(None)
            continue
        (x, _, _, _, _, D), (p, f) = zone.state(problem.rod, y, c), zone.tractions(problem.rod, y, c)
        keeping = functools.partial(_keeping_friction, problem, y, D)
        parts.append(Sample(sigma=start + (end - start) * part, x=x, p=p, f=f, D=D, keeping=keeping))
    pressure = sum(float(trapezoid(part.p, part.sigma)) for part in parts if part is not None)
    stretch, place = grip(problem, discrete)
    return Samples(
        ends=ends,
        parts=tuple(parts),
        pulleys=(Resultants(stretch, place, pressure, -torque(problem, discrete) / problem.rod.radius),),
        finer=functools.partial(samples, problem, discrete, FINER) if pieces == 1 else None,
    )


def _keeping_friction(problem: Problem, y: Array, D: Array) -> Array:
    """Friction that would keep the stretch."""
    return Stick().tractions(problem.rod, y[:3], D[None])[1]


def changes(scene: Scene, problem: Problem, before: Discrete, after: Discrete) -> Array:
    """How far two solutions of a dimensionless scene differ: in what is asked for, and in each of the `FIELDS`.

    What is asked for is the angular velocity, relatively; where it is given, the torque, relative to the radius times
    the tension.
    """
    inside = places(after.widths, np.linspace(0.0, 1.0, SAMPLES))
    omega, asked, kinds = scene.pulleys[0].omega, [], []
    tension = np.hypot(*after.p[problem.slices[0][1]])
    for discrete in (before, after):
        D = grip(problem, discrete)[0]
        asked.append(math.log(abs(D)) if omega is None else torque(problem, discrete) / (problem.rod.radius * tension))
        _, x, y, phi, theta, kappa, stretch, p, f = columns(problem, discrete, inside)
        eps, Gamma = stretch * np.cos(theta - phi) - 1.0, -stretch * np.sin(theta - phi)
        v_rel = stretch - (D if omega is None else problem.rod.radius * omega)
        Q = np.stack([problem.rod.b1 * eps, problem.rod.b2 * Gamma])
        kinds.append((np.stack([x, y]), theta, stretch, eps, Gamma, kappa, Q, p, f, v_rel))
    errors = [np.max(np.abs(b - a)) / max(np.max(np.abs(b)), NO_FIELD) for a, b in zip(*kinds, strict=True)]
    return np.array([abs(asked[1] - asked[0]), *errors])


def field_errors(errors: Array) -> dict[str, float]:
    """Errors of the `FIELDS` by name; that of M is that of kappa."""
    named = dict(zip(FIELDS, map(float, errors), strict=True))
    return {**named, "M": named["kappa"]}


def answer(
    problem: Problem, scene: Scene, discrete: Discrete, omega: float | None = None
) -> tuple[tuple[Contact, ...], tuple[Zone, ...], Fields]:
    """Contacts, zones and fields of a dimensionless solution, at the speed of stick if not another."""
    xi = discrete.finer(math.ceil(DENSE / (discrete.mesh.size - 1)))
    table, zones = columns(problem, discrete, places(discrete.widths, xi)), []
    for i, zone in enumerate(problem.zones):
        sense: Sense | None = ("forward" if zone.friction >= 0.0 else "backward") if isinstance(zone, Slip) else None
        (start, end), x = table[0, i, [FIRST, LAST]].tolist(), table[1, i, [FIRST, LAST]].tolist()
        pulley = None if zone.kind == "free" else 0
        zones.append(Zone(kind=zone.kind, slip=sense, pulley=pulley, sigma=(start, end), x=(x[0], x[1])))
    index = np.repeat(np.arange(len(zones)), xi.size)
    sigma, x, y, phi, theta, kappa, D, pressure, friction = table.reshape(9, -1)
    omega = speed(problem, discrete) if omega is None else omega
    fields = Fields.from_state(
        scene.belt,
        zone=index,
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
    torques = (torque(problem, discrete),)
    contacts = contacts_of(scene, zones, fields, rate=1.0, omegas=(omega,), torques=torques)
    return contacts, tuple(zones), fields


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
