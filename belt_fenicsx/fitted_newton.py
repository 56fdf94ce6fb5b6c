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
from belt_fenicsx.fields import Array
from belt_fenicsx.fitted_forms import CONSTANTS, SWITCHES, forms, points
from belt_fenicsx.fitted_state import State
from belt_fenicsx.newton import set_options
from belt_fenicsx.scene import Scene
from belt_fenicsx.zones import BEFORE, Mesh

LARGEST_STEP = 0.5  # of a border, in lengths of a zone that it shortens
SETTLED = 0.1  # of the same, that the last step may take


class Newton:
    """Newton's iteration on the residual of one list of zones, cells and degree.

    It is a SNES, with its options and monitors, of a type that is written here: the callbacks of PETSc's own type took
    a third of a step's time. The Jacobian is never a PETSc matrix: PETSc's own LU meets zero pivots here, and MUMPS,
    the one sparse solver with pivoting that all builds of PETSc have, took 0.7 to 2 ms for a step where the elimination
    cell by cell in `condensed` took 0.4 to 1 ms.
    """

    def __init__(self, mesh: Mesh, degree: int, friction: bool, options: Mapping[str, Any] | None) -> None:
        self.forms = forms(degree, mesh.zone.size)
        self.condensed = Condensed(mesh, degree, self.forms.dofs, friction)
        self._u = self.forms.unknown.x.array
        n, width = self.forms.dofs.shape
        self._jacobians = np.empty((n, width, width))
        self._b = np.empty_like(self._u)
        self._switches = switches(mesh).ravel()
        self._weights = np.empty((n, 2, 2))
        self._nodes = np.split(self.forms.dofs[:, self.condensed.local.r], mesh.ends[[0, -1]])
        self._x, F = (PETSc.Vec().createSeq(self._u.size, comm=MPI.COMM_SELF) for _ in range(2))
        self.snes = snes = PETSc.SNES().create(MPI.COMM_SELF)
        snes.setType("python")
        snes.setPythonContext(self)
        snes.setFunction(lambda *_: None, F)
        set_options(snes, {"snes_max_it": 30}, options)

    def solve_scene(self, scene: Scene, start: State, arrived: float, *, held: bool = False) -> tuple[State, int]:
        """Iterates until a step is smaller than ``arrived``, and small against the zones that it shortens.

        Args:
            scene: The dimensionless scene.
            start: Where it starts.
            arrived: Largest step of a border, or of the stretch in stick.
            held: Whether the first step holds the borders, so that all others know the forces that move them.

        Returns:
            The new state, and the number of iterations; negative where they did not converge.
        """
        self._scene_data(scene, start)
        self._arrived, self._held = arrived, held
        self._u[self.forms.dofs] = start.values
        self.snes.solve(None, self._x)
        iterations = self.snes.getIterationNumber()
        state = replace(start, values=self._u[self.forms.dofs])
        return state, iterations if self.snes.getConvergedReason() > 0 else -iterations

    def solve(self, snes: PETSc.SNES, _b: PETSc.Vec, _x: PETSc.Vec) -> None:
        """The iteration; called by SNES."""
        reasons = PETSc.SNES.ConvergedReason
        reason = reasons.DIVERGED_MAX_IT
        for iteration in range(snes.max_it):
            self.forms.residual(self._b)
            snes.monitor(iteration, float(np.linalg.norm(self._b)))
            self.forms.jacobians(self._jacobians)
            held = self._held and iteration == 0
            try:
                step, change, shortening = self._step(held)
            except np.linalg.LinAlgError:
                change = math.nan
            snes.setIterationNumber(iteration + 1)
            if not math.isfinite(change):
                reason = reasons.DIVERGED_FNORM_NAN
                break
            self._advance(step)
            if change <= self._arrived and shortening <= SETTLED and not held:
                reason = reasons.CONVERGED_SNORM_RELATIVE
                break
        snes.setConvergedReason(reason)

    def _step(self, held: bool) -> tuple[Array, float, float]:
        """Newton's step, shortened where a border would come too close to the next one.

        Returns:
            The step, the largest change of a border or of the stretch in stick by the full one, and the largest part
            that it takes from a zone.
        """
        step, scalars = self.condensed.step(self._jacobians, self._b, self._weights, held=held)
        sigma_dofs = self.forms.dofs[:, self.condensed.local.sigma]
        ends, moved = self._u[sigma_dofs], step[sigma_dofs]
        shortening = float(np.max((moved[:, 0] - moved[:, 1]) / (ends[:, 1] - ends[:, 0])))
        if shortening > LARGEST_STEP:
            step *= LARGEST_STEP / shortening
        return step, float(np.abs(scalars).max()), shortening

    def _advance(self, step: Array) -> None:
        """Takes a step; nodes in contact go along the pulley, and those of the free zones follow the ends of contact.

        A straight step leaves the circle, and stretches the belt, by the square of its length. Where a border moves
        through a short zone, the pressure and the friction that would mend this are larger than those by which the next
        step has to place the border.
        """
        (before, touching, after), (center, radius) = self._nodes, self._circle
        arm, moved = self._u[touching] - center, step[touching]
        across = np.stack([-arm[..., 1], arm[..., 0]], axis=2)
        square = (arm**2).sum(axis=2, keepdims=True)
        angle = (moved * across).sum(axis=2, keepdims=True) / square
        new = center + (np.cos(angle) * arm + np.sin(angle) * across) * (radius / np.sqrt(square))
        self._u += step
        bent = new - self._u[touching]
        self._u[before] += self._along[0] * bent[0, 0]
        self._u[after] += self._along[1] * bent[-1, 1]
        self._u[touching] = new

    def _scene_data(self, scene: Scene, state: State) -> None:
        belt, pulley = scene.belt, scene.pulleys[0]
        values = {
            "a": belt.bending_stiffness, "b1": belt.extensional_stiffness, "b2": belt.shear_stiffness,
            "R": pulley.radius, "xc": pulley.center[0], "H": pulley.center[1], "mu": pulley.friction,
            "x_trans": pulley.x_trans if pulley.drive == "x_trans" and not isinstance(pulley.x_trans, str) else 0.0,
            "D_given": pulley.omega * pulley.radius if pulley.drive == "omega" else 1.0,
            "force_given": -pulley.torque / pulley.radius if pulley.drive == "torque" else 0.0,
        }  # fmt: skip
        self.forms.constants.value[:] = [values[name] for name in CONSTANTS]
        self.forms.switches.x.array[:] = self._switches
        self._weights[..., 0], self._weights[..., 1] = 1.0 - state.cells, state.cells
        self._circle = np.array(pulley.center), pulley.radius
        # A free zone follows its moving end as a sheared bar does: by the square of the distance from the clamp.
        place = state.cells[:, :1] + np.diff(state.cells) * points(state.degree)[0]
        before, _, after = np.split(place[..., None], state.mesh.ends[[0, -1]])
        self._along = before**2, (1.0 - after) ** 2


@functools.lru_cache(maxsize=64)
def newton(mesh: Mesh, degree: int, friction: bool, options: tuple[tuple[str, Any], ...]) -> Newton:
    """The iteration on one list of zones, cells and degree; made once in a process."""
    return Newton(mesh, degree, friction, dict(options))


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
