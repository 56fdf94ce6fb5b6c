"""How friction holds a belt on its pulleys: where it sticks, where it slides, and what drives ask of both.

On each pulley, the belt slides before the run-off as far as the force asks for that it leaves there: friction is at its
bound over the last points of contact, of which the first one only by a share, so that a force is met to rounding on any
mesh. Before, it keeps the stretch, within Coulomb's bound, which makes what slides at the run-up. So one signed number
for each pulley, the growth of the belt's force on it, says all of its sliding, in either sense or in none.

A torque says this number; a place or an angle says the sliding itself. A speed says the stretch in stick, which is that
of the span before; where friction lacks the force for it, the belt slides all along. By string theory, forces of the
spans follow from those numbers: `corrected` changes them until all drives are met, and with them the transport rate.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.pulley import RUN_OFF, RUN_UP, Pulley
from belt_fenicsx.scene.scene import Scene

# A point counts in full from this part of its cell's largest pressure on.
TOUCHING = 0.1


class Points(NamedTuple):
    """What counts of the points along the belt that are nearest to one pulley ``(cells, points)``.

    Attributes:
        sigma: Material-length coordinate.
        weight: Gauss weight, a material length.
        x: Global coordinate x of the touching fibre.
        g: Penetration.
        stretch: Stretch of the touching fibre.
        held: Friction that would keep the stretch.
        p: Pressure.
        f: Friction before.
    """

    sigma: Array
    weight: Array
    x: Array
    g: Array
    stretch: Array
    held: Array
    p: Array
    f: Array

    @property
    def growth(self) -> float:
        """Growth of the belt's force by this friction."""
        return -float(np.sum(self.weight * self.f))

    @property
    def edges(self) -> Array:
        """Ends of the points' parts of their cells ``(cells points + 1,)``."""
        start = self.sigma[0].mean() - self.weight[0].sum() / 2.0
        return start + np.append(0.0, np.cumsum(self.weight))


class Grip(NamedTuple):
    """Friction on one pulley.

    Attributes:
        f: Friction at its points ``(cells, points)``.
        share: Share of each point's part of its cell that slides before the run-off, from 0 to 1.
        sense: Sense of this sliding; zero without any.
        level: Stretch in stick, or at the transition.
        lacking: Part of the wanted force that is beyond what friction can transmit.
    """

    f: Array
    share: Array
    sense: float
    level: float
    lacking: float = 0.0


def gripped(pulley: Pulley, at: Points, force: float | None) -> Grip:
    """Friction on a pulley on which the belt's force grows by so much; None where its sliding is given."""
    bound = pulley.friction * at.p
    held = np.clip(_mean(at), -bound, bound)
    lacking = 0.0
    if force is None:
        sense = 1.0 if pulley.slip == "forward" else -1.0
        share = _placed(pulley, at)
    else:
        sense, share, lacking = _sliding(at.weight * bound, at.weight * held, force)
    f = (1.0 - share) * held - sense * share * bound
    stuck = (at.p > 0.0) & (share == 0.0) & (np.abs(held) < bound)
    if stuck.any():
        level = float(np.average(at.stretch[stuck], weights=at.weight[stuck]))
    else:
        level = _at_transition(at, np.ones_like(share) if pulley.friction == 0.0 else share)
    return Grip(f, share, sense, level, lacking)


def _at_transition(at: Points, share: Array) -> float:
    """Stretch where sliding begins, of a belt that sticks nowhere; at its run-up, if it slides all along."""
    inside = np.flatnonzero(np.all(at.p > 0.0, axis=1))
    cells = inside[np.all(share[inside] > 0.0, axis=1)]
    if cells.size < 2:
        return float(at.stretch.ravel()[np.argmax(at.p)])
    # Cells know their mean stretch, and the first cell in contact is part free.
    (one, other), stretch = at.sigma[cells[:2]].mean(axis=1), at.stretch[cells[:2], 0]
    first = int(np.argmax(at.p.ravel() > 0.0))
    start = lift_off(at.sigma.ravel(), at.g.ravel(), first, -1) if cells[0] == inside[0] else one
    return float(stretch[0] + (stretch[1] - stretch[0]) * (start - one) / (other - one))


def _mean(at: Points) -> Array:
    """Mean of what would keep the stretch over the points in contact of each cell ``(cells, 1)``, see `multipliers`.

    A point that hardly touches hardly counts, lest the updates go to and fro as it comes and leaves.
    """
    most = np.max(at.p, axis=1, keepdims=True)
    weights = at.weight * np.clip(at.p / np.where(most > 0.0, TOUCHING * most, 1.0), 0.0, 1.0)
    whole = np.sum(weights, axis=1, keepdims=True)
    return np.sum(weights * at.held, axis=1, keepdims=True) / np.where(whole > 0.0, whole, 1.0)


