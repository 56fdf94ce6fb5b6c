"""The path of the belt's middle line at rest, taut: arcs on the pulleys, straight spans between them.

A pulley to the right of the direction of travel has turn s = +1, one to the left s = -1. Where the middle line runs on
it in the direction phi, it is at C + s (R + e) n(phi), with n = (-sin phi, cos phi), and phi decreases for s = +1.
Angles are counted on along the belt, without jumps.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from belt_fenicsx.scene.checks import SceneError, Verbatim

if TYPE_CHECKING:
    from belt_fenicsx.scene.pulley import Pulley
    from belt_fenicsx.scene.scene import Scene

Point = tuple[float, float]
FULL_TURN = 2.0 * math.pi
ROUNDING = 1e-9  # of angles [rad] and of ratios of lengths
CLAMPS = ("the first clamp", "the last clamp")


@dataclass(frozen=True)
class Arc:
    """What lies on a pulley.

    Attributes:
        pulley: Index of the pulley.
        center: Its centre [m].
        radius: Radius R + e of the middle line [m].
        turn: Its sign s.
        start: Angle phi of the tangent at the run-up [rad].
        end: The same at the run-off [rad].
    """

    pulley: int
    center: Point
    radius: float
    turn: float
    start: float
    end: float

    @property
    def wrap(self) -> float:
        """By how much the belt turns on the pulley [rad]."""
        return self.turn * (self.start - self.end)

    @property
    def length(self) -> float:
        """Length of the arc [m]."""
        return self.radius * self.wrap

    def gain(self, pulley: Pulley) -> float:
        """How much longer the path becomes for each length that the pulley moves along its take-up [-]."""
        (x, y), (dx, dy) = self.pull, pulley.direction
        return -(x * dx + y * dy)

    @property
    def pull(self) -> Point:
        """Force of the belt on the pulley where its tension is one: tangent at the run-off less that at the run-up."""
        return math.cos(self.end) - math.cos(self.start), math.sin(self.end) - math.sin(self.start)

    def at(self, angle: float) -> Point:
        """Where the tangent has this angle [m]."""
        return _touched(self.center, self.turn * self.radius, angle)

    def faces(self, place: Point) -> bool:
        """Whether the arc is between its centre and a place."""
        x, y = place[0] - self.center[0], place[1] - self.center[1]
        return self.turn * (self.start - math.atan2(-self.turn * x, self.turn * y)) % FULL_TURN <= self.wrap


@dataclass(frozen=True)
class Line:
    """A straight span.

    Attributes:
        start: Where it starts [m].
        end: Where it ends [m].
        angle: Angle of its direction [rad].
    """

    start: Point
    end: Point
    angle: float

    @property
    def length(self) -> float:
        """Length of the span [m]."""
        return math.dist(self.start, self.end)

    def seen_from(self, place: Point) -> tuple[float, float]:
        """How far along the line a place is, and how far the line is to the left of it, both in its direction [m]."""
        along, left = math.cos(self.angle), math.sin(self.angle)
        x, y = place[0] - self.start[0], place[1] - self.start[1]
        return x * along + y * left, x * left - y * along

    def distance(self, place: Point) -> float:
        """Least distance of a place from the span [m]."""
        along, aside = self.seen_from(place)
        return math.hypot(aside, max(-along, along - self.length, 0.0))


@dataclass(frozen=True)
class Path:
    """The taut middle line.

    Attributes:
        arcs: One for each pulley.
        lines: Spans: in a loop, each behind the arc of the same index; otherwise, one before each arc and the last.
        closed: Whether it is a loop.
    """

    arcs: tuple[Arc, ...]
    lines: tuple[Line, ...]
    closed: bool

    @property
    def length(self) -> float:
        """Length of the whole path [m]."""
        return sum(arc.length for arc in self.arcs) + sum(line.length for line in self.lines)


@dataclass(frozen=True)
class _Round:
    """A circle that the path touches, or a clamp, which is one without a radius.

    Attributes:
        center: Its centre [m].
        reach: Signed radius s (R + e): where the path touches it, it is this far to the left of the centre [m].
        name: What an error calls it.
    """

    center: Point
    reach: float
    name: str


def taut_path(scene: Scene, centers: Sequence[Point] | None = None) -> Path:
    """The path of the taut middle line over all pulleys of a scene.

    Args:
        scene: The scene.
        centers: Centres of the pulleys [m]; by default, the scene's.

    Raises:
        SceneError: There is none: pulleys overlap, a span crosses a pulley, or the belt does not touch one of them.
    """
    rounds = _rounds(scene, centers)
    _check_overlaps(scene, rounds)
    path = tangent_path(scene, centers)
    _check_contacts(scene, rounds, path)
    _check_room(path)
    return path


def tangent_path(scene: Scene, centers: Sequence[Point] | None = None) -> Path:
    """The path by its tangents alone, whatever may be in its way; see `taut_path`."""
    rounds, closed = _rounds(scene, centers), scene.closed
    lines = [_tangent(one, other) for one, other in _neighbours(rounds, closed)]
    before = lines[-1:] + lines[:-1] if closed else lines[:-1]
    # Angles in (-pi, pi]; of those that are pi but for rounding, none is at the other end.
    angle = before[0].angle - FULL_TURN * math.ceil((before[0].angle - math.pi) / FULL_TURN - ROUNDING)
    arcs: list[Arc] = []
    counted = [] if closed else [Line(lines[0].start, lines[0].end, angle)]
    for index, (pulley, line) in enumerate(zip(scene.pulleys, lines if closed else lines[1:], strict=True)):
        here, turn = rounds[index + (not closed)], pulley.turn
        end = angle - turn * (turn * (angle - line.angle) % FULL_TURN)
        arcs.append(Arc(index, here.center, abs(here.reach), turn, angle, end))
        counted.append(Line(line.start, line.end, end))
        angle = end
    return Path(tuple(arcs), tuple(counted), closed)


def _check_overlaps(scene: Scene, rounds: Sequence[_Round]) -> None:
    """That no two pulleys are at the same place."""
    pulleys = rounds if scene.closed else rounds[1:-1]
    for (one, a), (other, b) in itertools.combinations(zip(pulleys, scene.pulleys, strict=True), 2):
        distance, least = math.dist(one.center, other.center), a.radius + b.radius
        if distance <= least:
            expected = f"be more than {least:g} [m], both radii, away from that of {one.name} (they overlap)"
            raise SceneError(f"{other.name}.center", expected, Verbatim(f"{distance:g} [m]"))


def _check_contacts(scene: Scene, rounds: Sequence[_Round], path: Path) -> None:
    """That the belt is held by each pulley.

    It is not where the straight span from neighbour to neighbour passes the pulley on the side where the belt is
    anyway. Round by a wrong pulley, the tangents make nearly a full turn.
    """
    shift = 0 if scene.closed else 1
    for arc, pulley in zip(path.arcs, scene.pulleys, strict=True):
        index = arc.pulley + shift
        before, after = rounds[index - 1], rounds[(index + 1) % len(rounds)]
        if before is after or math.dist(before.center, after.center) <= abs(before.reach - after.reach):
            continue
        direct = _tangent(before, after)
        along, left = direct.seen_from(arc.center)
        clear, rounding = left * arc.turn - arc.radius, ROUNDING * arc.radius
        if 0.0 <= along <= direct.length and clear >= -rounding:
            expected = (
                f"be where the taut belt touches the pulley (it passes at {clear if clear > rounding else 0.0:g} [m], "
                f"straight from {before.name} to {after.name}: a wrap of zero)"
            )
            raise SceneError(f"pulleys.{arc.pulley}.side", expected, pulley.side)


def _check_room(path: Path) -> None:
    """That nothing is in the belt's way: neither in that of a span nor in that of an arc."""
    shift, count = (0, len(path.arcs)) if path.closed else (-1, len(path.lines) + 1)
    for arc in path.arcs:
        name, least = f"pulleys.{arc.pulley}.center", arc.radius * (1.0 - ROUNDING)
        for index, line in enumerate(path.lines):
            ends = ((index + shift) % count, (index + shift + 1) % count)
            if arc.pulley not in ends and (distance := line.distance(arc.center)) < least:
                expected = f"be at least {arc.radius:g} [m] away from span {index}, which crosses the pulley"
                raise SceneError(name, expected, Verbatim(f"{distance:g} [m]"))
        for other in path.arcs:
            distance, least = math.dist(arc.center, other.center), arc.radius + other.radius
            if other is not arc and distance < least * (1.0 - ROUNDING) and other.faces(arc.center):
                expected = f"be at least {least:g} [m] away from that of `pulleys.{other.pulley}`, for the belt on it"
                raise SceneError(name, expected, Verbatim(f"{distance:g} [m]"))


