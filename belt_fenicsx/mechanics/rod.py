"""The shear-deformable rod in UFL: strains (18.6) and strain energy (18.9) of a position r and an angle theta."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import ufl

Expr = Any
Derivative = Callable[[Expr], Expr]


class Strains(NamedTuple):
    """Axial strain, shear strain and bending strain."""

    eps: Expr
    Gamma: Expr
    kappa: Expr


def along(sigma: Expr) -> Derivative:
    """The derivative d/dsigma on a mesh of unit cells, sigma = sigma(eta)."""
    return along_slope(sigma.dx(0))


def along_slope(slope: Expr) -> Derivative:
    """The same from the slope of sigma by the mesh's coordinate."""
    return lambda field: field.dx(0) / slope


def stretch(r: Expr, d_sigma: Derivative) -> Expr:
    """D = |r'| (18.6)."""
    return ufl.sqrt(ufl.dot(d_sigma(r), d_sigma(r)))


def tangent(r: Expr, d_sigma: Derivative) -> Expr:
    """Unit tangent t = r'/D (18.2)."""
    return d_sigma(r) / stretch(r, d_sigma)


def strains(r: Expr, theta: Expr, d_sigma: Derivative) -> Strains:
    """eps = r'.e1 - 1, Gamma = r'.e2, kappa = theta' with the axes (18.3) of the cross-section."""
    return strains_of_slope(d_sigma(r), theta, d_sigma)


def strains_of_slope(slope: Expr, theta: Expr, d_sigma: Derivative) -> Strains:
    """The same from r'."""
    e1 = ufl.as_vector([ufl.cos(theta), ufl.sin(theta)])
    e2 = ufl.as_vector([-ufl.sin(theta), ufl.cos(theta)])
    return Strains(eps=ufl.dot(slope, e1) - 1, Gamma=ufl.dot(slope, e2), kappa=d_sigma(theta))


def strains_in_frame(q: tuple[Expr, Expr], turn: Expr, d_sigma: Derivative) -> Strains:
    """The same strains from small numbers, with the rounding error of these instead of that of one.

    In a frame that is turned by a constant angle, r' is 1 + q1 along its first axis and q2 along its second one, and
    the cross-section is turned further by an angle. As complex numbers, eps + i Gamma = (1 + q) exp(-i turn) - 1.

    Args:
        q: Components q1 and q2.
        turn: The angle of the cross-section in the frame.
        d_sigma: The derivative along the belt.
    """
    (q1, q2), sine, versine = q, ufl.sin(turn), 2 * ufl.sin(turn / 2) ** 2
    return Strains(
        eps=q1 - (1 + q1) * versine + q2 * sine, Gamma=q2 - (1 + q1) * sine - q2 * versine, kappa=d_sigma(turn)
    )


def elongation(q: tuple[Expr, Expr]) -> Expr:
    """D - 1, from the same q: (2 q1 + q1^2 + q2^2) / (1 + D)."""
    q1, q2 = q
    return (2 * q1 + q1**2 + q2**2) / (1 + ufl.sqrt((1 + q1) ** 2 + q2**2))


def strain_energy(strain: Strains, *, a: Expr, b1: Expr, b2: Expr) -> Expr:
    """Strain energy per material length, the integrand of (18.9)."""
    return (a * strain.kappa**2 + b1 * strain.eps**2 + b2 * strain.Gamma**2) / 2


def kinetic_energy(strain: Strains, *, density: Expr, inertia: Expr) -> Expr:
    """Kinetic energy per material length at unit transport rate, of the belt's velocity r' and spin theta'."""
    return (density * ((1 + strain.eps) ** 2 + strain.Gamma**2) + inertia * strain.kappa**2) / 2


def tractions(
    strain: Strains,
    D: Expr,
    *,
    side: Expr,
    radius: Expr,
    a: Expr,
    b1: Expr,
    b2: Expr,
    mass: Expr = 0,
    offset: Expr = 0,
    weight: tuple[Expr, Expr] = (0, 0),
) -> tuple[Expr, Expr]:
    """Pressure and friction that keep the belt on a pulley, with D constant; of UFL or of arrays.

    With N = Q - rho A c^2 r' and q = f t + s p n, they follow from N' + q + rho A g = 0 (18.17) in the axes of the
    cross-section and from psi' = kappa + s D/R, so that they need no more than theta'. The multipliers of the pulley's
    conditions answer to second derivatives, of which short zones, and little friction, know too little.

    Args:
        strain: Strains of the middle line.
        D: Stretch of the touching fibre.
        side: The sign s: +1 for a pulley on the right of the belt, -1 for one on its left.
        radius: R.
        a: Bending stiffness, less rho I c^2.
        b1: Extensional stiffness.
        b2: Shear stiffness.
        mass: rho A c^2.
        offset: Distance d of the touching fibre from the middle line, towards -e2.
        weight: rho A g in the axes of the cross-section.
    """
    eps, Gamma, kappa = strain
    # Of the touching fibre, along and across the axis of the belt.
    along = 1 + eps + offset * kappa
    psi_rate = kappa + side * D / radius
    N1, N2 = b1 * eps - mass * (1 + eps), (b2 - mass) * Gamma
    # What changes the strain of the touching fibre bends the belt, too, by the moment of its traction.
    lever = offset * (b1 - mass) / (a + offset**2 * (b1 - mass))
    q1 = (1 - offset * lever) * (kappa * N2 - weight[0] - (b1 - mass) * Gamma * psi_rate)
    q1 += lever * (Gamma * N1 - (1 + eps) * N2)
    q2 = (b2 - mass) * along * psi_rate - kappa * N1 - weight[1]
    return side * (q2 * along - q1 * Gamma) / D, (q1 * along + q2 * Gamma) / D
