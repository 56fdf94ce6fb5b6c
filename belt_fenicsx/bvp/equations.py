"""The ordinary differential equations of the belt in each kind of zone, with exact derivatives.

All zones are parametrised by the material-length coordinate sigma. Section 18.3 takes x in free spans and phi on the
pulley instead, which needs cos phi > 0; the equations are the same after multiplication by dx/dsigma and
dphi/dsigma. In a free span two of its six equations, those for D and psi in (18.20), say no more than that the force
Q is constant in global axes. They are integrated here: Q's components X, Y are unknown constants of the span, and

    x' = (1 + eps) cos th - Gamma sin th      th' = kappa
    y' = (1 + eps) sin th + Gamma cos th      a kappa' = -Q2 (1 + eps) + Q1 Gamma

with Q1 = b1 eps and Q2 = b2 Gamma the components of Q in the axes of the cross-section. On the pulley

    phi' = -D / R      th' = kappa      a kappa' = -D Qn(psi, D)

(18.21), with Q = Qt t + Qn n. There, equilibrium gives the tractions f = -Q'.t and p = -Q'.n. Stick has an unknown
constant D; sliding of sense s adds the equation Q'.t + s mu Q'.n = 0, solved for D'. It is (18.22) for s = -1, and
(18.22) with -mu in place of mu for the forward sliding that the source means.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from belt_fenicsx.layout.arrays import Array

TINY_STRAIN = 1e-6  # below which a span is as good as slack


@dataclass(frozen=True, kw_only=True)
class Rod:
    """Stiffnesses of the belt and the pulley under it, dimensionless."""

    a: float
    b1: float
    b2: float
    radius: float
    center: tuple[float, float]

    @property
    def shear_layer(self) -> float:
        """About the length over which shear dies out on the pulley."""
        return math.sqrt(self.a / self.b2)

    def bending_layer(self, tension: float) -> float:
        """Length over which bending dies out in a free span, not above that of a strain that is tiny."""
        return math.sqrt(self.a / max(tension, TINY_STRAIN * self.b1))


class ZoneEquations(Protocol):
    """What the boundary-value problem knows of a zone.

    Attributes:
        kind: ``"free"``, ``"stick"`` or ``"slip"``.
        unknowns: Number of unknown functions n.
        constants: Number of unknown constants k.
    """

    kind: ClassVar[str]
    unknowns: ClassVar[int]
    constants: ClassVar[int]

    def rate(self, rod: Rod, y: Array, c: Array) -> Array:
        """Derivatives of the unknowns ``(n, m)`` at ``y`` ``(n, m)``, constants ``c`` ``(k,)``."""

    def linearised(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        """The rate and its derivatives ``(n, n + k, m)`` with respect to unknowns and constants."""

    def state(self, rod: Rod, y: Array, c: Array) -> Array:
        """What is continuous along the belt: x, y, phi, theta, kappa, D ``(6, m)``."""

    def linearised_state(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        """The state and its derivatives ``(6, n + k, m)``."""

    def tractions(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        """Pressure p and friction f ``(m,)`` each."""


@dataclass(frozen=True)
class Free:
    """A free span: unknowns x, y, theta, kappa and constants X, Y."""

    kind: ClassVar[str] = "free"
    unknowns: ClassVar[int] = 4
    constants: ClassVar[int] = 2

    def rate(self, rod: Rod, y: Array, c: Array) -> Array:
        cos, sin = np.cos(y[2]), np.sin(y[2])
        Q1, Q2 = c[0] * cos + c[1] * sin, c[1] * cos - c[0] * sin
        along, Gamma = 1.0 + Q1 / rod.b1, Q2 / rod.b2
        return np.array([along * cos - Gamma * sin, along * sin + Gamma * cos, y[3], (Q1 * Gamma - Q2 * along) / rod.a])

    def linearised(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        rate, J = self.rate(rod, y, c), np.zeros((4, 6, *y.shape[1:]))
        cos, sin = np.cos(y[2]), np.sin(y[2])
        Q1, Q2 = c[0] * cos + c[1] * sin, c[1] * cos - c[0] * sin
        along, Gamma = 1.0 + Q1 / rod.b1, Q2 / rod.b2
        # Of theta, X and Y, each moves Q1 and Q2; theta turns the axes as well.
        for column, dQ1, dQ2 in ((2, Q2, -Q1), (4, cos, -sin), (5, sin, cos)):
            J[0, column] = dQ1 / rod.b1 * cos - dQ2 / rod.b2 * sin
            J[1, column] = dQ1 / rod.b1 * sin + dQ2 / rod.b2 * cos
            J[3, column] = (dQ1 * Gamma + Q1 * dQ2 / rod.b2 - dQ2 * along - Q2 * dQ1 / rod.b1) / rod.a
        J[0, 2] -= rate[1]
        J[1, 2] += rate[0]
        J[2, 3] = 1.0
        return rate, J

    def state(self, rod: Rod, y: Array, c: Array) -> Array:
        rx, ry = self.rate(rod, y, c)[:2]
        return np.array([y[0], y[1], np.arctan2(ry, rx), y[2], y[3], np.hypot(rx, ry)])

    def linearised_state(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        (rx, ry, *_), (dx, dy, *_) = self.linearised(rod, y, c)
        state, J = self.state(rod, y, c), np.zeros((6, 6, *y.shape[1:]))
        J[0, 0] = J[1, 1] = J[3, 2] = J[4, 3] = 1.0
        J[2] = (rx * dy - ry * dx) / state[5] ** 2
        J[5] = (rx * dx + ry * dy) / state[5]
        return state, J

    def tractions(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        return np.zeros(y.shape[1:]), np.zeros(y.shape[1:])


class Force(NamedTuple):
    """Force Q in the axes t, n as a function of psi and D, with its derivatives (18.5), (18.6)."""

    t: Array
    n: Array
    t_psi: Array
    n_psi: Array
    t_D: Array
    n_D: Array

    @classmethod
    def at(cls, rod: Rod, psi: Array, D: Array) -> Force:
        sin, cos, b = np.sin(psi), np.cos(psi), rod.b1 - rod.b2
        sin2, cos2 = 2.0 * sin * cos, cos**2 - sin**2
        return cls(
            t=rod.b2 * D + b * D * cos**2 - rod.b1 * cos,
            n=b * D * sin2 / 2.0 - rod.b1 * sin,
            t_psi=rod.b1 * sin - b * D * sin2,
            n_psi=b * D * cos2 - rod.b1 * cos,
            t_D=rod.b2 + b * cos**2,
            n_D=b * sin2 / 2.0,
        )

    def tractions(self, turn: Array, psi_rate: Array, D_rate: Array | float) -> tuple[Array, Array]:
        """Pressure and friction from equilibrium (18.17), ``turn`` being phi'."""
        p = -(self.n_psi * psi_rate + self.n_D * D_rate + turn * self.t)
        f = -(self.t_psi * psi_rate + self.t_D * D_rate - turn * self.n)
        return p, f


