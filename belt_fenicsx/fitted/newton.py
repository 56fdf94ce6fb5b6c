"""Newton's iteration of the fitted method: PETSc SNES, with the linear solves of `elimination`."""

from __future__ import annotations

import functools
import logging
import math
import threading
import weakref
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from petsc4py import PETSc

from belt_fenicsx.backend.petsc_options import PREFIX, set_options
from belt_fenicsx.fitted.cells import Mesh
from belt_fenicsx.fitted.dofs import Terms, local, loose_joint, table
from belt_fenicsx.fitted.elimination import Condensed
from belt_fenicsx.fitted.forms import CHORD, constants_of, forms, pulley_data, switches_of
from belt_fenicsx.fitted.geometry import Geometry
from belt_fenicsx.fitted.state import State
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layout import BEFORE
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene

logger = logging.getLogger(__name__)

# A step takes at most this part from the length of a zone; a longer one is shortened.
LARGEST_STEP = 0.5
# The last step takes at most this part from the length of a zone.
SETTLED = 0.1
# A step that takes at most this part from the length of a zone moves nodes on the pulley straight ahead.
STRAIGHT = 0.02
# SNES ends after this number of iterations.
MOST_ITERATIONS = 30
# The iteration on at most this number of cells is kept for the next scene.
KEPT = 300
# Iterations and PETSc's solvers are shared by all solves of the process, of which one thread at a time is at work here:
# Python's own lock would let another one in between two steps.
TURNS = threading.RLock()


