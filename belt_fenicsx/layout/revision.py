"""Which layout the tractions of a state call for: one rule for every method.

A layout breaks where a part has shrunk to nothing, where friction in stick exceeds Coulomb's bound, or where the belt
slides the other way. `revise` says what the first of these on each pulley calls for:

1. A part that has shrunk to nothing is left out; sliding behind stick turns round instead, if the drive lets it.
2. Stick that holds nowhere gives way to sliding; stick that breaks the bound at the run-up has a slip part before it.
   Usually friction in stick is negative there, and positive at the run-off, so that the belt slides forward at both.
3. Stick that breaks the bound at its end ends earlier, if the drive lets it: in pure stick, where friction reaches its
   bound; by a given speed or torque, with sliding that turns, since these change without a break where it begins to.
4. A slip part in which the belt slides both ways is two. Where sliding turns behind it though friction could keep the
   stretch, the belt sticks in between: before, it slides against its sense for a while, which is as short as the stick
   part, and as slow, so that the speed of sliding does not show it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import Part, sliding
from belt_fenicsx.layout.layers import shear_layer
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered
from belt_fenicsx.scene.pulley import RUN_OFF, Pulley
from belt_fenicsx.scene.scene import Scene

ROUNDING = 1e-14  # A stretch is known to about this.
LEAST = 1e-3  # The part of a contact that a new part is long, at least, if nothing else tells its length.
FURTHEST = 0.8  # Sliding takes this part of a stick part that holds nowhere, if it may hold later on.
WORTH = 1e-4, 1e-2  # Sliding that turns in less, in belt lengths and in shear layers, is left as it is.
BEGINNING = 1e-2  # Sliding that is right in no more than this part of its length is wrong all along.


@dataclass(frozen=True)
class Sample:
    """Fields densely along a part in contact, all ``(m,)``: sigma, x, pressure p, friction f, stretch D, and what
    computes the friction ``keeping`` that would keep the stretch, D' = 0."""

    sigma: Array
    x: Array
    p: Array
    f: Array
    D: Array
    keeping: Callable[[], Array]


@dataclass(frozen=True)
class Resultants:
    """What a pulley has of the belt.

    Attributes:
        speed: Stretch of the belt that goes with the pulley's speed: that in stick, or that of the belt where it is
            nearest to stick.
        place: Where the belt leaves this speed for good, or is nearest to it: a global coordinate.
        pressure: Integral of the pressure.
        friction: Integral of the friction.
        doubt: What rounding may make of that.
    """

    speed: float
    place: float
    pressure: float
    friction: float
    doubt: float = 0.0


@dataclass(frozen=True)
class Samples:
    """What a state of any method says about its layout, dimensionless.

    Attributes:
        ends: Ends of the parts in the material-length coordinate ``(len(parts) + 1,)``.
        parts: Samples of the parts; None of free ones.
        pulleys: Resultants on each pulley.
        finer: Makes the same more densely, for the places of new joints, which have to start close to where they will
            be; None if these samples suffice.
        rate: Transport rate.
        closing: The pulley that closes a loop without a joint that does so, and the force along the belt that is
            missing where the loop begins; None elsewhere.
    """

    ends: Array
    parts: tuple[Sample | None, ...]
    pulleys: tuple[Resultants, ...]
    finer: Callable[[], Samples] | None = None
    rate: float = 1.0
    closing: tuple[int, float] | None = None

    @property
    def only(self) -> Resultants:
        """What they say of the only pulley."""
        (resultants,) = self.pulleys
        return resultants

    @property
    def densest(self) -> Samples:
        """These samples as densely as there are any."""
        return self if self.finer is None else self.finer()


@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """How far a state is trusted.

    Attributes:
        shrunk: Length in belt lengths down to which a part has not yet shrunk to nothing; negative where joints are
            not known better.
        bound: Excess of Coulomb's bound that does not count, relative to the largest bound of the part.
        sense: Speed of sliding in the wrong sense that does not count, relative to the largest speed of the part.
        furthest: Part of a stick part that sliding next to it takes at once, at most.
        stretch: Error of a stretch, whatever the speed of sliding.
    """

    shrunk: float
    bound: float
    sense: float
    furthest: float = 1.0
    stretch: float = 0.0


@dataclass(frozen=True)
class Revision:
    """A layout that is called for.

    Attributes:
        why: What was seen.
        layout: The layout; None where the drive asks for a transition at which stick cannot end.
        ends: Ends of its parts, about ``(len(layout.parts) + 1,)``.
    """

    why: str
    layout: Layout | None = None
    ends: Array | None = None


