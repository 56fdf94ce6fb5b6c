"""Is a converged state an answer? Contact and friction inequalities, checked on the fields with their margins."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from belt_fenicsx.layout.arrays import Array, places
from belt_fenicsx.layout.kind import SENSE
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.path import tangent_path
from belt_fenicsx.scene.pulley import Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.contact import Contact
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.reading import along, arc, beside, directions, fibre, force, on_pulley, parts_of, weighed
from belt_fenicsx.solution.status import Status

if TYPE_CHECKING:
    from belt_fenicsx.solution.solution import Solution

BALANCE = 1e-4  # of the tension: sums over the contact of values at points; what is wrong in kind misses by far more
DRIVE = 1e-9  # of what friction can transmit, by which a drive may be missed
UNKNOWN = 1e-7  # The same, by which rounding of a method's forces may excuse a drive that is missed.
ROUNDING = 64 * float(np.finfo(float).eps)  # of a force, in units of the extensional stiffness
MOST = 1e-3  # of what is checked, that the estimated error of a field may excuse


@dataclass(frozen=True, kw_only=True)
class Check:
    """One line of the certificate.

    Attributes:
        name: What must hold.
        margin: How far it holds, relative to the natural size of the checked quantity; negative where it does not.
        tolerance: The negative margin that the discretisation is allowed.
        x: Where the margin is smallest; for what the whole belt must meet, where it begins [m].
        pulley: Index of the pulley that it is about; None for the whole belt, and for an only pulley.
    """

    name: str
    margin: float
    tolerance: float
    x: float
    pulley: int | None = None

    @property
    def holds(self) -> bool:
        """Whether the margin is within the tolerance; false for NaN."""
        return bool(self.margin >= -self.tolerance)

    @property
    def title(self) -> str:
        """Its name, with the index of the pulley that it is about."""
        return self.name if self.pulley is None else f"{self.name}, pulley {self.pulley}"

    def __str__(self) -> str:
        verdict = "holds" if self.holds else "violated"
        margin = f"margin {self.margin:.3g} at x = {self.x:.6g} m (tolerance {self.tolerance:.1g})"
        return f"{self.title}: {verdict}, {margin}"


class Condition(NamedTuple):
    """What holds at all points of some zones: values relative to their size are at least zero, up to what is unknown.

    Attributes:
        name: Its name.
        pulley: Index of the pulley that it is about.
        kinds: Kinds of zones in which it holds: free ones, and those on the pulley.
        values: The values ``(n,)``.
        size: Their size ``(n,)``.
        error: Their estimated error, of which a part `MOST` of the size counts at most.
        rounding: Their rounding error.
    """

    name: str
    pulley: int
    kinds: tuple[str, ...]
    values: Array
    size: Array
    error: float = 0.0
    rounding: float = 0.0


def certified(
    solution: Solution,
    *,
    tolerance: float,
    balance: float = BALANCE,
    hub: float | None = None,
    doubts: Sequence[float] | None = None,
) -> Solution:
    """Adds the certificate to a converged solution and takes its success back where a check fails.

    Args:
        solution: A converged solution, in the units of its scene.
        tolerance: Negative relative margin that the discretisation is allowed.
        balance: Negative margin of the balances, relative to the tension, that the discretisation is allowed.
        hub: The same of the force of a take-up; the tolerance by default.
        doubts: What rounding may make of the resultant of friction on each pulley [N]; nothing by default.
    """
    checks = certify(solution, tolerance=tolerance, balance=balance, hub=hub, doubts=doubts)
    if all(check.holds for check in checks):
        return replace(solution, checks=checks)
    return replace(solution, checks=checks, status=Status.NOT_ADMISSIBLE)


def check_transition(scene: Scene, x_up: float, x_off: float, pulley: int = 0) -> None:
    """Checks that the transition was asked for inside of the contact zone that was found.

    Raises:
        SceneError: It was not.
    """
    x_trans, (low, high) = scene.pulleys[pulley].x_trans, sorted((x_up, x_off))
    if x_trans is None or isinstance(x_trans, str) or low < x_trans < high:
        return
    raise SceneError(f"pulleys.{pulley}.x_trans", f"lie in the contact zone ({low:.6g}, {high:.6g}) [m]", x_trans)


def certify(
    solution: Solution,
    *,
    tolerance: float,
    balance: float = BALANCE,
    hub: float | None = None,
    doubts: Sequence[float] | None = None,
) -> tuple[Check, ...]:
    """Checks joints, pressure, penetration, Coulomb's bound, the sense of sliding, the balances and the drives.

    Each margin is relative to the size of what it checks: friction to mu p, a sliding speed to the largest one of its
    zone, forces to the tension. Where there is more than one pulley below a belt without loads, the whole belt has to
    be in balance, too.

    Args:
        solution: A solution with fields on both sides of each joint and densely between.
        tolerance: Negative relative margin that the discretisation is allowed.
        balance: Negative margin of the balances, relative to the tension, that the discretisation is allowed.
        hub: The same of the force of a take-up; the tolerance by default.
        doubts: What rounding may make of the resultant of friction on each pulley [N]; nothing by default.

    Returns:
        One check for each condition that the zones call for.
    """
    if solution.fields is None:
        raise ValueError("A solution without fields cannot be certified.")
    fields, errors = solution.fields, solution.field_errors
    parts = parts_of(fields, solution.zones)
    allowed = max(tolerance, balance) + min(sum(errors.get(name, 0.0) for name in ("Q", "M", "p", "f")), MOST)
    checks = [_joints_in_order(solution), *_smallest_margins(solution, fields, parts, tolerance)]
    checks += _balances(solution, fields, parts, allowed)
    for contact in solution.contacts:
        checks += _drive_met(solution, contact, fields, parts, doubts[contact.pulley] if doubts else 0.0)
    if not solution.scene.is_published:
        checks += _whole_belt(solution, fields, tolerance, allowed, tolerance if hub is None else hub)
    return tuple(checks)


def transmissible(friction: float, pressure: float) -> float:
    """Force that friction can transmit [N], from the integral of the pressure; that of mu = 1 where mu is larger.

    With mu far above one, the belt gets slack long before the bound is reached.
    """
    return min(friction, 1.0) * pressure


def _numbered(scene: Scene, pulley: int) -> int | None:
    """The index of a pulley that a check is about: an only one needs none."""
    return pulley if len(scene.pulleys) > 1 else None


def _joints_in_order(solution: Solution) -> Check:
    zones = solution.zones
    lengths = np.array([zone.sigma[1] - zone.sigma[0] for zone in zones]) / solution.scene.belt.length
    shortest = int(np.argmin(lengths))
    # A zone of no length may have ends that differ in their last digits.
    return Check(
        name="joints in order",
        margin=float(lengths[shortest]),
        tolerance=ROUNDING / 16,
        x=float(zones[shortest].x[0]),
    )


def _conditions(solution: Solution, fields: Fields, parts: Sequence[slice]) -> Iterator[Condition]:
    """What holds at all points of some zones, pulley by pulley."""
    scene, zones, errors = solution.scene, solution.zones, solution.field_errors
    centers, everywhere = {contact.pulley: contact.center for contact in solution.contacts}, np.ones(fields.p.size)
    f, speed, least = np.abs(fields.f), np.abs(fields.v_rel), ROUNDING * solution.transport_rate
    unknown_f = errors.get("f", 0.0) * float(f.max())
    # There may be no speed where there is no pulley.
    unknown_speed = errors.get("v_rel", 0.0) * float(np.fmax.reduce(speed))
    senses, largest = np.zeros(len(zones)), np.zeros(len(zones))
    for i, zone in enumerate(zones):
        if zone.slip is not None:
            senses[i], largest[i] = SENSE[zone.slip], speed[parts[i]].max(initial=0.0)
    ahead, fastest = senses[fields.zone] * fields.v_rel, np.maximum(largest, least)[fields.zone]
    for i, pulley in enumerate(scene.pulleys):
        gap = np.abs(fibre(scene, fields, pulley.turn) - complex(*centers.get(i, pulley.center))) - pulley.radius
        yield Condition("no penetration outside contact", i, ("free",), gap, pulley.radius * everywhere)
        if i not in centers:
            continue
        p_max, bound = float(fields.p[arc(parts, on_pulley(zones, i))].max()), pulley.friction * fields.p
        yield Condition("positive pressure in contact", i, ("stick", "slip"), fields.p, p_max * everywhere)
        if pulley.friction > 0.0:
            yield Condition("Coulomb's bound in stick", i, ("stick",), bound - f, np.abs(bound), unknown_f)
            yield Condition("sense of sliding in slip", i, ("slip",), ahead, fastest, unknown_speed, least)


def _smallest_margins(solution: Solution, fields: Fields, parts: Sequence[slice], tolerance: float) -> list[Check]:
    """Checks of all conditions at all points at once, each where its margin is smallest.

    Args:
        solution: The solution.
        fields: Its fields.
        parts: The points of each zone.
        tolerance: Negative relative margin that the discretisation is allowed.
    """
    names, pulleys, kinds, *columns = zip(*_conditions(solution, fields, parts), strict=True)
    values, sizes, errors, roundings = (np.array(column) for column in columns)
    # A zone that is a point bears nothing: the belt has the pulley's speed there, on its way to the other sense.
    rows = [
        [
            zone.kind in wanted and zone.pulley in (None, pulley) and zone.sigma[0] != zone.sigma[1]
            for zone in solution.zones
        ]
        for pulley, wanted in zip(pulleys, kinds, strict=True)
    ]
    where = np.array(rows).take(fields.zone, axis=1)
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
            pulley=_numbered(solution.scene, pulley),
        )
        for name, pulley, at in zip(names, pulleys, enumerate(worst), strict=True)
        if where[at]
    ]


def _balances(solution: Solution, fields: Fields, parts: Sequence[slice], allowed: float) -> Iterator[Check]:
    """Equilibrium of what lies on each pulley, between the free spans at both sides of it, integrated from (18.17).

    What the pulley exerts, summed up along the contact, and the weight there have to be what the belt's forces and
    moments in the two spans differ by. The second comes from the strains, the first from pressure and friction. The
    defect is relative to the tension, the largest force in the belt.

    Args:
        solution: The solution.
        fields: Its fields.
        parts: The points of each zone.
        allowed: What the discretisation is allowed.
    """
    if not fields.p.any():
        return
    scene, zones, rate = solution.scene, solution.zones, solution.transport_rate
    r, N, tension = places(fields.r), force(scene, fields, rate), float(np.abs(places(fields.Q)).max())
    M = fields.M - scene.belt.rotary_inertia * rate**2 * fields.kappa
    line_weight = scene.belt.line_density * complex(*scene.gravity)
    for contact in solution.contacts:
        pulley, zones_on = scene.pulleys[contact.pulley], on_pulley(zones, contact.pulley)
        on, arm, number = arc(parts, zones_on), r - complex(*contact.center), _numbered(scene, contact.pulley)
        taken, turned = weighed(scene, fields, complex(*contact.center))
        before, after = beside(scene, fields, parts, zones_on, N, taken)
        load = (fields.f[on] + 1j * pulley.turn * fields.p[on]) * directions(fields.phi[on]) * fields.weight[on]
        defect = after - before + load.sum()
        before, after = beside(scene, fields, parts, zones_on, M + (arm.conj() * N).imag, turned)
        lever = fibre(scene, fields, pulley.turn, on) - complex(*contact.center)
        twist = (after - before).real + np.vdot(lever, load).imag
        if line_weight:
            weight = line_weight * fields.weight[on]
            defect, twist = defect + weight.sum(), twist + np.vdot(arm[on], weight).imag
        for name, missed in (
            ("balance of forces", abs(defect) / tension),
            ("balance of moments", abs(twist) / (tension * pulley.radius)),
        ):
            yield Check(name=name, margin=-float(missed), tolerance=allowed, x=contact.center[0], pulley=number)


def _drive_met(
    solution: Solution, contact: Contact, fields: Fields, parts: Sequence[slice], doubt: float
) -> Iterator[Check]:
    """Whether what drives the pulley is met, relative to what friction can transmit.

    A speed is missed by the force b1 R (omega - omega given) / c that would stretch the belt by as much in stick; where
    nothing sticks, any speed is met. A place is missed by its distance, relative to the contact; an angle, relative to
    the wrap; both by as much as there is where the sliding behind has the other sense.
    """
    pulley, b1 = solution.scene.pulleys[contact.pulley], solution.scene.belt.extensional_stiffness
    drive, on = pulley.drive, arc(parts, on_pulley(solution.zones, contact.pulley))
    capacity = transmissible(pulley.friction, float(fields.weight[on] @ fields.p[on]))
    if drive.kind == "none" or not capacity > 0.0 or isinstance(drive.value, str):
        return
    # Turns what is missed into a part of the contact, or of the force that friction can transmit.
    unit = {
        "x_trans": contact.x_off - contact.x_up,
        "torque": pulley.radius * capacity,
        "omega": solution.transport_rate / pulley.radius * capacity / b1,
        "slip_angle": contact.wrap_angle,
    }[drive.kind]
    wanted = drive.value + drive.drag * contact.omega
    missed = abs(getattr(contact, drive.kind) - wanted) / unit
    if drive.is_place and _behind_stick(contact) not in (None, drive.slip):
        missed = 1.0
    unknown = ROUNDING * max(b1 / capacity, abs(wanted) / unit)
    yield Check(
        name="drive met",
        margin=-missed,
        tolerance=DRIVE + unknown + min(doubt / capacity, UNKNOWN),
        x=contact.x_trans,
        pulley=_numbered(solution.scene, contact.pulley),
    )


def _behind_stick(contact: Contact) -> Slip | None:
    """Sense of the sliding that follows stick; None where nothing sticks, or nothing follows."""
    following = itertools.dropwhile(lambda zone: zone.kind != "stick", contact.zones)
    return next((zone.slip for zone in itertools.islice(following, 1, None)), None)


def _whole_belt(solution: Solution, fields: Fields, tolerance: float, allowed: float, hub: float) -> Iterator[Check]:
    """Whether a loop is closed, forces and power are in balance on the whole belt, and take-ups have their force.

    Forces are relative to the tension, power to that which passes through the belt.

    Args:
        solution: The solution.
        fields: Its fields.
        tolerance: What the joints are allowed.
        allowed: What sums are allowed.
        hub: What hub loads along take-ups are allowed.
    """
    scene, belt, rate, start = solution.scene, solution.scene.belt, solution.transport_rate, float(fields.x[0])
    tension, N = float(np.abs(places(fields.Q)).max()), force(scene, fields, rate)
    clamped, r = complex(N[-1] - N[0]), places(fields.r)
    delivered = rate * float(np.diff(_carried(scene, fields, rate))[0])
    if scene.closed:
        path = tangent_path(scene)
        turn = path.lines[-1].angle - path.arcs[0].start
        gap = max(abs(r[-1] - r[0]) / belt.length, abs(fields.theta[-1] - fields.theta[0] - turn))
        yield Check(name="loop closed", margin=-float(gap), tolerance=tolerance, x=start)
        # A loop has no clamps that could hold what is missing.
        clamped, delivered = 0j, 0.0
    weight = belt.line_density * belt.length * complex(*scene.gravity)
    hubs = sum(complex(*contact.hub_force) for contact in solution.contacts)
    yield Check(name="balance of hub loads", margin=-abs(clamped + weight - hubs) / tension, tolerance=allowed, x=start)
    lost = sum(contact.power for contact in solution.contacts) + solution.losses - delivered
    yield Check(name="balance of power", margin=-abs(lost) / (tension * rate), tolerance=allowed, x=start)
    for contact in solution.contacts:
        pulley = scene.pulleys[contact.pulley]
        if pulley.take_up is not None and pulley.force is not None:
            missed = abs(along(pulley.take_up, complex(*contact.hub_force)) + pulley.force) / tension
            yield Check(
                name="force of the take-up",
                margin=-missed,
                tolerance=hub,
                x=contact.center[0],
                pulley=_numbered(scene, contact.pulley),
            )


def _carried(scene: Scene, fields: Fields, rate: float) -> Array:
    """What the belt carries along at its ends: c times its change is the power that the clamps put in ``(2,)`` [N].

    With the energy L of strain less that of motion, N.r' + M* theta' - L + rhoA g.r changes by - q.r_c' alone: by the
    power of friction on the fibre that touches. A stress-free curvature takes the same away at both ends.
    """
    ends = np.array([0, -1])
    eps, Gamma, kappa = (getattr(fields, name)[ends] for name in ("eps", "Gamma", "kappa"))
    Q1, Q2 = fields.Q[ends].T
    strained = Q1 * (1.0 + eps / 2) + (Q2 * Gamma + scene.belt.bending_stiffness * kappa**2) / 2
    belt, line_weight = scene.belt, scene.belt.line_density * np.array(scene.gravity)
    moving = rate**2 / 2 * (belt.line_density * ((1.0 + eps) ** 2 + Gamma**2) + belt.rotary_inertia * kappa**2)
    return strained - moving + fields.r[ends] @ line_weight
