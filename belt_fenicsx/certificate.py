"""Is a converged state an answer? Contact and friction inequalities, checked on the fields with their margins."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from belt_fenicsx.fields import Array, Fields
from belt_fenicsx.scene import Scene, SceneError
from belt_fenicsx.solution import Check, Solution, Status, Zone

# Sums over the whole contact of values that are known at points: what is wrong in kind misses by far more.
BALANCE = 1e-3
SENSE = {"forward": 1.0, "backward": -1.0}


def certified(solution: Solution, *, tolerance: float) -> Solution:
    """Adds the certificate to a converged solution and takes its success back where a check fails.

    Args:
        solution: A converged solution, in the units of its scene.
        tolerance: Negative relative margin that the discretisation is allowed.

    Raises:
        SceneError: The transition was asked for outside of the contact zone that was found.
    """
    if solution.fields is None:
        raise ValueError("A solution without fields cannot be certified.")
    checks = certify(solution.scene, solution.zones, solution.fields, tolerance=tolerance)
    if all(check.holds for check in checks):
        return replace(solution, checks=checks)
    return replace(solution, checks=checks, status=Status.NOT_ADMISSIBLE)


def check_transition(scene: Scene, x_up: float, x_off: float) -> None:
    """Checks that the transition was asked for inside of the contact zone that was found.

    Raises:
        SceneError: It was not.
    """
    x_trans = scene.pulleys[0].x_trans
    if x_trans is None or isinstance(x_trans, str) or x_up < x_trans < x_off:
        return
    raise SceneError("pulleys.0.x_trans", f"lie in the contact zone ({x_up:.6g}, {x_off:.6g}) [m]", x_trans)


def certify(scene: Scene, zones: tuple[Zone, ...], fields: Fields, *, tolerance: float) -> tuple[Check, ...]:
    """Checks borders, pressure, penetration, Coulomb's bound and the sense of sliding.

    Args:
        scene: The scene, in the units of the other arguments.
        zones: All zones, in the direction of travel.
        fields: Fields on both sides of each border and densely between.
        tolerance: Negative relative margin that the discretisation is allowed.

    Returns:
        One check for each condition that the zones call for.
    """
    pulley = scene.pulleys[0]
    touching, sticking, sliding = (
        np.array([zone.kind in kinds for zone in zones])[fields.zone]
        for kinds in (("stick", "slip"), ("stick",), ("slip",))
    )
    p_max = np.max(fields.p, initial=0.0)
    gap = np.hypot(*(fields.r - np.asarray(pulley.center)).T) - pulley.radius

    checks = [_borders_in_order(scene, zones)]

    def check(name: str, margin: Array, where: Array) -> None:
        # The smallest of them is NaN where one of them is.
        margins = margin[where]
        if margins.size:
            index = int(margins.argmin())
            x = float(fields.x[where][index])
            checks.append(Check(name=name, margin=float(margins[index]), tolerance=tolerance, x=x))

    check("no penetration outside contact", gap / pulley.radius, ~touching)
    check("positive pressure in contact", fields.p / (p_max or math.nan), touching)
    if pulley.friction > 0.0:
        scale = pulley.friction * (p_max or math.nan)
        check("Coulomb's bound in stick", (pulley.friction * fields.p - np.abs(fields.f)) / scale, sticking)
        sense = np.array([SENSE.get(zone.slip or "", 0.0) for zone in zones])[fields.zone]
        speed = scene.transport_rate * fields.D
        check("sense of sliding in slip", sense * fields.v_rel / speed, sliding)
    for name, margin in _balances(scene, fields):
        allowed = max(tolerance, BALANCE)
        checks.append(Check(name=name, margin=margin, tolerance=allowed, x=pulley.center[0]))
    return tuple(checks)


def _balances(scene: Scene, fields: Fields) -> list[tuple[str, float]]:
    """Names and margins of the equilibrium of the whole belt between its clamps, integrated from (18.17).

    What the pulley exerts, summed up along the contact, has to be what the belt's forces and moments in the two free
    spans differ by. The second comes from the strains, the first from pressure and friction. The defect is relative to
    the whole pressure.
    """
    pulley, whole = scene.pulleys[0], fields.weight @ fields.p
    if not whole > 0.0:
        return []
    # Vectors in the complex plane.
    arm = fields.x - pulley.center[0] + 1j * (fields.y - pulley.center[1])
    force = (fields.Q[:, 0] + 1j * fields.Q[:, 1]) * np.exp(1j * fields.theta)
    load = (fields.f + 1j * fields.p) * np.exp(1j * fields.phi)
    moment = fields.M + (arm.conj() * force).imag
    # Constant in a free span; its mean is what a fixed mesh holds in equilibrium where it does not resolve the layers.
    first, last = (_mean(fields.zone == zone, fields.weight) for zone in (0, fields.zone[-1]))
    defect = fields.weight @ load + (last - first) @ force
    twist = fields.weight @ (arm.conj() * load).imag + (last - first) @ moment
    return [
        ("balance of forces", -float(abs(defect) / whole)),
        ("balance of moments", -float(abs(twist) / (whole * pulley.radius))),
    ]


def _mean(where: Array, weight: Array) -> Array:
    """Weights of the mean over a part of the belt."""
    part = where * weight
    return part / part.sum()


def _borders_in_order(scene: Scene, zones: tuple[Zone, ...]) -> Check:
    lengths = np.array([zone.sigma[1] - zone.sigma[0] for zone in zones]) / scene.belt.length
    shortest = int(np.argmin(lengths))
    return Check(name="borders in order", margin=float(lengths[shortest]), tolerance=0.0, x=float(zones[shortest].x[0]))