class Iteration:
    """Newton's iteration on the residual of one list of zones, cells and degree.

    It is a type of SNES, with SNES's options and monitors, that is written here: the callbacks of PETSc's own type took
    a third of a step's time. The Jacobian is never a PETSc matrix: PETSc's own LU meets zero pivots here, and MUMPS,
    the one sparse solver with pivoting that all builds of PETSc have, took 0.7 to 2 ms for a step where the elimination
    cell by cell takes 0.1 to 0.3 ms.

    Attributes:
        values: Unknowns of each cell ``(n, dofs)``, as in a state, but for theta, of which they are what it is more
            than the angle of the cell's frame, and for displacements, of which they are what is not yet in the chords.
        pulleys: Data of the pulley at each cell ``(n, len(pulley_data))``.
        ends: Ends of the zones ``(z + 1,)``.
        condensed: Solves for the step.
        residuals: Computes the residual of each cell.
        jacobians: Computes the Jacobian of each cell.
    """

    def __init__(self, mesh: Mesh, degree: int, terms: Terms, moving: tuple[int, ...]) -> None:
        self.condensed = Condensed(table(mesh, degree, terms, moving))
        jacobians, residuals = self.condensed.cells
        (n, dofs), on = residuals.shape, switches(mesh, terms).reshape(mesh.zone.size, -1)
        sizes = dofs, on.shape[1], len(CHORD), len(pulley_data(terms))
        coefficients, self._constants = np.empty((n, sum(sizes))), np.zeros(len(constants_of(terms)))
        self.values, switched, _, self.pulleys = np.split(coefficients, np.cumsum(sizes[:-1]), axis=1)
        switched[:] = on
        compiled = forms(degree, terms)
        self.residuals = compiled.F.on(residuals, coefficients, self._constants)
        self.jacobians = compiled.J.on(jacobians.reshape(n, -1), coefficients, self._constants)
        self._geometry = Geometry(mesh, degree, terms.loads, coefficients, sum(sizes[:2]))
        at = local(degree)
        self._positions, self._others, self._sigma = at.r, slice(at.theta.start, None), at.sigma
        self._move, self._length, self._mesh = at.move, at.sigma.stop - 1, mesh

    def load(
        self, scene: Scene, state: State, arrived: float, *, fixed_joints: bool = False, monitored: bool = False
    ) -> None:
        """Sets the parameters of a scene, the state to start from, and when to end.

        Args:
            scene: The dimensionless scene.
            state: Where it starts.
            arrived: Largest step of a joint, in lengths of the shortest cell, or of the stretch in stick, at which the
                iteration ends.
            fixed_joints: Whether the first step holds the joints, so that all others know the forces that move them.
            monitored: Whether the norm of the residual is asked for.
        """
        self._constants[:] = constants(scene, state.terms)
        self.pulleys[:] = np.array([driven(pulley, state.terms) for pulley in scene.pulleys])[self._mesh.pulley]
        self._arrived, self._fixed_joints, self._missing = arrived, fixed_joints, 0.0
        self._monitored = monitored or logger.isEnabledFor(logging.INFO)
        self.values[:], self.ends, self._share = state.values, state.ends, state.cells[:, 1] - state.cells[:, 0]
        self._moves = self.values[:, self._move].copy()
        self.values[:, self._move] = 0.0
        self._geometry.load(scene, state)

    def solve(self, snes: PETSc.SNES, _b: PETSc.Vec, _x: PETSc.Vec) -> None:
        """The iteration; called by SNES."""
        reasons = PETSc.SNES.ConvergedReason
        for iteration in range(snes.max_it):
            self.residuals()
            residual = self.condensed.residual_norm() if self._monitored else 0.0
            if self._monitored:
                snes.monitor(iteration, residual)
            self.jacobians()
            fixed_joints = self._fixed_joints and iteration == 0
            step, scalars = self.linear_step(fixed_joints)
            change = float(np.abs(scalars).max())
            snes.setIterationNumber(iteration + 1)
            if not math.isfinite(change):
                return snes.setConvergedReason(reasons.DIVERGED_LINEAR_SOLVE)
            step, shortening = self._move_joints(step, scalars[: self.condensed.table.joints.size])
            if self._monitored:
                joints = " ".join(f"{end:.6f}" for end in self.ends[1:-1])
                numbers = iteration, residual, change, joints
                logger.info("iteration %d: residual %.1e, step %.1e, joints %s Ls", *numbers)
            shortest = self.values[:, self._length].min()
            arrived = change <= self._arrived * shortest and shortening <= SETTLED and not fixed_joints
            self._move_nodes(step, bent=shortening > STRAIGHT and not arrived)
            if arrived:
                return snes.setConvergedReason(reasons.CONVERGED_SNORM_RELATIVE)
            self._geometry.measure()
        snes.setConvergedReason(reasons.DIVERGED_MAX_IT)

    def state(self, start: State) -> State:
        """The state where it stands, which is of the kind of the one that it started from."""
        values = self.values.copy()
        values[:, self._move] = self._moves
        chords = self._geometry.put_together(values)
        return replace(start, ends=self.ends, chords=chords, values=values, missing=self._missing)

    def linear_step(self, fixed_joints: bool) -> tuple[Array, Array]:
        """The step of each cell's dofs, but for sigma, and of the scalars; not finite where there is none."""
        jacobians, sigma = self.condensed.cells[0], self._sigma
        # Equations depend on sigma by its slope alone; so a derivative by an end of the zone is as large a part of that
        # by the same end of the cell as the cell is of the zone.
        for end in (sigma.start, sigma.stop - 1):
            jacobians[:, :, end] *= self._share[:, None]
        if self.condensed.table.forced is not None:
            self._force_last_span(jacobians)
        try:
            step, scalars = self.condensed.step(fixed_joints=fixed_joints)
        except np.linalg.LinAlgError:
            return np.full(self.values.shape, math.nan), np.full(1, math.nan)
        step[:, sigma] = 0.0
        if self.condensed.table.forced is not None:
            # The residual is without this force, and linear in it: a step has all of it.
            (at,) = np.flatnonzero(self.condensed.table.scalars == self.condensed.table.forced)
            self._missing, scalars[at] = float(scalars[at]), 0.0
        return step, scalars

    def _force_last_span(self, jacobians: Array) -> None:
        """Puts a force along the belt, in the middle of the last span, in place of the way of the joint behind it."""
        sigma, last = self._sigma, self._mesh.cells(len(self._mesh.layout.parts) - 1)
        jacobians[self._mesh.cells(0), :, sigma.start] = 0.0
        jacobians[last, :, sigma.stop - 1] = 0.0
        # At the left node of a cell: a pulley's own multipliers would take it up.
        cell, at = (last.start + last.stop) // 2, slice(self._positions.start, self._positions.start + 2)
        chord = self._geometry.chords[cell, 1]
        along = chord / abs(chord)
        jacobians[cell, at, sigma.stop - 1] = -along.real, -along.imag

    def _move_joints(self, step: Array, joints: Array) -> tuple[Array, float]:
        """Moves the joints by a step, shortened where one would come too close to the next one.

        Returns:
            The step of the cells, shortened alike, and the largest part that the full step takes from a zone.
        """
        way = np.zeros(self.ends.size)
        # A loop begins where it does.
        way[1:-1] = joints[: way.size - 2]
        shortening = float(((way[:-1] - way[1:]) / (self.ends[1:] - self.ends[:-1])).max())
        if shortening > LARGEST_STEP:
            step, way = step * (LARGEST_STEP / shortening), way * (LARGEST_STEP / shortening)
        self.ends = self.ends + way
        # Not from the new ends: what their rounding takes from the length of a short zone would be a strain there.
        self.values[:, self._length] += (way[1:] - way[:-1])[self._mesh.zone] * self._share
        return step, shortening

    def _move_nodes(self, step: Array, *, bent: bool) -> None:
        """Takes the step of the cells; the way of nodes on the pulley may be bent to it."""
        move = step[:, self._move]
        self._geometry.move(step[:, self._positions].view(complex), move, bent=bent)
        self.values[:, self._others] += step[:, self._others]
        # The chords are seen from where the pulleys are now.
        self.values[:, self._move] = 0.0
        self._moves += move