class OnPulley:
    """What stick and slip share; their first unknowns are phi, theta, kappa."""

    def state(self, rod: Rod, y: Array, c: Array) -> Array:
        (x, h), phi, D = rod.center, y[0], self.stretch(y, c)
        return np.array([x - rod.radius * np.sin(phi), h + rod.radius * np.cos(phi), phi, y[1], y[2], D])

    def linearised_state(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        J = np.zeros((6, 4, *y.shape[1:]))
        J[0, 0], J[1, 0] = -rod.radius * np.cos(y[0]), -rod.radius * np.sin(y[0])
        J[2, 0] = J[3, 1] = J[4, 2] = J[5, 3] = 1.0
        return self.state(rod, y, c), J

    def tractions(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        D, rate = self.stretch(y, c), self.rate(rod, y, c)
        force = Force.at(rod, y[1] - y[0], D)
        return force.tractions(rate[0], rate[1] - rate[0], rate[3] if rate.shape[0] > 3 else 0.0)

    def _bending(self, rod: Rod, y: Array, D: Array, force: Force, J: Array) -> None:
        """Derivatives of the rates of phi, theta and kappa with respect to phi, theta, kappa and D."""
        J[0, 3], J[1, 2] = -1.0 / rod.radius, 1.0
        J[2, 1] = -D * force.n_psi / rod.a
        J[2, 0] = -J[2, 1]
        J[2, 3] = -(force.n + D * force.n_D) / rod.a


@dataclass(frozen=True)
class Stick(OnPulley):
    """Stick: unknowns phi, theta, kappa and the constant D (18.15)."""

    kind: ClassVar[str] = "stick"
    unknowns: ClassVar[int] = 3
    constants: ClassVar[int] = 1

    def stretch(self, y: Array, c: Array) -> Array:
        return np.full(y.shape[1:], c[0])

    def rate(self, rod: Rod, y: Array, c: Array) -> Array:
        D, psi = self.stretch(y, c), y[1] - y[0]
        return np.array(
            [-D / rod.radius, y[2], D * np.sin(psi) * (rod.b1 - (rod.b1 - rod.b2) * D * np.cos(psi)) / rod.a]
        )

    def linearised(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        J, D = np.zeros((3, 4, *y.shape[1:])), self.stretch(y, c)
        self._bending(rod, y, D, Force.at(rod, y[1] - y[0], D), J)
        return self.rate(rod, y, c), J


@dataclass(frozen=True)
class Slip(OnPulley):
    """Sliding with f = -friction p: unknowns phi, theta, kappa, D. Backward sliding has a negative ``friction``."""

    friction: float

    kind: ClassVar[str] = "slip"
    unknowns: ClassVar[int] = 4
    constants: ClassVar[int] = 0

    def stretch(self, y: Array, c: Array) -> Array:
        return y[3]

    def tractions(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        p, _ = super().tractions(rod, y, c)
        return p, -self.friction * p

    def rate(self, rod: Rod, y: Array, c: Array) -> Array:
        return self._rate(rod, y, Force.at(rod, y[1] - y[0], y[3]))

    def _rate(self, rod: Rod, y: Array, force: Force) -> Array:
        # Without D', the tractions leave f + friction p = rest; each unit of D' takes `per_D` from it.
        D, turn = y[3], -y[3] / rod.radius
        p, f = force.tractions(turn, y[2] - turn, 0.0)
        per_D = force.t_D + self.friction * force.n_D
        return np.array([turn, y[2], -D * force.n / rod.a, (f + self.friction * p) / per_D])

    def linearised(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        mu, R, D, J = self.friction, rod.radius, y[3], np.zeros((4, 4, *y.shape[1:]))
        psi = y[1] - y[0]
        force = Force.at(rod, psi, D)
        rate = self._rate(rod, y, force)
        self._bending(rod, y, D, force, J)
        sin, cos, b = np.sin(psi), np.cos(psi), rod.b1 - rod.b2
        sin2, cos2 = 2.0 * sin * cos, cos**2 - sin**2
        t_psipsi, n_psipsi = rod.b1 * cos - 2.0 * b * D * cos2, rod.b1 * sin - 2.0 * b * D * sin2
        # g = g_psi psi' + g_D D' - h D / R vanishes, with g = Qt + mu Qn and h = mu Qt - Qn.
        psi_rate = y[2] + D / R
        g_psi, g_D = force.t_psi + mu * force.n_psi, force.t_D + mu * force.n_D
        g_psipsi, g_psiD = t_psipsi + mu * n_psipsi, b * (mu * cos2 - sin2)
        h, h_psi, h_D = mu * force.t - force.n, mu * force.t_psi - force.n_psi, mu * force.t_D - force.n_D
        J[3, 1] = -(g_psipsi * psi_rate + g_psiD * rate[3] - h_psi * D / R) / g_D
        J[3, 0] = -J[3, 1]
        J[3, 2] = -g_psi / g_D
        J[3, 3] = -(g_psiD * psi_rate + g_psi / R - (h + h_D * D) / R) / g_D
        return rate, J
