"""What a discrete solution of the boundary-value problem says: is it plausible, its contacts, zones and fields."""

from __future__ import annotations

import functools
import itertools
import math
from typing import Any

import numpy as np

from belt_fenicsx.bvp.collocation import POINTS, WEIGHTS, inner
from belt_fenicsx.bvp.equations import OnPulleys
from belt_fenicsx.bvp.newton import Discrete
from belt_fenicsx.bvp.problem import FIRST, LAST, Problem, placed_at, places
from belt_fenicsx.bvp.system import stretched
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.revision import Resultants, Sample, Samples
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.reading import contacts_of, zones_of
from belt_fenicsx.solution.solution import Solution

DENSE = 100  # Intervals of each part at least, for the fields.
SAMPLES = 97  # Places in each part at which the fields of two meshes are compared.
FIELDS = ("r", "theta", "D", "eps", "Gamma", "kappa", "Q", "p", "f", "v_rel")
NO_FIELD = 1e-15  # Largest value below which a field is nothing but rounding.
NO_SLIDING = 1e-12  # Speed of sliding, over the transport rate, below which stretches differ by rounding alone.
PIECES, FINER = 4, 32  # Pieces of each cell for samples; in which a new joint is looked for.
STRAIN, FRICTION = 3, 4  # Indices of unknowns on a pulley.


def plausible(problem: Problem, layout: Layout, discrete: Discrete, doubt: float | None = None) -> bool:
    """Whether a solution converged, with its joints in order and the belt pressed onto the pulleys.

    The equations have solutions without any mechanical sense, too. Joints may be out of order by what is in doubt, by
    default what the mesh leaves.
    """
    if not discrete.converged:
        return False
    doubt, lengths = discrete.doubt if doubt is None else doubt, discrete.values.lengths
    for index in layout.pulleys:
        on = lengths[list(layout.on(index))]
        if on.sum() <= 0.0 or np.any(on <= -doubt * on.sum()):
            return False
    if np.any(lengths[problem.spans.parts] <= 0.0):
        return False
    xi = np.tile(discrete.mesh, (problem.contacts.parts.size, 1))
    return bool(np.all(table(problem, discrete, 1, xi)[6] > 0.0))


def table(problem: Problem, discrete: Discrete, group: int, xi: Array) -> Array:
    """x, y, phi, theta, kappa, D - 1, p, f of a group ``(8, parts, q)`` at coordinates of its parts ``(parts, q)``."""
    own, values = problem.groups[group], discrete.values
    equations = problem.moved(values.moves) if group else own.equations
    return equations.fields(problem.rod, own.unscaled(discrete.between(group, xi)), np.asarray(values.c))


def columns(problem: Problem, discrete: Discrete, xi: Array) -> Array:
    """The same of all parts, the coordinate sigma first: ``(9, parts, q)`` for coordinates ``(parts, q)``."""
    result = np.empty((9, *xi.shape))
    inside, ends = places(discrete.widths, xi), known_ends(discrete)
    result[0] = ends[:-1, None] * (1.0 - inside) + ends[1:, None] * inside
    for index, group in enumerate(problem.groups):
        result[1:, group.parts] = table(problem, discrete, index, xi[group.parts])
    return result


def known_ends(discrete: Discrete) -> Array:
    """Ends of the parts, of which one is a point that has a negative length, but for what Newton's iteration leaves."""
    ends, lengths = discrete.ends, discrete.values.lengths
    for i in np.flatnonzero((lengths < 0.0) & (lengths >= -discrete.missed)):
        ends[i + 1] = ends[i]
    return ends


