"""The string with the layers of a belt that bends and touches with its surface, as a first guess.

Bending onto a pulley shortens the touching fibre, by e / R of its length, and bending off it lengthens it again: where
the belt comes and where it goes it slides forward, though a string would stick. What the belt does there follows from
layers that are short against the wrap, to first order in them. A force F makes

- a bending layer sqrt(a / F) in a span. Where it ends on the pulley, the belt has the curvature k / R, and it has
  turned k sqrt(a / F) / R less than a string would, at both ends of the contact;
- a shear layer l in contact, in which an angle psi = k sqrt(a F) / (b2 R) dies out, and with it a pressure b2 psi / l.
  As psi / l makes up for what is missing to the curvature 1 / R, k = 1 / (1 + sqrt(F / b2)). While the belt slides, its
  middle line keeps its strain, and l = sqrt(a / b2). In stick the touching fibre does, and a + b1 e^2 takes the place
  of a.

Friction that keeps the stretch dies out like psi, from b1 e psi / l^2; sliding before stick ends where this is mu times
the pressure. Backward sliding ends where bending off the pulley makes up for the stretch that it has lost.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import Part, sliding
from belt_fenicsx.scene.belt import StiffnessBelt
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.taut_string.forces import friction
from belt_fenicsx.taut_string.shape import Drawing, StringDrive, StringPart, sticking

STICKS = 1e-3  # A loop sticks in a first guess if it slides along no more than this part of each wrap.
MOST = 0.35  # Of a wrap, a bending layer takes this part at most from each end.
LEAST = 0.02  # Of a contact, this part sticks at least, or nothing, and so much slides behind stick.
BACKWARD = 0.75  # Of a contact on which nothing sticks, this part slides backward at most.
SHORTEST = 0.06  # Of sliding backward, sliding forward behind it is as long as this part at least, if there is some.


@dataclass(frozen=True, kw_only=True)
class BentSpan(StringPart):
    """A span whose angles at both ends die out.

    Attributes:
        layer: The length in which they do.
    """

    layer: float

    def at(self, fraction: Array) -> tuple[Array, Array, Array, Array]:
        start, way = complex(*self.start), complex(*self.end) - complex(*self.start)
        length = abs(way)
        chord = self.angles[0] + math.remainder(math.atan2(way.imag, way.real) - self.angles[0], 2.0 * math.pi)
        places = np.concatenate([[0.0], fraction, [1.0]]) * length
        first = (self.angles[0] - chord) * np.exp(-places / self.layer)
        last = (self.angles[1] - chord) * np.exp((places - length) / self.layer)
        aside = self.layer * (last - first)
        aside = aside[1:-1] - (1.0 - fraction) * aside[0] - fraction * aside[-1]
        r = start + way * (fraction + 1j * aside / length)
        return r.real, r.imag, chord + (first + last)[1:-1], np.full_like(fraction, self.stretches[0])


@dataclass(frozen=True, kw_only=True)
class BentPart(StringPart):
    """A part on a pulley with the layers there.

    Attributes:
        psi: The angle by which the cross-section leans at the run-up and the run-off.
        shear: The length in which it dies out.
        stiffness: The shear stiffness b2.
        mu: The coefficient of friction.
        held: The length in which friction dies out in stick.
    """

    psi: float
    shear: float
    stiffness: float
    mu: float
    held: float

    def layers(self, fraction: Array) -> tuple[Array, Array, Array]:
        assert self.arc is not None, "a part on a pulley"
        arc, phi = self.arc, np.append(self.angles[0], self.at(fraction)[2])
        rate = arc.turn * arc.radius / self.shear
        up, off = self.psi * np.exp(rate * (phi - arc.start)), self.psi * np.exp(rate * (arc.end - phi))
        pressure = self.stiffness / self.shear * (up + off)
        first = self.mu * (pressure[0] + self.force[0] * self.stretches[0] / arc.radius)
        return arc.turn * (off - up)[1:], pressure[1:], -first * np.exp(-fraction * self.length / self.held)


@dataclass(frozen=True)
class Layers:
    """Lengths in which a belt bends, shears and slides where it comes to a pulley and leaves it.

    Attributes:
        belt: The belt.
        force: The force F in it.
        mu: The coefficient of friction.
    """

    belt: StiffnessBelt
    force: float
    mu: float

    @property
    def bending(self) -> float:
        """The part k of the bending layer."""
        layer = math.sqrt(self.belt.bending_stiffness / self.force)
        return layer / (1.0 + math.sqrt(self.force / self.belt.shear_stiffness))

    @property
    def shear(self) -> float:
        """The shear layer while the belt slides."""
        return math.sqrt(self.belt.bending_stiffness / self.belt.shear_stiffness)

    @property
    def held(self) -> float:
        """The shear layer in stick."""
        belt = self.belt
        stiffness = belt.bending_stiffness + belt.extensional_stiffness * belt.contact_offset**2
        return math.sqrt(stiffness / belt.shear_stiffness)

    @property
    def entry(self) -> float:
        """Length in which the belt slides forward before it sticks; nothing where friction holds it at once.

        It is as short as the shear layers in sliding and in stick say.
        """
        if self.mu == 0.0:
            return 0.0
        belt, lengths = self.belt, []
        for layer in (self.shear, self.held):
            keeping = belt.extensional_stiffness * belt.contact_offset / (belt.shear_stiffness * layer**2)
            beyond = self.bending * (keeping / self.mu - 1.0 / layer)
            lengths.append(layer * math.log(max(beyond, 1.0)))
        return min(lengths)

    def leaving(self, slid: float) -> float:
        """Length in which the belt slides forward before the run-off, after it has slid backward in another one."""
        belt = self.belt
        regained = belt.extensional_stiffness * belt.contact_offset / (self.mu * belt.shear_stiffness * self.shear)
        return self.shear * math.log(max(self.bending * (regained - 1.0) / slid, 1.0))


def bent(scene: Scene, string: StringDrive) -> StringDrive:
    """The string of a dimensionless scene with the layers of a belt that touches with its surface, or only turns.

    Where contact acts at the middle line and drives make the belt slide, it is the string itself: its forces agree with
    its shape, and with layers Newton's iteration would fail more often. A loop in which it hardly slides is one that
    sticks: where a drive is not met, the search lets it slide.
    """
    belt = scene.belt
    assert isinstance(belt, StiffnessBelt), "the scene is dimensionless"
    string = settled(scene, string)
    if belt.contact_offset == 0.0 and not string.turns:
        return string
    groups = [(arc, [*on]) for arc, on in itertools.groupby(string.parts, key=lambda own: own.arc)]
    groups = [(arc, on if arc is None else [*_on_pulley(scene, on)]) for arc, on in groups]
    parts: list[StringPart] = []
    for index, (arc, on) in enumerate(groups):
        if arc is not None:
            parts += on
            continue
        (span,) = on
        # What lies on the pulleys before and behind, if they are not clamps.
        before = groups[index - 1][1][-1] if index else None
        after = groups[(index + 1) % len(groups)][1][0] if scene.closed or index + 1 < len(groups) else None
        start, angle = (before.end, before.angles[1]) if before else (span.start, span.angles[0])
        end = after.start if after else span.end
        # Angles are counted on along the belt, and a loop ends as many turns further on as it begins.
        last = span.angles[1] + math.remainder((after or span).angles[0] - span.angles[1], 2.0 * math.pi)
        layer = math.sqrt(belt.bending_stiffness / span.force[0])
        shape = {
            "length": math.dist(start, end) / span.stretches[0],
            "angles": (angle, last),
            "start": start,
            "end": end,
        }
        parts.append(BentSpan(**{**vars(span), **shape, "layer": layer}))
    return replace(string, parts=tuple(parts), bends=True)


def settled(scene: Scene, string: StringDrive) -> StringDrive:
    """The string of a loop that slides along next to nothing as one that only turns; any other one as it is."""
    wraps = {own.part.pulley: own.arc.wrap for own in string.parts if own.arc is not None}
    turns = scene.closed and all(
        not pulley.drive.is_place and (pulley.friction == 0.0 or string.slip_angles[i] <= STICKS * wraps[i])
        for i, pulley in enumerate(scene.pulleys)
    )
    return sticking(scene, string) if turns else string


def _on_pulley(scene: Scene, on: Sequence[StringPart]) -> Iterator[StringPart]:
    """The parts on a pulley, from those of the string."""
    first, arc, belt = on[0], on[0].arc, scene.belt
    assert arc is not None and isinstance(belt, StiffnessBelt), "a part on a pulley of a dimensionless scene"
    pulley, F = scene.pulleys[first.part.pulley], first.force[0]
    layers = Layers(belt, F, pulley.friction)
    turned = min(layers.bending / arc.radius, MOST * arc.wrap)
    contact = replace(arc, start=arc.start - arc.turn * turned, end=arc.end + arc.turn * turned)
    if first.part.kind == "stick" and not pulley.drive.is_place and layers.entry > 0.0:
        angle = first.stretches[0] / arc.radius
        slides = sum(own.part.sense * own.length for own in on)
        rows = [(part, length * angle) for part, length in _divided(layers, contact.wrap / angle, slides, first.part)]
    else:
        lengths = np.array([own.length for own in on])
        shares = np.maximum(lengths / lengths.sum(), LEAST)
        rows = [*zip([own.part for own in on], (shares / shares.sum() * contact.wrap).tolist(), strict=True)]
    b2, psi = belt.shear_stiffness, layers.bending * F / (belt.shear_stiffness * arc.radius)
    for own in Drawing(*first.stiffnesses).on_arc(contact, F, friction(pulley, arc), rows):
        yield BentPart(**vars(own), psi=psi, shear=layers.shear, stiffness=b2, mu=layers.mu, held=layers.held)


def _divided(layers: Layers, contact: float, slides: float, stick: Part) -> list[tuple[Part, float]]:
    """The parts of a contact with their lengths.

    Args:
        layers: The layers there.
        contact: Its length.
        slides: The length in which the string slides before the run-off, negative if backward.
        stick: The part in stick.
    """
    forward, backward = sliding(1.0, stick.pulley), sliding(-1.0, stick.pulley)
    # The belt slides forward at the entry, and with the pressure of both shear layers, k F / R of a bending layer each.
    missing = layers.entry + 2.0 * layers.bending - slides
    behind = [(forward, max(-missing, LEAST * contact))]
    if missing > 0.0:
        leaving = layers.leaving(missing)
        if leaving > 0.0:
            leaving = max(leaving, SHORTEST * missing)
        behind = [(backward, missing + leaving)]
        if leaving > 0.0:
            behind.append((forward, leaving))
    sticks = contact - layers.entry - sum(length for _, length in behind)
    parts = [(forward, layers.entry), (stick, max(sticks, LEAST * contact)), *behind]
    if sticks < LEAST * contact and missing > 0.0:
        # Layers leave no room for stick, not the load.
        back = min((contact - slides) / 2.0 + layers.bending, BACKWARD * contact)
        leaving = min(layers.leaving(back), (contact - back) / 2.0)
        parts = [(forward, contact - back - leaving), (backward, back)]
        if leaving > 0.0:
            parts.append((forward, leaving))
    whole = sum(length for _, length in parts)
    return [(part, length / whole * contact) for part, length in parts]
