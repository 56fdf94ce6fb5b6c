"""What drives ask for, by string theory: the growth of the belt's force on each pulley, and the transport rate.

A torque says the growth of the force; a place or an angle says the sliding itself. A speed says the stretch in stick,
which is that of the span before; where friction falls short of the force for it, the belt slides all along. Forces of
the spans follow from these numbers, and are corrected until all drives are met, and with them the transport rate.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from belt_fenicsx.lagrangian.friction import Friction, Points, friction_on
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene


class Drives:
    """Friction on all pulleys, and the transport rate, which each update brings nearer to what the drives ask for.

    Attributes:
        rate: Transport rate.
        growths: Growth of the belt's force on each pulley ``(pulleys,)``.
        frictions: Friction on each pulley, after an update.
        overloaded: Pulleys on which friction falls short of the force that is asked for, after an update.
        spans: Indices of the spans before and after each pulley.

    Args:
        scene: The dimensionless scene.
        rate: The transport rate to begin with.
        growths: The growths to begin with.
    """

    def __init__(self, scene: Scene, rate: float, growths: Sequence[float]) -> None:
        self.scene, self.rate, self.growths = scene, rate, np.array(growths)
        self.frictions: list[Friction] = []
        self.overloaded: list[int] = []
        count = len(scene.pulleys)
        self.spans = [((i - 1) % count, i) if scene.closed else (i, i + 1) for i in range(count)]
        # Growths are differences of the spans' forces; the last column is that of the transport rate.
        self._differences = np.zeros((count, count + (not scene.closed) + 1))
        for row, (before, after) in zip(self._differences, self.spans, strict=True):
            row[before] -= 1.0
            row[after] += 1.0

    @property
    def ask_for_forces(self) -> bool:
        """Whether forces have to be found; between clamps, places leave nothing to be met."""
        return not all(pulley.drive.is_place for pulley in self.scene.pulleys)

    def update(self, points: Sequence[Points], gap: float) -> float:
        """Finds friction on all pulleys and the transport rate anew.

        Args:
            points: The points near each pulley.
            gap: By what the force grows where a loop is held, which is nothing in the end.

        Returns:
            By what force the drives were missed.
        """
        pulleys, overloaded = self.scene.pulleys, list[int]()
        growths = [None if p.drive.is_place else g for p, g in zip(pulleys, self.growths.tolist(), strict=True)]
        frictions = [friction_on(*row) for row in zip(pulleys, points, growths, strict=True)]
        forces = np.array([gap])
        if self.ask_for_forces:
            forces, self.rate, frictions, overloaded = self._meet(points, frictions, gap)
        self.frictions, self.overloaded = frictions, overloaded
        self.growths = np.array([friction.growth for friction in frictions])
        return float(np.abs(forces).max())

    def _meet(
        self, points: Sequence[Points], frictions: Sequence[Friction], gap: float
    ) -> tuple[Array, float, list[Friction], list[int]]:
        """Corrections of the spans' forces with the gap, the transport rate, friction, and overloaded pulleys."""
        pulleys, stretches = self.scene.pulleys, np.array([friction.stretch for friction in frictions])
        lengths, capacities = self._lengths(frictions), dict[int, float]()
        # Once more where the belt turns out to slide all along a pulley whose speed is given.
        for _ in range(len(pulleys) + 1):
            forces, growths, more = self._correction(stretches, lengths, gap, capacities)
            rate = self.rate + more
            new = [
                old if pulley.drive.is_place else friction_on(pulley, at, _growth(pulley, growth, rate * stretch))
                for pulley, at, old, growth, stretch in zip(pulleys, points, frictions, growths, stretches, strict=True)
            ]
            short = [i for i, friction in enumerate(new) if friction.shortfall]
            sliding = {i: new[i].growth for i in {*capacities, *(i for i in short if pulleys[i].drive.kind == "omega")}}
            if sliding.keys() == capacities.keys() or not self._is_determined_without(sliding):
                break
            capacities = sliding
        return np.append(forces, gap), rate, new, [i for i in short if i not in capacities]

    def _correction(
        self, stretches: Array, lengths: Array, gap: float, capacities: Mapping[int, float]
    ) -> tuple[Array, Array, float]:
        """Corrections of the spans' forces ``(spans,)`` and of the transport rate; the new growths ``(pulleys,)``.

        Each drive has one equation, and so have a given transport rate, and the belt's length.

        Args:
            stretches: Stretch in stick on each pulley ``(pulleys,)``.
            lengths: Length of the belt that has the force of each span ``(spans,)``.
            gap: By what the force grows where a loop is held.
            capacities: Growths on pulleys whose speed is given, but that the belt slides along all the way.
        """
        belt, growths = self.scene.belt, self.growths.copy()
        # What a force is per stretch, less what motion takes.
        stiffness = belt.extensional_stiffness - belt.line_density * self.rate**2
        if self.scene.closed:
            growths[-1] += gap
        rows, right = [np.append(lengths, 0.0)], [0.0]
        if self.scene.transport_rate is not None:
            rows.append(np.append(0.0 * lengths, 1.0))
            right.append(self.scene.transport_rate - self.rate)
        for i, pulley in enumerate(self.scene.pulleys):
            speed = self.rate * stretches[i]
            if pulley.drive.kind == "omega" and i not in capacities:
                row = np.zeros(len(lengths) + 1)
                row[[self.spans[i][0], -1]] = self.rate / stiffness, stretches[i]
                rows.append(row)
                right.append(pulley.surface_speed - speed)
            elif pulley.drive.kind != "none":
                wanted = self.growths[i] if pulley.drive.is_place else _growth(pulley, capacities.get(i, 0.0), speed)
                rows.append(self._differences[i])
                right.append(wanted - growths[i])
        found = np.linalg.solve(np.array(rows), np.array(right))
        return found[:-1], growths + self._differences @ found, float(found[-1])

    def _lengths(self, frictions: Sequence[Friction]) -> Array:
        """Length of the belt that has the force of each span: that of the span, and what sticks behind it."""
        lengths = np.zeros(self._differences.shape[1] - 1)
        for (before, after), friction in zip(self.spans, frictions, strict=True):
            at, touching = friction.at, np.flatnonzero(np.any(friction.at.p > 0.0, axis=1))
            cells, share = at.weight.sum(axis=1), np.average(friction.share, weights=at.weight, axis=1)
            own = np.where(np.arange(len(cells)) > touching[-1], 1.0, share / 2.0)
            own[: touching[0]] = 0.0
            lengths[before] += cells @ (1.0 - own)
            lengths[after] += cells @ own
        return lengths

    def _is_determined_without(self, sliding: Collection[int]) -> bool:
        """Whether a loop keeps its pace, and its balance, without these pulleys; a belt between clamps does."""
        return not self.scene.closed or any(
            pulley.drive.kind in ("omega", "none") for i, pulley in enumerate(self.scene.pulleys) if i not in sliding
        )


def _growth(pulley: Pulley, growth: float, speed: float) -> float:
    """Growth of the belt's force on a pulley, at a speed of its surface: that of its torque, or else this one."""
    if pulley.drive.kind != "torque":
        return growth
    return (pulley.drive.by("torque") + pulley.drag * speed / pulley.radius) / pulley.radius