def surface(problem: Problem, layout: Layout, discrete: Discrete, pulley: int) -> tuple[float, float]:
    """Strain D - 1 and place x at which the belt leaves the pulley's speed, or is nearest to it in pure slip."""
    on = layout.on(pulley)
    sticks = [i for i in on if layout.parts[i].kind == "stick"]
    if sticks or len(on) > 1:
        return _at(problem, discrete, sticks[0] if sticks else on[0], 1.0)
    # Where the belt slides all along, its slowest or fastest point tells how the pulley may turn.
    (part,) = on
    sense, smooth = layout.parts[part].sense, float(problem.on(part).slope[0, 0]) == 0.0
    at = [0.0] if smooth else [0.0, 1.0, *_turns(problem, discrete, part)]
    return min((_at(problem, discrete, part, xi) for xi in at), key=lambda found: sense * found[0])


def _at(problem: Problem, discrete: Discrete, part: int, xi: float) -> tuple[float, float]:
    """Strain D - 1 and place x of the touching fibre at a coordinate of a part on a pulley."""
    index = problem.place[part][1]
    y = problem.contacts.unscaled(discrete.between(1, np.full((problem.contacts.parts.size, 1), xi)))[:, index, 0]
    on = problem.equations(part, discrete.values.moves)
    assert isinstance(on, OnPulleys)
    return float(y[STRAIN]), float(on.center[0, 0, 0] - on.turn[0, 0] * on.radius[0, 0] * math.sin(y[0]))


def _turns(problem: Problem, discrete: Discrete, part: int) -> list[float]:
    """Coordinates at which the stretch of a part is stationary."""
    rates = discrete.values.K[1][STRAIN, problem.place[part][1]]
    found = []
    for cell, rate in enumerate(rates):
        roots = np.roots(np.polynomial.Polynomial.fit(POINTS, rate, POINTS.size - 1).convert().coef[::-1])
        real = roots.real[np.abs(roots.imag) < 1e-12]
        found += [(cell + tau) / discrete.cells for tau in real if 0.0 <= tau <= 1.0]
    return found


def torque(problem: Problem, layout: Layout, discrete: Discrete, pulley: int) -> float:
    """Moment of the belt on a pulley."""
    total = sum(_friction(problem, discrete, part) for part in layout.on(pulley))
    return float(-problem.on(layout.on(pulley)[0]).radius[0, 0] * total)


def _friction(problem: Problem, discrete: Discrete, part: int) -> float:
    return float(discrete.values.z[1][FRICTION, problem.place[part][1], LAST] / problem.contacts.units[FRICTION])


def pressures(problem: Problem, discrete: Discrete) -> Array:
    """Integrals of the pressure over the parts on pulleys ``(parts of the group,)``."""
    group, values = problem.contacts, discrete.values
    y = group.unscaled(inner(values.z[1], values.K[1]))
    equations = problem.moved(values.moves)
    p, _ = equations.tractions(problem.rod, y.reshape(*y.shape[:2], -1), np.asarray(values.c))
    g = stretched(discrete.mesh, discrete.widths)[group.parts]
    return values.lengths[group.parts] * np.einsum("pcs,pcs,s->p", p.reshape(y.shape[1:]), g, WEIGHTS)


def transport_rate(problem: Problem, layout: Layout, discrete: Discrete) -> float:
    """The transport rate c."""
    if problem.giving is None:
        return discrete.values.c
    pulley, speed = problem.giving
    return speed / (1.0 + surface(problem, layout, discrete, pulley)[0])


