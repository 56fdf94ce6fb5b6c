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


def penetration_from(arm: Expr, way: Expr, *, radius: Expr, excess: Expr) -> Expr:
    """The same g at the end of ``arm + way`` from the centre, with little rounding error where the way is short.

    With |arm|^2 + excess = R^2 it is g = (excess - way.(2 arm + way)) / (R + |arm + way|). The rounding error of the
    difference in `penetration` is as large as that of positions; from point to point it is a roughness of the pulley,
    to which the pressure of a thin, stiff belt answers.
    """
    distance = ufl.sqrt(ufl.dot(arm + way, arm + way))
    return (excess - ufl.dot(way, 2 * arm + way)) / (radius + distance)


def normal_potential(g: Expr, *, lambda_p: Expr, penalty: Expr) -> Expr:
    """Augmented Lagrangian of the pressure, per material length.

    Its derivative by g is p = max(0, lambda_p + P g): Rockafellar's form of the first integral of (18.10).
    """
    trial = lambda_p + penalty * g
    return (ufl.max_value(0.0, trial) ** 2 - lambda_p**2) / (2 * penalty)


def friction_potential(r: Expr, *, lambda_f: Expr, t: Expr) -> Expr:
    """Second integrand of (18.10), of which only r is varied: the friction traction is no potential force."""
    return -lambda_f * ufl.dot(t, r)
