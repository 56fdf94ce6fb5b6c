"""Collocation of order four on meshes graded by the belt's boundary layers, and its error.

SciPy's solve_bvp is used on given meshes, not on those that it would choose: all of them are uniform in the
coordinates of the zones' maps, which widen the layers. So the error of a functional falls with a clean fourth power of
the number of intervals, and two meshes show it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_bvp
from scipy.interpolate import PPoly

from belt_fenicsx.bvp.problem import SAME, Problem, linearised, placed_at, places
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status

ORDER = 4  # of collocation with three Lobatto points
COARSE, FINEST = 12, 2048  # intervals of the first mesh, and at most
ROUNDS, JACOBIANS = 4, 4  # of SciPy's Newton iteration on one mesh, and Jacobians after which each of them gives up
NEWTON = 1e-6  # relative residual at which Newton's iteration ends
ROUNDING = 1e-14  # of residuals, which SciPy wants to be twenty times smaller
CLOSER = 1e-2  # ends of Newton's iteration below the wanted error
TYPICAL = 1.5e-2  # expected: twice the relative error times the fourth power of the number of intervals
DOUBT = 3e-3  # by how much borders may be off on the first mesh, about, in lengths of the contact
FINER = 1.5  # intervals of the second mesh over those of the first, at least
SAFETY = 2.0  # of the error estimate
STALLED = 2  # meshes whose errors are no smaller than before: rounding leaves no more
WORK = 340.0  # of a solve, at most; one Jacobian on a mesh of few intervals is one unit
OVERHEAD = 24  # intervals that cost as much as what each Jacobian costs besides


@dataclass(frozen=True, kw_only=True)
class Discrete:
    """A solution of the collocation's equations, or a guess of one.

    Attributes:
        widths: Widths of the layers that the map of each zone widens, in parts of the zone ``(len(zones),)``.
        mesh: Nodes in [0, 1], shared by all zones ``(m + 1,)``.
        y: Functions at the nodes ``(n, m + 1)``.
        p: Parameters ``(k,)``.
        spline: The functions between the nodes; None for a guess.
        residual: Largest relative residual of the collocation's equations and of the border conditions.
        iterations: Number of Jacobians.
    """

    widths: Array
    mesh: Array
    y: Array
    p: Array
    spline: PPoly | None = None
    residual: float = math.inf
    iterations: int = 0

    @property
    def converged(self) -> bool:
        """Whether Newton's iteration converged."""
        return self.residual <= NEWTON

    @property
    def between(self) -> PPoly:
        """The functions between the nodes, of a solution."""
        assert self.spline is not None, "a guess is known at its nodes only"
        return self.spline

    def on(self, problem: Problem, intervals: int) -> Discrete:
        """Itself as a guess on another mesh, whose maps are made for its own layers."""
        mesh, widths = np.linspace(0.0, 1.0, intervals + 1), problem.widths(self.p)
        change = widths / self.widths
        widths = np.where((change < SAME) & (change > 1.0 / SAME), self.widths, widths)
        if np.array_equal(widths, self.widths):
            return replace(self, mesh=mesh, y=self.between(mesh))
        before = placed_at(self.widths, places(widths, mesh))
        y = [self.between(xi)[rows] for xi, (rows, _) in zip(before, problem.slices, strict=True)]
        return replace(self, widths=widths, mesh=mesh, y=np.concatenate(y))

    @property
    def doubt(self) -> float:
        """By how much borders may be off on a mesh as coarse as this one, about, in lengths of the contact."""
        return DOUBT * (COARSE / (self.mesh.size - 1)) ** ORDER

    def finer(self, pieces: int) -> Array:
        """Coordinates, the nodes among them, that divide each interval of the mesh ``(pieces m + 1,)``."""
        return np.linspace(0.0, 1.0, pieces * (self.mesh.size - 1) + 1)