def samples(problem: Problem, layout: Layout, discrete: Discrete, pieces: int = PIECES) -> Samples:
    """What a solution says about its layout, from so many pieces of each cell of its mesh."""
    xi = np.linspace(0.0, 1.0, pieces * discrete.cells + 1)
    count = problem.contacts.parts.size
    found = table(problem, discrete, 1, np.tile(xi, (count, 1)))
    y = problem.contacts.unscaled(discrete.between(1, np.tile(xi, (count, 1))))
    inside, ends = places(discrete.widths, xi), discrete.ends
    equations = problem.moved(discrete.values.moves)
    parts: list[Sample | None] = []
    for i, part in enumerate(problem.parts):
        if not part.touches:
            parts.append(None)
            continue
        at = problem.place[i][1]
        x, _, _, _, _, strain, p, f = found[:, at]
        keeping = functools.partial(_keeping, problem, equations.of(at), y[:, at], discrete.values.c)
        sigma = ends[i] + discrete.values.lengths[i] * inside[i]
        parts.append(Sample(sigma=sigma, x=x, p=p, f=f, D=1.0 + strain, keeping=keeping))
    pressure = pressures(problem, discrete)
    resultants = []
    for index in layout.pulleys:
        on = layout.on(index)
        strain, place = surface(problem, layout, discrete, index)
        total = float(sum(pressure[problem.place[i][1]] for i in on))
        resultants.append(Resultants(1.0 + strain, place, total, sum(_friction(problem, discrete, i) for i in on)))
    return Samples(
        ends=ends,
        parts=tuple(parts),
        pulleys=tuple(resultants),
        finer=functools.partial(samples, problem, layout, discrete, FINER) if pieces == PIECES else None,
        rate=transport_rate(problem, layout, discrete),
        closing=None if layout.closes is None else (layout.closes, _missing(problem, discrete)),
    )


def _missing(problem: Problem, discrete: Discrete) -> float:
    """Force along the belt that is missing where a loop begins."""
    forces, c = [], np.asarray(discrete.values.c)
    for group, at, end in ((problem.spans, -1, LAST), (problem.contacts, 0, FIRST)):
        values = discrete.values.z[group is problem.contacts][..., [end]]
        equations = problem.moved(discrete.values.moves) if group is problem.contacts else group.equations
        forces.append(equations.joined(problem.rod, group.unscaled(values), c)[4:, at, 0])
    phi = discrete.values.z[1][0, 0, FIRST] / problem.contacts.units[0]
    return float((forces[0] - forces[1]) @ [math.cos(phi), math.sin(phi)])


def _keeping(problem: Problem, equations: OnPulleys, y: Array, c: float) -> Array:
    """Friction that would keep the stretch."""
    return equations.keeping(problem.rod, y[:, None], np.asarray(c))[0]


def changes(scene: Scene, layout: Layout, problem: Problem, before: Discrete, after: Discrete) -> Array:
    """How far two solutions of a dimensionless scene differ: in what is asked for, and in each of the `FIELDS`."""
    inside = places(after.widths, np.linspace(0.0, 1.0, SAMPLES))
    asked, kinds = [], []
    for discrete in (before, after):
        asked.append(_asked(scene, layout, problem, discrete))
        _, x, y, phi, theta, kappa, strain, p, f = columns(problem, discrete, placed_at(discrete.widths, inside))
        psi, offset, D = theta - phi, _offsets(problem)[:, None], 1.0 + strain
        eps, Gamma = D * np.cos(psi) - offset * kappa - 1.0, -D * np.sin(psi)
        Q = np.stack([problem.rod.b1 * eps, problem.rod.b2 * Gamma])
        v_rel = _sliding(scene, layout, problem, discrete, strain)[problem.contacts.parts]
        kinds.append((np.stack([x, y]), theta, D, eps, Gamma, kappa, Q, p, f, v_rel))
    least = [NO_FIELD] * (len(FIELDS) - 1) + [NO_SLIDING]
    errors = [np.max(np.abs(b - a)) / max(np.max(np.abs(b)), no) for a, b, no in zip(*kinds, least, strict=True)]
    return np.array([float(np.max(np.abs(asked[1] - asked[0]))), *errors])


