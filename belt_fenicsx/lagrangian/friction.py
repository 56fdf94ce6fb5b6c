"""Friction on a pulley: where the belt sticks, and where it slides.

The belt slides before the run-off as far as the force asks for that it leaves there: friction is at its bound over the
last points of contact, of which the first one only by a share, so that a force is met to rounding on any mesh. Before,
it keeps the stretch, within Coulomb's bound, which makes what slides at the run-up. So one signed number, the growth of
the belt's force on the pulley, says all of its sliding, in either sense or in none.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import SENSE
from belt_fenicsx.scene.pulley import RUN_OFF, RUN_UP, Pulley

# A point counts in full from this part of its cell's largest pressure on.
TOUCHING = 0.1


class Points(NamedTuple):
    """What counts of the points along the belt that are nearest to one pulley ``(cells, points)``.

    Attributes:
        sigma: Material-length coordinate.
        weight: Gauss weight, a material length.
        edges: Ends of the points' parts of their cells ``(cells points + 1,)``.
        x: Global coordinate x of the touching fibre.
        g: Penetration.
        stretch: Stretch of the touching fibre.
        level: The same, from which the speed of a belt that sticks is taken.
        p: Pressure.
        trial: Friction that would keep the stretch.
    """

    sigma: Array
    weight: Array
    edges: Array
    x: Array
    g: Array
    stretch: Array
    level: Array
    p: Array
    trial: Array


@dataclass(frozen=True)
class Friction:
    """Friction on one pulley.

    Attributes:
        at: The points.
        f: Friction there ``(cells, points)``.
        bound: The most that it can be there.
        share: Share of each point's part of its cell that slides before the run-off, from 0 to 1.
        sense: Sense of this sliding; zero without any.
        shortfall: Part of the force's growth that is beyond what friction can transmit.
    """

    at: Points
    f: Array
    bound: Array
    share: Array
    sense: float
    shortfall: float = 0.0

    @property
    def growth(self) -> float:
        """Growth of the belt's force on the pulley."""
        return -float((self.at.weight * self.f).sum())

    @functools.cached_property
    def level(self) -> float | None:
        """Stretch in stick; None where the belt sticks nowhere."""
        sticks = (self.share == 0.0) & (np.abs(self.f) < self.bound)
        return float(np.average(self.at.level[sticks], weights=self.at.weight[sticks])) if sticks.any() else None

    @property
    def transition(self) -> float:
        """Where the sliding before the run-off begins; at an end of all points, where all of them slide, or none."""
        share, weight, edges = self.share.ravel(), self.at.weight.ravel(), self.at.edges
        # One point at most slides by half and more, but not altogether, and one before it by less.
        last = int(np.argmax(share >= 0.5)) if share.max() >= 0.5 else share.size - 1
        partial = slice(max(0, last - 1), last + 1)
        return float(edges[last + 1] - share[partial] @ weight[partial])

    @property
    def stretch(self) -> float:
        """Stretch in stick, or about where sliding begins of a belt that sticks nowhere."""
        if self.level is not None:
            return self.level
        sigma, stretch = (values[self.at.p > 0.0] for values in (self.at.sigma, self.at.stretch))
        return float(np.interp(self.transition if self.bound.any() else -np.inf, sigma, stretch))


def friction_on(pulley: Pulley, at: Points, growth: float | None) -> Friction:
    """Friction on a pulley on which the belt's force grows by so much; None where its sliding is given."""
    bound = pulley.friction * at.p
    sticking = np.minimum(np.maximum(_mean_trial(at), -bound), bound)
    sense, shortfall = SENSE[pulley.slip or "forward"], 0.0
    if growth is None:
        share = _share_behind_place(pulley, at)
    else:
        sense, share, shortfall = _share_of_growth(at.weight * bound, at.weight * sticking, growth)
    return Friction(at, (1.0 - share) * sticking - sense * share * bound, bound, share, sense, shortfall)


