"""Zones as data: what each part of the belt does, what holds at the borders between them, and the cells inside.

A list of zones is all that tells one scene's equations from another's. `posed` writes down the list that a scene asks
for; `cells` divides the zones, with cells that grow away from the layers at their ends. Pure NumPy.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from belt_fenicsx.certificate import SENSE
from belt_fenicsx.scene import RUN_OFF, RUN_UP, Scene, Slip
from belt_fenicsx.solution import Array

Condition = Literal["tangent", "x", "speed", "coulomb"]
BEFORE, AFTER = 0, 1

FIRST_FREE, FIRST_CONTACT = 0.5, 1.0  # length of a zone's first cell, in lengths of the layer at that end
GROWTH = 2.0  # each further cell is longer by this factor
FEWEST = 2  # cells of a zone


@dataclass(frozen=True)
class Part:
    """A zone that is to be found.

    Attributes:
        kind: ``"free"``, ``"stick"`` or ``"slip"``.
        slip: Sense of sliding of a slip zone, otherwise None.
    """

    kind: str
    slip: Slip | None = None

    @property
    def touches(self) -> bool:
        """Whether the zone lies on the pulley."""
        return self.kind != "free"

    @property
    def sense(self) -> float:
        """+1 where the belt slides forward, -1 backward, 0 where it does not slide."""
        return SENSE.get(self.slip or "", 0.0)


@dataclass(frozen=True)
class Border:
    """The condition that places a border.

    Attributes:
        condition: ``"tangent"`` (the belt is tangent to the pulley: no concentrated force), ``"x"`` (the border
            lies at the scene's transition), ``"speed"`` (the belt sticks at the scene's angular velocity) or
            ``"coulomb"`` (friction in stick reaches its bound).
        side: The side from which the fields are taken, ``BEFORE`` or ``AFTER``.
    """

    condition: Condition
    side: int


@dataclass(frozen=True)
class Zones:
    """An ordered list of zones, and the borders between them.

    Attributes:
        parts: The zones, in the direction of travel; the first and the last are free.
        borders: One border between each two zones.
    """

    parts: tuple[Part, ...]
    borders: tuple[Border, ...]

    @property
    def grip(self) -> int:
        """The border at which the belt's stretch is the stretch in stick; the run-up where nothing sticks."""
        kinds = [part.kind for part in self.parts]
        return kinds.index("stick") - 1 if "stick" in kinds else 0


@dataclass(frozen=True)
class Mesh:
    """Zones divided into cells.

    Attributes:
        zones: The zones.
        counts: Number of cells of each zone.
    """

    zones: Zones
    counts: tuple[int, ...]

    @functools.cached_property
    def zone(self) -> Array:
        """Zone of each cell ``(n,)``."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    @functools.cached_property
    def ends(self) -> Array:
        """Nodes at the borders between zones ``(len(counts) - 1,)``."""
        return np.cumsum(self.counts)[:-1]

    @functools.cached_property
    def touches(self) -> Array:
        """Whether each cell lies on the pulley ``(n,)``."""
        return np.array([part.touches for part in self.zones.parts])[self.zone]


FREE, STICK = Part("free"), Part("stick")
RUN_UP_BORDER, RUN_OFF_BORDER = Border("tangent", BEFORE), Border("tangent", AFTER)


def posed(scene: Scene, slip: Slip | None = None) -> Zones:
    """The zones that a scene asks for, sliding in the given sense where the scene leaves it open."""
    pulley = scene.pulleys[0]
    slip = Part("slip", pulley.slip or slip or "forward")
    if pulley.friction == 0.0 or pulley.x_trans == RUN_UP:
        return Zones((FREE, slip, FREE), (RUN_UP_BORDER, RUN_OFF_BORDER))
    if pulley.x_trans == RUN_OFF:
        return Zones((FREE, STICK, FREE), (RUN_UP_BORDER, RUN_OFF_BORDER))
    transition = Border("x" if pulley.drive == "x_trans" else "speed", AFTER)
    return Zones((FREE, STICK, slip, FREE), (RUN_UP_BORDER, transition, RUN_OFF_BORDER))


def entered_sliding(zones: Zones, slip: Slip) -> Zones:
    """The zones with one more in front of stick, in which the belt slides."""
    (free, *contact), (run_up, *borders) = zones.parts, zones.borders
    return Zones((free, Part("slip", slip), *contact), (run_up, Border("coulomb", AFTER), *borders))


def bending_layer(scene: Scene, strain: float) -> float:
    """Length sqrt(a / tension) over which bending dies out in a free span [m]."""
    return math.sqrt(scene.belt.bending_stiffness / (scene.belt.extensional_stiffness * strain))


def shear_layer(scene: Scene, strain: float) -> float:
    """Length sqrt(a / (b2 D^2 - b1 D (D - 1))) over which shear dies out on the pulley [m]."""
    belt, D = scene.belt, 1.0 + strain
    return math.sqrt(
        belt.bending_stiffness / abs(belt.shear_stiffness * D**2 - belt.extensional_stiffness * D * strain)
    )


def divided(
    zones: Zones, ends: Sequence[float], *, bending: float, shear: float, elements: int | None = None
) -> tuple[Mesh, Array]:
    """Divides zones into cells.

    Args:
        zones: The zones.
        ends: Their ends in the material-length coordinate ``(len(zones.parts) + 1,)`` [m].
        bending: Length of the bending layers, at both ends of free zones [m].
        shear: Length of the shear layers, at both ends of zones in contact [m].
        elements: Number of cells in all; by default, as many as the layers call for.

    Returns:
        The mesh, and both ends of each cell in its zone, which goes from 0 to 1 ``(n, 2)``.
    """
    firsts = [
        FIRST_CONTACT * shear / (end - start) if part.touches else FIRST_FREE * bending / (end - start)
        for part, start, end in zip(zones.parts, ends[:-1], ends[1:], strict=True)
    ]
    wanted = np.array([2.0 * _cells_to(0.5, first) for first in firsts])
    counts = np.maximum(FEWEST, np.round(wanted if elements is None else wanted * elements / wanted.sum()).astype(int))
    nodes = [graded(first, count) for first, count in zip(firsts, counts, strict=True)]
    cells = np.concatenate([np.column_stack([part[:-1], part[1:]]) for part in nodes])
    return Mesh(zones, tuple(counts.tolist())), cells


def graded(first: float, count: int) -> Array:
    """Ends in [0, 1] of cells that grow from both sides, from about the length ``first`` ``(count + 1,)``."""
    half = _cells_to(0.5, first)
    steps = half * np.linspace(-1.0, 1.0, count + 1)
    inner = first * np.expm1(math.log(GROWTH) * (half - np.abs(steps))) / (GROWTH - 1.0)
    return np.where(steps <= 0.0, inner, 1.0 - inner)


def _cells_to(distance: float, first: float) -> float:
    """Number of growing cells up to a distance, of which the first has the length ``first``."""
    return math.log1p((GROWTH - 1.0) * distance / first) / math.log(GROWTH)