def near_angle(angle: float, to: float) -> float:
    """The angle of the same direction that is nearest to another one [rad]."""
    return angle + FULL_TURN * round((to - angle) / FULL_TURN)


def _rounds(scene: Scene, centers: Sequence[Point] | None) -> list[_Round]:
    """What the path touches, in the order of travel."""
    offset = scene.belt.contact_offset
    pulleys = [
        _Round(center, pulley.turn * (pulley.radius + offset), f"pulleys.{index}")
        for index, (pulley, center) in enumerate(
            zip(scene.pulleys, centers or [pulley.center for pulley in scene.pulleys], strict=True)
        )
    ]
    if scene.closed:
        return pulleys
    first, last = (_Round((x, y), 0.0, name) for name, (x, y, _) in zip(CLAMPS, scene.ends, strict=True))
    return [first, *pulleys, last]


def _neighbours(rounds: Sequence[_Round], closed: bool) -> list[tuple[_Round, _Round]]:
    return list(itertools.pairwise([*rounds, *rounds[: 1 if closed else 0]]))


def _touched(center: Point, reach: float, angle: float) -> Point:
    return center[0] - reach * math.sin(angle), center[1] + reach * math.cos(angle)


def _tangent(one: _Round, other: _Round) -> Line:
    """The straight span from one round to the other.

    Raises:
        SceneError: One is inside of the other, or there is no room between them.
    """
    across = (other.center[0] - one.center[0], other.center[1] - one.center[1])
    distance, apart = math.hypot(*across), one.reach - other.reach
    if distance <= abs(apart):
        pulley, beside = (other, one) if other.reach else (one, other)
        expected = f"be more than {abs(apart):g} [m] away from that of {beside.name}, for the belt to run between them"
        raise SceneError(f"{pulley.name}.center", expected, Verbatim(f"{distance:g} [m]"))
    angle = math.atan2(across[1], across[0]) - math.asin(apart / distance)
    return Line(_touched(one.center, one.reach, angle), _touched(other.center, other.reach, angle), angle)
