"""Degrees of freedom of the fitted method: those of one cell, and which unknowns of the whole belt they are.

The map sigma(eta) is no unknown of its own: a cell's sigma stands for the joints at both ends of its zone.

All of a cell's pressures and frictions are too many to be eliminated with it, as there is one more Gauss point than
inner nodes; so those of the middle Gauss point are shared, as those of the cell's ends are.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass

import numpy as np

from belt_fenicsx.fitted.cells import Mesh
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.scene.scene import Scene

# Degree from which positions, angles and tractions of a cell in stick are eliminated one after another: about where it
# begins to pay, and where the friction of a thin steel band needs it to be as accurate as its estimate says.
APART = 8
NODE = 3  # unknowns at a node: x, y and theta


@dataclass(frozen=True)
class Terms:
    """What there is to compute in the scenes of one kind, and in which forms.

    Attributes:
        friction: Whether the friction traction is an unknown.
        loads: Whether there is more than in the source's scenes: inertia and gravity, speeds that share an unknown
            transport rate, drag, slip angles, pulleys that move.
        offset: Whether another fibre than the middle line touches.
    """

    friction: bool = True
    loads: bool = False
    offset: bool = False


def terms_of(scene: Scene) -> Terms:
    """The terms that a scene needs."""
    friction = any(pulley.friction > 0.0 for pulley in scene.pulleys)
    speeds = sum(pulley.drive.kind == "omega" for pulley in scene.pulleys)
    loads = scene.has_inertia or (scene.transport_rate is None and speeds > 1)
    special = any(p.take_up or p.drag or p.drive.kind == "slip_angle" for p in scene.pulleys)
    return Terms(friction, loads or special, scene.belt.contact_offset > 0.0)


@dataclass(frozen=True)
class Local:
    """A cell's dofs by field, in the order of the mixed element of degree k.

    Attributes:
        r: Those of x and y at each node, in turns ``(2 k + 2,)``.
        theta: ``(k + 1,)``.
        p: ``(k,)``.
        f: ``(k,)``.
        sigma: ``(2,)``.
        D: ``(1,)``.
        rate: ``(1,)``, with loads.
        move: ``(1,)``, with loads.
    """

    r: slice
    theta: slice
    p: slice
    f: slice
    sigma: slice
    D: slice
    rate: slice
    move: slice

    @functools.cached_property
    def nodal(self) -> Array:
        """x, y and theta of the left, the right and the inner nodes ``(k + 1, NODE)``."""
        number = np.arange(self.theta.stop)
        return np.column_stack([number[self.r].reshape(-1, 2), number[self.theta]])

    def tractions(self, friction: bool) -> Array:
        """p, and f where there is friction, at the Gauss points ``(1 or 2, k)``."""
        number = np.arange(self.f.stop)
        return np.array([number[self.p], number[self.f]][: 1 + friction])

    def scalars(self, loads: bool) -> Array:
        """The joints of the zone and the stretch in stick; transport rate and take-up of the pulley ``(3 or 5,)``."""
        return np.arange(self.sigma.start, self.move.stop if loads else self.D.stop)


@functools.cache
def local(degree: int) -> Local:
    """A cell's dofs."""
    k = degree
    ends = itertools.accumulate([2 * (k + 1), k + 1, k, k, 2, 1, 1, 1], initial=0)
    return Local(*(slice(start, end) for start, end in itertools.pairwise(ends)))


def width(degree: int, loads: bool) -> int:
    """Number of a cell's dofs."""
    return 5 * degree + (8 if loads else 6)


@dataclass(frozen=True, eq=False)
class Pattern:
    """How the dofs of a cell are eliminated.

    Attributes:
        blocks: Equations and unknowns that are eliminated with a cell, as many of each, in an order in which the
            unknowns of a block are not in the equations of the blocks before it.
        shared: The other dofs, equations and unknowns alike ``(u,)``.
    """

    blocks: tuple[tuple[Array, Array], ...]
    shared: Array

    @functools.cached_property
    def equations(self) -> Array:
        """Equations that are eliminated ``(h,)``."""
        return np.concatenate([equations for equations, _ in self.blocks])

    @functools.cached_property
    def unknowns(self) -> Array:
        """Unknowns that are eliminated ``(h,)``."""
        return np.concatenate([unknowns for _, unknowns in self.blocks])


@dataclass(frozen=True)
class Table:
    """Numbers of the unknowns: those that couple cells, one for all dofs that are fixed, then those inside of cells.

    An equation has its unknown's number.

    Attributes:
        numbers: Number of each cell's dofs ``(n, dofs)``.
        fixed: The number that stands for dofs that are fixed; all that couple cells are less.
        count: Number of unknowns, with this one.
        chain: What couples each cell with the next ones: its left node, its shared tractions, its right node
            ``(n, 3 + 1 or 2 + 3)``.
        chains: The cells of each pulley, in the direction of travel.
        scalars: What couples all cells of a pulley: joints of zones, stretches in stick, transport rate, take-ups.
        joints: The joints among them; in a loop, the last one is where it begins.
        loose: In a loop, the scalar for which there is no equation: instead, the loop begins where it does.
        forced: The joint where a loop begins that no joint closes: it stays there, and instead of its way the force
            along the belt is unknown that is missing there; None elsewhere.
        sigma: The dofs of a cell that stand for the joints of its zone.
        patterns: Groups of cells, and how their dofs are eliminated; each cell is in one of them.
    """

    numbers: Array
    fixed: int
    count: int
    chain: Array
    chains: tuple[Array, ...]
    scalars: Array
    joints: Array
    loose: int | None
    forced: int | None
    sigma: slice
    patterns: tuple[tuple[Array, Pattern], ...]

    def scalars_of(self, cells: Array) -> Array:
        """The scalars that some cells have a part in."""
        numbers = np.unique(self.numbers[cells])
        return numbers[(numbers >= self.scalars[0]) & (numbers < self.fixed)]


