"""What is read from a state of the fitted method: fields, zones and contact."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from belt_fenicsx.fitted.cells import once
from belt_fenicsx.fitted.dofs import local
from belt_fenicsx.fitted.state import POINTS, State, tables
from belt_fenicsx.layout.arrays import Array, vectors
from belt_fenicsx.layout.revision import Resultants, Sample, Samples
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.contact import Zone
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.reading import contacts_of

CLOSE = 1e-4  # belt lengths, within which a stretch is at its extremum


def samples(scene: Scene, state: State) -> Samples:
    """What a state says about its layout."""
    stretch, place = grip(scene, state)
    parts = [sample(state, i) if part.touches else None for i, part in enumerate(state.layout.parts)]
    on_pulley = Resultants(stretch, place, state.pressure_force, state.friction_force)
    return Samples(ends=state.ends, parts=tuple(parts), pulleys=(on_pulley,))


def sample(state: State, index: int) -> Sample:
    """Fields densely along a part."""
    cells, dense = state.mesh.cells(index), state.dense
    # Where cells meet, a point counts once.
    once = np.append(np.arange((cells.stop - cells.start) * POINTS).reshape(-1, POINTS)[:, :-1], -1)

    def keeping() -> Array:
        return state.tractions(np.array(np.nan), dense.strain[cells], dense.kappa[cells])[1].ravel()[once]

    along = (dense.sigma, dense.r.real, dense.p, dense.f, dense.D)
    sigma, x, p, f, D = (field[cells].ravel()[once] for field in along)
    return Sample(sigma, x, p, f, D, keeping)


def grip(scene: Scene, state: State) -> tuple[float, float]:
    """Stretch D and place x at which the belt leaves the pulley's speed, or is nearest to it in pure slip."""
    transition, pulley = state.layout.transition(0), scene.pulleys[0]
    if transition or pulley.friction == 0.0:
        return state.D_stick, float(state.ends_r[state.mesh.ends[transition], 0].real)
    sense, at = state.layout.parts[1].sense, sample(state, 1)
    sigma, x, D = at.sigma, at.x, at.D
    slowest, last = int(np.argmin(sense * D)), D.size - 1
    while 0 < slowest < last and sigma[-1] - sigma[0] > CLOSE:
        sigma = np.linspace(sigma[slowest - 1], sigma[slowest + 1], POINTS)
        cell, xi = state.located(sigma)
        x, D = state.at(cell, xi)[0].real, np.abs(1.0 + state.strains_at(cell, xi)[0])
        slowest, last = int(np.argmin(sense * D)), D.size - 1
    return float(D[slowest]), float(x[slowest])


def pulley_speed(scene: Scene, state: State) -> float:
    """Speed of the pulley's surface: that of the belt in stick.

    Where the belt slides all along, it is the given one; without it, that of the belt where it is nearest to stick.
    """
    pulley = scene.pulleys[0]
    if pulley.friction > 0.0 and state.layout.transition(0):
        return state.D_stick
    return grip(scene, state)[0] if pulley.omega is None else pulley.omega * pulley.radius


def holds(scene: Scene, state: State) -> bool:
    """Whether friction holds at all Gauss points of stick, so that a coarse state calls for no other layout."""
    at, values = local(state.degree), state.values[state.mesh.sticks]
    return not np.any(np.abs(values[:, at.f]) > scene.pulleys[0].friction * values[:, at.p])


def fields_at(scene: Scene, state: State, sigma: Array, before: bool = False) -> Fields:
    """Fields at any points, with the accuracy of the method.

    Args:
        scene: The dimensionless scene.
        state: The state.
        sigma: Coordinates in the belt ``(m,)``.
        before: Whether a border between zones belongs to the zone before it instead of the zone after it.
    """
    sigma = np.asarray(sigma, dtype=float)
    cell, xi = state.located(sigma, before=before)
    (r, theta), (p, f), (strain, kappa) = state.at(cell, xi), state.tractions_at(cell, xi), state.strains_at(cell, xi)
    D = np.abs(1.0 + strain)
    return Fields.from_state(
        scene.belt, zone=state.mesh.zone[cell], sigma=sigma, r=vectors(r), theta=theta,
        phi=theta + np.arctan2(strain.imag, 1.0 + strain.real), D=D, kappa=kappa, p=p, f=f,
        v_rel=D - pulley_speed(scene, state),
    )  # fmt: skip


def fields(scene: Scene, state: State) -> Fields:
    """Fields at even points of each cell; the borders between zones appear once for each side."""
    mesh, dense = state.mesh, state.dense
    weight = state.length[:, None] * tables(state.degree)[3]
    inner = ~mesh.begins[1:]
    weight[:-1, -1][inner] += weight[1:, 0][inner]
    points, zone = once(mesh, POINTS)
    sigma, r, strain, D, theta, kappa, p, f, weight = (field.ravel()[points] for field in (*dense, weight))
    return Fields.from_state(
        scene.belt, zone=zone, weight=weight, sigma=sigma, r=vectors(r), theta=theta,
        phi=theta + np.arctan2(strain.imag, 1.0 + strain.real), D=D, kappa=kappa, p=p, f=f,
        v_rel=D - pulley_speed(scene, state),
    )  # fmt: skip


def answer(scene: Scene, state: State) -> dict[str, Any]:
    """Contact, zones and fields of a state, as arguments of a solution."""
    mesh, radius, r, found = state.mesh, scene.pulleys[0].radius, state.ends_r, fields(scene, state)
    border = np.concatenate([r[:1, 0], r[mesh.ends, 0], r[-1:, 1]])
    sigma, x = (list(itertools.pairwise(ends.tolist())) for ends in (state.ends, border.real))
    zones = tuple(
        Zone(kind=part.kind, slip=part.slip, pulley=part.pulley if part.touches else None, sigma=sigma[i], x=x[i])
        for i, part in enumerate(mesh.layout.parts)
    )
    omega, torque = pulley_speed(scene, state) / radius, -radius * state.friction_force
    contacts = contacts_of(scene, zones, found, rate=1.0, omegas=(omega,), torques=(torque,))
    return {"transport_rate": 1.0, "contacts": contacts, "zones": zones, "fields": found}
