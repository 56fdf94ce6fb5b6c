"""The ordinary differential equations of the belt: in a free span, and on a pulley.

All parts are parametrised by the material-length coordinate sigma. Section 18.3 takes x in free spans and phi on the
pulley instead, which needs cos phi > 0; the equations are the same after multiplication by dx/dsigma and
dphi/dsigma. With c^2 times the belt's inertia shifted into force and moment,

    N = Q - rho A c^2 r'          M* = (a - rho I c^2) kappa
    N' + f t + s p n + rho A g = 0        M*' + r' x N + d q1 = 0             (18.17), with inertia and gravity

where s = +1 for a pulley on the right of the belt and -1 for one on its left, d = s e is the distance of the middle
line from the touching fibre, and q1 = f cos psi + s p sin psi is what that fibre gets along the cross-section's first
axis.

In a free span N changes by the weight alone. On a pulley it is the touching fibre that runs on the circle: phi and D
are the angle of its tangent and its stretch, phi' = -s D / R, and with psi = theta - phi

    eps = D cos psi - 1 - d kappa         Gamma = -D sin psi                  (18.6), with the offset d

so that the balance of forces gives the tractions p and f. Stick keeps D. Sliding adds the equation f + m p = 0 with
m = mu forward and -mu backward, which is linear in D' and solved for it. It is (18.22) for backward sliding, and
(18.22) with -mu in place of mu for the forward sliding that the source means.

No equation is linearised by hand: `linearised` takes derivatives by a complex step. So rates and states are analytic
functions, without abs, hypot, arctan2 or bounds, of arrays ``(n, ..., parts, points)``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from belt_fenicsx.layout.arrays import Array

TINY_STRAIN = 1e-6  # A span of a smaller strain is as good as slack.
STEP = 1e-30  # Imaginary step of derivatives; its square is far below rounding.


def linearised(function: Callable[[Array], Array], z: Array) -> tuple[Array, Array]:
    """Values and derivatives of an analytic function by a complex step, exact but for rounding.

    They are Re f(z + i h) and Im f(z + i h) / h; all directions are one more axis of a single call.

    Args:
        function: Gives ``(r, ...)`` for arguments ``(n, ...)``.
        z: Where ``(n, ...)``.

    Returns:
        Values ``(r, ...)`` and derivatives ``(r, n, ...)``.
    """
    steps = 1j * STEP * np.eye(len(z)).reshape(len(z), len(z), *(1 for _ in z.shape[1:]))
    values = function(z[:, None] + steps)
    return values[:, 0].real, values.imag / STEP


@dataclass(frozen=True, kw_only=True)
class Rod:
    """The belt: stiffnesses, inertia, its weight per material length, and the offset of its touching fibre."""

    a: float
    b1: float
    b2: float
    density: float = 0.0
    inertia: float = 0.0
    weight: tuple[float, float] = (0.0, 0.0)
    offset: float = 0.0

    @property
    def shear_layer(self) -> float:
        """About the length over which shear dies out on a pulley."""
        return math.sqrt(self.a / self.b2)

    def bending_layer(self, tension: float) -> float:
        """Length over which bending dies out in a free span, not above that of a strain that is tiny."""
        return math.sqrt(self.a / max(tension, TINY_STRAIN * self.b1))

    def shifted(self, c: Array) -> tuple[Array, Array, Array, Array]:
        """The belt's stiffnesses a, b1, b2 and its strainless force, all shifted by inertia at transport rate ``c``."""
        G = self.density * c * c
        return self.a - self.inertia * c * c, self.b1 - G, self.b2 - G, -G


