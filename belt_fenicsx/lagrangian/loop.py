"""The two phases of the augmented-Lagrangian method on one mesh: Newton solves, and updates of the multipliers between.

1. Frictionless, with a relaxed penalty, from the taut string.
2. With friction, and a penalty that grows to its full value:
   lambda_p <- max(0, lambda_p + P g), the signed form of (18.12);
   lambda_f <- lambda_f + P_f D' in stick, in the mean of each element and clipped to Coulomb's bound, and
   -s mu lambda_p in slip (18.16).

Each update follows a loosely converged Newton solve; the loop ends when the multipliers and the penetration have
come to rest.

References:
    R. T. Rockafellar, "The multiplier method of Hestenes and Powell applied to convex programming", 1973,
    doi:10.1007/BF00934777, for the signed form. The source's own update can only grow.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.interpolate import CubicHermiteSpline

from belt_fenicsx.lagrangian import reading as recognition
from belt_fenicsx.lagrangian.forms import Problem, State
from belt_fenicsx.lagrangian.multipliers import Multipliers, Penalties, slip_share
from belt_fenicsx.lagrangian.newton import NewtonError
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stages, Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.string import taut_string

logger = logging.getLogger(__name__)

NAME = "augmented-lagrangian"
MAX_UPDATES = 200
NEWTON_RTOL, NEWTON_ATOL = 1e-1, 1e-13
EPS = np.finfo(float).eps
# Largest penetration per rtol, in the pulley's radius, and the bounds that it stays in whatever rtol is.
PENETRATION_PER_RTOL, PENETRATION_RANGE = 1e-1, (1e-9, 1e-7)
# Share of the nodal forces' rounding errors that does not cancel in the pressure: 0.05, measured on 4e5 elements.
ROUNDING = 0.1
# Rounding errors of a penetration by which updates go on to change the pressure: 0.4, measured on graded meshes.
BLUR = 0.5
LEAST_GROWTH = 1.2
# What is left of the multipliers' change sits near the borders and alternates in sign: omega, which feels their
# resultant, is closer to its limit by four to five digits.
MULTIPLIER_CHANGE_PER_RTOL = 1e3
# The resultant of the friction's change, which omega feels at once, counts by this factor more.
RESULTANT_COUNTS = 10.0


class Run:
    """One dimensionless scene on its way through the phases.

    Args:
        problem: Forms, function spaces and Newton solver.
        scene: The dimensionless scene.
        nodes: Positions of all nodes ``(elements + 1,)``.
        penalties: Penalties on this mesh.
        stages: What was done so far.
    """

    def __init__(self, problem: Problem, scene: Scene, nodes: Array, penalties: Penalties, stages: Stages) -> None:
        self.problem, self.scene, self.penalties, self.stages = problem, scene, penalties, stages
        self.pulley = scene.pulleys[0]
        self.multipliers = Multipliers(p=np.zeros_like(problem.space.eta), f=np.zeros_like(problem.space.eta))
        self.penalty = penalties.relaxed
        self.measures: dict[str, float] = {}
        # One answer for all ranks: what is told is computed by all.
        self.told = problem.space.comm.bcast(logger.isEnabledFor(logging.INFO))
        problem.load(scene, nodes)
        # An entry of the residual is a difference of forces b1 r/size, with pressures P g in it, most of which cancel.
        sizes, length = np.diff(nodes), scene.belt.length
        stiffness = scene.belt.extensional_stiffness / sizes + ROUNDING * penalties.limits(sizes) * sizes
        self.rounding = EPS * length * stiffness
        self.limit = np.repeat(penalties.limits(problem.sizes())[:, np.newaxis], problem.space.eta.shape[1], axis=1)

    def solve(self, fields: Fields | None, rtol: float) -> Solution:
        """Runs the phases, from the fields of another solution or from nothing, and reads off the solution."""
        try:
            if fields is None:
                self.relaxed("no initial solution was given")
            else:
                self.warm(fields)
            state = self.frictional(rtol)
        except NewtonError as failure:
            return self._ended(Status.NEWTON_DIVERGED, message=f"Stage `{self.stages[-1].name}`: {failure}")
        except Stopped as stopped:
            return self._ended(stopped.status, message=f"Stage `{self.stages[-1].name}`: {stopped.message}")
        fields, zones, contact = recognition.recognise(self.scene, self._gathered(state))
        return self._ended(Status.SOLVED, fields=fields, zones=zones, contacts=(contact,))

    def _ended(self, status: Status, **what_there_is: Any) -> Solution:
        stages = self.stages
        return Solution(
            scene=self.scene, method=NAME, status=status, stages=tuple(stages), iterations=stages.iterations,
            measures=self.measures, **what_there_is,
        )  # fmt: skip

    def _gathered(self, state: State) -> recognition.GaussData:
        """Everything at the Gauss points and at the clamps, of all ranks."""
        p, f, share = self.multipliers.p, self.multipliers.f, slip_share(state, self.pulley)
        columns = (state.sigma, state.weights, state.theta, state.kappa, state.g, p, f, share)
        table = np.concatenate([np.stack(columns, axis=-1), state.r, state.dr], axis=-1)
        table = self.problem.space.gather(self._between_clamps(table.reshape(-1, table.shape[-1])))
        sigma, weight, theta, kappa, g, p, f, share = table[:, :8].T
        return recognition.GaussData(
            sigma=sigma, weight=weight, r=table[:, 8:10], dr=table[:, 10:], theta=theta, kappa=kappa, g=g, p=p, f=f,
            share=share,
        )  # fmt: skip

    def _between_clamps(self, table: Array) -> Array:
        """Adds the clamps that this rank has as rows of a table of its Gauss points: free, and without weight."""
        nodes, half = self.problem.nodes, self.scene.belt.length / 2
        values, slopes = self.problem.space.nodal()
        ends = [index for index, end in ((0, -half), (-1, half)) if nodes[index] == end]
        zero, (r, theta) = np.zeros(len(ends)), np.split(values[ends], [2], axis=1)
        dr, kappa = np.split(slopes[ends] / self.problem.slopes[ends, np.newaxis], [2], axis=1)
        g = self.pulley.radius - np.hypot(*(r - np.asarray(self.pulley.center)).T)
        columns = (nodes[ends], zero, theta[:, 0], kappa[:, 0], g, zero, zero, zero, *r.T, *dr.T)
        table = np.concatenate([table, np.stack(columns, axis=-1)])
        return table[np.argsort(table[:, 0])]

    def relaxed(self, why: str) -> None:
        """First phase: frictionless with the relaxed penalty, from the taut string and its pressure T D / R."""
        string = taut_string(self.scene)
        if string is None:
            raise Stopped(Status.CONTACT_LOST, "the taut string does not touch the pulley")
        up, off = string.borders[0], string.borders[-1]
        radius, nodes, at = self.pulley.radius, self.problem.nodes, self.problem.gauss_points()
        D, phi = string.D(nodes), string.phi(nodes)
        kappa = np.where((up <= nodes) & (nodes <= off), -D / radius, 0.0)
        slopes = np.column_stack([D * np.cos(phi), D * np.sin(phi), kappa])
        self._set_state(np.column_stack([string.r(nodes), phi]), slopes)
        tension = self.scene.belt.extensional_stiffness * float(np.mean(string.strain))
        pressure = np.where((up <= at) & (at <= off), tension * float(np.mean(D)) / radius, 0.0)
        self.multipliers = Multipliers(p=pressure, f=np.zeros_like(at))
        with self._stage("relaxed", why) as stage:
            stage.iterations = self._newton()
            self._update(self.problem.state(), friction=0.0)

    def warm(self, fields: Fields) -> None:
        """Skips the first phase: state and multipliers from the fields of another solution."""
        self.stages.skipped("relaxed", "there is an initial solution")
        nodes, at = self.problem.nodes, self.problem.gauss_points()
        first, last = np.searchsorted(fields.sigma, nodes[[0, -1]])
        # What is around this rank's part of the belt; borders of zones have two points.
        index = np.arange(max(0, first - 3), min(len(fields.sigma), last + 3))
        sigma, single = np.unique(fields.sigma[index], return_index=True)
        index = index[single]
        D, phi = fields.D[index], fields.phi[index]
        values = np.column_stack([fields.r[index], fields.theta[index]])
        slopes = np.column_stack([D * np.cos(phi), D * np.sin(phi), fields.kappa[index]])
        spline = CubicHermiteSpline(sigma, values, slopes)
        self._set_state(spline(nodes), spline(nodes, 1))
        self.multipliers = Multipliers(p=np.interp(at, fields.sigma, fields.p), f=np.interp(at, fields.sigma, fields.f))
        self.penalty = self.penalties.full

    def _set_state(self, values: Array, slopes: Array) -> None:
        """Sets x, y, theta and their derivatives by sigma at this rank's nodes, with the clamps where they are."""
        half = self.scene.belt.length / 2
        for end in (-1, 1):
            values[self.problem.nodes == end * half] = (end * self.scene.span / 2, 0.0, 0.0)
        self.problem.space.set_state(values, slopes * self.problem.slopes[:, np.newaxis])

    def frictional(self, rtol: float) -> State:
        """Second phase: updates with friction until multipliers and penetration are at rest."""
        friction = self.penalties.friction if self.problem.frictional else 0.0
        growth = self.penalties.growth
        with self._stage("frictional", "always" if friction else "always (no friction: the pressure only)") as stage:
            for update in range(1, MAX_UPDATES + 1):
                penalty = self.penalty
                self.penalty = min(self.penalties.full, penalty * growth)
                try:
                    iterations = self._newton()
                except NewtonError as failure:
                    # The contact zone moves too far in one step: more updates at penalties that still converge.
                    stage.iterations += failure.iterations
                    growth = growth**0.5
                    if growth < LEAST_GROWTH or self.penalty == penalty:
                        raise
                    self.penalty = penalty
                    iterations = self._newton()
                stage.iterations += iterations
                state = self.problem.state()
                self._update(state, friction=friction)
                if self.told:
                    self._tell(update, iterations, state)
                if self.penalty == self.penalties.full and self._at_rest(rtol, iterations):
                    return state
            raise Stopped(Status.MULTIPLIERS_DIVERGED, f"{MAX_UPDATES} updates left {self.measures}")

    def _at_rest(self, rtol: float, iterations: int) -> bool:
        """Whether multipliers and penetration are, or rounding leaves nothing to do.

        Where Newton's method needed no iteration, the last update changed the forces by less than they are known.
        """
        change = max(MULTIPLIER_CHANGE_PER_RTOL * rtol, self.measures["rounding"])
        unchanged = iterations == 0 or self.measures["multiplier_change"] <= change
        penetration = np.clip(PENETRATION_PER_RTOL * rtol, *PENETRATION_RANGE)
        return unchanged and self.measures["penetration"] <= penetration

    def _newton(self) -> int:
        problem = self.problem
        problem.set_penalty(np.minimum(self.penalty, self.limit))
        problem.set_multipliers(self.multipliers.p, self.multipliers.f)
        return problem.newton.solve(rtol=NEWTON_RTOL, atol=max(NEWTON_ATOL, np.linalg.norm(self.rounding)))

    def _update(self, state: State, *, friction: float) -> None:
        """Updates the multipliers and measures their change and the penetration, both relative."""
        old = self.multipliers
        penalty = np.minimum(self.penalty, self.limit)
        new = self.multipliers = old.updated(state, self.pulley, penalty=penalty, friction=friction)
        comm, weights = self.problem.space.comm, state.weights
        blur = BLUR * EPS * self.pulley.radius * penalty * (new.p > 0.0)
        parts = (np.abs(new.p - old.p), np.abs(new.f - old.f), new.f - old.f, new.p, blur)
        sums = np.array([np.sum(weights * part) for part in parts])
        deepest = np.max(np.abs(state.g), where=new.p > 0.0, initial=0.0, keepdims=True)
        comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
        comm.Allreduce(MPI.IN_PLACE, deepest, MPI.MAX)
        dp, df, resultant, total, blurred = sums
        if total == 0.0:
            raise Stopped(Status.CONTACT_LOST, "no Gauss point is in contact")
        self.measures = {
            "multiplier_change": float(max(dp, df, RESULTANT_COUNTS * abs(resultant)) / total),
            "penetration": float(deepest.item() / self.pulley.radius),
            "penalty": self.penalty,
            "rounding": float((ROUNDING * np.sum(self.rounding) + blurred) / total),
        }

    def _tell(self, update: int, iterations: int, state: State) -> None:
        """Logs the course of an update, on rank 0; collective."""
        comm, touching = self.problem.space.comm, self.multipliers.p > 0.0
        residual, step = self.problem.newton.norms()
        x_up = comm.allreduce(np.min(state.r[..., 0], where=touching, initial=np.inf), MPI.MIN)
        x_off = comm.allreduce(np.max(state.r[..., 0], where=touching, initial=-np.inf), MPI.MAX)
        if comm.rank == 0:
            logger.info(
                "%d elements, update %d, Newton iterations %d: residual %.1e, step %.1e, penetration %.1e, "
                "multiplier change %.1e, contact from %.6f to %.6f Ls",
                self.problem.elements, update, iterations, residual, step, self.measures["penetration"],
                self.measures["multiplier_change"], x_up, x_off,
            )  # fmt: skip

    @contextlib.contextmanager
    def _stage(self, name: str, why: str) -> Iterator[_Counter]:
        """Notes a stage with its iterations and wall time, also where it fails."""
        counter = _Counter()
        try:
            yield counter
        finally:
            self.stages.ran(name, why, counter.iterations)


@dataclass
class _Counter:
    iterations: int = 0
