"""The ordinary differential equations of the belt in each kind of zone.

All zones are parametrised by the material-length coordinate sigma. Section 18.3 takes x in free spans and phi on the
pulley instead, which needs cos phi > 0; the equations are the same after multiplication by dx/dsigma and
dphi/dsigma. With psi = th - phi, the force's components Q1 and Q2 in the axes of the cross-section, and the belt's
tangent t and normal n,

    Q1 = b1 eps               Q2 = b2 Gamma                                   (18.5)
    1 + eps = D cos psi       Gamma = -D sin psi                              (18.6)
    Q' + f t + p n = 0        a kappa' + Q2 (1 + eps) - Q1 Gamma = 0          (18.17)

In a free span, two of its six equations, those for D and psi in (18.20), say no more than that the force Q is constant
in global axes. They are integrated here: Q's components X, Y are unknown constants of the span, and

    x' = (1 + eps) cos th - Gamma sin th      th' = kappa
    y' = (1 + eps) sin th + Gamma cos th

On the pulley phi' = -D / R and th' = kappa (18.21), and the balance of forces gives the tractions p and f. Stick has an
unknown constant D. Sliding of sense s adds the equation f + s mu p = 0, which is linear in D' and solved for it. It is
(18.22) for s = -1, and (18.22) with -mu in place of mu for the forward sliding that the source means.

No equation is linearised by hand: `problem.linearised` takes derivatives by a complex step. So rates and states are
analytic functions, without abs, hypot, arctan2 or bounds, of arrays with any number of further axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol

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

    def bending_rate(self, eps: Array, Gamma: Array) -> Array:
        """kappa' by the balance of moments (18.17)."""
        Q1, Q2 = self.b1 * eps, self.b2 * Gamma
        return (Q1 * Gamma - Q2 * (1.0 + eps)) / self.a

    def force(self, psi: Array, D: Array) -> tuple[Array, Array]:
        """Q.t and Q.n (18.5), (18.6)."""
        cos, sin = np.cos(psi), np.sin(psi)
        Q1, Q2 = self.b1 * (D * cos - 1.0), -self.b2 * D * sin
        return Q1 * cos - Q2 * sin, Q1 * sin + Q2 * cos

    def force_rate(self, psi: Array, D: Array, rates: tuple[Array | float, ...]) -> tuple[Array, Array]:
        """Q'.t and Q'.n, linear in the rates of phi, theta and D."""
        phi_rate, kappa, D_rate = rates
        cos, sin, psi_rate = np.cos(psi), np.sin(psi), kappa - phi_rate
        Q1, Q2 = self.b1 * (D * cos - 1.0), -self.b2 * D * sin
        Q1_rate, Q2_rate = self.b1 * (D_rate * cos - D * sin * psi_rate), -self.b2 * (D_rate * sin + D * cos * psi_rate)
        # The axes of the cross-section turn by kappa.
        along, across = Q1_rate - kappa * Q2, Q2_rate + kappa * Q1
        return along * cos - across * sin, along * sin + across * cos


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
        """Derivatives of the unknowns ``(n, ...)`` at ``y`` ``(n, ...)``, constants ``c`` ``(k,)`` or ``(k, ...)``."""

    def state(self, rod: Rod, y: Array, c: Array) -> Array:
        """What is continuous along the belt: x, y, phi, theta, kappa, D ``(6, ...)``."""

    def tractions(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        """Pressure p and friction f ``(...)`` each."""


@dataclass(frozen=True)
class Free:
    """A free span: unknowns x, y, theta, kappa and constants X, Y."""

    kind: ClassVar[str] = "free"
    unknowns: ClassVar[int] = 4
    constants: ClassVar[int] = 2

    def rate(self, rod: Rod, y: Array, c: Array) -> Array:
        cos, sin, eps, Gamma = self._strained(rod, y[2], c)
        return np.array(
            [(1.0 + eps) * cos - Gamma * sin, (1.0 + eps) * sin + Gamma * cos, y[3], rod.bending_rate(eps, Gamma)]
        )

    def state(self, rod: Rod, y: Array, c: Array) -> Array:
        _, _, eps, Gamma = self._strained(rod, y[2], c)
        psi, D = -np.arctan(Gamma / (1.0 + eps)), np.sqrt((1.0 + eps) ** 2 + Gamma**2)
        return np.array([y[0], y[1], y[2] - psi, y[2], y[3], D])

    def tractions(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        return np.zeros(y.shape[1:]), np.zeros(y.shape[1:])

    @staticmethod
    def _strained(rod: Rod, theta: Array, c: Array) -> tuple[Array, Array, Array, Array]:
        """cos theta, sin theta and the strains eps, Gamma under the force X, Y."""
        cos, sin = np.cos(theta), np.sin(theta)
        return cos, sin, (c[0] * cos + c[1] * sin) / rod.b1, (c[1] * cos - c[0] * sin) / rod.b2


class OnPulley:
    """What stick and slip share: their unknowns are phi, theta, kappa, D, the last of them a constant in stick."""

    def stretch(self, y: Array, c: Array) -> Array:
        """The stretch D ``(...)``."""
        return (*y, *c)[3] + np.zeros(y.shape[1:])

    def rate(self, rod: Rod, y: Array, c: Array) -> Array:
        psi, D = y[1] - y[0], self.stretch(y, c)
        return np.array([-D / rod.radius, y[2], rod.bending_rate(D * np.cos(psi) - 1.0, -D * np.sin(psi))])

    def state(self, rod: Rod, y: Array, c: Array) -> Array:
        (x, h), phi, D = rod.center, y[0], self.stretch(y, c)
        return np.array([x - rod.radius * np.sin(phi), h + rod.radius * np.cos(phi), phi, y[1], y[2], D])

    def tractions(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        phi_rate, kappa, _, D_rate = *self.rate(rod, y, c), *np.zeros_like(c)
        along, across = rod.force_rate(y[1] - y[0], self.stretch(y, c), (phi_rate, kappa, D_rate))
        return -across, -along


@dataclass(frozen=True)
class Stick(OnPulley):
    """Stick: unknowns phi, theta, kappa and the constant D (18.15)."""

    kind: ClassVar[str] = "stick"
    unknowns: ClassVar[int] = 3
    constants: ClassVar[int] = 1


@dataclass(frozen=True)
class Slip(OnPulley):
    """Sliding with f = -friction p: unknowns phi, theta, kappa, D. Backward sliding has a negative ``friction``."""

    friction: float

    kind: ClassVar[str] = "slip"
    unknowns: ClassVar[int] = 4
    constants: ClassVar[int] = 0

    def rate(self, rod: Rod, y: Array, c: Array) -> Array:
        phi_rate, kappa, kappa_rate = super().rate(rod, y, c)
        # Q'.t + friction Q'.n vanishes: what there is of it without D', and what each unit of D' adds.
        along, across = rod.force_rate(y[1] - y[0], y[3], (phi_rate, kappa, 0.0))
        along_D, across_D = rod.force_rate(y[1] - y[0], y[3], (0.0, 0.0, 1.0))
        D_rate = -(along + self.friction * across) / (along_D + self.friction * across_D)
        return np.array([phi_rate, kappa, kappa_rate, D_rate])

    def tractions(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        p, _ = super().tractions(rod, y, c)
        return p, -self.friction * p