def revise(scene: Scene, layout: Layout, samples: Samples, tolerances: Tolerances) -> Revision | None:
    """What the first broken bounds of a state on each pulley call for; None where all hold.

    Args:
        scene: The dimensionless scene.
        layout: The layout of the state.
        samples: Its samples.
        tolerances: How far it is trusted.
    """
    contacts = [_Contact(scene, layout, samples, tolerances, index) for index in range(len(scene.pulleys))]
    changes: list[_Change | None] = []
    slipped = False
    for contact in contacts:
        change = contact.change()
        # What begins to slide all along one pulley unloads others: they do not do so at the same time.
        slips = change is not None and change.ends is not None and contact.sticks and not _stick(change.parts)
        changes.append(None if slips and slipped else change)
        slipped |= slips
    why = ", ".join(dict.fromkeys(change.why for change in changes if change))
    if not why:
        return None
    if any(change and change.ends is None for change in changes):
        return Revision(why)
    own = [change or contact for change, contact in zip(changes, contacts, strict=True)]
    ends = [each.ends for each in own]
    first = samples.ends[: 0 if scene.closed else 1]
    revised = ordered(scene, [part for each in own for part in each.parts])
    return Revision(why, revised, np.concatenate([first, *ends, samples.ends[-1:]]))


@dataclass(frozen=True)
class _Change:
    """What is seen on one pulley, the parts there that it calls for, and their ends.

    There are none where the drive asks for a transition at which stick cannot end.
    """

    why: str
    parts: Sequence[Part] = ()
    ends: Sequence[float] | None = None


