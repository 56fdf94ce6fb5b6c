"""The exact extensible string of any drive, without gravity in its spans.

A string neither bends nor shears: spans are straight, and on a pulley its middle line runs on an arc of the radius
R + e. With T = b1 (D - 1) and the centrifugal action of the moving belt, what spans hold on to is

    F = T - rho A c^2 D,    constant in a span and in stick, and dF/dphi = +-mu F in sliding,

so that an angle |ln(F_off / F_up)| / mu of the wrap slides before the run-off, forward where F grows. The torque on the
pulley is (R + e) (F_off - F_up); its surface moves with the touching fibre, at c D (R / (R + e)) where the belt sticks.
Friction acts on that fibre, so that R int f makes this torque: mu is to be taken R / (R + e) times as large.
The unknowns are F in each span and, in a loop, c; the equations one for each pulley, what drives it, and the length.

1. Newton's iteration for all pulleys that stick somewhere.
2. A pulley whose wrap is too small for the angle slides all along instead; again.
3. Where that leaves no speed to give the transport rate, or a torque unmet, the drive is beyond its capacity.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import FREE, SENSE, Part
from belt_fenicsx.scene.path import Arc, Path, Point, tangent_path
from belt_fenicsx.scene.pulley import RUN_OFF, RUN_UP, Pulley, Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status

STEP = 1e-30  # Imaginary step of derivatives.
ITERATIONS = 50  # Newton's iterations, at most.
CONVERGED = 1e-13  # Steps that are no larger, relative to the largest force, end them.
RATES = 8  # Corrections of the transport rate at a limit.
LEAST = 0.2  # A step leaves at least this part of each force.
LEAST_STRAIN = 1e-4  # A string that would be slack starts from this strain.
NOTHING = 1e-12  # An angle that is no larger, in parts of the wrap, does not slide.
MOVED = 1e-7  # Displacement for differences of take-ups, in lengths of the belt.


@dataclass(frozen=True, kw_only=True)
class StringPart:
    """A part of the string, of the dimensionless scene.

    Attributes:
        part: What the belt does there.
        length: Material length.
        angles: Angles of the tangent at both ends ``(2,)``.
        stretches: Stretches of the middle line there ``(2,)``.
        force: Forces F along the tangent there ``(2,)``.
        start: Place of the start.
        end: Place of the end.
        arc: The arc on which it lies; None of a span.
        rate: By which the logarithm of F grows with the angle in which the belt has turned.
        stiffnesses: b1 and b1 - rho A c^2.
    """

    part: Part
    length: float
    angles: tuple[float, float]
    stretches: tuple[float, float]
    force: tuple[float, float]
    start: Point
    end: Point
    arc: Arc | None
    rate: float
    stiffnesses: tuple[float, float]

    def at(self, fraction: Array) -> tuple[Array, Array, Array, Array]:
        """x, y, phi and D of the middle line at fractions of the material length, ``(m,)`` each."""
        if self.arc is None:
            x, y = (a + (b - a) * fraction for a, b in zip(self.start, self.end, strict=True))
            return x, y, np.full_like(fraction, self.angles[0]), np.full_like(fraction, self.stretches[0])
        arc, (b1, shifted), F = self.arc, self.stiffnesses, self.force[0]
        sigma = fraction * self.length
        if self.rate:
            # From sigma = (R + e) (b1 - G) / (b1 k) (k a - ln((b1 + F exp(k a)) / (b1 + F))), a the angle turned by.
            grown = np.exp(sigma * b1 * self.rate / (arc.radius * shifted))
            factor = grown * b1 / (b1 + F - F * grown)
            turned, D = np.log(factor) / self.rate, (F * factor + b1) / shifted
        else:
            turned, D = sigma * self.stretches[0] / arc.radius, np.full_like(fraction, self.stretches[0])
        phi = self.angles[0] - arc.turn * turned
        reach = arc.turn * arc.radius
        return arc.center[0] - reach * np.sin(phi), arc.center[1] + reach * np.cos(phi), phi, D


@dataclass(frozen=True, kw_only=True)
class StringDrive:
    """The string of a drive, of the dimensionless scene.

    Attributes:
        parts: Its parts, in the direction of travel; a loop begins with the first one on its first pulley.
        rate: Transport rate c.
        omegas: Angular velocity of each pulley.
        torques: Moment of the belt on each.
        slip_angles: The part of each wrap that slides before the run-off.
        take_ups: Displacement of each pulley along its take-up; zero without one.
        centers: Centre of each, with its take-up done.
    """

    parts: tuple[StringPart, ...]
    rate: float
    omegas: tuple[float, ...]
    torques: tuple[float, ...]
    slip_angles: tuple[float, ...]
    take_ups: tuple[float, ...]
    centers: tuple[Point, ...]


class BeyondCapacity(Stopped):
    """A torque that friction cannot transmit.

    Attributes:
        pulley: The pulley on which the belt would slide all along.
        sense: Sense of this sliding.
    """

    def __init__(self, message: str, pulley: int, sense: Slip) -> None:
        self.pulley, self.sense = pulley, sense
        super().__init__(Status.CAPACITY_EXCEEDED, message, final=True)


def string_drive(scene: Scene) -> StringDrive:
    """The string of a dimensionless scene.

    Raises:
        BeyondCapacity: A torque is more than friction can transmit.
        Stopped: There is no taut string.
    """
    moving = [index for index, pulley in enumerate(scene.pulleys) if pulley.take_up is not None]
    moves = _moves(scene, moving) if moving else np.zeros(0)
    return _drawn(scene, _centers(scene, moving, moves))


def at_capacity(scene: Scene, index: int, sense: Slip) -> tuple[Scene, int]:
    """The scene in which the belt slides all along a pulley, and the pulley whose torque is left open for that.

    It is the torque on the same pulley or, if that is given its speed, the largest one. Where speeds slip, forces
    depend on none; with inertia, the transport rate is the one with which the belt would just stick at the run-up.

    Raises:
        Stopped: No torque can be left open.
    """
    pulleys = list(scene.pulleys)
    # Where the transport rate is given, so is that of a pulley which is driven by its speed: nothing else depends on it.
    driven = scene.pulleys[index].drive.kind == "omega" and scene.transport_rate is None
    loads = [i for i, p in enumerate(pulleys) if p.drive.kind == "torque"] if driven else [index]
    if not loads:
        raise Stopped(Status.NEWTON_DIVERGED, f"No torque could be left open for pulley {index} to slide all along.")
    load = max(loads, key=lambda i: abs(pulleys[i].torque or 0.0))
    undriven = {"x_trans": None, "omega": None, "torque": None, "drag": 0.0, "slip_angle": None, "slip": None}
    pulleys[load] = replace(pulleys[load], **undriven)
    pulleys[index] = replace(pulleys[index], **{**undriven, "x_trans": RUN_UP, "slip": sense})
    if not driven:
        return scene.altered(pulleys=tuple(pulleys)), load
    limit = scene.altered(pulleys=tuple(pulleys), transport_rate=1.0)
    for _ in range(RATES if scene.has_inertia else 0):
        string = string_drive(limit)
        start = next(own for own in string.parts if own.part.touches and own.part.pulley == index)
        reach = scene.pulleys[index].radius + scene.belt.contact_offset
        limit = limit.altered(transport_rate=scene.pulleys[index].drive.by("omega") * reach / start.stretches[0])
    return limit, load


def capacities(scene: Scene, string: StringDrive) -> tuple[float, ...]:
    """Torques that the pulleys transmit at most, each with what is left open by `at_capacity`; NaN where nothing can be."""
    found = []
    for index, torque in enumerate(string.torques):
        try:
            limit, _ = at_capacity(scene, index, "forward" if torque > 0.0 else "backward")
            found.append(string_drive(limit).torques[index] if scene.pulleys[index].friction > 0.0 else math.nan)
        except Stopped:
            found.append(math.nan)
    return tuple(found)


def _centers(scene: Scene, moving: Sequence[int], moves: Array) -> tuple[Point, ...]:
    """Centres of all pulleys, take-ups displaced."""
    centers = [pulley.center for pulley in scene.pulleys]
    for index, move in zip(moving, moves.tolist(), strict=True):
        x, y = _direction(scene.pulleys[index])
        centers[index] = (centers[index][0] + move * x, centers[index][1] + move * y)
    return tuple(centers)


def _direction(pulley: Pulley) -> Point:
    """Unit vector along a take-up."""
    assert pulley.take_up is not None, "a pulley that moves"
    x, y = pulley.take_up
    length = math.hypot(x, y)
    return x / length, y / length


def _moves(scene: Scene, moving: Sequence[int]) -> Array:
    """Displacements of take-ups at which they get their forces, by Newton's iteration with differences."""

    def missed(moves: Array) -> Array:
        drawn = _drawn(scene, _centers(scene, moving, moves))
        return np.array([_pushed(scene, drawn, index) for index in moving])

    moves = _taut(scene, moving)
    for _ in range(ITERATIONS):
        now = missed(moves)
        columns = [(missed(moves + MOVED * row) - now) / MOVED for row in np.eye(len(moving))]
        step = -np.linalg.solve(np.array(columns).T, now)
        part = 1.0
        while part > 1e-3:
            try:
                if np.abs(missed(moves + part * step)).max() < np.abs(now).max():
                    break
            except Stopped:
                pass
            part /= 2.0
        moves = moves + part * step
        if np.abs(step).max() <= 1e-13:
            break
    return moves


