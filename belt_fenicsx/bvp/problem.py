"""The boundary-value problem of a layout: parts side by side on [0, 1], joined at their ends.

Each part is mapped to [0, 1]; its length is an unknown scalar, as are the transport rate where inertia makes forces
depend on it, and the displacements of take-ups. Its own map widens its own boundary layers. Unknowns are
scaled to the size of what they do: forces by the tension, strains by that of the tension.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from belt_fenicsx.bvp.equations import Free, OnPulleys, Rod
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import Part

FIRST, LAST = 0, -1  # Ends of a part.
WIDTH_FREE, WIDTH_CONTACT = 2.0, 4.0  # Layers of a map, in bending layers and in shear layers of the belt.
NARROWEST = 1e-7  # Layer of a map, in parts of its part of the belt.


@dataclass(frozen=True)
class End:
    """Unknowns at an end of a part, as a condition sees them: ``y`` ``(n, ...)``, the part's length, and its
    equations.
    """

    y: Array
    length: Array
    equations: Free | OnPulleys


@dataclass(frozen=True)
class Condition:
    """An equation for an unknown scalar: a function of ends of parts and of the transport rate vanishes.

    Attributes:
        ends: Part and end of each.
        function: Of these ends and the transport rate, analytic.
    """

    ends: tuple[tuple[int, int], ...]
    function: Callable[[Sequence[End], Array], Array]


@dataclass(frozen=True)
class Joining:
    """Two parts that are continuous where they meet; over the joint the angle changes by ``jump``, in a loop's last
    one. There, the balance along the belt may follow from all other equations.
    """

    before: int
    after: int
    jump: float = 0.0
    follows: bool = False


@dataclass(frozen=True)
class TakeUp:
    """A pulley that moves along a direction, and the parts on it."""

    direction: tuple[float, float]
    parts: tuple[int, ...]


@dataclass(frozen=True)
class Group:
    """Parts with the same kind of unknowns, solved side by side.

    Attributes:
        equations: Their equations.
        parts: Their indices in the layout.
        units: What the unknowns are multiplied with ``(n,)``.
    """

    equations: Free | OnPulleys
    parts: Array
    units: Array

    def unscaled(self, z: Array) -> Array:
        """Unknowns from scaled ones ``(n, ...)``."""
        return (z.T / self.units).T

    def scaled(self, y: Array) -> Array:
        """Scaled unknowns ``(n, ...)``."""
        return (y.T * self.units).T


@dataclass(frozen=True, kw_only=True)
class Problem:
    """The boundary-value problem of a layout.

    Attributes:
        rod: The belt.
        parts: The parts, in the direction of travel.
        spans: The free ones.
        contacts: Those on pulleys.
        clamps: Places and angles of both clamps; None in a loop.
        joinings: One for each two parts that meet.
        conditions: The equations for all but one of the unknown scalars, of which the belt's length is the last.
        returning: Parts that end with the stretch with which they begin, which a part of no length does, too.
        take_ups: Pulleys that move.
        rate: The transport rate; None where it is an unknown. Without inertia nothing here depends on it.
        giving: The pulley whose surface speed gives the transport rate afterwards, and that speed; None elsewhere.
        tension: Typical force of the belt.
    """

    rod: Rod
    parts: tuple[Part, ...]
    spans: Group
    contacts: Group
    clamps: tuple[tuple[float, float, float], tuple[float, float, float]] | None
    joinings: tuple[Joining, ...]
    conditions: tuple[Condition, ...]
    returning: tuple[int, ...]
    take_ups: tuple[TakeUp, ...]
    rate: float | None
    giving: tuple[int, float] | None
    tension: float
    place: dict[int, tuple[Group, int]] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        place = {int(part): (group, i) for group in self.groups for i, part in enumerate(group.parts)}
        object.__setattr__(self, "place", place)

    @property
    def groups(self) -> tuple[Group, Group]:
        """Spans and contacts."""
        return self.spans, self.contacts

    def moved(self, moves: Array) -> OnPulleys:
        """The parts on pulleys where take-ups are displaced by ``moves`` ``(take-ups,)``."""
        contacts = self.contacts.equations
        assert isinstance(contacts, OnPulleys)
        if not self.take_ups:
            return contacts
        center = contacts.center.copy()
        for take_up, move in zip(self.take_ups, moves, strict=True):
            here = np.isin(self.contacts.parts, take_up.parts)
            center[:, here] += move * np.array(take_up.direction)[:, None, None]
        return replace(contacts, center=center)

    def equations(self, part: int, moves: Array) -> Free | OnPulleys:
        """Those of one part, where take-ups are displaced by ``moves`` ``(take-ups, ...)``."""
        group, at = self.place[part]
        if not isinstance(group.equations, OnPulleys):
            return group.equations
        own = group.equations.of(at)
        for take_up, move in zip(self.take_ups, moves, strict=True):
            if part in take_up.parts:
                x, y = take_up.direction
                own = replace(own, center=np.array([own.center[0] + move * x, own.center[1] + move * y]))
        return own

    def on(self, part: int) -> OnPulleys:
        """One part on a pulley alone, with its pulley where it is without displacements."""
        contacts = self.contacts.equations
        assert isinstance(contacts, OnPulleys)
        return contacts.of(self.place[part][1])

    def widths(self, lengths: Array) -> Array:
        """Widths of the layers at the ends of parts of these lengths, in parts of them ``(parts,)``."""
        free, contact = WIDTH_FREE * self.rod.bending_layer(self.tension), WIDTH_CONTACT * self.rod.shear_layer
        layers = np.array([contact if part.touches else free for part in self.parts])
        return np.clip(layers / np.maximum(np.abs(lengths), 1e-300), NARROWEST, 1.0)


def places(widths: Array, xi: Array) -> Array:
    """Maps ``xi`` in [0, 1] to places in parts whose density is about 1 / (distance to the nearer end + width).

    Args:
        widths: One for each part ``(z,)``.
        xi: Coordinates ``(m,)`` or ``(z, m)``.

    Returns:
        Places in [0, 1] ``(z, m)``.
    """
    reach = 1.0 + 2.0 * widths[:, None]
    inside = (1.0 + reach * np.tanh((2.0 * xi - 1.0) * np.arctanh(1.0 / reach))) / 2.0
    # The ends are met to the last bit.
    return np.where(xi <= 0.0, 0.0, np.where(xi >= 1.0, 1.0, np.clip(inside, 0.0, 1.0)))


def slopes(widths: Array, xi: Array) -> Array:
    """Derivatives of `places` ``(z, m)``."""
    reach = 1.0 + 2.0 * widths[:, None]
    outmost = np.arctanh(1.0 / reach)
    return reach * outmost / np.cosh((2.0 * xi - 1.0) * outmost) ** 2


def placed_at(widths: Array, places: Array) -> Array:
    """Inverse of `places`, for places ``(z, m)``."""
    reach = 1.0 + 2.0 * widths[:, None]
    return (1.0 + np.arctanh((2.0 * places - 1.0) / reach) / np.arctanh(1.0 / reach)) / 2.0