@dataclass(frozen=True)
class _Contact:
    """The parts on one pulley, counted from its run-up, and what each of them calls for."""

    scene: Scene
    layout: Layout
    samples: Samples
    tolerances: Tolerances
    index: int

    @property
    def on(self) -> range:
        return self.layout.on(self.index)

    @functools.cached_property
    def parts(self) -> list[Part]:
        return [self.layout.parts[i] for i in self.on]

    @functools.cached_property
    def ends(self) -> list[float]:
        return self.samples.ends[self.on[0] : self.on[-1] + 2].tolist()

    @property
    def sticks(self) -> bool:
        return self.layout.sticks(self.index)

    @property
    def pulley(self) -> Pulley:
        return self.scene.pulleys[self.index]

    @functools.cached_property
    def transition(self) -> int | None:
        """The part at whose end the belt leaves the pulley's speed for good; None where no sliding follows."""
        slides = self.layout.slides_behind(self.index)
        return self.layout.transition(self.index) - self.on[0] if slides else None

    @property
    def placed(self) -> bool:
        """Whether the scene says where stick ends."""
        return self.pulley.drive.is_place and self.pulley.x_trans != RUN_OFF and self.transition is not None

    def sample(self, i: int) -> Sample:
        """Samples of a part."""
        sample = self.samples.parts[self.on[i]]
        assert sample is not None
        return sample

    def change(self) -> _Change | None:
        """What the first broken bound on this pulley calls for; None where all hold."""
        if (
            (shorter := self.leave_out()) is not None
            or self.pulley.friction == 0.0
            or (found := self.first_broken()) is None
        ):
            return shorter
        return replace(self, samples=self.samples.densest).first_broken() or found

    def revised(self, why: str, parts: Sequence[Part], ends: Sequence[float] | Array) -> _Change:
        """Other parts on this pulley, of which equal neighbours are one."""
        kept = [i for i in range(len(parts)) if i == 0 or parts[i] != parts[i - 1]]
        revised = _Change(why, [parts[i] for i in kept], [*(ends[i] for i in kept), ends[-1]] if kept else [])
        if not self.placed:
            return revised
        left = next((i for i, part in enumerate(revised.parts) if part.kind == "stick"), 0)
        there = revised.parts[left + 1 : left + 2]
        return revised if there and there[0].slip == self.pulley.slip else _Change(why)

    def leave_out(self) -> _Change | None:
        """The layout without the shortest part, if that has shrunk to nothing."""
        parts, ends = self.parts, self.ends
        lengths = np.diff(ends)
        i, last = int(np.argmin(lengths)), len(parts) - 1
        if lengths[i] > self.tolerances.shrunk:
            return None
        why = f"part {i + 1} of {self.layout} has shrunk to nothing"
        if lengths[i] < 0.0 and i == last > 0 and parts[i - 1].kind == "stick" and not self.placed:
            length = max(-lengths[i], LEAST * (ends[-1] - ends[0]))
            return self.revised(why, [*parts[:-1], parts[-1].turned], [*ends[:-2], ends[-1] - length, ends[-1]])
        if self.pulley.drive.kind == "none" and len(parts) == 2:
            # The transition of the pulley that nothing drives is placed by the closing of the loop.
            return None
        return self.revised(why, [*parts[:i], *parts[i + 1 :]], np.delete(ends, i + 1 if i < last else i))

    def first_broken(self) -> _Change | None:
        """What the first bound that friction or sliding breaks calls for."""
        for i, (part, (start, end)) in enumerate(zip(self.parts, pairwise(self.ends), strict=True)):
            looks = (self.exceed_bound,) if part.kind == "stick" else (self.stick_again, self.reverse_sliding)
            for look in looks if start < end else ():
                if (found := look(i)) is not None:
                    return found
        return None

    def exceed_bound(self, i: int) -> _Change | None:
        """Sliding at the ends of a stick part where friction exceeds its bound; or in its place."""
        parts, ends, at = self.parts, self.ends, self.sample(i)
        bound = self.pulley.friction * at.p
        excess = np.abs(at.f) - bound
        broken, within = excess > self.tolerances.bound * bound.max(), np.flatnonzero(excess <= 0.0)
        before, length = sliding(-at.f[0], self.index), ends[i + 1] - ends[i]
        if broken.all() and not within.size and (at.f[0] * at.f[-1] > 0.0 or i < len(parts) - 1):
            why = "stick breaks Coulomb's bound all along"
            return self.revised(why, [*(parts[:i] or [before]), *parts[i + 1 :]], np.delete(ends, i) if i else ends)
        if broken[0] and i == 0:
            why = "Coulomb's bound breaks where stick begins"
            place = at.sigma[min(within[0], at.sigma.size - 2)] if within.size else ends[0] + FURTHEST * length
            place = min(place, ends[0] + self.tolerances.furthest * length)
            return self.revised(why, [before, *parts], [ends[0], place, *ends[1:]])
        if broken[-1]:
            place = at.sigma[max(within[-1], 1)] if within.size else ends[i + 1] - FURTHEST * length
            return self.end_earlier(i, max(place, ends[i + 1] - self.tolerances.furthest * length))
        return None

    def end_earlier(self, i: int, place: float) -> _Change | None:
        """A stick part that ends at a place before its end; None where it ends at Coulomb's bound already."""
        parts, ends, why = self.parts, self.ends, "Coulomb's bound breaks where stick ends"
        behind = sliding(self.sample(i).f[-1], self.index)
        if not self.pulley.drive.is_place:
            back = min(ends[i + 1] - place, place - ends[i]) / 2.0
            turned = [*ends[: i + 1], place - back, place + back, ends[-1]]
            return self.revised(why, [*parts[: i + 1], behind.turned, behind], turned)
        if self.transition is None:
            return self.revised(why, [*parts, behind], [*ends[:-1], place, ends[-1]])
        return None if self.pulley.x_trans == RUN_OFF else _Change(why)

    def reverse_sliding(self, i: int) -> _Change | None:
        """Two slip parts in place of one in which the belt slides both ways; or one of the other sense."""
        parts, ends, at = self.parts, self.ends, self.sample(i)
        if self.transition is not None:
            speed = self.samples.pulleys[self.index].speed
        elif self.pulley.omega is not None:
            speed = self.pulley.radius * self.pulley.omega / self.samples.rate
        else:
            return None
        ahead = parts[i].sense * (at.D - speed)
        wrong = ahead < -max(self.tolerances.sense * np.abs(ahead).max(), self.tolerances.stretch, ROUNDING)
        if not wrong.any():
            return None
        why = f"the belt slides the other way in a part of {parts[i]}"
        if wrong[-1]:
            crossing, pair = int(np.flatnonzero(~wrong).max(initial=0)), (parts[i], parts[i].turned)
        else:
            crossing, pair = int(np.flatnonzero(wrong).max()), (parts[i].turned, parts[i])
        right = at.sigma[crossing] - at.sigma[0]
        if wrong[-1] and right <= BEGINNING * (at.sigma[-1] - at.sigma[0]) and not self.pulley.drive.is_place:
            return self.revised(why, [*parts[:i], parts[i].turned, *parts[i + 1 :]], ends)
        if wrong[-1] and at.sigma[-1] - at.sigma[crossing] < min(WORTH[0], WORTH[1] * shear_layer(self.scene, 0.0)):
            return None
        place = _crossing(at.sigma, ahead, crossing)
        return self.revised(why, [*parts[:i], *pair, *parts[i + 1 :]], [*ends[: i + 1], place, *ends[i + 1 :]])

    def stick_again(self, i: int) -> _Change | None:
        """A stick part before the place where sliding turns, if friction could keep the stretch there."""
        parts, ends, at = self.parts, self.ends, self.sample(i)
        if i != self.transition or parts[i + 1].kind == "stick":
            return None
        bound = self.pulley.friction * at.p
        excess, last = np.abs(at.keeping()) - bound, at.sigma.size - 1
        if excess[last] >= -self.tolerances.bound * bound.max():
            return None
        exceeded = min(int(np.flatnonzero(excess > 0.0).max(initial=0)), last - 1)
        place = float(np.interp(0.0, -excess[exceeded : exceeded + 2], at.sigma[exceeded : exceeded + 2]))
        place = max(place, ends[i + 1] - self.tolerances.furthest * (ends[i + 1] - ends[i]))
        why = "sliding turns where friction could keep the stretch"
        stick = Part("stick", pulley=self.index)
        return self.revised(why, [*parts[: i + 1], stick, *parts[i + 1 :]], [*ends[: i + 1], place, *ends[i + 1 :]])


def _stick(parts: Sequence[Part]) -> bool:
    """Whether the belt sticks on any of some parts."""
    return any(part.kind == "stick" for part in parts)


def _crossing(sigma: Array, values: Array, i: int) -> float:
    """Where values change their sign between the points ``i`` and ``i + 1``."""
    part = np.clip(values[i] / (values[i] - values[i + 1]), 0.05, 0.95)
    return float(sigma[i] + part * (sigma[i + 1] - sigma[i]))