def _taut(scene: Scene, moving: Sequence[int]) -> Array:
    """Displacements that make the belt taut, all by the same way: none where it is taut already."""
    for reach in (0.0, *np.geomspace(1e-3, 1.0, 20)):
        for sign in (1.0, -1.0):
            moves = np.full(len(moving), sign * reach)
            if tangent_path(scene, _centers(scene, moving, moves)).length > 1.0 + LEAST_STRAIN:
                return moves
    raise Stopped(Status.CONTACT_LOST, "No displacement of the take-up makes the belt taut.", final=True)


def _pushed(scene: Scene, drawn: StringDrive, index: int) -> float:
    """Hub load along a take-up, and the force that pushes it there."""
    on = [own for own in drawn.parts if own.part.touches and own.part.pulley == index]
    (x, y), first, last = _direction(scene.pulleys[index]), on[0], on[-1]
    load = [
        last.force[1] * trig(last.angles[1]) - first.force[0] * trig(first.angles[0]) for trig in (math.cos, math.sin)
    ]
    return float(x * load[0] + y * load[1] + (scene.pulleys[index].force or 0.0))


def _drawn(scene: Scene, centers: tuple[Point, ...]) -> StringDrive:
    """The string where the pulleys have these centres."""
    path, slips = tangent_path(scene, centers), dict[int, Slip]()
    for _ in range(1 + len(scene.pulleys)):
        found = _Chain(scene, path, slips).solved()
        over = {index: sense for index, sense in found.over().items() if index not in slips}
        if not over:
            return found.drive(centers)
        worst = max(over, key=lambda index: found.angles[index] / path.arcs[index].wrap)
        speeds = [i for i, p in enumerate(scene.pulleys) if p.drive.kind == "omega" and i not in slips and i != worst]
        known = scene.transport_rate is not None or scene.has_inertia or speeds
        if scene.pulleys[worst].drive.kind != "omega" or not known:
            message = f"A string would slide all along pulley {worst}."
            raise BeyondCapacity(message, worst, over[worst])
        slips[worst] = over[worst]
    raise Stopped(Status.NEWTON_DIVERGED, "The string slides on one pulley after another.", final=True)