@dataclass
class Work:
    """What a solve may still spend on Newton's iterations, on all meshes and along all its ways.

    Attributes:
        left: Units of work.
        iterations: Number of Jacobians so far.
    """

    left: float = WORK
    iterations: int = 0

    def affords(self, intervals: float) -> bool:
        """Whether what a mesh takes from a good first guess, two Jacobians, may be spent."""
        return self.left >= 2.0 * (1.0 + intervals / OVERHEAD)

    def newton(
        self, problem: Problem, start: Discrete, tolerance: float, stage: str, *, positive: bool = False
    ) -> Discrete:
        """Solves the collocation's equations on the mesh of ``start``.

        Args:
            problem: The problem.
            start: The first guess.
            tolerance: The relative residual at which to end.
            stage: Name of the stage, for the message.
            positive: Whether to solve for the logarithms of the lengths of zones on the pulley.

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
        unit = 1.0 + (start.mesh.size - 1) / OVERHEAD
        rounds = int(np.clip(self.left / (JACOBIANS * unit), 1, ROUNDS))
        solution = newton(problem, start, tolerance, positive=positive, rounds=rounds)
        self.iterations += solution.iterations
        self.left -= solution.iterations * unit
        return solution


def rounding(problem: Problem, intervals: float) -> float:
    """Relative residual at which rounding ends Newton's iteration.

    It grows with the number of intervals, and with what short layers multiply.
    """
    return max(ROUNDING * intervals, 0.2 * ROUNDING / problem.unit)


def newton(
    problem: Problem, start: Discrete, tolerance: float = NEWTON, *, positive: bool = False, rounds: int = ROUNDS
) -> Discrete:
    """Solves the collocation's equations on the mesh of ``start``.

    The equations have solutions with zones of negative length. With their logarithms as unknowns, Newton's iteration
    does not get there; but neither does it pass them on its way, which is a detour where all is well.
    """
    jacobians = 0
    lengths = Lengths(len(problem.zones) - 1 if positive else 1)

    def rate(x: Array, y: Array, q: Array) -> Array:
        return problem.rate(x, y, lengths.borders(q), start.widths)

    def rate_jacobian(x: Array, y: Array, q: Array) -> tuple[Array, Array]:
        nonlocal jacobians
        jacobians += 1
        p, gradient = linearised(lengths.borders, q)
        dy, dp = problem.rate_jacobian(x, y, p, start.widths)
        return dy, np.einsum("nkm,kq->nqm", dp, gradient)

    def residual(first: Array, last: Array, q: Array) -> Array:
        return problem.residual(first, last, lengths.borders(q))

    def residual_jacobian(first: Array, last: Array, q: Array) -> tuple[Array, Array, Array]:
        p, gradient = linearised(lengths.borders, q)
        by_first, by_last, by_p = problem.residual_jacobian(first, last, p)
        return by_first, by_last, by_p @ gradient

    mesh, y, missed = start.mesh, start.y, math.inf
    q = lengths.logarithms(start.p)
    for _ in range(rounds):
        # Without room for more nodes, solve_bvp gives back what it has on this mesh.
        result = solve_bvp(
            rate,
            residual,
            mesh,
            y,
            q,
            fun_jac=rate_jacobian,
            bc_jac=residual_jacobian,
            tol=tolerance,
            bc_tol=tolerance,
            max_nodes=mesh.size,
        )
        y, q = result.y, result.p
        p = lengths.borders(q)
        before, missed = missed, _residual(problem, replace(start, y=y, p=p), result.yp)
        if missed <= tolerance or not math.isfinite(missed) or (missed <= NEWTON and missed > before / 2.0):
            break
    # solve_bvp linearises at the nodes and in the middle of the intervals: two calls for each Jacobian.
    return replace(start, y=y, p=p, spline=result.sol, residual=missed, iterations=jacobians // 2)


@dataclass(frozen=True)
class Lengths:
    """Logarithms of the lengths of zones on the pulley, in the place of all borders but the first.

    Attributes:
        count: Number of borders; 1 leaves all parameters as they are.
    """

    count: int

    def logarithms(self, p: Array) -> Array:
        """Unknowns from parameters ``(k,)``."""
        return np.array([p[0], *np.log(np.diff(p[: self.count])), *p[self.count :]])

    def borders(self, q: Array) -> Array:
        """Parameters from unknowns ``(k, ...)``."""
        lengths = np.exp(q[1 : self.count])
        return np.concatenate([np.cumsum(np.concatenate([q[:1], lengths]), axis=0), q[self.count :]])


@dataclass(frozen=True)
class Refined:
    """The end of a refinement.

    Attributes:
        discrete: The last solution.
        errors: Estimated errors of what was asked for.
        iterations: Number of Jacobians.
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
        change: How far two solutions differ in each of the things that are asked for ``(q,)``.
        wanted: The errors of them that are allowed ``(q,)``.
        work: What may be spent.
        closer: The end of Newton's iteration, over the first error that is allowed.
    """
    work, iterations, before, stalled = work or Work(), 0, math.inf, 0
    intervals = min(max(FINER * (coarse.mesh.size - 1), (TYPICAL / wanted[0]) ** (1 / ORDER)), FINEST)
    while True:
        tolerance = min(max(closer * wanted[0], rounding(problem, intervals)), NEWTON)
        fine = work.newton(problem, coarse.on(problem, math.ceil(intervals)), tolerance, "refinement")
        iterations += fine.iterations
        ratio = (fine.mesh.size - 1) / (coarse.mesh.size - 1)
        errors = SAFETY * change(problem, coarse, fine) / (ratio**ORDER - 1.0)
        worst = float(np.max(errors / wanted))
        reached = fine.converged and worst <= 1.0
        stalled += worst >= before
        if reached or not fine.converged or intervals >= FINEST or stalled == STALLED:
            return Refined(fine, errors, iterations, reached)
        coarse, before = fine, worst
        intervals = min(intervals * min(max((1.2 * worst) ** (1 / ORDER), 1.2), 4.0), FINEST)
        if not work.affords(intervals):
            return Refined(fine, errors, iterations, reached)


def _residual(problem: Problem, discrete: Discrete, rate: Array) -> float:
    mesh, y, p = discrete.mesh, discrete.y, discrete.p
    h = np.diff(mesh)
    middle = (y[:, 1:] + y[:, :-1]) / 2.0 - h / 8.0 * np.diff(rate)
    middle_rate = problem.rate((mesh[1:] + mesh[:-1]) / 2.0, middle, p, discrete.widths)
    missed = 1.5 * np.diff(y) / h - (rate[:, 1:] + rate[:, :-1] + 4.0 * middle_rate) / 4.0
    at_borders = problem.residual(y[:, 0], y[:, -1], p)
    return float(max(np.max(np.abs(missed) / (1.0 + np.abs(middle_rate))), np.max(np.abs(at_borders))))
