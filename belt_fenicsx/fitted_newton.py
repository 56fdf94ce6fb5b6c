"""Newton's iteration of the fitted method: PETSc SNES, with the linear solves of `condensed`."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from belt_fenicsx.condensed import Condensed
from belt_fenicsx.fitted_forms import CONSTANTS, SWITCHES, forms
from belt_fenicsx.fitted_state import State
from belt_fenicsx.newton import set_options
from belt_fenicsx.scene import Scene
from belt_fenicsx.solution import Array
from belt_fenicsx.zones import BEFORE, Mesh

LARGEST_STEP = 0.5  # of a border, in lengths of a zone that it shortens


class Newton:
    """SNES on the residual of one list of zones, cells and degree.

    The Jacobian is never a PETSc matrix: PETSc's own LU meets zero pivots here, and MUMPS, the one sparse solver with
    pivoting that all builds of PETSc have, took 0.7 to 2 ms for a step where the elimination cell by cell in
    `condensed` took 0.4 to 1 ms.
    """

    def __init__(self, mesh: Mesh, degree: int, friction: bool, options: Mapping[str, Any] | None) -> None:
        self.forms = forms(degree, mesh.zone.size)
        self.condensed = Condensed(mesh, degree, self.forms.dofs, friction)
        self._u = self.forms.unknown.x.array
        n, width = self.forms.dofs.shape
        self._jacobians = np.empty((n, width, width))
        self._x, self._b = (PETSc.Vec().createSeq(self._u.size, comm=MPI.COMM_SELF) for _ in range(2))
        self._J = PETSc.Mat().createPython([self._u.size] * 2, context=self, comm=MPI.COMM_SELF)
        self._J.setUp()
        self.snes = snes = PETSc.SNES().create(MPI.COMM_SELF)
        snes.setFunction(self._residual, self._b)
        snes.setJacobian(self._jacobian, self._J)
        snes.setConvergenceTest(self._converged)
        snes.ksp.pc.setType("python")
        snes.ksp.pc.setPythonContext(self)
        defaults = {"snes_type": "newtonls", "snes_linesearch_type": "basic", "snes_max_it": 30, "ksp_type": "preonly"}
        set_options(snes, defaults, options)

    def solve(self, scene: Scene, start: State, arrived: float) -> tuple[State, int]:
        """Iterates until a step is smaller than ``arrived``.

        Returns:
            The new state, and the number of iterations; negative where they did not converge.
        """
        self._scene_data(scene, start)
        self._change, self._arrived = math.inf, arrived
        self._u[self.forms.dofs] = start.values
        self._x.array_w[:] = self._u
        self.snes.solve(None, self._x)
        self._u[:] = self._x.array_r
        iterations = self.snes.getIterationNumber()
        state = replace(start, values=self._u[self.forms.dofs])
        return state, iterations if self.snes.getConvergedReason() > 0 else -iterations

    def _scene_data(self, scene: Scene, state: State) -> None:
        belt, pulley = scene.belt, scene.pulleys[0]
        values = {
            "a": belt.bending_stiffness, "b1": belt.extensional_stiffness, "b2": belt.shear_stiffness,
            "R": pulley.radius, "xc": pulley.center[0], "H": pulley.center[1],
            "x_trans": pulley.x_trans if pulley.drive == "x_trans" and not isinstance(pulley.x_trans, str) else 0.0,
            "D_given": pulley.omega * pulley.radius if pulley.drive == "omega" else 1.0,
        }  # fmt: skip
        self.forms.constants.value[:] = [values[name] for name in CONSTANTS]
        self.forms.switches.x.array[:] = switches(state.mesh, pulley.friction).ravel()
        self._weights = np.stack([1.0 - state.cells, state.cells], axis=2)

    def _residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        self._u[:] = x.array_r
        self.forms.residual(b.array_w)

    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        self.forms.jacobians(self._jacobians)

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, y: PETSc.Vec) -> None:
        """Newton's step, shortened where a border would come too close to the next one."""
        step, scalars = self.condensed.step(self._jacobians, b.array_r, self._weights)
        sigma_dofs = self.forms.dofs[:, self.condensed.local.sigma]
        length, growth = (np.subtract(*values[sigma_dofs].T) for values in (self._u, step))
        shrinking = float(np.max(-growth / length))
        shorter = 1.0 if shrinking <= LARGEST_STEP else LARGEST_STEP / shrinking
        self._change = float(np.abs(scalars).max()) if shorter == 1.0 else math.inf
        np.multiply(step, -shorter, out=y.array_w)

    def _converged(self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]) -> int:
        reasons = PETSc.SNES.ConvergedReason
        if not math.isfinite(norms[2]):
            return reasons.DIVERGED_FNORM_NAN
        if iteration and self._change <= self._arrived:
            return reasons.CONVERGED_SNORM_RELATIVE
        return reasons.DIVERGED_MAX_IT if iteration >= snes.max_it else reasons.CONVERGED_ITERATING


@functools.lru_cache(maxsize=64)
def newton(mesh: Mesh, degree: int, friction: bool, options: tuple[tuple[str, Any], ...]) -> Newton:
    """The iteration on one list of zones, cells and degree; made once in a process."""
    return Newton(mesh, degree, friction, dict(options))


@functools.lru_cache(maxsize=64)
def switches(mesh: Mesh, mu: float) -> Array:
    """Which equations hold where ``(n, 2, len(SWITCHES))``."""
    column = {name: index for index, name in enumerate(SWITCHES)}
    on = np.zeros((mesh.zone.size, 2, len(SWITCHES)))
    parts = mesh.zones.parts
    on[:, :, column["touch"]] = mesh.touches[:, None]
    on[:, :, column["stick"]] = np.array([part.kind == "stick" for part in parts])[mesh.zone, None]
    on[:, :, column["friction"]] = mu * np.array([part.sense for part in parts])[mesh.zone, None]
    for index, (node, border) in enumerate(zip(mesh.ends, mesh.zones.borders, strict=True)):
        here = (node - 1, 1) if border.side == BEFORE else (node, 0)
        on[here][column[border.condition]] = 1.0
        if border.condition == "coulomb":
            on[here][column["friction"]] = mu * parts[index + (border.side == BEFORE)].sense
    on[mesh.ends[mesh.zones.grip] - 1, 1, column["grip"]] = 1.0
    return on
