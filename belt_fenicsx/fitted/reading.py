"""What is read from a state of the fitted method: fields, zones and contact."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from belt_fenicsx.fitted.cells import distinct_points
from belt_fenicsx.fitted.dofs import local
from belt_fenicsx.fitted.state import POINTS, State, tables
from belt_fenicsx.layout.arrays import Array, vectors
from belt_fenicsx.layout.revision import Resultants, Sample, Samples
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.reading import contacts_of, zones_of

NEGATIVE = 0.1  # No error of a coarse state explains a negative pressure of this, relative to the largest one.
CLOSE = 1e-4  # belt lengths, within which a stretch is at its extremum


def samples(scene: Scene, state: State) -> Samples:
    """What a state says about its layout."""
    parts = [sample(state, i) if part.touches else None for i, part in enumerate(state.layout.parts)]
    forces_on = (state.pressure_forces, state.friction_forces, state.doubts)
    resultants = zip(*(forces.tolist() for forces in forces_on), strict=True)
    pulleys = [Resultants(*speed_at(scene, state, index), *forces) for index, forces in enumerate(resultants)]
    closes = state.layout.closes
    closing = None if closes is None else (closes, state.missing)
    return Samples(ends=state.ends, parts=tuple(parts), pulleys=tuple(pulleys), rate=state.rate, closing=closing)


def sample(state: State, index: int) -> Sample:
    """Fields densely along a part, with the x of the touching fibre."""
    cells, dense = state.mesh.cells(index), state.dense
    # Where cells meet, a point counts once.
    distinct = np.append(np.arange((cells.stop - cells.start) * POINTS).reshape(-1, POINTS)[:, :-1], -1)

    def keeping() -> Array:
        on = np.arange(cells.start, cells.stop)[:, None]
        own = dense.strain[cells], dense.kappa[cells], dense.theta[cells]
        return state.tractions(on, *own, sense=np.nan)[1].ravel()[distinct]

    x = dense.r.real[cells]
    if state.terms.offset:
        x = x + state.offsets[cells, None] * np.sin(dense.theta[cells])
    along = (dense.sigma[cells], x, dense.p[cells], dense.f[cells], dense.D[cells])
    sigma, x, p, f, D = (field.ravel()[distinct] for field in along)
    return Sample(sigma, x, p, f, D, keeping)


def speed_at(scene: Scene, state: State, index: int) -> tuple[float, float]:
    """Stretch D and place x at which the belt leaves a pulley's speed, or is nearest to it in pure slip."""
    layout = state.layout
    if index not in state.mesh.sliding or scene.pulleys[index].friction == 0.0:
        # Without friction, it is the speed at the run-up.
        cell = state.mesh.cells(layout.transition(index) % len(layout.parts)).stop - 1
        x = state.dense.r[cell, -1].real + state.offsets[cell] * math.sin(state.dense.theta[cell, -1])
        return float(state.stretches[index]), float(x)
    part = layout.on(index)[0]
    sense, at = layout.parts[part].sense, sample(state, part)
    sigma, x, D = at.sigma, at.x, at.D
    slowest, last = int(np.argmin(sense * D)), D.size - 1
    while 0 < slowest < last and sigma[-1] - sigma[0] > CLOSE:
        sigma = np.linspace(sigma[slowest - 1], sigma[slowest + 1], POINTS)
        cell, xi = state.located(sigma)
        strain, kappa = state.strains_at(cell, xi)
        x, D = state.at(cell, xi)[0].real, np.abs(state.fibre(cell, strain, kappa))
        slowest, last = int(np.argmin(sense * D)), D.size - 1
    return float(D[slowest]), float(x[slowest])


def surface_stretches(scene: Scene, state: State) -> Array:
    """Stretch of a belt that goes with the speed of each pulley's surface: that of the belt in stick ``(pulleys,)``.

    Where the belt slides all along, it is that of the given speed; without it, that of the belt where it is nearest to
    stick.
    """
    if not state.mesh.sliding:
        return state.stretches
    stretches = state.stretches.copy()
    for index in state.mesh.sliding:
        pulley = scene.pulleys[index]
        driven = pulley.drive.kind == "omega"
        stretches[index] = pulley.surface_speed / state.rate if driven else speed_at(scene, state, index)[0]
    return stretches


