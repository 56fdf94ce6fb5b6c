"""The exact string as a method of its own: the limit of a belt that neither bends nor shears.

It knows no gravity: spans are straight, and what lies on a pulley has no weight. Where a belt with a contact offset
slides, friction off its middle line would need a moment that a string has not: its forces are not in balance there.
Such a belt also slides where bending shortens the touching fibre: it comes close to the string in the first order of
e / R; one without an offset, in the first order of its bending stiffness.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.scene.units import Units
from belt_fenicsx.solution.certificate import certify
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.reading import contacts_of, zones_of
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stages, Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.capacity import at_capacity, capacities
from belt_fenicsx.taut_string.drive import string_drive
from belt_fenicsx.taut_string.shape import StringDrive
from belt_fenicsx.taut_string.standing import BeyondCapacity

METHOD = "string"
POINTS = 65  # Of each part, for its fields.
TOLERANCE = 1e-7  # Of the certificate.
SHORTEST = 1e-12  # A part that is no longer, in lengths of the belt, is none.


def solve(scene: Scene, *, rtol: float = 1e-8, comm: Any = None, initial: Solution | None = None) -> Solution:
    """Solves a scene as a string, exactly but for rounding.

    Args:
        scene: The scene.
        rtol: Not used.
        comm: Not used: each rank solves all of a scene.
        initial: Not used.

    Returns:
        The solution, without bending moments and shear; or what there is of it, as its status says.
    """
    dimensionless, units = scene.altered(gravity=(0.0, 0.0)).dimensionless()
    stages, solution = Stages(), Solution(scene=scene, method=METHOD, status=Status.SOLVED)
    try:
        string = string_drive(dimensionless)
    except BeyondCapacity as beyond:
        return replace(solution, status=beyond.status, message=_said(dimensionless, units, beyond))
    except Stopped as stopped:
        return replace(solution, status=stopped.status, message=stopped.message)
    # Where nothing slides behind a transition, there is nothing to show.
    string = replace(string, parts=tuple(own for own in string.parts if own.length > SHORTEST))
    stages.ran("string", "without gravity" if any(scene.gravity) and scene.belt.line_density else "exact")
    fields = _fields(dimensionless, string)
    zones = zones_of(dimensionless, [own.part for own in string.parts], fields)
    contacts = contacts_of(
        dimensionless,
        zones,
        fields,
        rate=string.rate,
        omegas=string.omegas,
        torques=string.torques,
        centers=string.centers,
        capacities=capacities(dimensionless, string),
    )
    solution = replace(
        solution,
        transport_rate=string.rate,
        contacts=contacts,
        zones=zones,
        fields=fields,
        stages=tuple(stages),
    ).in_units(scene.altered(gravity=(0.0, 0.0)), units)
    checks = certify(solution, tolerance=TOLERANCE)
    if scene.belt.contact_offset:
        checks = tuple(check for check in checks if not check.name.startswith("balance of"))
    admissible = all(check.holds for check in checks)
    status = Status.SOLVED if admissible else Status.NOT_ADMISSIBLE
    return replace(solution, scene=scene, checks=checks, status=status)


def _said(scene: Scene, units: Units, beyond: BeyondCapacity) -> str:
    """What the drive transmits at the limit that it is beyond, in words."""
    try:
        limit, load = at_capacity(scene, beyond.pulley, beyond.sense)
        torques, unit = string_drive(limit).torques, units.of(length=1, force=1)
    except Stopped:
        return beyond.message
    own = "" if load == beyond.pulley else f", and {torques[beyond.pulley] * unit:.6g} N m to pulley {beyond.pulley}"
    transmits = f"the string transmits {torques[load] * unit:.6g} N m to pulley {load}{own}"
    return f"Sliding all along pulley {beyond.pulley}, {transmits}."


def _fields(scene: Scene, string: StringDrive) -> Fields:
    """Fields of a dimensionless string: p = F D / R and f = -dF/dsigma (R + e) / R on a pulley."""
    fraction, columns = np.linspace(0.0, 1.0, POINTS), []
    sigma, G = -0.5, scene.belt.line_density * string.rate**2
    pulley = 0
    for index, own in enumerate(string.parts):
        x, y, phi, D = own.at(fraction)
        places, zero = sigma + fraction * own.length, np.zeros(POINTS)
        sigma += own.length
        # In a free part, sliding is told against the pulley before it.
        pulley = own.part.pulley if own.part.touches else pulley
        turn = scene.pulleys[pulley].turn if own.part.touches else 0.0
        radius, offset = scene.pulleys[pulley].radius, turn * scene.belt.contact_offset
        on_fibre = D * radius / (radius + scene.belt.contact_offset) if own.part.touches else D
        force = scene.belt.extensional_stiffness * (D - 1.0) - G * D
        p = force * on_fibre / radius if own.part.touches else zero
        f = -own.part.sense * scene.pulleys[pulley].friction * p
        kappa = -turn * on_fibre / radius
        v_rel = string.rate * on_fibre - radius * string.omegas[pulley]
        rows = (np.full(POINTS, index), places, x, y, phi, on_fibre, kappa, p, f, v_rel, np.full(POINTS, offset))
        columns.append(np.array(rows))
    zone, sigmas, x, y, phi, D, kappa, p, f, v_rel, offset = np.concatenate(columns, axis=1)
    fields = Fields.from_state(
        scene.belt,
        zone=zone.astype(int),
        sigma=sigmas,
        r=np.column_stack([x, y]),
        theta=phi,
        phi=phi,
        D=D,
        rate=string.rate,
        kappa=kappa,
        p=p,
        f=f,
        v_rel=v_rel,
        offset=offset if scene.belt.contact_offset else None,
    )
    return replace(fields, M=np.zeros_like(phi))