class Free:
    """Free spans: unknowns x, y, theta, kappa and the components X, Y of N."""

    size = 6
    bending = 3  # Index of kappa.

    def rate(self, rod: Rod, y: Array, c: Array) -> Array:
        """Derivatives of the unknowns ``(6, ...)``."""
        _, _, theta, kappa, X, Y = y
        a, _, _, _ = rod.shifted(c)
        cos, sin = np.cos(theta), np.sin(theta)
        eps, Gamma, N1, N2 = self._strained(rod, y, c)
        weight = np.zeros_like(X)
        return np.array(
            [
                (1.0 + eps) * cos - Gamma * sin,
                (1.0 + eps) * sin + Gamma * cos,
                kappa,
                (Gamma * N1 - (1.0 + eps) * N2) / a,
                weight - rod.weight[0],
                weight - rod.weight[1],
            ]
        )

    def joined(self, rod: Rod, y: Array, c: Array) -> Array:
        """What is continuous along the belt: x, y, theta, kappa, X, Y ``(6, ...)``."""
        return y

    def fields(self, rod: Rod, y: Array, c: Array) -> Array:
        """x, y, phi, theta, kappa, D - 1, p, f ``(8, ...)``."""
        eps, Gamma, _, _ = self._strained(rod, y, c)
        psi, D, none = -np.arctan(Gamma / (1.0 + eps)), np.sqrt((1.0 + eps) ** 2 + Gamma**2), np.zeros_like(eps)
        return np.array([y[0], y[1], y[2] - psi, y[2], y[3], D - 1.0, none, none])

    @staticmethod
    def _strained(rod: Rod, y: Array, c: Array) -> tuple[Array, Array, Array, Array]:
        """Strains eps, Gamma, and the force N in the axes of the cross-section."""
        _, _, theta, _, X, Y = y
        _, b1, b2, strainless = rod.shifted(c)
        cos, sin = np.cos(theta), np.sin(theta)
        N1, N2 = X * cos + Y * sin, Y * cos - X * sin
        return (N1 - strainless) / b1, N2 / b2, N1, N2