def loose_joint(layout: Layout, loads: bool) -> int | None:
    """The joint of a loop for which there is no equation; None where each has its own.

    Where nothing depends on the transport rate, it follows from the one speed that is given, which places no joint.
    """
    without = "speed" if layout.rate else "loop"
    if not layout.closed or (layout.rate and loads) or layout.closes is not None:
        return None
    return next((i for i, joint in enumerate(layout.joints) if joint.equation == without), None)


def table(mesh: Mesh, degree: int, terms: Terms, moving: tuple[int, ...] = ()) -> Table:
    """The table of a mesh with elements of one degree.

    Args:
        mesh: Zones and cells.
        degree: Degree k.
        terms: What there is to compute.
        moving: Indices of pulleys that move.
    """
    at, n, layout = local(degree), mesh.zone.size, mesh.layout
    left, right = at.nodal[:2]
    middle, contact = at.tractions(terms.friction)[:, degree // 2], np.flatnonzero(mesh.touches)
    rated = layout.rate and terms.loads
    counts = [
        NODE * (n - 1 + layout.closed), middle.size * contact.size, len(layout.joints), len(layout.speeds), rated,
        len(moving),
    ]  # fmt: skip
    ends = itertools.accumulate(counts, initial=0)
    nodes, tractions, joints, stretches, rate, moves = (np.arange(*pair) for pair in itertools.pairwise(ends))
    fixed = sum(counts)
    numbers = np.full((n, width(degree, terms.loads)), fixed)
    numbers[1:, left] = numbers[:-1, right] = nodes[: NODE * (n - 1)].reshape(-1, NODE)
    numbers[np.ix_(contact, middle)] = tractions.reshape(-1, middle.size)
    around = [joints[-1], *joints] if layout.closed else [fixed, *joints, fixed]
    numbers[:, at.sigma] = np.array(around)[mesh.zone[:, None] + [0, 1]]
    numbers[:, at.D] = stretches[mesh.pulley][:, None]
    if layout.closed:
        numbers[0, left] = numbers[-1, right] = nodes[-NODE:]
    if rated:
        numbers[:, at.rate] = rate
    for index, move in zip(moving, moves, strict=True):
        numbers[mesh.pulley == index, at.move] = move
    count, patterns = fixed + 1, _patterns(mesh, degree, terms)
    for cells, pattern in patterns:
        shape = cells.size, pattern.unknowns.size
        numbers[np.ix_(cells, pattern.unknowns)] = count + np.arange(shape[0] * shape[1]).reshape(shape)
        count += shape[0] * shape[1]
    chain = numbers[:, np.concatenate([left, middle, right])]
    # The first pulley of a loop begins in the last zone.
    order = np.roll(np.arange(n), np.count_nonzero(mesh.pulley[mesh.zone == mesh.zone[-1]] == 0) * layout.closed)
    chains = tuple(order[mesh.pulley[order] == pulley] for pulley in layout.pulleys)
    loose = loose_joint(layout, terms.loads)
    without = None if loose is None else joints[loose]
    forced = None if layout.closes is None else joints[-1]
    if rated and forced is None:
        without = rate[0]
    scalars = np.arange(joints[0], fixed)
    return Table(numbers, fixed, count, chain, chains, scalars, joints, without, forced, at.sigma, patterns)


def _patterns(mesh: Mesh, degree: int, terms: Terms) -> tuple[tuple[Array, Pattern], ...]:
    """The pattern of free cells, of those in contact, and of those in stick where blocks are worth it."""
    # With an offset, the conditions on a pulley tell angles, too.
    blockwise = mesh.sticks & (terms.friction and not terms.offset and degree >= APART)
    groups = (np.flatnonzero(cells) for cells in (~mesh.touches, mesh.touches & ~blockwise, blockwise))
    paired = zip(groups, _kinds(degree, terms), strict=True)
    return tuple((cells, pattern) for cells, pattern in paired if cells.size)


@functools.cache
def _kinds(degree: int, terms: Terms) -> tuple[Pattern, Pattern, Pattern]:
    """How a free cell is eliminated, one in contact, and one in stick in blocks."""
    at, tractions = local(degree), local(degree).tractions(terms.friction)
    (left, right), inner = at.nodal[:2], at.nodal[2:]
    r, theta = inner[:, :2].ravel(), inner[:, 2]
    middle, others = tractions[:, degree // 2], np.delete(tractions, degree // 2, axis=1).ravel()
    free, in_contact = np.concatenate([r, theta]), np.concatenate([r, theta, others])
    shared = np.concatenate([left, right, middle, at.scalars(terms.loads)])
    return (
        Pattern(((free, free),), np.concatenate([left, right, at.scalars(terms.loads)])),
        Pattern(((in_contact, in_contact),), shared),
        # In stick, the pulley's conditions tell positions, these tell angles, and both tell the tractions.
        Pattern(((others, r), (theta, theta), (r, others)), shared),
    )
