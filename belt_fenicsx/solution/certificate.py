"""Is a converged state an answer? Contact and friction inequalities, checked on the fields with their margins."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from belt_fenicsx.layout.arrays import Array, places
from belt_fenicsx.layout.kind import SENSE
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.contact import Contact, Zone
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.status import Status

if TYPE_CHECKING:
    from belt_fenicsx.solution.solution import Solution

BALANCE = 1e-4  # of the tension: sums over the contact of values at points; what is wrong in kind misses by far more
DRIVE = 1e-9  # of what friction can transmit, by which a drive may be missed
ROUNDING = 64 * float(np.finfo(float).eps)  # of a force, in units of the extensional stiffness
MOST = 1e-3  # of what is checked, that the estimated error of a field may excuse


@dataclass(frozen=True, kw_only=True)
class Check:
    """One line of the certificate.

    Attributes:
        name: What must hold.
        margin: How far it holds, relative to the natural size of the checked quantity; negative where it does not.
        tolerance: The negative margin that the discretisation is allowed.
        x: Where the margin is smallest [m].
    """

    name: str
    margin: float
    tolerance: float
    x: float

    @property
    def holds(self) -> bool:
        """Whether the margin is within the tolerance; false for NaN."""
        return bool(self.margin >= -self.tolerance)

    def __str__(self) -> str:
        verdict = "holds" if self.holds else "violated"
        margin = f"margin {self.margin:.3g} at x = {self.x:.6g} m (tolerance {self.tolerance:.1g})"
        return f"{self.name}: {verdict}, {margin}"


class Condition(NamedTuple):
    """What holds at all points of some zones: values relative to their size are at least zero, up to what is unknown.

    Attributes:
        name: Its name.
        kinds: Kinds of zones in which it holds.
        values: The values ``(n,)``.
        size: Their size ``(n,)``.
        error: Their estimated error, of which a part `MOST` of the size counts at most.
        rounding: Their rounding error.
    """

    name: str
    kinds: tuple[str, ...]
    values: Array
    size: Array
    error: float = 0.0
    rounding: float = 0.0


def certified(solution: Solution, *, tolerance: float, balance: float = BALANCE) -> Solution:
    """Adds the certificate to a converged solution and takes its success back where a check fails.

    Args:
        solution: A converged solution, in the units of its scene.
        tolerance: Negative relative margin that the discretisation is allowed.
        balance: Negative margin of the balances, relative to the tension, that the discretisation is allowed.

    Raises:
        SceneError: The transition was asked for outside of the contact zone that was found.
    """
    if solution.fields is None:
        raise ValueError("A solution without fields cannot be certified.")
    scene, zones, fields = solution.scene, solution.zones, solution.fields
    checks = certify(scene, zones, fields, tolerance=tolerance, balance=balance, errors=solution.field_errors)
    checks += _drive_met(scene, solution.contacts[0], fields)
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


def certify(
    scene: Scene,
    zones: tuple[Zone, ...],
    fields: Fields,
    *,
    tolerance: float,
    balance: float = BALANCE,
    errors: Mapping[str, float] = MappingProxyType({}),
) -> tuple[Check, ...]:
    """Checks borders, pressure, penetration, Coulomb's bound, the sense of sliding and the balances.

    Each margin is relative to the size of what it checks: friction to mu p, a sliding speed to the largest one of its
    zone, forces to the tension.

    Args:
        scene: The scene, in the units of the other arguments.
        zones: All zones, in the direction of travel.
        fields: Fields on both sides of each border and densely between.
        tolerance: Negative relative margin that the discretisation is allowed.
        balance: Negative margin of the balances, relative to the tension, that the discretisation is allowed.
        errors: Estimated errors of fields, relative to their largest values, which a margin is allowed, too.

    Returns:
        One check for each condition that the zones call for.
    """
    pulley, p_max = scene.pulleys[0], float(fields.p.max(initial=0.0))
    arm = places(fields.r) - complex(*pulley.center)
    everywhere = np.ones(fields.p.size)
    conditions: list[Condition] = [
        Condition("no penetration outside contact", ("free",), np.abs(arm) - pulley.radius, pulley.radius * everywhere),
        Condition("positive pressure in contact", ("stick", "slip"), fields.p, p_max * everywhere),
    ]
    if pulley.friction > 0.0:
        bound, f, speed = pulley.friction * fields.p, np.abs(fields.f), np.abs(fields.v_rel)
        unknown = errors.get("f", 0.0) * float(f.max())
        conditions.append(Condition("Coulomb's bound in stick", ("stick",), bound - f, np.abs(bound), unknown))
        senses, largest = np.zeros(len(zones)), np.zeros(len(zones))
        for index, zone in enumerate(zones):
            if zone.slip is not None:
                senses[index], largest[index] = SENSE[zone.slip], speed[fields.zone == index].max(initial=0.0)
        ahead, unknown = senses[fields.zone] * fields.v_rel, errors.get("v_rel", 0.0) * float(speed.max())
        least = ROUNDING * (scene.transport_rate or 1.0)
        size = np.maximum(largest, least)[fields.zone]
        conditions.append(Condition("sense of sliding in slip", ("slip",), ahead, size, unknown, least))
    checks = [_borders_in_order(scene, zones), *_smallest_margins(zones, fields, conditions, tolerance)]
    allowed = max(tolerance, balance) + min(sum(errors.get(name, 0.0) for name in ("Q", "M", "p", "f")), MOST)
    for name, margin in _balances(scene, fields, arm):
        checks.append(Check(name=name, margin=margin, tolerance=allowed, x=pulley.center[0]))
    return tuple(checks)


def transmissible(friction: float, pressure: float) -> float:
    """Force that friction can transmit [N], from the integral of the pressure; that of mu = 1 where mu is larger.

    With mu far above one, the belt gets slack long before the bound is reached.
    """
    return min(friction, 1.0) * pressure


def _smallest_margins(
    zones: tuple[Zone, ...],
    fields: Fields,
    conditions: Sequence[Condition],
    tolerance: float,
) -> list[Check]:
    """Checks of conditions at all points at once, each where its margin is smallest.

    Args:
        zones: All zones.
        fields: Fields, in the zones.
        conditions: The conditions.
        tolerance: Negative relative margin that the discretisation is allowed.
    """
    names, kinds, *columns = zip(*conditions, strict=True)
    values, sizes, errors, roundings = (np.array(column) for column in columns)
    where = np.array([[zone.kind in wanted for zone in zones] for wanted in kinds]).take(fields.zone, axis=1)
    # Without a size nothing can be told: NaN fails, and the smallest margin is NaN where one of them is.
    sizes[~(sizes > 0.0)] = math.nan
    excused = np.minimum(errors[:, None], MOST * sizes) + roundings[:, None]
    worst = np.where(where, (values + excused) / sizes, math.inf).argmin(axis=1).tolist()
    return [
        Check(
            name=name,
            margin=float(values[at] / sizes[at]),
            tolerance=float(tolerance + excused[at] / sizes[at]),
            x=float(fields.x[at[1]]),
        )
        for name, at in zip(names, enumerate(worst), strict=True)
        if where[at]
    ]


def _drive_met(scene: Scene, contact: Contact, fields: Fields) -> tuple[Check, ...]:
    """Whether the place, the speed or the torque that drives the pulley is met, relative to what friction can transmit.

    A speed is missed by the force b1 R (omega - omega given) / c that would stretch the belt by as much in stick; where
    nothing sticks, any speed is met. A place is missed by its distance, relative to the contact.
    """
    pulley, b1, drive = scene.pulleys[0], scene.belt.extensional_stiffness, scene.pulleys[0].drive
    capacity = transmissible(pulley.friction, float(fields.weight @ fields.p))
    if not capacity > 0.0 or isinstance(drive.value, str):
        return ()
    # Turns what is missed into a part of the contact, or of the force that friction can transmit.
    unit = {
        "x_trans": contact.x_off - contact.x_up,
        "torque": pulley.radius * capacity,
        "omega": (scene.transport_rate or 1.0) / pulley.radius * capacity / b1,
    }[drive.kind]
    missed = abs(getattr(contact, drive.kind) - drive.value) / unit
    unknown = ROUNDING * max(b1 / capacity, abs(drive.value) / unit)
    return (Check(name="drive met", margin=-missed, tolerance=DRIVE + unknown, x=contact.x_trans),)


def _balances(scene: Scene, fields: Fields, arm: Array) -> list[tuple[str, float]]:
    """Names and margins of the equilibrium of the whole belt between its clamps, integrated from (18.17).

    What the pulley exerts, summed up along the contact, has to be what the belt's forces and moments in the two free
    spans differ by. The second comes from the strains, the first from pressure and friction. The defect is relative to
    the tension, the largest force in the belt.

    Args:
        scene: The scene.
        fields: Fields.
        arm: Positions as seen from the pulley's centre, in the complex plane ``(n,)``.
    """
    if not fields.p.any():
        return []
    force = places(fields.Q) * np.exp(1j * fields.theta)
    load = (fields.f + 1j * fields.p) * np.exp(1j * fields.phi) * fields.weight
    moment = fields.M + (arm.conj() * force).imag
    # Constant in a free span; its mean is what a fixed mesh holds in equilibrium where it does not resolve the layers.
    up, off = fields.zone.searchsorted([1, fields.zone[-1]])
    first, last = (fields.weight[span] / fields.weight[span].sum() for span in (slice(up), slice(off, None)))
    defect = load.sum() + last @ force[off:] - first @ force[:up]
    twist = np.vdot(arm, load).imag + last @ moment[off:] - first @ moment[:up]
    tension = np.abs(force).max()
    return [
        ("balance of forces", -float(abs(defect) / tension)),
        ("balance of moments", -float(abs(twist) / (tension * scene.pulleys[0].radius))),
    ]


def _borders_in_order(scene: Scene, zones: tuple[Zone, ...]) -> Check:
    lengths = np.array([zone.sigma[1] - zone.sigma[0] for zone in zones]) / scene.belt.length
    shortest = int(np.argmin(lengths))
    return Check(name="borders in order", margin=float(lengths[shortest]), tolerance=0.0, x=float(zones[shortest].x[0]))