def _mean_trial(at: Points) -> Array:
    """Mean of the trial friction over the points in contact of each cell ``(cells, 1)``; zero without any.

    A cubic on a circle has D' of opposite signs at a cell's two points, which falls with the third power of its size.
    Little friction cannot make it zero at each of them: it comes to its bound at both, with opposite signs, and
    nothing sticks. A point that hardly touches hardly counts, lest the updates go to and fro as it comes and leaves.
    """
    # Column by column, as sums along short rows take five times as long.
    most = TOUCHING * functools.reduce(np.maximum, at.p.T)[:, np.newaxis]
    weights = at.weight * np.minimum(at.p, most)
    whole = sum(weights.T)
    return (sum((weights * at.trial).T) / np.where(whole > 0.0, whole, 1.0))[:, np.newaxis]


def _share_of_growth(bound: Array, sticking: Array, growth: float) -> tuple[float, Array, float]:
    """Sense and share of the sliding with which the belt's force grows by so much, and its shortfall.

    Args:
        bound: The most that each point can transmit.
        sticking: What it transmits in stick.
        growth: Growth of the force.
    """
    missing = growth + sticking.sum()
    sense = 1.0 if missing > 0.0 else -1.0
    # What each point adds to the force once it slides, and what all points behind it add.
    gain = np.maximum(bound + sense * sticking, 0.0).ravel()
    behind = gain.sum() - np.cumsum(gain)
    share = np.clip((abs(missing) - behind) / np.where(gain > 0.0, gain, 1.0), 0.0, 1.0)
    share[gain == 0.0] = 0.0
    # Where nothing is pressed on, or without friction, no force is asked for in earnest.
    shortfall = abs(missing) - float(gain.sum()) if gain.any() else 0.0
    return sense, share.reshape(bound.shape), max(0.0, shortfall)


def _share_behind_place(pulley: Pulley, at: Points) -> Array:
    """The share of sliding at a given place, or within a given angle before the run-off.

    A sharp choice would move the transition by up to a point's part of its cell, and the answer with it.
    """
    place = pulley.drive.value
    if isinstance(place, str):
        assert place in (RUN_UP, RUN_OFF), f"a transition at {place}"
        return np.full_like(at.x, float(place == RUN_UP))
    touching, edges = np.flatnonzero(at.p > 0.0), at.edges
    if pulley.drive.kind == "x_trans":
        within = slice(touching[0], touching[-1] + 1)
        x, sigma = at.x.ravel()[within], at.sigma.ravel()[within]
        # The belt passes the place in the sense of x, or against it where it lies below the pulley.
        onwards = 1.0 if x[-1] >= x[0] else -1.0
        start = float(np.interp(onwards * place, onwards * x, sigma))
    else:
        angle = np.append(0.0, np.cumsum(at.weight * at.stretch / pulley.radius))
        off = lift_off(at.sigma.ravel(), at.g.ravel(), int(touching[-1]), 1)
        start = float(np.interp(np.interp(off, edges, angle) - place, angle, edges))
    return np.minimum(np.maximum((at.sigma - start) / at.weight + 0.5, 0.0), 1.0)


def lift_off(sigma: Array, g: Array, last: int, outwards: int) -> float:
    """End of contact between its last point and the first free one.

    The gap grows with the square of the distance from it.

    Args:
        sigma: Coordinates of points ``(n,)``.
        g: Penetrations there.
        last: Number of the last point in contact.
        outwards: Whether free points follow, 1, or go before, -1.
    """
    touching, near, far = np.clip([last + i * outwards for i in range(3)], 0, len(sigma) - 1)
    far_gap, gap = np.sqrt(np.maximum(-g[[far, near]], 0.0))
    if far_gap <= gap:
        return float(sigma[near] + sigma[touching]) / 2.0
    place = float(sigma[near] + (sigma[near] - sigma[far]) * gap / (far_gap - gap))
    inside = float(sigma[touching] + sigma[max(0, touching - outwards)]) / 2.0
    return max(place, inside) if outwards > 0 else min(place, inside)
