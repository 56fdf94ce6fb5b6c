"""An answer that needs no solver: a string that is exact, on a drive of two equal pulleys with inertia."""

from __future__ import annotations

import math

import numpy as np

from belt_fenicsx import Pulley, Scene, Solution, Status, StiffnessBelt
from belt_fenicsx.layout.arrays import vectors
from belt_fenicsx.layout.kind import FREE, Part
from belt_fenicsx.solution.certificate import certified
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.reading import contacts_of, zones_of

POINTS = 201  # of each part
RADIUS, DISTANCE, FRICTION, RATE = 0.1, 0.4, 0.5, 3.0
TIGHT, SLACK = 1600.0, 1000.0  # forces in the string's counterpart [N]
B1, MASS, A = 5e4, 20.0, 1e-9  # extensional stiffness, inertia rhoA c^2, bending stiffness of as good as none
SLIP = math.log(TIGHT / SLACK) / FRICTION


def stretch(F):
    """D, from F = b1 (D - 1) - rhoA c^2 D."""
    return (F + B1) / (B1 - MASS)


def part(pulley, kind, start, wrap, F, growth=0.0, slip=None):
    """A part on a pulley: what it is, and columns of its fields, seen from its first point and from the centre."""
    psi = np.linspace(0.0, wrap, POINTS)
    force = F * np.exp(growth * psi)
    lengths = psi / stretch(F)
    if growth:
        lengths = (B1 - MASS) / B1 * (psi - np.log((B1 + force) / (B1 + F)) / growth)
    D, phi = stretch(force), start - psi
    p = force * D / RADIUS
    r = pulley * DISTANCE + 1j * RADIUS * np.exp(1j * phi)
    columns = {"phi": phi, "D": D, "kappa": -D / RADIUS, "p": p, "f": -growth * p, "r": r}
    return Part(kind, slip, pulley), {"sigma": RADIUS * lengths, **columns}


def span(start, phi, F):
    """A straight span."""
    s = np.linspace(0.0, DISTANCE, POINTS)
    columns = {"phi": phi, "D": stretch(F), "kappa": 0.0, "p": 0.0, "f": 0.0, "r": start + s * np.exp(1j * phi)}
    return FREE, {"sigma": s / stretch(F), **{name: np.broadcast_to(value, s.shape) for name, value in columns.items()}}


def two_pulleys(side="right", turned=0.0, moved=0j, certificate=True, **changed):
    """The drive, seen from above or below, turned and moved; by default with its certificate.

    Args:
        side: Side of the pulleys.
        turned: Angle by which the drive is turned [rad].
        moved: Way by which it is moved [m].
        certificate: Whether to add the certificate.
        changed: Other values of the scene.
    """
    parts, rows = zip(
        part(0, "stick", math.pi, math.pi - SLIP, SLACK),
        part(0, "slip", SLIP, SLIP, SLACK, FRICTION, "forward"),
        span(1j * RADIUS, 0.0, TIGHT),
        part(1, "stick", 0.0, math.pi - SLIP, TIGHT),
        part(1, "slip", SLIP - math.pi, SLIP, TIGHT, -FRICTION, "backward"),
        span(DISTANCE - 1j * RADIUS, -math.pi, SLACK),
        strict=True,
    )
    sign = 1.0 if side == "right" else -1.0

    def place(z):
        return (z if sign > 0.0 else np.conj(z)) * np.exp(1j * turned) + moved

    columns = {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}
    ends = np.cumsum([0.0, *(row["sigma"][-1] for row in rows)])
    omegas, torque = (RATE * stretch(SLACK) / RADIUS, RATE * stretch(TIGHT) / RADIUS), RADIUS * (TIGHT - SLACK)
    belt = StiffnessBelt(
        length=float(ends[-1]), bending_stiffness=A, extensional_stiffness=B1, shear_stiffness=B1,
        line_density=MASS / RATE**2,
    )  # fmt: skip
    centers = [place(0j), place(DISTANCE + 0j)]
    drives = ({"omega": omegas[0]}, {"torque": -torque})
    pulleys = tuple(
        Pulley(radius=RADIUS, center=(center.real, center.imag), friction=FRICTION, side=side, **drive)
        for center, drive in zip(centers, drives, strict=True)
    )
    scene = Scene(**{"belt": belt, "pulleys": pulleys, "closed": True, **changed})
    zone, phi = np.repeat(np.arange(len(rows)), POINTS), sign * columns["phi"] + turned
    speeds = np.array([RADIUS * omegas[part.pulley] for part in parts])
    fields = Fields.from_state(
        belt, zone=zone, sigma=columns["sigma"] + ends[zone] - ends[-1] / 2, r=vectors(place(columns["r"])), theta=phi,
        phi=phi, D=columns["D"], kappa=sign * columns["kappa"], p=columns["p"], f=columns["f"],
        rate=RATE, v_rel=RATE * columns["D"] - speeds[zone],
    )  # fmt: skip
    zones = zones_of(scene, parts, fields)
    contacts = contacts_of(
        scene, zones, fields, rate=RATE, omegas=omegas, torques=(torque, -torque), capacities=(120.0, math.nan)
    )
    solution = Solution(
        scene=scene, method="made up", status=Status.SOLVED, transport_rate=RATE, contacts=contacts,
        zones=zones, fields=fields,
    )  # fmt: skip
    return certified(solution, tolerance=1e-9, balance=1e-7) if certificate else solution
