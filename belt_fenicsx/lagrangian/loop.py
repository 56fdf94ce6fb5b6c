"""The augmented-Lagrangian method on one mesh: Newton's iteration, and updates of the multipliers between.

1. Begin with the fields of another solution, and leave step 2 out; or with the taut string.
2. With a relaxed penalty, with which Newton's iteration follows best as friction comes: one update or two as in step 3.
3. With a penalty P that grows to its full value, until multipliers and penetration are at rest:
   a. Newton's iteration, loosely converged.
   b. lambda_p <- max(0, lambda_p + P g), the signed form of (18.12).
   c. On each pulley lambda_f <- lambda_f + P_f D' in stick, in the mean of each element and clipped to Coulomb's bound,
      and -s mu lambda_p where the belt slides before the run-off (18.16), as far as the drive asks for (`friction`).
   d. The growth of the belt's force on each pulley, and the transport rate, from what drives ask for (`drives`).

References:
    R. T. Rockafellar, "The multiplier method of Hestenes and Powell applied to convex programming", 1973,
    doi:10.1007/BF00934777, for the signed form. The source's own update can only grow.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from belt_fenicsx.lagrangian import reading
from belt_fenicsx.lagrangian.drives import Drives
from belt_fenicsx.lagrangian.forms import Problem
from belt_fenicsx.lagrangian.friction import Points
from belt_fenicsx.lagrangian.guess import from_fields, from_taut_belt
from belt_fenicsx.lagrangian.multipliers import Multipliers, Penalties
from belt_fenicsx.lagrangian.newton import NewtonError
from belt_fenicsx.lagrangian.problems import Options
from belt_fenicsx.lagrangian.state import State
from belt_fenicsx.lagrangian.taut import TautBelt
from belt_fenicsx.lagrangian.tolerances import Tolerances
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stages, Stopped
from belt_fenicsx.solution.status import Status

logger = logging.getLogger(__name__)

NAME = "augmented-lagrangian"
EPS = float(np.finfo(float).eps)
PATIENCE = 20  # Updates with the full one in which friction may fall short of a force.


class Task(NamedTuple):
    """What is to be solved on one mesh.

    Attributes:
        scene: The dimensionless scene.
        nodes: Dimensionless positions of all nodes ``(elements + 1,)``.
        start: Dimensionless fields to start from; None for the taut belt.
        rtol: Relative change of omega that the last updates may still make.
        options: The caller's PETSc options.
        tolerances: All other tolerances.
        taut: The taut belt of the scene.
        rate: Dimensionless transport rate that goes with the fields to start from.
    """

    scene: Scene
    nodes: Array
    start: Fields | None
    rtol: float
    options: Options
    tolerances: Tolerances
    taut: TautBelt
    rate: float = 1.0

    @property
    def elements(self) -> int:
        """Number of elements."""
        return len(self.nodes) - 1


class Run:
    """A task on its way through the steps.

    Args:
        problem: Forms, function spaces and Newton solver.
        task: The task.
        stages: What was done so far.
    """

    def __init__(self, problem: Problem, task: Task, stages: Stages) -> None:
        self.problem, self.task, self.stages, self.tolerances = problem, task, stages, task.tolerances
        self.radius = min(pulley.radius for pulley in task.scene.pulleys)
        self.iterations = self.overloads = 0
        self.measures: dict[str, float] = {}
        # One answer for all ranks: what is logged is computed by all.
        self.logs = problem.space.comm.bcast(logger.isEnabledFor(logging.INFO))
        problem.load(task.scene, task.taut, task.nodes)
        belt, sizes = task.scene.belt, np.diff(task.nodes)
        self.penalties = Penalties.of(task.scene, float(np.min(sizes)), self.tolerances.penalty_scale)
        self.growth = self.tolerances.penalty_growth
        self.limit = self.penalties.limits(np.diff(problem.nodes)[:, np.newaxis])
        # An entry of the residual is a difference of forces b1 r/size, with pressures P g in it, most of which cancel.
        pressed = self.tolerances.rounding * self.penalties.limits(sizes) * sizes
        rounding = EPS * belt.length * (belt.extensional_stiffness / sizes + pressed)
        self.rounding = self.tolerances.rounding * float(np.sum(rounding))
        self.newton_atol = max(self.tolerances.newton_atol, float(np.linalg.norm(rounding)))

    def solve(self) -> Solution:
        """Takes the steps and reads off the solution."""
        try:
            self._begin()
            answer = self._answer(self._update_to_rest())
        except NewtonError as failure:
            return self._failed(Status.NEWTON_DIVERGED, str(failure))
        except Stopped as stopped:
            return self._failed(stopped.status, stopped.message)
        return self._end(Status.SOLVED, **answer)

    def _failed(self, status: Status, why: str) -> Solution:
        few = self.task.taut.too_few_elements(self.task.nodes)
        return self._end(status, message=f"Stage `{self.stages[-1].name}`: {why}{few}")

    def _end(self, status: Status, **answer: Any) -> Solution:
        return Solution(
            scene=self.task.scene, method=NAME, status=status, stages=tuple(self.stages),
            iterations=self.stages.iterations, measures=self.measures, **answer,
        )  # fmt: skip

    def _begin(self) -> None:
        """Steps 1 and 2."""
        scene, fields, problem = self.task.scene, self.task.start, self.problem
        mesh = problem.nodes, problem.points[problem.own]
        if fields is None:
            guess = from_taut_belt(scene, self.task.taut, *mesh)
        else:
            guess = from_fields(scene, fields, self.task.rate, *mesh)
        problem.set_rate(guess.rate)
        problem.set_state(guess.values, guess.slopes)
        self.multipliers = guess.multipliers
        (f,) = problem.space.of_all_ranks(guess.multipliers.f)
        growths = [-float(np.sum(problem.weights[near] * f[near])) for near in problem.near]
        self.drives = Drives(scene, guess.rate, growths)
        if fields is not None:
            self.penalty = self.penalties.full
            self.stages.skipped("relaxed", "there is an initial solution")
            return
        self.penalty = self.penalties.relaxed
        with self._stage("relaxed", "no initial solution was given"):
            # Forces that drives ask for are found in a second one.
            for _ in range(1 + self.drives.ask_for_forces):
                self._newton()
                self._update(problem.state())

    def _update_to_rest(self) -> State:
        """Step 3."""
        frictional = self.problem.terms.frictional
        with self._stage("frictional", "always" if frictional else "always (no friction: the pressure only)"):
            for update in range(1, self.tolerances.updates + 1):
                iterations = self._newton_at_larger_penalty()
                state = self.problem.state()
                self._update(state)
                if self.logs:
                    self._log(update, iterations, state)
                if self.penalty == self.penalties.full and self._at_rest(iterations):
                    return state
        raise Stopped(Status.MULTIPLIERS_DIVERGED, f"{self.tolerances.updates} updates left {self.measures}")

    def _newton_at_larger_penalty(self) -> int:
        """Step 3a; with the old penalty, which grows more slowly from now on, where it moves the contact too far."""
        penalty = self.penalty
        self.penalty = min(self.penalties.full, penalty * self.growth)
        try:
            return self._newton()
        except NewtonError as failure:
            self.iterations += failure.iterations
            self.growth = self.growth**0.5
            if self.growth < self.tolerances.least_growth or self.penalty == penalty:
                raise
        self.penalty = penalty
        return self._newton()

    def _newton(self) -> int:
        """Newton's iteration for the present multipliers and penalty; its number of iterations."""
        problem = self.problem
        problem.set_penalty(np.minimum(self.penalty, self.limit))
        problem.set_multipliers(*self.multipliers)
        iterations = problem.newton.solve(rtol=self.tolerances.newton_rtol, atol=self.newton_atol)
        self.iterations += iterations
        return iterations

    def _update(self, state: State) -> None:
        """Steps 3b to 3d. All ranks see the whole belt in the last two."""
        old, penalty, problem = self.multipliers, np.minimum(self.penalty, self.limit), self.problem
        p, trial = np.maximum(0.0, old.p + penalty * state.g), old.f + self.penalties.friction * state.dD
        columns = problem.space.of_all_ranks(state.fibre_x, state.g, state.stretch, state.level, p, trial)
        points = [
            Points(problem.points[near], problem.weights[near], edges, *(column[near] for column in columns))
            for near, edges in zip(problem.near, problem.edges, strict=True)
        ]
        for i, at in enumerate(points):
            if not at.p.any():
                raise Stopped(Status.CONTACT_LOST, f"no Gauss point is in contact with pulley {i}")
        missed = self.drives.update(points, problem.growth_at_support())
        if self.task.scene.has_inertia:
            problem.set_rate(self.drives.rate)
        self._stop_beyond_capacity()
        f = np.concatenate([friction.f for friction in self.drives.frictions])[problem.own]
        self.multipliers = Multipliers(p, f)
        self._measure(state, old, penalty, missed)

    def _stop_beyond_capacity(self) -> None:
        """Stops where friction has fallen short of some drive for many updates.

        Raises:
            Stopped: It has.
        """
        overloaded = self.drives.overloaded
        self.overloads = self.overloads + 1 if overloaded and self.penalty == self.penalties.full else 0
        if self.overloads == PATIENCE:
            text = "the belt slides all along pulley {}, and friction still lacks force"
            raise Stopped(Status.CAPACITY_EXCEEDED, text.format(" and ".join(map(str, overloaded))))

    def _measure(self, state: State, old: Multipliers, penalty: Array, missed: float) -> None:
        """Measures the change of the multipliers and the penetration, both relative.

        Args:
            state: The state.
            old: Multipliers before the update.
            penalty: Penalty of the pressure.
            missed: Force by which drives are missed.
        """
        new, touching = self.multipliers, self.multipliers.p > 0.0
        df = new.f - old.f
        parts = (np.abs(new.p - old.p), np.abs(df), df, new.p, penalty * touching)
        sums = np.array([np.vdot(state.weight, part) for part in parts])
        deepest = np.max(np.abs(state.g) * touching, keepdims=True)
        self.problem.space.comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
        self.problem.space.comm.Allreduce(MPI.IN_PLACE, deepest, MPI.MAX)
        dp, df, resultant, pressure, penalty = sums.tolist()
        blurred = self.tolerances.blur * EPS * self.radius * penalty
        change = max(dp, df, self.tolerances.resultant_factor * max(abs(resultant), missed))
        self.measures = {
            "multiplier_change": change / pressure,
            "penetration": deepest.item() / self.radius,
            "penalty": self.penalty,
            "rounding": (self.rounding + blurred) / pressure,
        }

    def _at_rest(self, iterations: int) -> bool:
        """Whether multipliers and penetration are at rest, or rounding leaves nothing to do.

        Where Newton's method needed no iteration, the last update changed the forces by less than they are known.
        """
        rtol, tolerances = self.task.rtol, self.tolerances
        change = max(tolerances.multiplier_change * rtol, self.measures["rounding"])
        unchanged = iterations == 0 or self.measures["multiplier_change"] <= change
        least, most = tolerances.penetration_range
        penetration = min(max(tolerances.penetration * rtol, least), most)
        return unchanged and not self.overloads and self.measures["penetration"] <= penetration

    def _answer(self, state: State) -> dict[str, Any]:
        """What is read from the state at rest, as arguments of a solution."""
        inside, ends = np.stack([*state, *self.multipliers], axis=-1), self.problem.ends()
        outside = np.stack([*ends, *np.zeros((2, len(ends.sigma)))], axis=-1)
        table = np.concatenate([inside.reshape(-1, inside.shape[-1]), outside])
        # Contiguous: of columns of a table NumPy 1 rounds angles in one of two ways, by the place of the result.
        columns = np.ascontiguousarray(self.problem.space.gather(table[np.argsort(table[:, 0])]).T)
        state, multipliers = State(*columns[:-2]), Multipliers(*columns[-2:])
        return reading.answer(self.task.scene, self.task.taut, state, multipliers, self.drives)

    def _log(self, update: int, iterations: int, state: State) -> None:
        """Logs the course of an update, on rank 0; collective."""
        comm, touching = self.problem.space.comm, self.multipliers.p > 0.0
        residual, step = self.problem.newton.norms()
        x_up = comm.allreduce(np.min(state.x, where=touching, initial=np.inf), MPI.MIN)
        x_off = comm.allreduce(np.max(state.x, where=touching, initial=-np.inf), MPI.MAX)
        if comm.rank == 0:
            logger.info(
                "%d elements, update %d, Newton iterations %d: residual %.1e, step %.1e, penetration %.1e, "
                "multiplier change %.1e, contact from %.6f to %.6f Ls",
                self.task.elements, update, iterations, residual, step, self.measures["penetration"],
                self.measures["multiplier_change"], x_up, x_off,
            )  # fmt: skip

    @contextlib.contextmanager
    def _stage(self, name: str, why: str) -> Iterator[None]:
        """Notes a stage with its iterations and wall time, also where it fails."""
        before = self.iterations
        try:
            yield
        finally:
            self.stages.ran(name, why, self.iterations - before)
