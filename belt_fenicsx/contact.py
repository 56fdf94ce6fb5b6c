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


def penetration_near_chord(
    place: Expr, along: Expr, deviation: Expr, eta: Expr, *, radius: Expr, excess: tuple[Expr, Expr]
) -> Expr:
    """The same g at a deviation from a chord of the circle, with little rounding error where the chord is short.

    With E = R^2 - |r - C|^2 at both ends of the chord, and at the place of its part eta,

        E(eta) = (1 - eta) E(0) + eta E(1) + eta (1 - eta) |along|^2,
        g = (E(eta) - deviation.(2 place + deviation)) / (R + |place + deviation|).

    The rounding error of the difference in `penetration` is as large as that of positions; from point to point it is a
    roughness of the pulley, to which the pressure of a thin, stiff belt answers.

    Args:
        place: Place on the chord, as seen from the centre.
        along: Vector from the chord's first to its last end.
        deviation: Vector from the place to the point.
        eta: Part of the chord before the place.
        radius: Radius of the pulley.
        excess: E at both ends.
    """
    on_chord = (1 - eta) * excess[0] + eta * excess[1] + eta * (1 - eta) * ufl.dot(along, along)
    distance = ufl.sqrt(ufl.dot(place + deviation, place + deviation))
    return (on_chord - ufl.dot(deviation, 2 * place + deviation)) / (radius + distance)


def normal_potential(g: Expr, *, lambda_p: Expr, penalty: Expr) -> Expr:
    """Augmented Lagrangian of the pressure, per material length.

    Its derivative by g is p = max(0, lambda_p + P g): Rockafellar's form of the first integral of (18.10).
    """
    trial = lambda_p + penalty * g
    return (ufl.max_value(0.0, trial) ** 2 - lambda_p**2) / (2 * penalty)


def friction_potential(r: Expr, *, lambda_f: Expr, t: Expr) -> Expr:
    """Second integrand of (18.10), of which only r is varied: the friction traction is no potential force."""
    return -lambda_f * ufl.dot(t, r)
