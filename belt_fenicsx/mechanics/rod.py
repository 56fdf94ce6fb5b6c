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
    e1 = ufl.as_vector([ufl.cos(theta), ufl.sin(theta)])
    e2 = ufl.as_vector([-ufl.sin(theta), ufl.cos(theta)])
    return Strains(eps=ufl.dot(d_sigma(r), e1) - 1, Gamma=ufl.dot(d_sigma(r), e2), kappa=d_sigma(theta))


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


def kinetic_energy(r: Expr, theta: Expr, d_sigma: Derivative, *, mass: Expr, rotary: Expr) -> Expr:
    """Energy of motion at the transport rate c per material length, with mass rho A c^2 and rotary rho I c^2.

    What is varied is the strain energy less this one: steady motion is a shift of forces and moments.
    """
    return (mass * ufl.dot(d_sigma(r), d_sigma(r)) + rotary * d_sigma(theta) ** 2) / 2


def tractions(strain: Strains, D: Expr, *, radius: Expr, b1: Expr, b2: Expr) -> tuple[Expr, Expr]:
    """Pressure and friction that keep the belt on a pulley to the right, with D constant; of UFL or of arrays.

    They are -Q'.n and -Q'.t (18.17) with phi' = -D/R, so that they need no more than theta'. The multipliers of the
    pulley's conditions answer to second derivatives, of which short zones, and little friction, know too little.
    """
    (eps, Gamma, kappa), along = strain, 1 + strain.eps
    turn, psi_rate = -D / radius, kappa + D / radius
    # At constant D, psi changes eps by Gamma and Gamma by -(1 + eps).
    Qt, Qn = (b1 * eps * along + b2 * Gamma**2) / D, (b2 * along - b1 * eps) * Gamma / D
    Qt_psi = (b1 * (along + eps) - 2 * b2 * along) * Gamma / D
    Qn_psi = ((b2 - b1) * Gamma**2 - (b2 * along - b1 * eps) * along) / D
    return -Qn_psi * psi_rate - turn * Qt, -Qt_psi * psi_rate + turn * Qn