def iteration_on(mesh: Mesh, degree: int, terms: Terms, moving: tuple[int, ...] = ()) -> Iteration:
    """The iteration on one list of zones, cells and degree; made once in a process where the cells are not many."""
    # A cell takes some 60 kB. With many of them, making it anew takes less time than the solve.
    make = _iteration_on if mesh.zone.size <= KEPT else Iteration
    return make(mesh, degree, terms, moving)


@functools.lru_cache(maxsize=48)
def _iteration_on(mesh: Mesh, degree: int, terms: Terms, moving: tuple[int, ...]) -> Iteration:
    return Iteration(mesh, degree, terms, moving)


class Newton:
    """SNES for solves with the same options."""

    def __init__(self, options: Mapping[str, Any]) -> None:
        self._x, self._b = (PETSc.Vec().createSeq(1, comm=PETSc.COMM_SELF) for _ in range(2))
        self.snes = PETSc.SNES().create(PETSc.COMM_SELF)
        self.snes.setType("python")
        self.snes.setFunction(lambda *_: None, self._b)
        self.snes.setTolerances(max_it=MOST_ITERATIONS)
        set_options(self.snes, {}, options)
        asked = {*PETSc.Options(PREFIX).getAll(), *options}
        self._monitored = any(name.startswith("snes_monitor") for name in asked)
        # With this object, and at the latest when Python ends: PETSc ends after it, when the iteration is gone.
        weakref.finalize(self, self.snes.destroy)

    def solve(self, scene: Scene, start: State, arrived: float, *, fixed_joints: bool = False) -> tuple[State, int]:
        """Iterates until a step is below ``arrived``, and small against the zones that it shortens.

        Returns:
            The new state, and the number of iterations; negative where they did not converge.
        """
        with TURNS:
            moving = tuple(index for index, pulley in enumerate(scene.pulleys) if pulley.take_up)
            iteration = iteration_on(start.mesh, start.degree, start.terms, moving)
            iteration.load(scene, start, arrived, fixed_joints=fixed_joints, monitored=self._monitored)
            self.snes.setPythonContext(iteration)
            self.snes.solve(None, self._x)
            iterations = self.snes.getIterationNumber()
            return iteration.state(start), iterations if self.snes.getConvergedReason() > 0 else -iterations