def _sliding(bound: Array, held: Array, force: float) -> tuple[float, Array, float]:
    """Sense and share of the sliding with which the belt's force grows by so much, and what it lacks.

    Args:
        bound: The most that each point can hold.
        held: What it holds in stick.
        force: Growth of the force.
    """
    missing = force + held.sum()
    sense = 1.0 if missing > 0.0 else -1.0
    # What each point adds to the force once it slides, and what all points behind it add.
    gain = np.maximum(bound + sense * held, 0.0).ravel()
    behind = gain.sum() - np.cumsum(gain)
    share = np.clip((abs(missing) - behind) / np.where(gain > 0.0, gain, 1.0), 0.0, 1.0)
    share[gain == 0.0] = 0.0
    # Where nothing is pressed on, or without friction, no force is asked for in earnest.
    lacking = abs(missing) - float(gain.sum()) if gain.any() else 0.0
    return sense, share.reshape(bound.shape), max(0.0, lacking)


def _placed(pulley: Pulley, at: Points) -> Array:
    """The share of sliding at a given place, or within a given angle before the run-off."""
    if pulley.x_trans in (RUN_UP, RUN_OFF):
        return np.full_like(at.x, float(pulley.x_trans == RUN_UP))
    touching, edges = np.flatnonzero(at.p > 0.0), at.edges
    if isinstance(pulley.x_trans, float):
        x, sigma = at.x.ravel()[touching], at.sigma.ravel()[touching]
        # The belt passes the place in the sense of x, or against it where it lies below the pulley.
        onwards = 1.0 if x[-1] >= x[0] else -1.0
        start = float(np.interp(onwards * pulley.x_trans, onwards * x, sigma))
    else:
        angle = np.append(0.0, np.cumsum(at.weight * at.stretch / pulley.radius))
        off = lift_off(at.sigma.ravel(), at.g.ravel(), int(touching[-1]), 1)
        start = float(np.interp(np.interp(off, edges, angle) - pulley.drive.by("slip_angle"), angle, edges))
    return np.clip((edges[1:] - start) / at.weight.ravel(), 0.0, 1.0).reshape(at.x.shape)


def lift_off(sigma: Array, g: Array, last: int, outwards: int) -> float:
    """Border of contact between its last point and the first free one.

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
    inside = float(0.9 * sigma[touching] + 0.1 * sigma[near])
    return max(place, inside) if outwards > 0 else min(place, inside)


class Levels(NamedTuple):
    """Corrections of the forces in the spans, by string theory.

    Attributes:
        spans: Those of the spans ``(spans,)``.
        growths: Those of the growth of the belt's force on each pulley ``(pulleys,)``.
        rate: That of the transport rate.
    """

    spans: Array
    growths: Array
    rate: float


def corrected(
    scene: Scene,
    levels: Array,
    growths: Array,
    lengths: Array,
    *,
    stiffness: float,
    rate: float,
    gap: float,
    slid: Mapping[int, float] = MappingProxyType({}),
) -> Levels:
    """What corrects the forces in the spans, so that all drives are met.

    The unknowns are the corrections of the spans' forces and of the transport rate. Each drive has one equation, and so
    have a given transport rate, and the belt's length.

    Args:
        scene: The dimensionless scene.
        levels: Stretch in stick on each pulley ``(pulleys,)``.
        growths: Growth of the belt's force on each pulley ``(pulleys,)``.
        lengths: Length of the belt that has the force of each span ``(spans,)``.
        stiffness: What a force is per stretch.
        rate: Transport rate.
        gap: By what the force grows where a loop is held, which is nothing in the end.
        slid: How much the belt's force grows on pulleys whose speed is given, but that it slides along all the way.
    """
    count, spans = len(scene.pulleys), len(lengths)
    rows, right = [np.append(lengths, 0.0)], [0.0]
    if scene.transport_rate is not None:
        rows.append(np.append(np.zeros(spans), 1.0))
        right.append(scene.transport_rate - rate)
    grown = np.zeros((count, spans + 1))
    extra = np.zeros(count)
    extra[-1] = gap if scene.closed else 0.0
    for i, pulley in enumerate(scene.pulleys):
        before, after = ((i - 1) % count, i) if scene.closed else (i, i + 1)
        grown[i, before] -= 1.0
        grown[i, after] += 1.0
        row = np.zeros(spans + 1)
        match pulley.drive.kind:
            case "omega" if i in slid:
                rows.append(grown[i])
                right.append(slid[i] - growths[i] - extra[i])
            case "omega":
                row[[before, -1]] = rate / stiffness, levels[i]
                rows.append(row)
                right.append(pulley.surface_speed - rate * levels[i])
            case "torque":
                rows.append(grown[i])
                right.append(wanted(pulley, rate * levels[i]) - growths[i] - extra[i])
            case "x_trans" | "slip_angle":
                rows.append(grown[i])
                right.append(-extra[i])
    found = np.linalg.solve(np.array(rows), np.array(right))
    return Levels(found[:-1], grown @ found + extra, float(found[-1]))


def wanted(pulley: Pulley, speed: float) -> float:
    """Growth of the belt's force on a pulley with a given torque, at a speed of its surface."""
    return (pulley.drive.by("torque") + pulley.drag * speed / pulley.radius) / pulley.radius