def sliding(scene: Scene, state: State, cell: Array, D: Array) -> Array:
    """Sliding speed c D - R omega at points of cells."""
    return state.rate * (D - surface_stretches(scene, state)[state.mesh.pulley[cell]])


def friction_suffices(scene: Scene, state: State) -> bool:
    """Whether friction holds at all Gauss points of stick, so that a coarse state calls for no other layout."""
    at, sticks = local(state.degree), state.mesh.sticks
    values, friction = state.values[sticks], state.pulleys[1, sticks, None]
    return not np.any(np.abs(values[:, at.f]) > friction * values[:, at.p])


def lifts_off(state: State) -> bool:
    """Whether the pressure is so negative in contact that no error explains it."""
    p = state.values[:, local(state.degree).p]
    return bool(p.min() < -NEGATIVE * p.max())


def fields_in(scene: Scene, state: State, cell: Array, xi: Array) -> Fields:
    """Fields at any points, with the accuracy of the method.

    Args:
        scene: The dimensionless scene.
        state: The state.
        cell: Cells of the points ``(m,)``.
        xi: Where they lie in these, from 0 to 1 ``(m,)``.
    """
    (r, theta), (p, f), (strain, kappa) = state.at(cell, xi), state.tractions_at(cell, xi), state.strains_at(cell, xi)
    tangent = state.fibre(cell, strain, kappa)
    D = np.abs(tangent)
    return Fields.from_state(
        scene.belt, zone=state.mesh.zone[cell], sigma=state.sigma[cell, 0] + xi * state.length[cell], r=vectors(r),
        theta=theta, phi=theta + np.angle(tangent), D=D, rate=state.rate, kappa=kappa, p=p, f=f,
        v_rel=sliding(scene, state, cell, D), offset=state.offsets[cell] if state.terms.offset else None,
    )  # fmt: skip


def fields(scene: Scene, state: State) -> Fields:
    """Fields at even points of each cell; the joints between zones appear once for each side."""
    mesh, dense = state.mesh, state.dense
    weight = state.length[:, None] * tables(state.degree)[3]
    inner = ~mesh.begins[1:]
    weight[:-1, -1][inner] += weight[1:, 0][inner]
    points, zone = distinct_points(mesh, POINTS)
    sigma, r, strain, D, theta, kappa, p, f, weight = (field.ravel()[points] for field in (*dense, weight))
    cell = points // POINTS
    return Fields.from_state(
        scene.belt, zone=zone, weight=weight, sigma=sigma, r=vectors(r), theta=theta,
        phi=theta + np.angle(state.fibre(cell, strain, kappa)), D=D, rate=state.rate, kappa=kappa, p=p, f=f,
        v_rel=sliding(scene, state, cell, D), offset=state.offsets[cell] if state.terms.offset else None,
    )  # fmt: skip


def answer(scene: Scene, state: State) -> dict[str, Any]:
    """Contacts, zones and fields of a state, as arguments of a solution."""
    found, rate = fields(scene, state), state.rate
    omegas = [
        pulley.drive.by("omega") if pulley.drive.kind == "omega" else rate * stretch / pulley.radius
        for pulley, stretch in zip(scene.pulleys, surface_stretches(scene, state).tolist(), strict=True)
    ]
    torques = [-p.radius * force for p, force in zip(scene.pulleys, state.friction_forces.tolist(), strict=True)]
    zones = zones_of(scene, state.layout.parts, found)
    contacts = contacts_of(
        scene, zones, found, rate=rate, omegas=omegas, torques=torques, centers=vectors(state.centers).tolist()
    )
    return {"transport_rate": rate, "contacts": contacts, "zones": zones, "fields": found}