@dataclass(frozen=True)
class OnPulleys:
    """Parts on pulleys: unknowns phi, psi, kappa, the strain D - 1 of the touching fibre, and the integral of friction
    f.

    Attributes:
        radius: Radii of their pulleys ``(parts, 1)``.
        center: Centres ``(2, parts, 1)``.
        turn: The signs s ``(parts, 1)``.
        slope: Friction is ``-slope`` times the pressure where the belt slides ``(parts, 1)``.
        slides: One where it slides, zero where it sticks ``(parts, 1)``.
    """

    radius: Array
    center: Array
    turn: Array
    slope: Array
    slides: Array

    size = 5
    bending = 2

    def of(self, part: int) -> Self:
        """One of the parts alone."""
        own = {f.name: getattr(self, f.name)[..., part : part + 1, :] for f in fields(self)}
        return replace(self, **own)

    def rate(self, rod: Rod, y: Array, c: Array) -> Array:
        """Derivatives of the unknowns ``(5, ...)``."""
        return self._balanced(rod, y, c)[:5]

    def tractions(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        """Pressure p and friction f ``(...)`` each."""
        *_, f, p = self._balanced(rod, y, c)
        return p, np.where(self.slides > 0.0, -self.slope * p, f)

    def onset(self, rod: Rod, y: Array, c: Array, slope: Array) -> Array:
        """Rate of D in sliding with a friction of ``-slope`` times the pressure ``(...)``.

        It is zero where sliding passes into stick with continuous friction.
        """
        return self._sliding(rod, y, c, slope)[0]

    def _balanced(self, rod: Rod, y: Array, c: Array) -> Array:
        """Derivatives of the unknowns, the last of which is friction, and the pressure ``(6, ...)``."""
        stretch_rate, kept, gained = self._sliding(rod, y, c, self.slope)
        return kept + self.slides * stretch_rate * gained

    def _sliding(self, rod: Rod, y: Array, c: Array, slope: Array) -> tuple[Array, Array, Array]:
        """The rate of D with which f + slope p vanishes; all rates with D kept, and what each unit of its rate adds."""
        none = np.zeros_like(y[0])
        kept = self._rates(rod, y, c, none)
        gained = self._rates(rod, y, c, none + 1.0) - kept
        return -(kept[4] + slope * kept[5]) / (gained[4] + slope * gained[5]), kept, gained

    def keeping(self, rod: Rod, y: Array, c: Array) -> Array:
        """Friction that would keep the stretch ``(...)``."""
        return self._rates(rod, y, c, np.zeros_like(y[0]))[4]

    def joined(self, rod: Rod, y: Array, c: Array) -> Array:
        """What is continuous along the belt: x, y, theta, kappa, X, Y ``(6, ...)``."""
        phi, psi, kappa, _, _ = y
        (xc, yc), reach, d, theta = self.center, self.turn * self.radius, self.turn * rod.offset, phi + psi
        cos, sin = np.cos(theta), np.sin(theta)
        N1, N2 = self._force(rod, y, c)[2:]
        return np.array(
            [
                xc - reach * np.sin(phi) - d * sin,
                yc + reach * np.cos(phi) + d * cos,
                theta,
                kappa,
                N1 * cos - N2 * sin,
                N1 * sin + N2 * cos,
            ]
        )

    def fields(self, rod: Rod, y: Array, c: Array) -> Array:
        """x, y, phi, theta, kappa, D - 1, p, f ``(8, ...)``; phi and D are those of the touching fibre."""
        x, height, theta, kappa, _, _ = self.joined(rod, y, c)
        return np.array([x, height, y[0], theta, kappa, y[3], *self.tractions(rod, y, c)])

    def _force(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array, Array, Array]:
        """Strains eps, Gamma, and the force N in the axes of the cross-section."""
        _, psi, kappa, strain, _ = y
        d = self.turn * rod.offset
        _, b1, b2, strainless = rod.shifted(c)
        # The same as D cos psi - 1, without the difference of numbers near one.
        eps = strain * np.cos(psi) - 2.0 * np.sin(psi / 2.0) ** 2 - d * kappa
        Gamma = -(1.0 + strain) * np.sin(psi)
        return eps, Gamma, b1 * eps + strainless, b2 * Gamma

    def _rates(self, rod: Rod, y: Array, c: Array, stretch_rate: Array) -> Array:
        """Derivatives of the unknowns, the last of which is friction, and the pressure, with a given rate of D."""
        phi, psi, kappa, strain, _ = y
        a, b1, b2, _ = rod.shifted(c)
        d, D, theta = self.turn * rod.offset, 1.0 + strain, phi + psi
        eps, Gamma, N1, N2 = self._force(rod, y, c)
        cos, sin = np.cos(psi), np.sin(psi)
        phi_rate = -self.turn * D / self.radius
        psi_rate = kappa - phi_rate
        w1 = rod.weight[0] * np.cos(theta) + rod.weight[1] * np.sin(theta)
        w2 = rod.weight[1] * np.cos(theta) - rod.weight[0] * np.sin(theta)
        # The rate of eps but for the part of bending, which the moment of friction about the middle line holds, too.
        eps_rate = stretch_rate * cos - D * sin * psi_rate
        kappa_rate = (Gamma * N1 - (1.0 + eps) * N2 + d * (b1 * eps_rate - kappa * N2 + w1)) / (a + b1 * d * d)
        # N' + rho A g in the axes of the cross-section, which turn by kappa, and then along and across the fibre.
        q1 = b1 * (eps_rate - d * kappa_rate) - kappa * N2 + w1
        q2 = kappa * N1 - b2 * (stretch_rate * sin + D * cos * psi_rate) + w2
        f, p = q2 * sin - q1 * cos, -self.turn * (q1 * sin + q2 * cos)
        return np.array([phi_rate, psi_rate, kappa_rate, stretch_rate + 0.0 * phi, f, p])


@dataclass(frozen=True)
class Creeping(OnPulleys):
    """Parts on pulleys with friction that grows with the speed of sliding, f = -mu p g,
    g = tanh((D - S) / width) + viscosity (D - S).

    S is the stretch that goes with the surface of the pulley; S - 1 is one more unknown, a constant. Where the friction
    is nearly all of mu p, the belt slides; elsewhere it sticks, but for some creep. So there are no parts to be told
    before. With a viscosity, each torque has its speed.

    Attributes:
        friction: mu ``(parts, 1)``.
        width: Difference of stretches at which friction is large ``(parts, 1)``.
        viscosity: What friction grows by where it is large ``(parts, 1)``.
    """

    friction: Array
    width: Array
    viscosity: Array

    size = 6

    def friction_ratio(self, ahead: Array) -> Array:
        """Part of mu p that friction is where the belt is ``ahead`` of the pulley, D - S ``(...)``."""
        return np.tanh(ahead / self.width) + self.viscosity * ahead

    def rate(self, rod: Rod, y: Array, c: Array) -> Array:
        """Derivatives of the unknowns ``(6, ...)``."""
        stretch_rate, kept, gained = self._sliding(rod, y[:5], c, self.friction * self.friction_ratio(y[3] - y[5]))
        return np.concatenate([(kept + stretch_rate * gained)[:5], np.zeros_like(y[:1])])

    def tractions(self, rod: Rod, y: Array, c: Array) -> tuple[Array, Array]:
        """Pressure p and friction f ``(...)`` each."""
        slope = self.friction * self.friction_ratio(y[3] - y[5])
        p = self.pressure(rod, y, c)
        return p, -slope * p

    def pressure(self, rod: Rod, y: Array, c: Array) -> Array:
        """Pressure ``(...)``."""
        stretch_rate, kept, gained = self._sliding(rod, y[:5], c, self.friction * self.friction_ratio(y[3] - y[5]))
        return (kept + stretch_rate * gained)[5]

    def joined(self, rod: Rod, y: Array, c: Array) -> Array:
        """What is continuous along the belt: x, y, theta, kappa, X, Y ``(6, ...)``."""
        return super().joined(rod, y[:5], c)
