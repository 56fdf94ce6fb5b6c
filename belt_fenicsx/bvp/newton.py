"""Newton's iteration on meshes graded by the belt's boundary layers, and the error of what it finds.

All meshes are uniform in the coordinates of the parts' maps, which widen the layers. So errors fall with a clean power
of the number of cells, and two meshes show them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from belt_fenicsx.bvp.collocation import ORDER_AT_ENDS, ORDER_INSIDE, POINTS, increments, integrals
from belt_fenicsx.bvp.problem import Problem, placed_at, places
from belt_fenicsx.bvp.system import System, Values
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status

COARSE, FINEST = 8, 256  # Cells of the first mesh, and at most.
ITERATIONS = 16  # Newton's iterations on one mesh, at most.
NEWTON = 1e-6  # A step that is no larger ends Newton's iteration, if no other tolerance is given.
SMALLEST_STEP = 2.0**-5  # A Newton step is shortened to this part of it, at most.
LESS = 0.25  # A step has to take away at least this part of what it would if the equations were linear.
SLOW = 0.3  # Where what is left falls by less than to this part of it, rounding leaves no more.
ROUNDING = 1e-13  # Steps that are no larger are nothing but rounding.
CLOSER = 1e-2  # The end of Newton's iteration, over the wanted error.
TYPICAL = 0.1  # The relative error of a field times the power of the number of cells is at least about this.
DOUBT = 3e-3  # By how much joints may be off on the first mesh, about, in lengths of the contact.
FINER = 1.5  # Cells of the second mesh over those of the first, at least.
SAFETY = 4.0  # Of the error estimate.
LAST_DIGIT = 1e-15  # No estimate is below what rounding leaves.
STALLED = 2  # That many meshes whose errors are no smaller than before show that rounding leaves no more.
WORK = 1200.0  # Of a solve, at most; an iteration on a mesh of few cells is one unit.
FEW_PARTS = 6  # An iteration costs as many times more as there are more parts.
OVERHEAD = 24  # An iteration on that many cells costs twice as much as on none.


@dataclass(frozen=True, kw_only=True)
class Discrete:
    """A solution of the collocation's equations, or a guess of one.

    Attributes:
        widths: Widths of the layers that the map of each part widens, in parts of the part ``(parts,)``.
        mesh: Nodes in [0, 1], shared by all parts ``(m + 1,)``.
        values: The unknowns.
        missed: Size of the Newton step that would come next, relative to what the unknowns are scaled by.
        iterations: Number of Newton's iterations.
    """

    widths: Array
    mesh: Array
    values: Values
    missed: float = math.inf
    iterations: int = 0

    @property
    def cells(self) -> int:
        """Number of cells of each part."""
        return int(self.mesh.size - 1)

    @property
    def converged(self) -> bool:
        """Whether Newton's iteration converged."""
        return self.missed <= NEWTON

    @property
    def ends(self) -> Array:
        """Ends of the parts in the material-length coordinate ``(parts + 1,)``."""
        return np.concatenate([[-0.5], np.cumsum(self.values.lengths[:-1]) - 0.5, [0.5]])

    def between(self, group: int, xi: Array) -> Array:
        """Scaled unknowns of a group at coordinates of each of its parts, ``(n, parts, q)`` for ``(parts, q)``."""
        z, K = self.values.z[group], self.values.K[group]
        cell = np.clip((xi * self.cells).astype(int), 0, self.cells - 1)
        part = np.arange(z.shape[1])[:, None]
        weights = integrals(xi * self.cells - cell)
        return z[:, part, cell] + np.einsum("npqs,pqs->npq", K[:, part, cell], weights)

    def on(self, problem: Problem, cells: int) -> Discrete:
        """Itself as a guess on another mesh, whose maps are made for its own layers."""
        widths = problem.widths(self.values.lengths)

        def unknowns(group: int, place: Array) -> Array:
            parts = problem.groups[group].parts
            return self.between(group, placed_at(self.widths[parts], place))

        return interpolated(problem, cells, widths, self.values, unknowns)

    @property
    def doubt(self) -> float:
        """By how much joints may be off on a mesh as coarse as this one, about, in lengths of the contact."""
        return DOUBT * (COARSE / self.cells) ** ORDER_INSIDE


def interpolated(
    problem: Problem, cells: int, widths: Array, values: Values, unknowns: Callable[[int, Array], Array]
) -> Discrete:
    """A guess from functions along the belt.

    Args:
        problem: The problem.
        cells: Number of cells.
        widths: Widths of the layers of the maps ``(parts,)``.
        values: Where its lengths and other scalars are taken from.
        unknowns: Scaled unknowns of a group ``(n, parts, q)`` at places in [0, 1] of its parts ``(parts, q)``.
    """
    mesh = np.linspace(0.0, 1.0, cells + 1)
    inside = (mesh[:-1, None] + POINTS / cells).ravel()
    z, K = [], []
    for index, group in enumerate(problem.groups):
        at = places(widths[group.parts], np.concatenate([mesh, inside]))
        found = unknowns(index, at)
        nodes, points = found[..., : cells + 1], found[..., cells + 1 :].reshape(*found.shape[:2], cells, POINTS.size)
        z.append(nodes)
        K.append(increments(nodes, points))
    return Discrete(widths=widths, mesh=mesh, values=replace(values, z=(z[0], z[1]), K=(K[0], K[1])))


