"""The taut string: straight spans tangent to the pulley and an arc on it. A first guess for every method.

A string knows neither bending nor shear, so its shape is in closed form, and its strain follows from the belt's length
and the friction law of Euler and Eytelwein: equal along stick, growing by exp(mu angle) along forward sliding.

Adding the belt's bending layers to it makes a guess that looks better and is worse: forces and shape of the string
agree with each other, those of the embellished string do not, and Newton's iteration fails more often.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from belt_fenicsx.layout.arrays import Array, vectors
from belt_fenicsx.layout.layers import LEAST_STRAIN
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene

TINY = 1e-300  # angle of a straight line, whose sine over itself is still one
MOST_GROWTH = 25.0  # of the logarithm of the tension along a contact; the smaller one is rounding to the larger one
PIECES = np.linspace(0.0, 1.0, 33)  # of the arc behind the transition


@dataclass(frozen=True, kw_only=True)
class TautString:
    """A string over one pulley, in the units of its scene.

    It is a chain of pieces of constant stretch and curvature: two straight spans, and the arc between them.

    Attributes:
        joints: Run-up, transition and run-off in the material-length coordinate ``(3,)`` [m].
        angles: Angles of the tangent at these joints ``(3,)`` [rad].
        x: Global coordinates of these joints ``(3,)`` [m].
        strain: Strains of the spans before and after the pulley, at least that of a slack belt ``(2,)`` [-].
        sigma: Ends of the pieces ``(n + 1,)`` [m].
        r_ends: Positions of these ends ``(n + 1, 2)`` [m].
        phi_ends: Angles of the tangent there ``(n + 1,)`` [rad].
        stretches: Stretch of each piece ``(n,)`` [-].
        growth: Logarithm of the factor by which sliding behind the transition changes the tension [-].
    """

    joints: Array
    angles: Array
    x: Array
    strain: Array
    sigma: Array
    r_ends: Array
    phi_ends: Array
    stretches: Array
    growth: float

    @property
    def slack(self) -> str:
        """Why no belt can slide as far as this string; empty where one can."""
        if self.growth <= MOST_GROWTH:
            return ""
        return (
            f"Sliding along {self.angles[1] - self.angles[2]:.3g} rad changes the tension by a factor of "
            f"exp({self.growth:.3g}): the belt is slack at one end of the contact. Let it slide along less of it."
        )

    def D(self, sigma: Array) -> Array:
        """Stretch at ``sigma`` ``(m,)`` [-]."""
        return self.stretches[self._piece(sigma)]

    def phi(self, sigma: Array) -> Array:
        """Angle of the tangent at ``sigma`` ``(m,)`` [rad]."""
        return np.interp(sigma, self.sigma, self.phi_ends)

    def r(self, sigma: Array) -> Array:
        """Position at ``sigma``, ``(m, 2)`` for ``(m,)`` [m]."""
        piece = self._piece(sigma)
        length = self.stretches[piece] * (sigma - self.sigma[piece])
        return self.r_ends[piece] + vectors(_chord(length, self.phi_ends[piece], self.phi(sigma)))

    def _piece(self, sigma: Array) -> Array:
        return np.minimum(self.sigma[1:].searchsorted(sigma, side="right"), self.stretches.size - 1)


def taut_string(scene: Scene, contact: tuple[float, float] | None = None) -> TautString | None:
    """The string over the pulley of a scene.

    A transition outside of the string's contact is moved into it. In pure stick the string's transition is its
    run-off, in pure slip its run-up; a given speed or torque leaves it in the middle.

    Args:
        scene: The scene.
        contact: Angles of the tangent at the run-up and at the run-off [rad]; by default, those of straight spans.
            With others, the spans are arcs.

    Returns:
        The string, or None where it is straight and clear of the pulley.
    """
    (pulley,), half = scene.pulleys, scene.belt.length / 2
    across = [scene.span / 2 + pulley.center[0], scene.span / 2 - pulley.center[0]]
    up, off = contact or (_tangent(pulley, across[0]), -_tangent(pulley, across[1]))
    if up <= off:
        return None
    (start, before), (end, after) = _span(pulley, across[0], up), _span(pulley, across[1], -off)
    trans = _transition(pulley, up, off)
    turned = (trans - off) * PIECES
    phi_ends = np.concatenate([[start, up], trans - turned, [-end]])
    lengths = (phi_ends[:-1] - phi_ends[1:]) * pulley.radius
    lengths[0], lengths[-1] = before, after
    slid = np.concatenate([[0.0, 0.0], (turned[1:] + turned[:-1]) / 2, turned[-1:]])
    power = pulley.friction * slid
    growth = np.exp((-1.0 if pulley.slip == "backward" else 1.0) * np.minimum(power, 2.0 * MOST_GROWTH))
    strain = _strain(lengths, growth, scene.belt.length)
    stretches = 1.0 + strain * growth
    # A slack belt fills its path with a stretch below one.
    stretches *= (lengths / stretches).sum() / scene.belt.length
    sigma = _sums(lengths / stretches) - half
    sigma[-1] = half
    angles = np.array([up, trans, off])
    return TautString(
        joints=sigma[[1, 2, -2]],
        angles=angles,
        x=pulley.center[0] - pulley.radius * np.sin(angles),
        strain=strain * growth[[0, -1]],
        sigma=sigma,
        r_ends=vectors(_sums(_chord(lengths, phi_ends[:-1], phi_ends[1:])) - scene.span / 2),
        phi_ends=phi_ends,
        stretches=stretches,
        growth=float(power.max()),
    )


def _sums(parts: Array) -> Array:
    """Sums of no part, of the first one, of the first two and so on, ``(n + 1,)`` for ``(n,)``."""
    sums = np.zeros(parts.size + 1, dtype=parts.dtype)
    parts.cumsum(out=sums[1:])
    return sums


def _tangent(pulley: Pulley, across: float) -> float:
    """Angle of the tangent to the pulley from a clamp, ``across`` from the centre."""
    return math.atan2(pulley.center[1], across) + math.asin(pulley.radius / math.hypot(across, pulley.center[1]))


def _span(pulley: Pulley, across: float, angle: float) -> tuple[float, float]:
    """Angle at the clamp and length of the arc from there to the pulley, where it has the angle of its tangent."""
    x, y = across - pulley.radius * math.sin(angle), pulley.center[1] + pulley.radius * math.cos(angle)
    start = 2.0 * math.atan2(y, x) - angle
    half = (angle - start) / 2 + TINY
    return start, math.hypot(x, y) * half / math.sin(half)


def _transition(pulley: Pulley, up: float, off: float) -> float:
    """Angle of the tangent at the transition, inside of the contact."""
    if pulley.x_trans is None:
        return (up + off) / 2
    if isinstance(pulley.x_trans, str):
        return up if pulley.x_trans == "run-up" else off
    margin = 0.05 * (up - off)
    angle = -math.asin((pulley.x_trans - pulley.center[0]) / pulley.radius)
    return min(max(angle, off + margin), up - margin)


def _strain(lengths: Array, growth: Array, length: float) -> float:
    """Strain of the first piece, with which the pieces have this length in all when they are not stretched."""
    strain, weighted = LEAST_STRAIN / float(growth.min()), lengths * growth
    # The reciprocal of the length is an increasing, concave function of the strain, and nearly linear: Newton's
    # iteration is monotonous from below, and takes two or three steps.
    while True:
        shares = 1.0 / (1.0 + strain * growth)
        total = float(lengths @ shares)
        step = (total - length) * (total / length) / float(weighted @ (shares * shares))
        if not step > 1e-12 * strain:
            return strain
        strain += step


def _chord(length: Array, start: Array, end: Array) -> Array:
    """Ways from end to end of arcs, from their lengths and their tangents' angles, in the complex plane ``(m,)``."""
    half = (end - start) / 2 + TINY
    return length * (np.sin(half) / half) * np.exp(0.5j * (start + end))
