"""Contact of the belt with a pulley in UFL: penetration, and the two terms of the potential (18.10)."""

from __future__ import annotations

from typing import Any

import ufl

Expr = Any


def penetration(r: Expr, *, radius: Expr, center: Expr) -> Expr:
    """g = R - |r - C|, signed: positive inside the pulley.

    The source cuts it off at zero (18.11). The sign is what lets a multiplier shrink where the belt lifts off.
    """
    return radius - ufl.sqrt(ufl.dot(r - center, r - center))


def fibre(r: Expr, theta: Expr, *, offset: Expr) -> Expr:
    """Place r - d e2 of the fibre that touches, at an offset d from the middle line."""
    return r - offset * ufl.as_vector([-ufl.sin(theta), ufl.cos(theta)])


def penetration_near(
    place: Expr, deviation: Expr, *, radius: Expr, excess: Expr, offset: Expr, side: Expr, e2: Expr
) -> Expr:
    """The same g of the fibre at r - d e2, with little rounding error next to a place of which it is known well.

    With E = (R + s d)^2 - |place|^2 and r = place + deviation, it is

        X = E - deviation.(2 place + deviation) = (R + s d)^2 - |r|^2,
        g = (X - 2 s d (R + s d - s r.e2)) / (R + |r - d e2|),
        R + s d - s r.e2 = (R + s d - |r|) + (|r| - s r.e2) = X / (R + s d + |r|) + (r.e1)^2 / (|r| + s r.e2),

    where r.e1 is small, as the cross-section stands on the pulley.

    The rounding error of the difference in `penetration` is as large as that of positions; from point to point it is a
    roughness of the pulley, to which the pressure of a thin, stiff belt answers.

    Args:
        place: A place, as seen from the centre.
        deviation: Vector from there to the point.
        radius: Radius of the pulley.
        excess: E.
        offset: d.
        side: The sign s of the pulley's side.
        e2: Second axis of the cross-section.
    """
    r = place + deviation
    touching, distance, e1 = r - offset * e2, ufl.sqrt(ufl.dot(r, r)), ufl.as_vector([e2[1], -e2[0]])
    more = excess - ufl.dot(deviation, 2 * place + deviation)
    above = more / (radius + side * offset + distance) + ufl.dot(r, e1) ** 2 / (distance + side * ufl.dot(r, e2))
    return (more - 2 * side * offset * above) / (radius + ufl.sqrt(ufl.dot(touching, touching)))


def excess_on_parabola(eta: Expr, *, ends: tuple[Expr, Expr], flat: Expr, skew: Expr, bulge: tuple[Expr, Expr]) -> Expr:
    """The E of `penetration_near` on a parabola, from small numbers that are known to less than their rounding error.

    The parabola is arm + eta along + h bulge with h = eta (1 - eta), and there

        E = (1 - eta) E(0) + eta E(1) + h (flat - 2 eta skew - h |bulge|^2).

    Args:
        eta: Its parameter, from 0 to 1.
        ends: E at both ends.
        flat: |along|^2 - 2 bulge.arm.
        skew: bulge.along.
        bulge: Components of the bulge.
    """
    h = eta * (1 - eta)
    return (1 - eta) * ends[0] + eta * ends[1] + h * (flat - 2 * eta * skew - h * (bulge[0] ** 2 + bulge[1] ** 2))


def normal_potential(g: Expr, *, lambda_p: Expr, penalty: Expr) -> Expr:
    """Augmented Lagrangian of the pressure, per material length.

    Its derivative by g is p = max(0, lambda_p + P g): Rockafellar's form of the first integral of (18.10).
    """
    trial = lambda_p + penalty * g
    return (ufl.max_value(0.0, trial) ** 2 - lambda_p**2) / (2 * penalty)


def friction_potential(r: Expr, *, lambda_f: Expr, t: Expr) -> Expr:
    """Second integrand of (18.10), of which only r is varied: the friction traction is no potential force."""
    return -lambda_f * ufl.dot(t, r)
