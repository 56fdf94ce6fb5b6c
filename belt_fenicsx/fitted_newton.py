"""Newton's iteration of the fitted method: PETSc SNES, with the linear solves of `condensed`."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from petsc4py import PETSc

from belt_fenicsx.condensed import Condensed, local
from belt_fenicsx.fields import Array
from belt_fenicsx.fitted_forms import CONSTANTS, SWITCHES, forms
from belt_fenicsx.fitted_state import State
from belt_fenicsx.petsc_options import set_options
from belt_fenicsx.scene import Scene
from belt_fenicsx.zones import BEFORE, Mesh

LARGEST_STEP = 0.5  # of a border, in lengths of a zone that it shortens


class Iteration:
    """Newton's iteration on the residual of one list of zones, cells and degree.

    It is a type of SNES, with SNES's options and monitors, that is written here: the callbacks of PETSc's own type took
    a third of a step's time. The Jacobian is never a PETSc matrix: PETSc's own LU meets zero pivots here, and MUMPS,
    the one sparse solver with pivoting that all builds of PETSc have, took 0.7 to 2 ms for a step where the elimination
    cell by cell in `condensed` took 0.3 to 1 ms.

    Attributes:
        values: Unknowns of each cell ``(n, 5 k + 6)``.
        residuals: Computes the residual of each cell.
        jacobians: Computes the Jacobian of each cell.
        arrived: Largest step of a border, and of the stretch in stick, at which the iteration ends.
    """

    def __init__(self, mesh: Mesh, degree: int, friction: bool) -> None:
        self.condensed = Condensed(mesh, degree, friction)
        (n, dofs), on = self.condensed.numbers.shape, switches(mesh)
        coefficients = np.empty((n, dofs + on[0].size))
        coefficients[:, dofs:] = on.reshape(n, -1)
        self.values, self._constants = coefficients[:, :dofs], np.zeros(len(CONSTANTS))
        compiled, (jacobians, residuals) = forms(degree, friction), self.condensed.cells
        self.residuals = compiled.F.on(residuals, coefficients, self._constants)
        self.jacobians = compiled.J.on(jacobians.reshape(n, -1), coefficients, self._constants)
        self.arrived = 0.0
        self._sigma, self._weights = local(degree).sigma, np.empty((n, 2, 2))

    def solve(self, snes: PETSc.SNES, _b: PETSc.Vec, _x: PETSc.Vec) -> None:
        """The iteration; called by SNES."""
        reasons = PETSc.SNES.ConvergedReason
        reason = reasons.DIVERGED_MAX_IT
        for iteration in range(snes.max_it):
            self.residuals()
            snes.monitor(iteration, self.condensed.residual_norm())
            self.jacobians()
            step, change = self._step()
            self.values += step
            snes.setIterationNumber(iteration + 1)
            if not math.isfinite(change):
                reason = reasons.DIVERGED_FNORM_NAN
                break
            if change <= self.arrived:
                reason = reasons.CONVERGED_SNORM_RELATIVE
                break
        snes.setConvergedReason(reason)

    def _step(self) -> tuple[Array, float]:
        """Newton's step, shortened where a border would come too close to the next one.

        Returns:
            The step, and the largest change of a border or of the stretch in stick by the full one.
        """
        step, scalars = self.condensed.step(self._weights)
        ends, moved = self.values[:, self._sigma], step[:, self._sigma]
        shrinking = float(((moved[:, 0] - moved[:, 1]) / (ends[:, 1] - ends[:, 0])).max())
        if shrinking > LARGEST_STEP:
            step *= LARGEST_STEP / shrinking
        return step, float(np.abs(scalars).max())

    def load(self, scene: Scene, state: State, arrived: float) -> None:
        """Sets the parameters of a scene, the state to start from, and the step at which to end."""
        belt, pulley = scene.belt, scene.pulleys[0]
        values = {
            "a": belt.bending_stiffness, "b1": belt.extensional_stiffness, "b2": belt.shear_stiffness,
            "R": pulley.radius, "xc": pulley.center[0], "H": pulley.center[1], "mu": pulley.friction,
            "x_trans": pulley.x_trans if pulley.drive == "x_trans" and not isinstance(pulley.x_trans, str) else 0.0,
            "D_given": pulley.omega * pulley.radius if pulley.drive == "omega" else 1.0,
            "force_given": -pulley.torque / pulley.radius if pulley.drive == "torque" else 0.0,
        }  # fmt: skip
        self.arrived = arrived
        self._constants[:] = [values[name] for name in CONSTANTS]
        self.values[:] = state.values
        self._weights[..., 0], self._weights[..., 1] = 1.0 - state.cells, state.cells


@functools.lru_cache(maxsize=64)
def iteration_on(mesh: Mesh, degree: int, friction: bool) -> Iteration:
    """The iteration on one list of zones, cells and degree; made once in a process."""
    return Iteration(mesh, degree, friction)


class Newton:
    """SNES for the solves of one scene.

    It is to be closed: petsc4py would keep it until PETSc ends, when its iteration, which is in Python, is gone.
    """

    def __init__(self, options: Mapping[str, Any] | None) -> None:
        self._x, self._b = (PETSc.Vec().createSeq(1, comm=PETSc.COMM_SELF) for _ in range(2))
        self.snes = PETSc.SNES().create(PETSc.COMM_SELF)
        self.snes.setType("python")
        self.snes.setFunction(lambda *_: None, self._b)
        set_options(self.snes, {"snes_max_it": 30}, options)

    def close(self) -> None:
        """Destroys what PETSc holds."""
        for held in (self.snes, self._x, self._b):
            held.destroy()

    def solve(self, scene: Scene, start: State, arrived: float) -> tuple[State, int]:
        """Iterates until a step is smaller than ``arrived``.

        Returns:
            The new state, and the number of iterations; negative where they did not converge.
        """
        iteration = iteration_on(start.mesh, start.degree, scene.pulleys[0].friction > 0.0)
        iteration.load(scene, start, arrived)
        self.snes.setPythonContext(iteration)
        self.snes.solve(None, self._x)
        iterations = self.snes.getIterationNumber()
        state = replace(start, values=iteration.values.copy())
        return state, iterations if self.snes.getConvergedReason() > 0 else -iterations


def switches(mesh: Mesh) -> Array:
    """Which equations hold where ``(n, 2, len(SWITCHES))``."""
    column = {name: index for index, name in enumerate(SWITCHES)}
    on = np.zeros((mesh.zone.size, 2, len(SWITCHES)))
    parts, borders = mesh.zones.parts, mesh.zones.borders
    on[:, :, column["touch"]] = mesh.touches[:, None]
    on[:, :, column["stick"]] = np.array([part.kind == "stick" for part in parts])[mesh.zone, None]
    on[:, :, column["sense"]] = np.array([part.sense for part in parts])[mesh.zone, None]
    for node, border, before, after in zip(mesh.ends, borders, parts[:-1], parts[1:], strict=True):
        here = (node - 1, 1) if border.side == BEFORE else (node, 0)
        on[here][column[border.condition]] = 1.0
        if border.condition == "coulomb":
            # Friction in stick is that of the sliding before it, but opposes the sliding that begins after it.
            on[here][column["sense"]] = -after.sense if border.side == BEFORE else before.sense
    on[mesh.ends[mesh.zones.grip] - 1, 1, column["grip"]] = 1.0
    on[:, :, column["force"]] = mesh.zones.by_force
    return on
