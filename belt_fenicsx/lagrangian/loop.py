"""The augmented-Lagrangian method on one mesh: Newton's iteration, and updates of the multipliers between.

1. Begin with the fields of another solution, and leave step 2 out; or with the taut string.
2. Without friction, with a relaxed penalty: Newton's iteration and one update of the pressure.
3. With friction, and a penalty P that grows to its full value, until multipliers and penetration are at rest:
   a. Newton's iteration, loosely converged.
   b. lambda_p <- max(0, lambda_p + P g), the signed form of (18.12).
   c. lambda_f <- lambda_f + P_f D' in stick, in the mean of each element and clipped to Coulomb's bound, and
      -s mu lambda_p in slip (18.16).

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
from belt_fenicsx.lagrangian.guess import from_fields, from_string
from belt_fenicsx.lagrangian.multipliers import Multipliers, Penalties
from belt_fenicsx.lagrangian.newton import NewtonError
from belt_fenicsx.lagrangian.problems import Options
from belt_fenicsx.lagrangian.state import State
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


class Task(NamedTuple):
    """What is to be solved on one mesh.

    Attributes:
        scene: The dimensionless scene.
        nodes: Dimensionless positions of all nodes ``(elements + 1,)``.
        start: Dimensionless fields to start from; None for the taut string.
        rtol: Relative change of omega that the last updates may still make.
        options: The caller's PETSc options.
        tolerances: All other tolerances.
        rate: Dimensionless transport rate that goes with the fields to start from.
    """

    scene: Scene
    nodes: Array
    start: Fields | None
    rtol: float
    options: Options
    tolerances: Tolerances
    rate: float = 1.0

    @property
    def elements(self) -> int:
        """Number of elements."""
        return len(self.nodes) - 1


class Run:
    """A task on its way through the steps.

    Args:
        problem: Forms, function spaces and Newton solver, of a `forms.Problem` or what stands for it.
        task: The task.
        stages: What was done so far.
    """

    def __init__(self, problem: Any, task: Task, stages: Stages) -> None:
        self.problem, self.task, self.stages, self.tolerances = problem, task, stages, task.tolerances
        self.pulley, self.iterations = task.scene.pulleys[0], 0
        self.radius = min(pulley.radius for pulley in task.scene.pulleys)
        self.measures: dict[str, float] = {}
        # One answer for all ranks: what is logged is computed by all.
        self.logs = problem.space.comm.bcast(logger.isEnabledFor(logging.INFO))
        problem.load(task.scene, task.nodes)
        belt, sizes = task.scene.belt, np.diff(task.nodes)
        self.penalties = Penalties.of(task.scene, float(np.min(sizes)), self.tolerances.penalty_scale)
        self.growth = self.tolerances.penalty_growth
        self.limit = self.penalties.limits(np.diff(problem.nodes)[:, np.newaxis])
        # An entry of the residual is a difference of forces b1 r/size, with pressures P g in it, most of which cancel.
        pressed = self.tolerances.rounding * self.penalties.limits(sizes) * sizes
        self.rounding = EPS * belt.length * (belt.extensional_stiffness / sizes + pressed)

    def solve(self) -> Solution:
        """Takes the steps and reads off the solution."""
        try:
            self._begin()
            answer = self._answer(self._update_to_rest())
        except NewtonError as failure:
            return self._end(Status.NEWTON_DIVERGED, message=f"Stage `{self.stages[-1].name}`: {failure}")
        except Stopped as stopped:
            return self._end(stopped.status, message=f"Stage `{self.stages[-1].name}`: {stopped.message}")
        return self._end(Status.SOLVED, **answer)

    def _end(self, status: Status, **answer: Any) -> Solution:
        return Solution(
            scene=self.task.scene, method=NAME, status=status, stages=tuple(self.stages),
            iterations=self.stages.iterations, measures=self.measures, **answer,
        )  # fmt: skip

    def _begin(self) -> None:
        """Steps 1 and 2."""
        scene, fields, nodes, points = self.task.scene, self.task.start, self.problem.nodes, self.problem.points
        guess = from_string(scene, nodes, points) if fields is None else from_fields(scene, fields, nodes, points)
        self.problem.set_state(guess.values, guess.slopes)
        self.multipliers = guess.multipliers
        self.penalty = self.penalties.relaxed if fields is None else self.penalties.full
        if fields is not None:
            self.stages.skipped("relaxed", "there is an initial solution")
            return
        with self._stage("relaxed", "no initial solution was given"):
            self._newton()
            self._update(self.problem.state(), friction=0.0)

    def _update_to_rest(self) -> State:
        """Step 3."""
        friction = self.penalties.friction if self.problem.frictional else 0.0
        with self._stage("frictional", "always" if friction else "always (no friction: the pressure only)"):
            for update in range(1, self.tolerances.updates + 1):
                iterations = self._newton_at_larger_penalty()
                state = self.problem.state()
                self._update(state, friction)
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
        problem, atol = self.problem, max(self.tolerances.newton_atol, float(np.linalg.norm(self.rounding)))
        problem.set_penalty(np.minimum(self.penalty, self.limit))
        problem.set_multipliers(*self.multipliers)
        iterations = problem.newton.solve(rtol=self.tolerances.newton_rtol, atol=atol)
        self.iterations += iterations
        return iterations

    def _update(self, state: Any, friction: float) -> None:
        """Steps 3b and 3c."""
        old, penalty = self.multipliers, np.minimum(self.penalty, self.limit)
        self.multipliers = old.update(state, self.pulley, penalty=penalty, friction=friction)
        self._measure(state, old, penalty)

    def _measure(self, state: Any, old: Multipliers, penalty: Array, missed: float = 0.0) -> None:
        """Measures the change of the multipliers and the penetration, both relative.

        Args:
            state: The state.
            old: Multipliers before the update.
            penalty: Penalty of the pressure.
            missed: Force by which drives are missed.
        """
        new, radius = self.multipliers, self.radius
        blur = self.tolerances.blur * EPS * radius * penalty * (new.p > 0.0)
        parts = (np.abs(new.p - old.p), np.abs(new.f - old.f), new.f - old.f, new.p, blur)
        sums = np.array([np.sum(state.weight * part) for part in parts])
        deepest = np.max(np.abs(state.g), where=new.p > 0.0, initial=0.0, keepdims=True)
        self.problem.space.comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
        self.problem.space.comm.Allreduce(MPI.IN_PLACE, deepest, MPI.MAX)
        dp, df, resultant, pressure, blurred = sums
        if pressure == 0.0:
            raise Stopped(Status.CONTACT_LOST, "no Gauss point is in contact")
        change = max(dp, df, self.tolerances.resultant_factor * max(abs(resultant), missed))
        self.measures = {
            "multiplier_change": float(change / pressure),
            "penetration": float(deepest.item() / radius),
            "penalty": self.penalty,
            "rounding": float((self.tolerances.rounding * np.sum(self.rounding) + blurred) / pressure),
        }

    def _at_rest(self, iterations: int) -> bool:
        """Whether multipliers and penetration are at rest, or rounding leaves nothing to do.

        Where Newton's method needed no iteration, the last update changed the forces by less than they are known.
        """
        rtol, tolerances = self.task.rtol, self.tolerances
        change = max(tolerances.multiplier_change * rtol, self.measures["rounding"])
        unchanged = iterations == 0 or self.measures["multiplier_change"] <= change
        penetration = np.clip(tolerances.penetration * rtol, *tolerances.penetration_range)
        return unchanged and bool(self.measures["penetration"] <= penetration)

    def _answer(self, state: Any) -> dict[str, Any]:
        """What is read from the state at rest, as arguments of a solution."""
        columns = self._gathered(state, self.problem.clamps())
        return reading.answer(self.task.scene, State(*columns[:-2]), Multipliers(*columns[-2:]))

    def _gathered(self, state: Any, clamps: Any) -> Array:
        """State and multipliers at the Gauss points of all ranks and at the belt's ends ``(.., n)``, along the belt."""
        inside = np.stack([*state, *self.multipliers], axis=-1)
        ends = np.stack([*clamps, *np.zeros((2, len(clamps.sigma)))], axis=-1)
        table = np.concatenate([inside.reshape(-1, inside.shape[-1]), ends])
        # Contiguous: of columns of a table NumPy 1 rounds angles in one of two ways, by the place of the result.
        return np.ascontiguousarray(self.problem.space.gather(table[np.argsort(table[:, 0])]).T)

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
