"""The shape of the exact extensible string, part by part, from the forces in it.

A string neither bends nor shears: spans are straight, and on a pulley its middle line runs on an arc of the radius
R + e. With T = b1 (D - 1) and the centrifugal action of the moving belt, what spans hold on to is

    F = T - rho A c^2 D,    constant in a span and in stick, and dF/dphi = +-mu F in sliding,

so that an angle |ln(F_off / F_up)| / mu of the wrap slides before the run-off, forward where F grows. The torque on the
pulley is (R + e) (F_off - F_up); its surface moves with the touching fibre, at c D (R / (R + e)) where the belt sticks.
Friction acts on that fibre, so that R int f makes this torque: mu is to be taken R / (R + e) times as large.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import FREE, Part
from belt_fenicsx.scene.path import Arc, Line, Path, Point
from belt_fenicsx.scene.pulley import Pulley, Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.taut_string.forces import Forces, friction, slip_angle

NOTHING = 1e-12  # An angle that is no larger, in parts of the wrap, does not slide.


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

    def layers(self, fraction: Array) -> tuple[Array, Array, Array]:
        """What layers add to the angle of the cross-section, to the pressure and, in stick, to friction, ``(m,)`` each.

        A string has none.
        """
        return (np.zeros_like(fraction),) * 3


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
        bends: Whether it has the layers and the parts of a belt that bends.
        turns: Whether it is a loop that only turns.
        pressed: Whether a clamp presses it onto a pulley.
    """

    parts: tuple[StringPart, ...]
    rate: float
    omegas: tuple[float, ...]
    torques: tuple[float, ...]
    slip_angles: tuple[float, ...]
    take_ups: tuple[float, ...]
    centers: tuple[Point, ...]
    bends: bool = False
    turns: bool = False
    pressed: bool = False

    @property
    def strain(self) -> float:
        """Mean of the strains of its parts."""
        return sum(sum(own.stretches) for own in self.parts) / (2.0 * len(self.parts)) - 1.0

    def on(self, pulley: int) -> list[StringPart]:
        """The parts on a pulley."""
        return [own for own in self.parts if own.part.touches and own.part.pulley == pulley]

    def asked(self, pulley: Pulley, index: int) -> float:
        """Torque that is given to a pulley, at the speed that it has."""
        return pulley.drive.by("torque") + pulley.drive.drag * self.omegas[index]


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


def sticking(scene: Scene, string: StringDrive) -> StringDrive:
    """The string that sticks all along each pulley with friction."""
    parts = [
        replace(own, part=Part("stick", pulley=own.part.pulley))
        if own.part.touches and scene.pulleys[own.part.pulley].friction > 0.0
        else own
        for own in undivided(string).parts
    ]
    return replace(string, parts=tuple(parts), turns=True)


def drawn_on(path: Path, scene: Scene, forces: Forces, centers: tuple[Point, ...]) -> StringDrive:
    """The string with these forces on its path."""
    b1, c = scene.belt.extensional_stiffness, forces.rate
    string = Drawing(b1, b1 - scene.belt.line_density * c**2)
    spans = [string.span(line, F) for line, F in zip(path.lines, forces.spans, strict=True)]
    parts, ahead = ([], spans) if scene.closed else (spans[:1], spans[1:])
    omegas, torques, angles, take_ups = [], [], [], []
    for pulley, arc, up, off, span in zip(scene.pulleys, path.arcs, forces.up, forces.off, ahead, strict=True):
        mu, grown, speed = friction(pulley, arc), math.log(off / up), c * string.stretch(up) / arc.radius
        # With little friction, forces know an angle less well than a place does.
        angle = slip_angle(pulley, arc) if pulley.drive.is_place else min(abs(grown) / mu, arc.wrap) if mu else 0.0
        omega = pulley.drive.by("omega") if pulley.drive.kind == "omega" else speed
        # Where a drive places a transition, there is one, even if hardly anything sticks before it.
        through = pulley.drive.kind in ("slip_angle", "x_trans") or abs(speed - omega) > NOTHING * speed
        sense: Slip = pulley.slip or ("forward" if grown > 0.0 else "backward")
        parts += [*string.on_pulley(pulley, arc, up, mu, sense, angle, through), span]
        omegas.append(omega)
        torques.append(arc.radius * (off - up))
        angles.append(abs(grown) / mu if mu else 0.0)
        take_ups.append(float(np.subtract(arc.center, pulley.center) @ pulley.direction))
    return StringDrive(
        parts=tuple(parts), rate=c, omegas=tuple(omegas), torques=tuple(torques), slip_angles=tuple(angles),
        take_ups=tuple(take_ups), centers=centers,
    )  # fmt: skip


@dataclass(frozen=True)
class Drawing:
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
        # A place is asked for even where the string does not touch, as the belt may.
        at_place = isinstance(pulley.x_trans, float)
        if mu == 0.0:
            rows = [(Part("slip", drive.slip or "forward", index), arc.wrap)]
        elif through and not at_place and angle >= arc.wrap * (1.0 - NOTHING):
            rows = [(Part("slip", sense, index), arc.wrap)]
        elif angle <= NOTHING * arc.wrap and not at_place and drive.kind not in ("omega", "none"):
            rows = [(Part("stick", pulley=index), arc.wrap)]
        else:
            rows = [(Part("stick", pulley=index), arc.wrap - angle), (Part("slip", sense, index), angle)]
        return self.on_arc(arc, F, mu, rows)

    def on_arc(self, arc: Arc, F: float, mu: float, rows: Sequence[tuple[Part, float]]) -> Iterator[StringPart]:
        """Parts on a pulley, each with the angle in which the belt turns, behind a span with the force F."""
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