class _Chain:
    """The equations of a string, and their solution.

    Args:
        scene: The dimensionless scene.
        path: The path.
        slips: Pulleys on which the belt slides all along, past their speed, with the sense.
    """

    def __init__(self, scene: Scene, path: Path, slips: Mapping[int, Slip]) -> None:
        self.scene, self.path, self.slips = scene, path, slips
        count = len(scene.pulleys)
        self.before = np.arange(count) - 1 if scene.closed else np.arange(count)
        self.after = np.arange(count) if scene.closed else np.arange(count) + 1
        self.radius = np.array([arc.radius for arc in path.arcs])
        self.wrap = np.array([arc.wrap for arc in path.arcs])
        self.friction = np.array(
            [p.friction * p.radius / arc.radius for p, arc in zip(scene.pulleys, path.arcs, strict=True)]
        )
        self.lines = np.array([line.length for line in path.lines])
        self.rate = scene.transport_rate

    def solved(self) -> _Chain:
        """Solves the equations.

        Raises:
            Stopped: The belt is not taut, or Newton's iteration does not converge.
        """
        b1, strain = self.scene.belt.extensional_stiffness, self.path.length / self.scene.belt.length - 1.0
        if strain <= 0.0:
            raise Stopped(
                Status.CONTACT_LOST,
                f"The belt is slack: it is longer than its path by {-strain * 100.0:.3g} % of its length.",
                final=True,
            )
        rate = self.rate if self.rate is not None else self._first_rate(strain)
        tension = b1 * strain - self.scene.belt.line_density * rate**2 * (1.0 + strain)
        z = np.full(self.lines.size + 1, max(tension, LEAST_STRAIN * b1))
        z[-1] = rate
        free = slice(0, None if self.rate is None else -1)
        for _ in range(ITERATIONS):
            values = self._missed(z[:, None] + 1j * STEP * np.eye(z.size))
            missed, matrix = values[:, 0].real, values.imag[:, free] / STEP
            try:
                step = -np.linalg.solve(matrix, missed)
            except np.linalg.LinAlgError:
                break
            # No force gets negative; how far a step may go is told by the one that falls most.
            falls = float(np.max(-step[: self.lines.size] / z[:-1]))
            part = min(1.0, (1.0 - LEAST) / falls) if falls > 0.0 else 1.0
            z[free] += part * step
            if part == 1.0 and np.abs(step[: self.lines.size]).max() <= CONVERGED * z[:-1].max():
                self.forces, self.c = z[:-1], float(z[-1])
                return self
        raise Stopped(Status.NEWTON_DIVERGED, "The string's forces were not found.", final=True)

    def _first_rate(self, strain: float) -> float:
        """Transport rate of a belt of uniform strain."""
        return next(
            p.drive.by("omega") * arc.radius / (1.0 + strain)
            for p, arc in zip(self.scene.pulleys, self.path.arcs, strict=True)
            if p.drive.kind == "omega"
        )

    def stretch(self, F: Array, c: Array) -> Array:
        """Stretch of the middle line under a force F."""
        b1 = self.scene.belt.extensional_stiffness
        return (F + b1) / (b1 - self.scene.belt.line_density * c**2)

    def _missed(self, z: Array) -> Array:
        """Residuals of all equations ``(equations, ...)``."""
        F, c, rows = z[:-1], z[-1], []
        up, off = F[self.before], F[self.after]
        stretch = self.stretch(F, c)
        omega = c * stretch[self.before] / self.radius[:, None]
        for i, (pulley, arc) in enumerate(zip(self.scene.pulleys, self.path.arcs, strict=True)):
            if i in self.slips:
                rows.append(off[i] - up[i] * math.exp(SENSE[self.slips[i]] * self.friction[i] * arc.wrap))
                continue
            drive = pulley.drive
            if drive.kind == "none":
                continue
            if drive.kind == "omega":
                rows.append(omega[i] - drive.by("omega"))
            elif drive.kind == "torque" and pulley.friction > 0.0:
                rows.append(arc.radius * (off[i] - up[i]) - drive.by("torque") - drive.drag * omega[i])
            else:
                angle = 0.0 if pulley.friction == 0.0 else _slip_angle(pulley, arc)
                rows.append(off[i] - up[i] * math.exp(SENSE[drive.slip or "forward"] * self.friction[i] * angle))
        rows.append(self._length(F, c, up, off) - self.scene.belt.length)
        return np.array(rows)

    def _length(self, F: Array, c: Array, up: Array, off: Array) -> Array:
        """Material length of the belt that lies in the path."""
        b1 = self.scene.belt.extensional_stiffness
        shifted = b1 - self.scene.belt.line_density * c**2
        spans = (self.lines[:, None] / self.stretch(F, c)).sum(axis=0)
        grown = np.log(off / up)
        with np.errstate(divide="ignore", invalid="ignore"):
            angle = np.where(self.friction[:, None] > 0.0, _abs(grown) / self.friction[:, None], 0.0)
            # The mean of b1 / (F + b1) along the sliding part.
            turned = np.where(np.abs(grown) > 1e-9, (grown - np.log((b1 + off) / (b1 + up))) / grown, b1 / (b1 + up))
        sticks = (self.wrap[:, None] - angle) / self.stretch(up, c)
        slides = shifted / b1 * angle * turned
        return spans + (self.radius[:, None] * (sticks + slides)).sum(axis=0)

    @functools.cached_property
    def angles(self) -> Array:
        """Angles that slide ``(pulleys,)``."""
        grown = np.abs(np.log(self.forces[self.after] / self.forces[self.before]))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.friction > 0.0, grown / self.friction, 0.0)

    def over(self) -> dict[int, Slip]:
        """Pulleys whose wrap is less than the angle that is to slide, with the sense of sliding."""
        grows = self.forces[self.after] > self.forces[self.before]
        over = np.flatnonzero(self.angles > self.wrap * (1.0 + NOTHING)).tolist()
        return {i: "forward" if grows[i] else "backward" for i in over}

    def drive(self, centers: tuple[Point, ...]) -> StringDrive:
        """The string as what comes back."""
        parts: list[StringPart] = []
        lines = iter(range(self.lines.size))
        if not self.scene.closed:
            parts.append(self._span(next(lines)))
        for arc in self.path.arcs:
            parts += [*self._on_pulley(arc), self._span(next(lines))]
        up, off = self.forces[self.before], self.forces[self.after]
        speeds = self.c * self.stretch(up, np.asarray(self.c)) / self.radius
        omegas = [
            p.drive.by("omega") if p.drive.kind == "omega" else float(speed)
            for p, speed in zip(self.scene.pulleys, speeds, strict=True)
        ]
        return StringDrive(
            parts=tuple(parts),
            rate=self.c,
            omegas=tuple(omegas),
            torques=tuple((self.radius * (off - up)).tolist()),
            slip_angles=tuple(np.minimum(self.angles, self.wrap).tolist()),
            take_ups=tuple(
                0.0 if p.take_up is None else float(np.dot(np.subtract(center, p.center), _direction(p)))
                for p, center in zip(self.scene.pulleys, centers, strict=True)
            ),
            centers=centers,
        )

    def _span(self, index: int) -> StringPart:
        line, F = self.path.lines[index], float(self.forces[index])
        D = float(self.stretch(np.asarray(F), np.asarray(self.c)))
        return StringPart(
            part=FREE, length=line.length / D, angles=(line.angle,) * 2, stretches=(D, D), force=(F, F),
            start=line.start, end=line.end, arc=None, rate=0.0, stiffnesses=self._stiffnesses,
        )  # fmt: skip

    @property
    def _stiffnesses(self) -> tuple[float, float]:
        b1 = self.scene.belt.extensional_stiffness
        return b1, b1 - self.scene.belt.line_density * self.c**2

    def _on_pulley(self, arc: Arc) -> list[StringPart]:
        """The parts on a pulley: the belt sticks, and slides before the run-off."""
        i = arc.pulley
        pulley, angle = self.scene.pulleys[i], float(min(self.angles[i], arc.wrap))
        up, off = float(self.forces[self.before[i]]), float(self.forces[self.after[i]])
        sense = "forward" if off >= up else "backward"
        slides = Part("slip", pulley.drive.slip or sense, i) if pulley.friction == 0.0 else Part("slip", sense, i)
        sticks = Part("stick", pulley=i)
        if pulley.friction == 0.0 or i in self.slips or pulley.x_trans == RUN_UP:
            rows = [(slides, arc.wrap)]
        elif angle <= NOTHING * arc.wrap and pulley.drive.kind != "omega":
            rows = [(sticks, arc.wrap)]
        else:
            rows = [(sticks, arc.wrap - angle), (slides, angle)]
        made, phi, F = [], arc.start, up
        for part, turned in rows:
            rate = float(self.friction[i]) * part.sense
            end, after = phi - arc.turn * turned, F * math.exp(rate * turned)
            ends = tuple(float(self.stretch(np.asarray(force), np.asarray(self.c))) for force in (F, after))
            b1, shifted = self._stiffnesses
            length = arc.radius * turned / ends[0]
            if rate:
                length = arc.radius * shifted / (b1 * rate) * (rate * turned - math.log((b1 + after) / (b1 + F)))
            made.append(
                StringPart(
                    part=part, length=length, angles=(phi, end), stretches=(ends[0], ends[1]), force=(F, after),
                    start=arc.at(phi), end=arc.at(end), arc=arc, rate=rate, stiffnesses=self._stiffnesses,
                )
            )  # fmt: skip
            phi, F = end, after
        return made


def _slip_angle(pulley: Pulley, arc: Arc) -> float:
    """The angle of sliding that a pulley is given by a place."""
    if pulley.slip_angle is not None:
        return pulley.slip_angle
    if isinstance(pulley.x_trans, str):
        return 0.0 if pulley.x_trans == RUN_OFF else arc.wrap
    assert pulley.x_trans is not None, "a pulley that is driven by a place"
    phi = math.asin(-arc.turn * (pulley.x_trans - arc.center[0]) / pulley.radius)
    return min(max(arc.turn * (phi - arc.end), 0.0), arc.wrap)


def _abs(values: Array) -> Array:
    """Absolute values, as an analytic function."""
    return np.where(values.real < 0.0, -values, values)