def _asked(scene: Scene, layout: Layout, problem: Problem, discrete: Discrete) -> Array:
    """What is asked for: logarithms of speeds, and torques relative to the radius times the tension.

    Of one pulley between clamps, it is the speed or, where that is given, the torque.
    """
    values = []
    for index, pulley in enumerate(scene.pulleys):
        moment = torque(problem, layout, discrete, index) / (pulley.radius * problem.tension)
        speed = math.log(abs(1.0 + surface(problem, layout, discrete, index)[0]))
        if scene.is_published:
            return np.array([speed if pulley.omega is None else moment])
        values += [speed, moment]
    return np.array([*values, math.log(abs(transport_rate(problem, layout, discrete))), *discrete.values.moves])


def _offsets(problem: Problem) -> Array:
    """Offset d of the middle line from the fibre that fields on the parts are of ``(parts,)``."""
    offsets = np.zeros(len(problem.parts))
    for part in problem.contacts.parts:
        offsets[part] = problem.rod.offset * problem.on(int(part)).turn[0, 0]
    return offsets


def speeds(scene: Scene, layout: Layout, problem: Problem, discrete: Discrete) -> tuple[float, ...]:
    """Angular velocity of each pulley: the given one, or that at which its surface moves with the belt in stick.

    Where nothing sticks, it is the one that is nearest to it.
    """
    rate = transport_rate(problem, layout, discrete)
    return tuple(
        pulley.drive.by("omega")
        if pulley.drive.kind == "omega"
        else rate * (1.0 + surface(problem, layout, discrete, index)[0]) / pulley.radius
        for index, pulley in enumerate(scene.pulleys)
    )


def _sliding(scene: Scene, layout: Layout, problem: Problem, discrete: Discrete, strains: Array) -> Array:
    """Sliding speed c D - R omega in each part, from the strains D - 1 ``(parts, q)``, whose differences it is.

    In a free part, it is against the pulley before it.
    """
    rate, on_surface = transport_rate(problem, layout, discrete), []
    for index, pulley in enumerate(scene.pulleys):
        driven = pulley.drive.kind == "omega" and not layout.sticks(index)
        strain = pulley.surface_speed / rate - 1.0 if driven else surface(problem, layout, discrete, index)[0]
        on_surface.append(strain)
    pulleys = list(itertools.accumulate((p.pulley if p.touches else -1 for p in layout.parts), max))
    return rate * (strains - np.array(on_surface)[np.maximum(pulleys, 0), None])


def field_errors(errors: Array) -> dict[str, float]:
    """Errors of the `FIELDS` by name; that of M is that of kappa."""
    named = dict(zip(FIELDS, map(float, errors), strict=True))
    return {**named, "M": named["kappa"]}


def answer(scene: Scene, layout: Layout, problem: Problem, discrete: Discrete) -> dict[str, Any]:
    """Zones, fields and what else a dimensionless solution has, as its arguments."""
    tau, weight = _inside(discrete.cells)
    xi = np.append((np.arange(discrete.cells)[:, None] + tau).ravel() / discrete.cells, 1.0)
    found = columns(problem, discrete, np.tile(xi, (len(layout.parts), 1)))
    rate, omegas = transport_rate(problem, layout, discrete), speeds(scene, layout, problem, discrete)
    # The rule of the collocation, which gives the integrals that its equations hold.
    g = np.zeros((len(layout.parts), discrete.cells, tau.size))
    g[:, :, weight > 0.0] = stretched(discrete.mesh, discrete.widths) * WEIGHTS
    weights = np.append(g.reshape(len(g), -1), np.zeros((len(g), 1)), axis=1) * discrete.values.lengths[:, None]
    sigma, x, y, phi, theta, kappa, strain, p, f = found.reshape(9, -1)
    v_rel = _sliding(scene, layout, problem, discrete, found[6])
    fields = Fields.from_state(
        scene.belt,
        zone=np.repeat(np.arange(len(layout.parts)), xi.size),
        sigma=sigma,
        r=np.column_stack([x, y]),
        theta=theta,
        phi=phi,
        D=1.0 + strain,
        rate=rate,
        kappa=kappa,
        p=p,
        f=f,
        v_rel=v_rel.ravel(),
        weight=weights.ravel(),
        offset=np.repeat(_offsets(problem), xi.size) if problem.rod.offset else None,
    )
    torques = tuple(torque(problem, layout, discrete, index) for index in range(len(scene.pulleys)))
    centers = [pulley.center for pulley in scene.pulleys]
    for take_up, move in zip(problem.take_ups, discrete.values.moves, strict=True):
        direction, pulley = take_up.direction, layout.parts[take_up.parts[0]].pulley
        centers[pulley] = tuple(at + move * way for at, way in zip(centers[pulley], direction, strict=True))
    zones = zones_of(scene, layout.parts, fields)
    contacts = contacts_of(scene, zones, fields, rate=rate, omegas=omegas, torques=torques, centers=centers)
    return dict(transport_rate=rate, contacts=contacts, zones=zones, fields=fields)


