"""The augmented-Lagrangian method for general drives: the loop of `loop.Run`, with another begin and another update.

3. c. On each pulley lambda_f <- lambda_f + P_f D' in stick, in the mean of each element and clipped to Coulomb's bound,
      and -s mu lambda_p where the belt slides before the run-off, which reaches as far as the drive asks for (`grip`).
   d. The growth of the belt's force on each pulley, and the transport rate, from speeds, torques and the belt's length.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from belt_fenicsx.lagrangian import drive_reading
from belt_fenicsx.lagrangian.accuracy import FEWEST
from belt_fenicsx.lagrangian.drive_forms import DriveState
from belt_fenicsx.lagrangian.drive_guess import from_fields, from_track
from belt_fenicsx.lagrangian.grip import Grip, Points, corrected, gripped, wanted
from belt_fenicsx.lagrangian.loop import Run
from belt_fenicsx.lagrangian.multipliers import Multipliers
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status

RELAXED = 2  # Updates with the relaxed penalty.
PATIENCE = 20  # Updates with the full one in which friction may lack force.


class DriveRun(Run):
    """A task on its way through the steps, for any drive."""

    def _begin(self) -> None:
        scene, problem, fields = self.task.scene, self.problem, self.task.start
        self.lacking = 0
        nodes, points = problem.nodes, problem.points
        if fields is None:
            guess = from_track(scene, problem.track, nodes, points)
        else:
            guess = from_fields(scene, fields, self.task.rate, nodes, points)
        self.rate = guess.rate
        problem.set_rate(self.rate)
        problem.set_state(guess.values, guess.slopes)
        self.multipliers = guess.multipliers
        self.penalty = self.penalties.relaxed if fields is None else self.penalties.full
        if fields is not None:
            self.stages.skipped("relaxed", "there is an initial solution")
            return
        with self._stage("relaxed", "no initial solution was given"):
            friction = self.penalties.friction if problem.frictional else 0.0
            # Friction changes the belt the most when it comes, and Newton's iteration follows best while P is small.
            for _ in range(RELAXED):
                self._newton()
                self._update(problem.state(), friction)

    @property
    def stiffness(self) -> float:
        """What a force is per stretch, less what motion takes."""
        return self.task.scene.belt.extensional_stiffness - self.problem.constants["mass"].value.item()

    def _update(self, state: DriveState, friction: float) -> None:
        """Steps 3b to 3d; measures the change of the multipliers, what drives miss, and the penetration."""
        old, penalty = self.multipliers, np.minimum(self.penalty, self.limit)
        p = np.maximum(0.0, old.p + penalty * state.g)
        f, missed = self._friction(state, p, friction)
        self.multipliers = Multipliers(p, f)
        self._measure(state, old, penalty, missed)

    def _friction(self, state: DriveState, p: Array, friction: float) -> tuple[Array, float]:
        """Friction after an update, and by what force the drives are missed. All ranks see the whole belt here."""
        space, d = self.problem.space, self.problem.circles[state.pulley.astype(int), 3]
        held, x = self.multipliers.f + friction * state.dD, state.x + d * np.sin(state.theta)
        own = [state.sigma, state.weight, x, state.g, state.stretch, held, p, self.multipliers.f, state.pulley]
        rows = space.gather(np.stack(own, axis=-1).reshape(-1, len(own)))
        *columns, number = rows.T.reshape(len(own), -1, state.x.shape[1])
        on = [number[:, 0] == i for i in range(len(self.task.scene.pulleys))]
        points = [Points(*(column[here] for column in columns)) for here in on]
        for i, at in enumerate(points):
            if not np.any(at.p > 0.0):
                raise Stopped(Status.CONTACT_LOST, f"no Gauss point is in contact with pulley {i}")
        missed, f = self._drive(points), np.empty_like(number)
        for here, grip in zip(on, self.grips, strict=True):
            f[here] = grip.f
        first = space.comm.exscan(len(state.x)) or 0
        return f[first : first + len(state.x)], missed

    def _drive(self, points: Sequence[Points]) -> float:
        """Finds friction on all pulleys and the transport rate; by what force the drives are missed so far."""
        pulleys, gap = self.task.scene.pulleys, self._gap()
        growths = np.array([at.growth for at in points])
        forces = [None if pulley.drive.is_place else at.growth for pulley, at in zip(pulleys, points, strict=True)]
        grips = [gripped(*each) for each in zip(pulleys, points, forces, strict=True)]
        levels, lengths = np.array([grip.level for grip in grips]), self._lengths(points, grips)
        slid: dict[int, float] = {}
        # Once more where the belt turns out to slide all along a pulley whose speed is given.
        for _ in range(len(pulleys) + 1):
            correction = corrected(
                self.task.scene, levels, growths, lengths,
                stiffness=self.stiffness, rate=self.rate, gap=gap, slid=slid,
            )  # fmt: skip
            rate = self.rate + correction.rate
            for i, pulley in enumerate(pulleys):
                if pulley.drive.kind == "torque":
                    forces[i] = wanted(pulley, rate * levels[i])
                elif forces[i] is not None:
                    forces[i] = float(growths[i] + correction.growths[i])
            grips = [gripped(*each) for each in zip(pulleys, points, forces, strict=True)]
            found = {
                i: at._replace(f=grip.f).growth
                for i, (at, grip) in enumerate(zip(points, grips, strict=True))
                if i in slid or (grip.lacking and pulleys[i].drive.kind == "omega")
            }
            if found.keys() == slid.keys() or not self._holds_without(found):
                break
            slid = found
        self.rate, self.grips = rate, grips
        self.problem.set_rate(rate)
        self._stop_beyond_capacity([i for i, grip in enumerate(grips) if grip.lacking and i not in slid])
        return max(float(np.abs(correction.spans).max()), abs(gap))

    def _end(self, status: Status, **answer: Any) -> Solution:
        if "fields" not in answer:
            answer["message"] += self._too_short()
        return super()._end(status, **answer)

    def _too_short(self) -> str:
        """What is said of a mesh on which the taut belt touches some pulley with few elements."""
        track, nodes = self.problem.track, self.task.nodes
        elements, lengths = [], []
        for start, end in ((track.ends[i], track.ends[i + 1]) for i in track.touching):
            middles = (nodes[1:] + nodes[:-1]) / 2.0
            elements.append(float(np.interp((start + end) / 2.0, middles, np.diff(nodes))))
            lengths.append(float(end - start))
        counts = np.array(lengths) / np.array(elements)
        pulley = int(np.argmin(counts))
        if counts[pulley] >= FEWEST:
            return ""
        wanted = math.ceil(FEWEST / counts[pulley] * self.task.elements)
        return f"; the taut belt has {counts[pulley]:.2g} elements on pulley {pulley}, {wanted} of all would do there"

    def _gap(self) -> float:
        """By what the belt's force grows where a loop is held."""
        if not self.problem.closed:
            return 0.0
        force = self.problem.space.comm.allreduce(self.problem.newton.reaction)
        return -float(force) * self.problem.track.direction[self.problem.axis]

    def _lengths(self, points: Sequence[Points], grips: Sequence[Grip]) -> Array:
        """Length of the belt that has the force of each span: that of the span, and what sticks behind it."""
        count, closed = len(points), self.problem.closed
        lengths = np.zeros(count if closed else count + 1)
        for i, (at, grip) in enumerate(zip(points, grips, strict=True)):
            before, after = ((i - 1) % count, i) if closed else (i, i + 1)
            touching = np.flatnonzero(np.any(at.p > 0.0, axis=1))
            cells, share = at.weight.sum(axis=1), np.average(grip.share, weights=at.weight, axis=1)
            own = np.where(np.arange(len(cells)) > touching[-1], 1.0, share / 2.0)
            own[: touching[0]] = 0.0
            lengths[before] += cells @ (1.0 - own)
            lengths[after] += cells @ own
        return lengths

    def _at_rest(self, iterations: int) -> bool:
        return super()._at_rest(iterations) and not self.lacking

    def _holds_without(self, slid: Mapping[int, float]) -> bool:
        """Whether a loop keeps its pace, and its balance, without these pulleys; a belt between clamps does."""
        pulleys = self.task.scene.pulleys
        return not self.problem.closed or any(
            pulley.drive.kind in ("omega", "none") for i, pulley in enumerate(pulleys) if i not in slid
        )

    def _stop_beyond_capacity(self, lacking: Sequence[int]) -> None:
        """Stops where friction has lacked force on some pulleys for many updates.

        Raises:
            Stopped: It has.
        """
        self.lacking = self.lacking + 1 if lacking and self.penalty == self.penalties.full else 0
        if self.lacking == PATIENCE:
            text = "the belt slides all along pulley {}, and friction still lacks force"
            raise Stopped(Status.CAPACITY_EXCEEDED, text.format(" and ".join(map(str, lacking))))

    def _answer(self, state: DriveState) -> dict[str, Any]:
        table = self._gathered(state, self.problem.ends())
        return drive_reading.answer(
            self.task.scene,
            self.problem.track,
            DriveState(*table[:-2]),
            Multipliers(*table[-2:]),
            self.grips,
            self.rate,
        )
