"""Forces in a string on a path that is known: one equation for one of them, whatever the number of pulleys.

Against the direction of travel, what drives a pulley gives the force before it from the one behind it:

    torque        F_up = F_off - torque / (R + e)
    slip angle    F_up = F_off exp(-+mu angle)
    speed         c D(F_up) = omega (R + e)

and friction keeps it between F_off exp(-mu wrap) and F_off exp(mu wrap), where the belt slides all along the pulley.
So one force X gives all others: in a loop, the one before a pulley whose speed then gives the transport rate, or before
the one that nothing drives; between clamps, the one in the last span. All forces grow with X, and the material length
on the path falls: the belt fits with one X, or it is slack.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from belt_fenicsx.layout.layers import LEAST_STRAIN
from belt_fenicsx.scene.path import Arc, Path
from belt_fenicsx.scene.pulley import RUN_OFF, RUN_UP, Pulley
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status

STEP = 1e-30j  # of the derivative.
ITERATIONS = 100  # of Newton and bisection, at most.
ROUNDING = 1e-14  # A step that is no larger ends them, as they converge quadratically, in parts of b1.
NEAR = 1e-6  # The same for steps that no longer become smaller.
LARGEST = 600.0  # Of the logarithm of the force along a contact, within the range of a float.
MOST_GROWTH = 25.0  # The same of a belt that is not slack; beyond it, one force is rounding to the other one.


@dataclass(frozen=True, kw_only=True)
class Forces:
    """Forces in a string.

    Attributes:
        up: Force F at the run-up of each pulley.
        off: Force F at the run-off of each.
        spans: Force F in each span.
        rate: Transport rate c.
    """

    up: tuple[float, ...]
    off: tuple[float, ...]
    spans: tuple[float, ...]
    rate: float


class Chain:
    """The pulleys of a dimensionless scene, as each gives one force from the next.

    Args:
        scene: The scene.
        path: The path.
        first: In a loop, the pulley before which the force is X.
    """

    def __init__(self, scene: Scene, path: Path, first: int) -> None:
        self.scene, self.path, self.first = scene, path, first
        self.density, self.b1 = scene.belt.line_density, scene.belt.extensional_stiffness
        count = len(scene.pulleys)
        # In a loop, a span has the number of the pulley before it; between clamps, of the one behind it.
        shift = 0 if scene.closed else 1
        self.before = [(i - 1 + shift) % (count + shift) for i in range(count)]
        self.after = [i + shift for i in range(count)]
        self.backward = [(first - i) % count for i in range(1, count)] if scene.closed else list(reversed(range(count)))
        self.rows = list(zip(scene.pulleys, path.arcs, map(friction, scene.pulleys, path.arcs), strict=True))

    def solved(self, *, slack: bool = False) -> Forces:
        """The forces with which the belt fits.

        Args:
            slack: Whether a belt that is longer than its path has those of a small strain all the same.

        Raises:
            Stopped: The belt is slack.
        """
        wanted, low, high, step = self.scene.belt.length, 0.0, math.inf, math.inf
        _, rate = self._given(0.0)
        taut = self.path.length * (self.b1 - self.density * rate**2) / self.b1
        if taut <= wanted and slack:
            return self._forces(LEAST_STRAIN * self.b1)
        if taut <= wanted:
            at_rest = "" if self.path.length <= wanted else ", as fast as it runs"
            longer = 100.0 * (1.0 - taut / wanted)
            message = f"The belt is slack{at_rest}: it is longer than its path by {longer:.3g} % of its length."
            raise Stopped(Status.CONTACT_LOST, message, final=True)
        X = max(self.b1 * (taut / wanted - 1.0), LEAST_STRAIN * self.b1)
        for _ in range(ITERATIONS):
            length = self._length(*self._given(X + STEP))
            if length.real > wanted:
                low = X
            else:
                high = X
            # Newton's iteration for the reciprocal of the length, which is nearly linear in the forces.
            nearer = X - (length.real - wanted) * length.real / wanted * STEP.imag / length.imag
            if not low <= nearer <= high:
                nearer = 2.0 * low if math.isinf(high) else (low + high) / 2.0
            before, step, X = step, abs(nearer - X), nearer
            # With little friction, rounding of the length moves the force to and fro.
            if step <= ROUNDING * (self.b1 + X) or before <= step <= NEAR * (self.b1 + X):
                break
        else:
            raise Stopped(Status.NEWTON_DIVERGED, "The string's forces were not found.", final=True)
        return self._forces(X)

    def _forces(self, X: float) -> Forces:
        """All forces from that one."""
        spans, rate = self._given(X)
        return Forces(
            up=tuple(spans[i] for i in self.before),
            off=tuple(spans[i] for i in self.after),
            spans=tuple(spans),
            rate=rate,
        )

    def _given(self, X: Any) -> tuple[list[Any], Any]:
        """Forces in all spans, and the transport rate, from the force before the first pulley or in the last span."""
        rate = self.scene.transport_rate or self._rate(X)
        spans = [X] * len(self.path.lines)
        for i in self.backward:
            spans[self.before[i]] = self._before(i, spans[self.after[i]], rate)
        return spans, rate

    def _rate(self, X: Any) -> Any:
        """Transport rate with which a belt of this force has the speed of the first pulley: c D = omega (R + e)."""
        pulley, arc, _ = self.rows[self.first]
        speed, grown = pulley.drive.by("omega") * arc.radius, X + self.b1
        return 2.0 * speed * self.b1 / (grown + (grown**2 + 4.0 * self.density * self.b1 * speed**2) ** 0.5)

    def _before(self, index: int, F: Any, rate: Any) -> Any:
        """Force before a pulley, from the one behind it."""
        pulley, arc, mu = self.rows[index]
        if mu == 0.0:
            return F
        if pulley.drive.kind == "omega":
            up = pulley.drive.by("omega") * arc.radius / rate * (self.b1 - self.density * rate**2) - self.b1
        elif pulley.drive.kind == "torque":
            # The drag is that of the speed at the run-up, which is linear in the force there.
            drag = pulley.drive.drag * rate / (arc.radius**2 * (self.b1 - self.density * rate**2))
            up = (F - pulley.drive.by("torque") / arc.radius - drag * self.b1) / (1.0 + drag)
        else:
            sense = -1.0 if pulley.drive.slip == "backward" else 1.0
            grown = mu * slip_angle(pulley, arc)
            if grown > MOST_GROWTH:
                message = (
                    f"Sliding along {grown / mu:.3g} rad of pulley {index} changes the force by a factor of "
                    f"exp({grown:.3g}): the belt is slack at one end of the contact. Let it slide along less of it."
                )
                raise Stopped(Status.CONTACT_LOST, message, final=True)
            return F * math.exp(-sense * grown)
        most = math.exp(min(mu * arc.wrap, LARGEST))
        if up.real * most < F.real:
            return F / most
        return F * most if up.real > F.real * most else up

    def _length(self, spans: Sequence[complex], rate: complex) -> complex:
        """Material length of the belt on the path."""
        b1, shifted = self.b1, self.b1 - self.density * rate**2
        total: complex = sum(line.length / (b1 + F) for line, F in zip(self.path.lines, spans, strict=True))
        for (_, arc, mu), before, after in zip(self.rows, self.before, self.after, strict=True):
            up, off = spans[before], spans[after]
            grown = cmath.log(off / up) if mu and off != up else 0.0
            # Sliding along more than the wrap is left to who asks; until then, friction is as large as it has to be.
            mu = max(mu, abs(grown.real) / arc.wrap)
            sense = 1.0 if grown.real > 0.0 else -1.0
            total += arc.radius * arc.wrap / (b1 + up)
            if grown:
                slid = sense * (grown - cmath.log((b1 + off) / (b1 + up))) / b1 - sense * grown / (b1 + up)
                total += arc.radius * slid / mu
        return total * shifted


def friction(pulley: Pulley, arc: Arc) -> float:
    """By how much the logarithm of F grows for each angle: friction acts on the radius of the touching fibre."""
    return pulley.friction * pulley.radius / arc.radius


def slip_angle(pulley: Pulley, arc: Arc) -> float:
    """The angle of sliding that a pulley is given, by itself or by a place."""
    if pulley.slip_angle is not None:
        return min(pulley.slip_angle, arc.wrap)
    if isinstance(pulley.x_trans, str):
        return {RUN_OFF: 0.0, RUN_UP: arc.wrap}[pulley.x_trans]
    assert pulley.x_trans is not None, "a pulley that is driven by a place"
    # Between two verticals, a place is passed once.
    turned = round((arc.start + arc.end) / (2.0 * math.pi))
    ratio = min(max(-arc.turn * (pulley.x_trans - arc.center[0]) / pulley.radius, -1.0), 1.0)
    phi = math.pi * turned + (-1.0) ** turned * math.asin(ratio)
    return min(max(arc.turn * (phi - arc.end), 0.0), arc.wrap)