@dataclass
class Work:
    """What a solve may still spend on Newton's iterations, on all meshes and along all its ways.

    Attributes:
        left: Units of work.
        iterations: Number of Newton's iterations so far.
    """

    left: float = WORK
    iterations: int = 0

    def affords(self, cells: float) -> bool:
        """Whether what a mesh takes from a good first guess, two iterations, may be spent."""
        return self.left >= 2.0 * (1.0 + cells / OVERHEAD)

    def newton(
        self, problem: Problem, start: Discrete, tolerance: float, stage: str, *, positive: bool = False
    ) -> Discrete:
        """Solves the collocation's equations on the mesh of ``start``.

        Args:
            problem: The problem.
            start: The first guess.
            tolerance: The size of a step at which to end.
            stage: Name of the stage, for the message.
            positive: Whether to solve for the logarithms of the lengths of parts.

        Raises:
            Stopped: All the work has been spent before.
        """
        if self.left <= 0.0:
            raise Stopped(
                Status.NEWTON_DIVERGED,
                f"After {self.iterations} Newton iterations, which is as many as there may be, stage `{stage}` has no "
                "answer yet. Start from a solution nearby (`initial`), or drive the pulley by `x_trans` first.",
                final=True,
            )
        unit = (1.0 + start.cells / OVERHEAD) * max(1.0, len(problem.parts) / FEW_PARTS)
        most = int(np.clip(self.left / unit, 1, ITERATIONS))
        solution = newton(problem, start, tolerance, positive=positive, most=most)
        self.iterations += solution.iterations
        self.left -= solution.iterations * unit
        return solution


def newton(
    problem: Problem,
    start: Discrete,
    tolerance: float = NEWTON,
    *,
    positive: bool = False,
    most: int = ITERATIONS,
) -> Discrete:
    """Solves the collocation's equations on the mesh of ``start``.

    A step is shortened until the one that would come next, with the same derivatives, is sufficiently smaller: a test
    that does not depend on the scaling of equations. Where no part of it is, the shortest is taken.

    The equations have solutions with parts of negative length. With their logarithms as unknowns, Newton's iteration
    does not get there; but neither does it pass them on its way, which is a detour where all is well.
    """
    system, values, missed, iterations = System(problem, start.mesh, start.widths), start.values, math.inf, 0
    residual = system.residual(values)
    while iterations < most:
        iterations += 1
        try:
            linear = system.linearised(values)
        except (RuntimeError, np.linalg.LinAlgError):  # A matrix that is singular: no step leads on from here.
            return replace(start, values=values, iterations=iterations)
        step, part = system.step(linear, residual), 1.0
        size = step.size
        if not math.isfinite(size):
            return replace(start, values=values, iterations=iterations)
        while True:
            trial = system.after(values, step, part, positive=positive)
            residual = system.residual(trial)
            further = system.step(linear, residual)
            if further.size <= (1.0 - LESS * part) * size or part <= SMALLEST_STEP:
                break
            part /= 2.0
        values, before, missed = trial, missed, further.largest
        if missed <= tolerance or (missed <= NEWTON and missed > SLOW * min(before, step.largest)):
            values = system.after(values, further, 1.0, positive=positive)
            break
    return replace(start, values=values, missed=missed, iterations=iterations)


@dataclass(frozen=True)
class Refined:
    """The end of a refinement.

    Attributes:
        discrete: The last solution.
        errors: Estimated errors of what was asked for.
        iterations: Number of Newton's iterations.
        reached: Whether the errors are as small as wanted.
    """

    discrete: Discrete
    errors: Array
    iterations: int
    reached: bool


def refined(
    problem: Problem,
    coarse: Discrete,
    change: Callable[[Problem, Discrete, Discrete], Array],
    wanted: Array,
    work: Work | None = None,
    *,
    closer: float = CLOSER,
) -> Refined:
    """Refines a solution until all that is asked for is as accurate as wanted, or rounding leaves no more.

    Args:
        problem: The problem.
        coarse: Its solution on a coarse mesh.
        change: How far two solutions differ in each of the things that are asked for ``(q,)``: first a functional,
            which ends of cells tell, and then fields.
        wanted: The errors of them that are allowed ``(q,)``.
        work: What may be spent.
        closer: The end of Newton's iteration, over the first error that is allowed.
    """
    work, iterations, before, stalled = work or Work(), 0, math.inf, 0
    orders = np.array([ORDER_AT_ENDS, *[ORDER_INSIDE] * (wanted.size - 1)])
    cells = min(max(FINER * coarse.cells, (TYPICAL / wanted[1:].min()) ** (1 / ORDER_INSIDE)), FINEST)
    while True:
        tolerance = min(max(closer * wanted[0], ROUNDING), NEWTON)
        fine = work.newton(problem, coarse.on(problem, math.ceil(cells)), tolerance, "refinement")
        iterations += fine.iterations
        errors = SAFETY * change(problem, coarse, fine) / ((fine.cells / coarse.cells) ** orders - 1.0) + LAST_DIGIT
        worst = float(np.max(errors / wanted))
        reached = fine.converged and worst <= 1.0
        stalled += worst >= before
        if reached or not fine.converged or cells >= FINEST or stalled == STALLED:
            return Refined(fine, errors, iterations, reached)
        coarse, before = fine, worst
        more = float(np.max((1.2 * errors / wanted) ** (1 / orders)))
        cells = min(cells * min(max(more, 1.2), 4.0), FINEST)
        if not work.affords(cells):
            return Refined(fine, errors, iterations, reached)