def newton(options: tuple[tuple[str, Any], ...]) -> Newton:
    """The solver with these options; made once in a process."""
    with TURNS:
        return _newton(options)


@functools.lru_cache(maxsize=8)
def _newton(options: tuple[tuple[str, Any], ...]) -> Newton:
    return Newton(dict(options))


def constants(scene: Scene, terms: Terms) -> list[float]:
    """The constants of the forms."""
    belt, (x, y) = scene.belt, scene.gravity
    values = [belt.bending_stiffness, belt.extensional_stiffness, belt.shear_stiffness]
    if terms.loads:
        values += [belt.line_density, belt.rotary_inertia, belt.line_density * x, belt.line_density * y]
    return [*values, belt.contact_offset] if terms.offset else values


def driven(pulley: Pulley, terms: Terms) -> list[float]:
    """What the forms know of a pulley."""
    values = [pulley.radius, pulley.friction, pulley.turn, given(pulley)]
    if not terms.loads:
        return values
    return [*values, pulley.drag / pulley.radius**2, *pulley.direction, pulley.force or 0.0]


def given(pulley: Pulley) -> float:
    """What the drive gives, as the forms compare it.

    It is the transition, the elongation in stick at unit transport rate, the friction force or the slip angle.
    """
    match pulley.drive.kind:
        case "omega":
            return pulley.surface_speed - 1.0
        case "torque":
            return -pulley.drive.by("torque") / pulley.radius
        case "slip_angle":
            return pulley.drive.by("slip_angle")
        case _:
            # Where the belt sticks or slides all along, no joint lies at a given place.
            return pulley.x_trans - pulley.center[0] if isinstance(pulley.x_trans, float) else 0.0


def switches(mesh: Mesh, terms: Terms) -> Array:
    """Which equations hold where ``(n, 2, len(switches_of(terms)))``."""
    column = {name: index for index, name in enumerate(switches_of(terms))}
    on, layout = np.zeros((mesh.zone.size, 2, len(column))), mesh.layout
    parts, loose = layout.parts, loose_joint(layout, terms.loads)
    on[:, :, column["touch"]] = mesh.touches[:, None]
    on[:, :, column["stick"]] = np.array([part.kind == "stick" for part in parts])[mesh.zone, None]
    on[:, :, column["sense"]] = np.array([part.sense for part in parts])[mesh.zone, None]
    for index, joint in enumerate(layout.joints):
        before, after = index, (index + 1) % len(parts)
        if index == loose:
            continue
        here = (mesh.cells(before).stop - 1, 1) if joint.side == BEFORE else (mesh.cells(after).start, 0)
        on[here][column["stretch" if joint.equation == "angle" else joint.equation]] = 1.0
        if joint.equation == "coulomb":
            # Friction in stick is that of the sliding before it, but opposes the sliding that begins after it.
            on[here][column["sense"]] = -parts[after].sense if joint.side == BEFORE else parts[before].sense
    for pulley, speed in zip(layout.pulleys, layout.speeds, strict=True):
        place = mesh.cells(speed.joint % len(parts)).stop - 1, 1
        on[place][column["surface"]] = 1.0
        on[mesh.pulley == pulley, :, column["force"]] = speed.equation == "torque"
        if terms.loads:
            on[place][column["take_up"]] = 1.0
            on[place][column["runs"]] = speed.equation == "loop" and layout.rate
            transition = layout.transition(pulley)
            if layout.joints[transition].equation == "angle":
                on[place][column["surface"]], on[place][column["angle"]] = 0.0, 1.0
                behind = slice(mesh.cells(transition).stop, mesh.cells(layout.on(pulley)[-1]).stop)
                on[behind, :, column["behind"]] = 1.0
    return on
