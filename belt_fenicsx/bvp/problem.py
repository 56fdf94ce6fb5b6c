"""Zones of the belt stacked to one boundary-value problem on [0, 1], with derivatives by complex steps.

Each zone is mapped to [0, 1], so that all of them are solved side by side; their inner borders are unknown parameters.
Its own map widens its own boundary layers. The bending strain is solved for in units of the inverse shear layer: then
all functions and their rates are of the size of angles, however thin the belt is, and so are their residuals.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

import numpy as np

from belt_fenicsx.bvp.equations import Rod, Slip, ZoneEquations
from belt_fenicsx.layout.arrays import Array

FIRST, LAST = 0, -1  # ends of a zone
WIDTH_FREE, WIDTH_CONTACT = 2.0, 4.0  # of the layers of a map, in bending layers and in shear layers of the belt
NARROWEST = 1e-7  # layer of a map, in parts of its zone
WEIGHT = 1e3  # of the conditions, which are met to more digits than the equations
SAME = 1.5  # ratio of widths up to which a map is kept
STEP = 1e-30  # imaginary, of derivatives; its square is far below rounding

StateFunction = Callable[[Array], Array]


def linearised(function: Callable[..., Array], *arguments: Array) -> tuple[Array, ...]:
    """Values and derivatives of an analytic function by a complex step, exact but for rounding.

    They are Re f(z + i h) and Im f(z + i h) / h; all directions are one more axis of a single call.

    Args:
        function: Gives ``(r, ...)`` for arguments ``(n, ...)``, all with the same further axes.
        arguments: Where.

    Returns:
        Values ``(r, ...)``, and the derivatives ``(r, n, ...)`` with respect to each argument.
    """
    z, ends = np.concatenate(arguments), np.cumsum([len(argument) for argument in arguments[:-1]], dtype=int)
    steps = 1j * STEP * np.eye(len(z)).reshape(len(z), len(z), *(1 for _ in z.shape[1:]))
    values = function(*np.split(z[:, None] + steps, ends))
    return values[:, 0].real, *np.split(values.imag / STEP, ends, axis=1)


@dataclass(frozen=True)
class Condition:
    """A condition at borders: a sum of functions of the state at ends of zones has a given value.

    Attributes:
        terms: Zone, end and function of each.
        value: The value of the sum.
    """

    terms: tuple[tuple[int, int, StateFunction], ...]
    value: float = 0.0


def component(index: int, sign: float = 1.0) -> StateFunction:
    """One component of the state x, y, phi, theta, kappa, D."""
    return lambda state: sign * state[index]


def moment(rod: Rod, sign: float) -> StateFunction:
    """Moment of the belt's force and bending about the pulley's centre, on the pulley: M - R Qt."""
    return lambda state: sign * (rod.a * state[4] - rod.radius * rod.force(state[3] - state[2], state[5])[0])


def onset(rod: Rod, slip: Slip) -> StateFunction:
    """Rate of D of sliding; zero where sliding passes into stick with continuous friction."""
    return lambda state: slip.rate(rod, state[2:], np.empty(0))[3]


@dataclass(frozen=True)
class Problem:
    """The boundary-value problem of an ordered list of zones, on [0, 1].

    Functions of all zones are stacked; parameters are the inner borders and then the constants of the zones.

    Attributes:
        rod: Stiffnesses and the pulley.
        span: Distance of the clamps.
        zones: The zones, in the direction of travel.
        conditions: One for each border between zones on the pulley.
        unit: Length that the bending strain is multiplied with among the functions; by default the shear layer.
        slices: Functions and constants of each zone, in all functions and in the parameters.
        size: Numbers n of functions and k of parameters.
        units: What the unknowns are multiplied with among the functions ``(n,)``.
    """

    rod: Rod
    span: float
    zones: tuple[ZoneEquations, ...]
    conditions: tuple[Condition, ...]
    unit: float = math.nan
    slices: list[tuple[slice, slice]] = field(init=False, repr=False, compare=False)
    size: tuple[int, int] = field(init=False, repr=False, compare=False)
    units: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        rows = np.cumsum([0, *(zone.unknowns for zone in self.zones)])
        constants = len(self.zones) - 1 + np.cumsum([0, *(zone.constants for zone in self.zones)])
        slices = [(slice(*own), slice(*fixed)) for own, fixed in zip(pairwise(rows), pairwise(constants), strict=True)]
        object.__setattr__(self, "slices", slices)
        object.__setattr__(self, "size", (int(rows[-1]), int(constants[-1])))
        if math.isnan(self.unit):
            object.__setattr__(self, "unit", self.rod.shear_layer)
        bending = [3 if zone.kind == "free" else 2 for zone in self.zones]
        units = np.ones(rows[-1])
        units[rows[:-1] + bending] = self.unit
        object.__setattr__(self, "units", units)

    def borders(self, p: Array) -> Array:
        """All borders of zones, the clamps among them ``(len(zones) + 1,)``."""
        return np.array([-0.5, *p[: len(self.zones) - 1], 0.5])

    def parts(self, y: Array, p: Array) -> list[tuple[ZoneEquations, Array, Array]]:
        """Each zone with its unknowns and constants."""
        y = (y.T / self.units).T
        return [(zone, y[rows], p[cols]) for zone, (rows, cols) in zip(self.zones, self.slices, strict=True)]

    def stacked(self, parts: list[Array]) -> Array:
        """Functions from the unknowns of each zone ``(n, m)``."""
        return np.concatenate(parts) * self.units[:, None]

    def widths(self, p: Array) -> Array:
        """Widths of the layers at the ends of the zones, in parts of the zones ``(len(zones),)``."""
        layers = [
            WIDTH_FREE * self.rod.bending_layer(float(np.hypot(*p[constants])))
            if zone.kind == "free"
            else WIDTH_CONTACT * self.rod.shear_layer
            for zone, (_, constants) in zip(self.zones, self.slices, strict=True)
        ]
        lengths = np.maximum(np.abs(np.diff(self.borders(p))), 1e-300)
        return np.clip(layers / lengths, NARROWEST, 1.0)

    def rate(self, xi: Array, y: Array, p: Array, widths: Array) -> Array:
        """Right-hand side of all equations ``(n, m)``."""
        lengths = np.diff(self.borders(p))
        parts = zip(lengths, slopes(widths, xi), self.parts(y, p), strict=True)
        return self.stacked([length * slope * zone.rate(self.rod, y, c) for length, slope, (zone, y, c) in parts])

    def rate_jacobian(self, xi: Array, y: Array, p: Array, widths: Array) -> tuple[Array, Array]:
        """Derivatives of the rate with respect to ``y`` ``(n, n, m)`` and ``p`` ``(n, k, m)``."""
        (n, k), m, count = self.size, y.shape[1], len(self.zones)
        dy, dp = np.zeros((n, n, m)), np.zeros((n, k, m))
        lengths, slope = np.diff(self.borders(p)), slopes(widths, xi)
        by_borders = np.diff(np.eye(count + 1, count - 1, -1), axis=0)  # derivatives of the lengths
        for i, (zone, part, c) in enumerate(self.parts(y, p)):
            rows, constants = self.slices[i]
            rate, by_y, by_c = linearised(partial(zone.rate, self.rod), part, np.tile(c[:, None], m))
            units = self.units[rows, None, None]
            dy[rows, rows] = lengths[i] * slope[i] * units * by_y / units[:, 0]
            dp[rows, constants] = lengths[i] * slope[i] * units * by_c
            dp[rows, : count - 1] = slope[i] * units * rate[:, None] * by_borders[i][:, None]
        return dy, dp

    def residual(self, first: Array, last: Array, p: Array) -> Array:
        """Residual of all border conditions ``(n + k, ...)`` at the ends ``(n, ...)``, parameters ``(k, ...)``."""
        states = [[zone.state(self.rod, y, c) for zone, y, c in self.parts(end, p)] for end in (first, last)]
        rows = []
        for (x, y, _, theta, *_), clamp in ((states[FIRST][0], -self.span / 2), (states[LAST][-1], self.span / 2)):
            rows += [x - clamp, y, theta]
        for i, (before, behind) in enumerate(zip(states[LAST][:-1], states[FIRST][1:], strict=True)):
            x, y, phi, theta, kappa, D = before - behind
            # Between two zones on the pulley, x and y follow from phi.
            free = "free" in (self.zones[i].kind, self.zones[i + 1].kind)
            rows += [*([x, y] if free else []), phi, theta, self.unit * kappa, D]
        for condition in self.conditions:
            total = sum(function(states[end][zone]) for zone, end, function in condition.terms)
            rows.append(WEIGHT * (total - condition.value))
        return np.array(rows)

    def residual_jacobian(self, first: Array, last: Array, p: Array) -> tuple[Array, Array, Array]:
        """Derivatives of the residual with respect to both ends ``(n + k, n)`` and ``p`` ``(n + k, k)``."""
        _, by_first, by_last, by_p = linearised(self.residual, first, last, p)
        return by_first, by_last, by_p


def places(widths: Array, xi: Array) -> Array:
    """Maps ``xi`` in [0, 1] to places in zones whose density is about 1 / (distance to the nearer end + width).

    Args:
        widths: One for each zone ``(z,)``.
        xi: Coordinates ``(m,)`` or ``(z, m)``.

    Returns:
        Places in [0, 1] ``(z, m)``.
    """
    reach = 1.0 + 2.0 * widths[:, None]
    return np.clip((1.0 + reach * np.tanh((2.0 * xi - 1.0) * np.arctanh(1.0 / reach))) / 2.0, 0.0, 1.0)


def slopes(widths: Array, xi: Array) -> Array:
    """Derivatives of `places` ``(z, m)``."""
    reach = 1.0 + 2.0 * widths[:, None]
    outmost = np.arctanh(1.0 / reach)
    return reach * outmost / np.cosh((2.0 * xi - 1.0) * outmost) ** 2


def placed_at(widths: Array, places: Array) -> Array:
    """Inverse of `places`, for places ``(z, m)``."""
    reach = 1.0 + 2.0 * widths[:, None]
    return (1.0 + np.arctanh((2.0 * places - 1.0) / reach) / np.arctanh(1.0 / reach)) / 2.0