def _inside(cells: int) -> tuple[Array, Array]:
    """Places in a cell at which fields are given, and their weights: its start, its Gauss points, and some between."""
    between = max(1, math.ceil(DENSE / cells / (POINTS.size + 1)))
    ends = np.concatenate([[0.0], POINTS, [1.0]])
    tau = np.unique(np.concatenate([np.linspace(*pair, between + 1)[:-1] for pair in itertools.pairwise(ends)]))
    return tau, np.where(np.isin(tau, POINTS), 1.0, 0.0)


def explained(solution: Solution) -> str:
    """What a state that is not admissible looks like, and where."""
    failed, several = [check for check in solution.checks if not check.holds], len(solution.contacts) > 1
    by_name = {check.name: check for check in reversed(failed)}
    if "joints in order" in by_name:
        return _out_of_order(solution, by_name["joints in order"].x)
    sentences, contacts = [], {contact.pulley: contact for contact in solution.contacts}
    for check in failed:
        contact = contacts.get(check.pulley or 0)
        if contact is None:
            continue
        on, x = f" on pulley {contact.pulley}" if several else "", check.x
        near = 0.01 * abs(contact.x_off - contact.x_up)
        side = (
            "next to the run-up" if abs(x - contact.x_up) < near
            else "next to the run-off" if abs(x - contact.x_off) < near
            else "inside of the contact, which is not one arc"
        )  # fmt: skip
        way = "The free span before the run-up" if x < contact.x_up else "The free span behind the run-off"
        said = {
            "positive pressure in contact": f"The belt would lift off{on} {side}, at x = {x:.6g} m, where the pressure "
            "is negative.",
            "no penetration outside contact": f"A free span would go through pulley {contact.pulley} at x = {x:.6g} m."
            if several
            else f"{way} would go through the pulley at x = {x:.6g} m.",
            "Coulomb's bound in stick": f"Friction does not suffice for stick{on} at x = {x:.6g} m.",
            "sense of sliding in slip": f"The belt would slide the other way{on} at x = {x:.6g} m.",
        }
        if check.name in said:
            sentences.append((list(said).index(check.name) < 2, said[check.name]))
    # Where the shape is wrong, friction says no more.
    shapes = [text for of_shape, text in sentences if of_shape]
    return " ".join(shapes or [text for _, text in sentences])


def _out_of_order(solution: Solution, x: float) -> str:
    """What has joints out of order."""
    for contact in solution.contacts:
        on = f" with pulley {contact.pulley}" if len(solution.contacts) > 1 else ""
        if contact.zones[0].sigma[0] >= contact.zones[-1].sigma[1]:
            return f"The contact{on} shrinks to a point near x = {(contact.x_up + contact.x_off) / 2:.6g} m."
    if not solution.scene.closed:
        half, zones = solution.scene.belt.length / 2, solution.zones
        if zones[0].sigma[1] <= -half or zones[-1].sigma[0] >= half:
            return "The contact reaches a clamp."
    return f"A zone shrinks to nothing at x = {x:.6g} m."
