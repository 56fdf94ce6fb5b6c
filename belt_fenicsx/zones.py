"""Zones as data: what each part of the belt does, what holds at the borders between them, and the cells inside.

A list of zones is all that tells one scene's equations from another's. `posed` writes down the list that a scene asks
for; `cells` divides the zones, with cells that grow away from the layers at their ends. Pure NumPy.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from belt_fenicsx.certificate import SENSE
from belt_fenicsx.fields import Array
from belt_fenicsx.scene import RUN_OFF, RUN_UP, Scene, Slip
from belt_fenicsx.taut_string import LEAST_STRAIN

Condition = Literal["tangent", "x", "speed", "hold", "coulomb"]
BEFORE, AFTER = 0, 1

# Length of a zone's first cell, in lengths of the layer at that end, and by which factor each further cell is longer:
# free spans are straight outside of their layers, contact is curved all along.
FIRST_FREE, GROWTH_FREE = 0.4, 3.0
FIRST_CONTACT, GROWTH_CONTACT = 1.2, 1.8
FEWEST = 3  # cells of a zone


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
            lies at the scene's transition), ``"speed"`` (the belt sticks at the scene's angular velocity),
            ``"hold"`` (the belt's stretch is that in stick) or ``"coulomb"`` (friction in stick reaches its bound).
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
        by_force: Whether the stretch in stick is the one at which friction has the scene's resultant, instead of the
            one at the border `grip`.
    """

    parts: tuple[Part, ...]
    borders: tuple[Border, ...]
    by_force: bool = False

    @property
    def transition(self) -> int:
        """The border at which the belt leaves the pulley's speed for good; the run-off in pure stick, the run-up where
        it slides all along in one sense."""
        if STICK in self.parts:
            return self.parts.index(STICK)
        return 1 if len(self.parts) > 3 else 0

    @property
    def grip(self) -> int:
        """The border at which the belt's stretch is the stretch in stick."""
        return self.transition - (STICK in self.parts)


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

    def cells(self, index: int) -> slice:
        """Cells of a zone."""
        end = sum(self.counts[: index + 1])
        return slice(end - self.counts[index], end)

    @functools.cached_property
    def touches(self) -> Array:
        """Whether each cell lies on the pulley ``(n,)``."""
        return np.array([part.touches for part in self.zones.parts])[self.zone]

    @functools.cached_property
    def sticks(self) -> Array:
        """Whether the belt sticks in each cell ``(n,)``."""
        return np.array([part == STICK for part in self.zones.parts])[self.zone]

    @functools.cached_property
    def senses(self) -> Array:
        """Sense of sliding of each cell ``(n,)``."""
        return np.array([part.sense for part in self.zones.parts])[self.zone]

    @functools.cached_property
    def begins(self) -> Array:
        """Whether each cell is the first one of its zone ``(n,)``."""
        return np.append(True, self.zone[1:] != self.zone[:-1])

    @functools.cached_property
    def _hash(self) -> int:
        return hash((self.zones, self.counts))

    def __hash__(self) -> int:
        return self._hash


@functools.lru_cache(maxsize=64)
def once(mesh: Mesh, count: int) -> tuple[Array, Array]:
    """``count`` points in each cell, but those that two cells of a zone share only for the first of them.

    Returns:
        Which of all points they are, cell by cell, and their zones.
    """
    counted = np.ones((mesh.zone.size, count), dtype=bool)
    counted[:, 0] = mesh.begins
    return np.flatnonzero(counted), np.repeat(mesh.zone, count)[counted.ravel()]


@functools.lru_cache(maxsize=64)
def meshed(zones: Zones, counts: tuple[int, ...]) -> Mesh:
    """Zones divided into so many cells; made once in a process, with what follows from it."""
    return Mesh(zones, counts)


FREE, STICK = Part("free"), Part("stick")
RUN_UP_BORDER, RUN_OFF_BORDER = Border("tangent", BEFORE), Border("tangent", AFTER)


def posed(scene: Scene, slip: Slip | None = None) -> Zones:
    """The zones that a scene asks for, sliding in the given sense where the scene leaves it open."""
    pulley = scene.pulleys[0]
    sliding = Part("slip", pulley.slip or slip or "forward")
    if pulley.friction == 0.0 or pulley.x_trans == RUN_UP:
        return ordered(scene, [sliding])
    return ordered(scene, [STICK] if pulley.x_trans == RUN_OFF else [STICK, sliding])


def ordered(scene: Scene, contact: Sequence[Part]) -> Zones:
    """Zones in contact, with free ones around them and the conditions at the borders between them.

    The belt leaves the pulley's speed for good at the end of the first stick zone, or of the first slip zone where
    nothing sticks: it does so where the scene says, or else where friction cannot hold it any longer. Before, sliding
    passes into stick where friction is continuous; after, sliding turns where the belt has the pulley's speed.
    """
    drive = scene.pulleys[0].drive
    placed: dict[str, Condition] = {"x_trans": "x", "omega": "speed", "torque": "hold"}
    borders, by_force = [RUN_UP_BORDER], False
    left = contact.index(STICK) if STICK in contact else 0
    for index, (_, after) in enumerate(itertools.pairwise(contact)):
        if after == STICK:
            borders.append(Border("coulomb", AFTER))
        elif index != left:
            borders.append(Border("hold", BEFORE))
        elif scene.pulleys[0].x_trans == RUN_OFF:
            borders.append(Border("coulomb", BEFORE))
        else:
            borders.append(Border(placed[drive], AFTER))
            by_force = drive == "torque"
    return Zones((FREE, *contact, FREE), (*borders, RUN_OFF_BORDER), by_force)


def bending_layer(scene: Scene, strain: float) -> float:
    """Length sqrt(a / tension) over which bending dies out in a free span [m]."""
    return math.sqrt(scene.belt.bending_stiffness / (scene.belt.extensional_stiffness * max(strain, LEAST_STRAIN)))


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
    counts, nodes = [], []
    gradings = [
        (FIRST_CONTACT * shear / (end - start), GROWTH_CONTACT)
        if part.touches
        else (FIRST_FREE * bending / (end - start), GROWTH_FREE)
        for part, (start, end) in zip(zones.parts, itertools.pairwise(ends), strict=True)
    ]
    wanted = [2.0 * _cells_to(0.5, *grading) for grading in gradings]
    share = 1.0 if elements is None else elements / sum(wanted)
    for part, grading, count in zip(zones.parts, gradings, wanted, strict=True):
        # A contact zone that is as short as a first cell is one: errors of tractions grow as cells get shorter.
        fewest = min(FEWEST, math.ceil(1.0 / grading[0])) if part.touches else FEWEST
        counts.append(max(fewest, int(count * share)))
        nodes += itertools.pairwise(graded(*grading, counts[-1]))
    return meshed(zones, tuple(counts)), np.array(nodes)


def graded(first: float, growth: float, count: int) -> list[float]:
    """Ends in [0, 1] of cells that grow from both sides, from about the length ``first`` ``(count + 1,)``."""
    half = _cells_to(0.5, first, growth)
    steps = [2.0 * half * i / count for i in range(count // 2 + 1)]
    inner = [first * math.expm1(math.log(growth) * step) / (growth - 1.0) for step in steps]
    return inner + [1.0 - node for node in reversed(inner[: (count + 1) // 2])]


def _cells_to(distance: float, first: float, growth: float) -> float:
    """Number of growing cells up to a distance, of which the first has the length ``first``."""
    return math.log1p((growth - 1.0) * distance / first) / math.log(growth)
