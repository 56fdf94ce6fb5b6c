"""The exact extensible string of any drive, without gravity in its spans.

A string neither bends nor shears: spans are straight, and on a pulley its middle line runs on an arc of the radius
R + e. With T = b1 (D - 1) and the centrifugal action of the moving belt, what spans hold on to is

    F = T - rho A c^2 D,    constant in a span and in stick, and dF/dphi = +-mu F in sliding,

so that an angle |ln(F_off / F_up)| / mu of the wrap slides before the run-off, forward where F grows. The torque on the
pulley is (R + e) (F_off - F_up); its surface moves with the touching fibre, at c D (R / (R + e)) where the belt sticks.
Friction acts on that fibre, so that R int f makes this torque: mu is to be taken R / (R + e) times as large.

`forces` finds F in all spans, with friction that is not exceeded. A pulley of given speed may then slide all along, if
another one gives the transport rate; a torque that is not met is beyond the capacity of the drive.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import FREE, Part
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.path import Arc, Line, Path, Point, tangent_path, taut_path
from belt_fenicsx.scene.pulley import RUN_UP, Pulley, Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.forces import Chain, Forces, friction

ITERATIONS = 50  # Newton's iterations for take-ups, at most.
CONVERGED = 1e-13  # Transport rates at a limit that are no farther apart are the same.
MET = 1e-12  # A take-up has its force with no larger error, relative to it.
MOST_CENTRIFUGAL = 0.5  # G / b1 for which a slack belt is made taut.
TAUT, NEAR = 1e-3, 1e-2  # Strain from which a slack belt starts, and how well it is met, relative to it.
RATES = 10  # Corrections of the transport rate at a limit, at most.
NOTHING = 1e-12  # An angle that is no larger, in parts of the wrap, does not slide.
LACKING = 1e-11  # A torque that lacks no more is met, in parts of the radius and the larger force.
LEAST_PART = 1e-4  # Of a step of Newton's iteration, at least this part is taken.
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
            grown = np.expm1(sigma * b1 * self.rate / (arc.radius * shifted))
            factor = grown * (b1 + F) / (b1 - F * grown)
            turned, D = np.log1p(factor) / self.rate, (F + F * factor + b1) / shifted
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

    def asked(self, pulley: Pulley, index: int) -> float:
        """Torque that is given to a pulley, at the speed that it has."""
        return pulley.drive.by("torque") + pulley.drive.drag * self.omegas[index]


class BeyondCapacity(Stopped):
    """A torque that friction cannot transmit.

    Attributes:
        pulley: The pulley on which the belt would slide all along.
        sense: Sense of this sliding.
        drawn: The string that slides there, and asks for more friction than there is.
    """

    def __init__(self, message: str, drawn: StringDrive, pulley: int, sense: Slip) -> None:
        self.drawn, self.pulley, self.sense = drawn, pulley, sense
        super().__init__(Status.CAPACITY_EXCEEDED, message, final=True)


def string_drive(scene: Scene) -> StringDrive:
    """The string of a dimensionless scene.

    Raises:
        BeyondCapacity: A torque is more than friction can transmit.
        Stopped: There is no taut string.
    """
    moving = [index for index, pulley in enumerate(scene.pulleys) if pulley.take_up is not None]
    moves = _moves(scene, moving) if moving else np.zeros(0)
    drawn, beyond = _drawn(scene, _centers(scene, moving, moves))
    if beyond is not None:
        raise beyond
    return drawn


def at_capacity(scene: Scene, index: int, sense: Slip, load: int | None = None) -> tuple[Scene, int]:
    """The scene in which the belt slides all along a pulley, and the pulley whose torque is left open for that.

    It is the torque on the same pulley or, if that gives the speed of all, the largest one. Where speeds slip, forces
    depend on none; with inertia, the transport rate is the one with which the belt would just stick at the run-up.

    Args:
        scene: The scene.
        index: The pulley.
        sense: Sense of sliding on it.
        load: The pulley whose torque is left open, if it is to be another one.

    Raises:
        Stopped: No torque can be left open.
    """
    load = _load(scene, index) if load is None else load
    pulleys = [p.driven() if i == load else p for i, p in enumerate(scene.pulleys)]
    pulleys[index] = scene.pulleys[index].driven(x_trans=RUN_UP, slip=sense)
    if not _leads(scene, index) or scene.transport_rate is not None:
        return scene.altered(pulleys=tuple(pulleys)), load
    limit = scene.altered(pulleys=tuple(pulleys), transport_rate=1.0)
    surface = scene.pulleys[index].drive.by("omega") * (scene.pulleys[index].radius + scene.belt.contact_offset)

    def sticking(rate: float) -> float:
        """Transport rate with which the belt would stick at the run-up, if forces are those of another one."""
        string = string_drive(limit.altered(transport_rate=rate))
        return surface / next(own.stretches[0] for own in string.parts if own.part.touches and own.part.pulley == index)

    if scene.has_inertia:
        limit = limit.altered(transport_rate=_fixed_point(sticking, 1.0))
    return limit, load


def _fixed_point(function: Callable[[float], float], start: float) -> float:
    """Where a function gives its argument back, by the secant method."""
    old, value = start, function(start)
    old_off, x = value - old, value
    for _ in range(RATES):
        off = function(x) - x
        if abs(off) <= CONVERGED or off == old_off:
            break
        old, old_off, x = x, off, x - off * (x - old) / (off - old_off)
    return x


def capacities(scene: Scene, string: StringDrive) -> tuple[float, ...]:
    """Torques that the pulleys transmit at most, as the one that `at_capacity` leaves open grows; NaN where none does.

    The pulley on which the belt then slides all along first may be another one, which gives the speed of all.
    """
    found = []
    for index, torque in enumerate(string.torques):
        limit = limited(scene, index, "backward" if torque < 0.0 else "forward")
        found.append(math.nan if limit is None else limit[1].torques[index])
    return tuple(found)


def limits(scene: Scene, index: int) -> Iterator[Scene]:
    """Scenes in which the belt slides all along a pulley, or another one, as the torque grows that `at_capacity` names.

    The first one is that of the string; which pulley slides first may be another one for a belt.
    """
    torques = string_drive(scene).torques
    senses: list[Slip] = ["backward" if torque < 0.0 else "forward" for torque in torques]
    first = limited(scene, index, senses[index])
    if first is None:
        return
    yield first[0]
    for other, pulley in enumerate(scene.pulleys):
        if pulley.friction and torques[other]:
            limit, _ = at_capacity(scene, other, senses[other], _load(scene, index))
            if limit.pulleys != first[0].pulleys:
                yield limit


def limited(scene: Scene, index: int, sense: Slip) -> tuple[Scene, StringDrive] | None:
    """The scene in which the belt slides all along a pulley, or along what slides first, and its string.

    There is none without friction, and where no torque could be left open for that.
    """
    if scene.pulleys[index].friction == 0.0:
        return None
    try:
        load = _load(scene, index)
        limit, _ = at_capacity(scene, index, sense)
        try:
            return limit, string_drive(limit)
        except BeyondCapacity as beyond:
            if not (beyond.pulley == load or _leads(scene, beyond.pulley)):
                return None
            limit, _ = at_capacity(scene, beyond.pulley, beyond.sense, load)
            return limit, string_drive(limit)
    except Stopped:
        return None


def _load(scene: Scene, index: int) -> int:
    """The pulley whose torque grows, on the way to the limit of a pulley.

    Raises:
        Stopped: There is none.
    """
    if not _leads(scene, index):
        return index
    loads = [i for i, p in enumerate(scene.pulleys) if p.drive.kind == "torque" and p.friction > 0.0]
    if not loads:
        raise Stopped(Status.NEWTON_DIVERGED, f"No torque could be left open for pulley {index} to slide all along.")
    return max(loads, key=lambda i: abs(scene.pulleys[i].drive.by("torque")))


def _leads(scene: Scene, index: int) -> bool:
    """Whether nothing but this pulley gives a loop its speed, or takes the torque that is left."""
    return scene.closed and _leading(scene) == [index]


def undivided(string: StringDrive) -> StringDrive:
    """The string with a single part on each pulley, as a first guess, whose stretch is that at its run-up."""
    parts: list[StringPart] = []
    for own in string.parts:
        if parts and own.part.touches and parts[-1].part.touches:
            first = parts[-1]
            angles = (first.angles[0], own.angles[1])
            parts[-1] = replace(first, length=first.length + own.length, angles=angles, end=own.end)
        elif own.part.touches:
            parts.append(replace(own, part=Part("slip", "forward", own.part.pulley), rate=0.0))
        else:
            parts.append(own)
    return replace(string, parts=tuple(parts))


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
    """Displacements of take-ups at which they get their forces, by Newton's iteration with differences.

    Raises:
        Stopped: There are none, or with them something is in the belt's way.
    """

    def missed(moves: Array) -> Array:
        try:
            drawn, _ = _drawn(scene, _centers(scene, moving, moves))
        except SceneError as error:
            raise Stopped(
                Status.CONTACT_LOST, f"A take-up moves to where `{error.field}` cannot be.", final=True
            ) from None
        return np.array([pushed(scene, drawn, index) for index in moving])

    moves = _taut(scene, moving)
    now, allowed = missed(moves), MET * max(scene.pulleys[index].force or 0.0 for index in moving)
    for _ in range(ITERATIONS):
        if np.abs(now).max() <= allowed:
            break
        columns = [(missed(moves + MOVED * row) - now) / MOVED for row in np.eye(len(moving))]
        step = -np.linalg.solve(np.array(columns).T, now)
        moves, now = _nearer(moves, step, missed, float(np.abs(now).max()))
    else:
        raise Stopped(Status.NEWTON_DIVERGED, "The places of the take-ups were not found.", final=True)
    try:
        taut_path(scene, _centers(scene, moving, moves))
    except SceneError as error:
        message = f"Where the take-ups have their forces, `{error.field}` would have to {error.expected}."
        raise Stopped(Status.CONTACT_LOST, message, final=True) from None
    return moves


def _nearer(moves: Array, step: Array, missed: Callable[[Array], Array], now: float) -> tuple[Array, Array]:
    """Displacements after a step, or after a part of it, with which less is missing, and what is.

    Raises:
        Stopped: There are none.
    """
    part = 1.0
    while part > LEAST_PART:
        try:
            after = missed(moves + part * step)
        except (Stopped, SceneError):
            pass
        else:
            if np.abs(after).max() < now:
                return moves + part * step, after
        part /= 2.0
    raise Stopped(Status.NEWTON_DIVERGED, "The places of the take-ups were not found.", final=True)


def _taut(scene: Scene, moving: Sequence[int]) -> Array:
    """Displacements with which the belt is taut: none where it is so already, otherwise all of them equal."""
    # In units of its scene, a belt has a transport rate of one, or less where it is to be found.
    centrifugal = scene.belt.line_density / scene.belt.extensional_stiffness
    wanted, moves = scene.belt.length * (1.0 + TAUT) / (1.0 - min(centrifugal, MOST_CENTRIFUGAL)), np.zeros(len(moving))

    def path(moves: Array) -> Path:
        return tangent_path(scene, _centers(scene, moving, moves))

    def missing(moves: Array) -> Array:
        return np.array([wanted - path(moves).length])

    now = missing(moves)
    for _ in range(ITERATIONS):
        if now[0] <= NEAR * TAUT:
            break
        gain = -sum(float(np.dot(path(moves).arcs[i].pull, _direction(scene.pulleys[i]))) for i in moving)
        moves, now = _nearer(moves, np.full(len(moving), now[0] / gain), missing, float(now[0]))
    return moves


def pushed(scene: Scene, drawn: StringDrive, index: int) -> float:
    """Hub load along a take-up, and the force that pushes it there."""
    on = [own for own in drawn.parts if own.part.touches and own.part.pulley == index]
    (x, y), first, last = _direction(scene.pulleys[index]), on[0], on[-1]
    load = [
        last.force[1] * trig(last.angles[1]) - first.force[0] * trig(first.angles[0]) for trig in (math.cos, math.sin)
    ]
    return float(x * load[0] + y * load[1] + (scene.pulleys[index].force or 0.0))


def _drawn(scene: Scene, centers: tuple[Point, ...]) -> tuple[StringDrive, BeyondCapacity | None]:
    """The string where the pulleys have these centres, and what is beyond its capacity, if anything is."""
    path, found = tangent_path(scene, centers), []
    for first in _leading(scene):
        forces = Chain(scene, path, first).solved()
        drive = _made(scene, path, forces, centers)
        over = _overloaded(scene, path, drive, forces, first)
        if over is None:
            return drive, None
        found.append((drive, BeyondCapacity(f"A string would slide all along pulley {over[0]}.", drive, *over)))
    return found[0]


def _leading(scene: Scene) -> list[int]:
    """Pulleys that may give a loop its speed, or take the torque that is left; any number between clamps."""
    if not scene.closed:
        return [0]
    kind = "omega" if scene.transport_rate is None else "none"
    pulleys = enumerate(scene.pulleys)
    return [i for i, p in pulleys if p.drive.kind == kind and p.friction > 0.0 and (p.omega is None or p.omega > 0.0)]


def _overloaded(scene: Scene, path: Path, drive: StringDrive, forces: Forces, first: int) -> tuple[int, Slip] | None:
    """A pulley whose friction is not enough, with the sense of sliding; None where there is none."""
    if scene.closed and drive.slip_angles[first] > path.arcs[first].wrap * (1.0 + NOTHING):
        return first, "forward" if drive.torques[first] > 0.0 else "backward"
    lacking = {
        i: (drive.asked(pulley, i) - drive.torques[i]) / (path.arcs[i].radius * max(forces.up[i], forces.off[i]))
        for i, pulley in enumerate(scene.pulleys)
        if pulley.drive.kind == "torque"
    }
    worst = max(lacking, key=lambda i: abs(lacking[i]), default=None)
    if worst is None or abs(lacking[worst]) <= LACKING:
        return None
    return worst, "forward" if lacking[worst] > 0.0 else "backward"


def _made(scene: Scene, path: Path, forces: Forces, centers: tuple[Point, ...]) -> StringDrive:
    """The string with these forces on its path."""
    b1, c = scene.belt.extensional_stiffness, forces.rate
    string = _Drawing(b1, b1 - scene.belt.line_density * c**2)
    spans = [string.span(line, F) for line, F in zip(path.lines, forces.spans, strict=True)]
    parts, ahead = ([], spans) if scene.closed else (spans[:1], spans[1:])
    omegas, torques, angles, take_ups = [], [], [], []
    for pulley, arc, up, off, span in zip(scene.pulleys, path.arcs, forces.up, forces.off, ahead, strict=True):
        mu, grown, speed = friction(pulley, arc), math.log(off / up), c * string.stretch(up) / arc.radius
        angle = min(abs(grown) / mu, arc.wrap) if mu else 0.0
        omega = pulley.drive.by("omega") if pulley.drive.kind == "omega" else speed
        # Where a drive places a transition, there is one, even if hardly anything sticks before it.
        through = pulley.drive.kind in ("slip_angle", "x_trans") or abs(speed - omega) > NOTHING * speed
        sense: Slip = "forward" if grown > 0.0 else "backward"
        parts += [*string.on_pulley(pulley, arc, up, mu, sense, angle, through), span]
        omegas.append(omega)
        torques.append(arc.radius * (off - up))
        angles.append(abs(grown) / mu if mu else 0.0)
        moved = np.subtract(arc.center, pulley.center)
        take_ups.append(float(moved @ _direction(pulley)) if pulley.take_up else 0.0)
    return StringDrive(
        parts=tuple(parts), rate=c, omegas=tuple(omegas), torques=tuple(torques), slip_angles=tuple(angles),
        take_ups=tuple(take_ups), centers=centers,
    )  # fmt: skip


@dataclass(frozen=True)
class _Drawing:
    """Parts of a string, from forces and places.

    Attributes:
        b1: Extensional stiffness.
        shifted: The same less rho A c^2.
    """

    b1: float
    shifted: float

    def stretch(self, F: float) -> float:
        """Stretch of the middle line under a force F."""
        return (F + self.b1) / self.shifted

    def span(self, line: Line, F: float) -> StringPart:
        D = self.stretch(F)
        return StringPart(
            part=FREE, length=line.length / D, angles=(line.angle,) * 2, stretches=(D, D), force=(F, F),
            start=line.start, end=line.end, arc=None, rate=0.0, stiffnesses=(self.b1, self.shifted),
        )  # fmt: skip

    def on_pulley(
        self, pulley: Pulley, arc: Arc, F: float, mu: float, sense: Slip, angle: float, through: bool
    ) -> Iterator[StringPart]:
        """The parts on a pulley: the belt sticks, and slides through an angle before the run-off, or all along."""
        index, drive = arc.pulley, pulley.drive
        if mu == 0.0:
            rows = [(Part("slip", drive.slip or "forward", index), arc.wrap)]
        elif through and angle >= arc.wrap * (1.0 - NOTHING):
            rows = [(Part("slip", sense, index), arc.wrap)]
        elif angle <= NOTHING * arc.wrap and drive.kind not in ("omega", "none"):
            rows = [(Part("stick", pulley=index), arc.wrap)]
        else:
            rows = [(Part("stick", pulley=index), arc.wrap - angle), (Part("slip", sense, index), angle)]
        phi = arc.start
        for part, turned in rows:
            rate = mu * part.sense
            gained = F * math.expm1(rate * turned)
            end, after = phi - arc.turn * turned, F + gained
            length = arc.radius * turned / self.stretch(F)
            if rate:
                length = arc.radius * self.shifted / self.b1 * (turned - math.log1p(gained / (self.b1 + F)) / rate)
            yield StringPart(
                part=part, length=length, angles=(phi, end), stretches=(self.stretch(F), self.stretch(after)),
                force=(F, after), start=arc.at(phi), end=arc.at(end), arc=arc, rate=rate,
                stiffnesses=(self.b1, self.shifted),
            )  # fmt: skip
            phi, F = end, after
