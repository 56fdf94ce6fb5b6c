"""Newton's iteration of the fitted method: PETSc SNES, with the linear solves of `condensed`."""

from __future__ import annotations

import atexit
import functools
import logging
import math
import threading
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from petsc4py import PETSc

from belt_fenicsx.condensed import Condensed, local
from belt_fenicsx.fields import Array
from belt_fenicsx.fitted_forms import CHORD, CONSTANTS, SWITCHES, forms, points
from belt_fenicsx.fitted_state import State, on_chords, sum_error
from belt_fenicsx.petsc_options import PREFIX, set_options
from belt_fenicsx.scene import Scene
from belt_fenicsx.zones import BEFORE, Mesh

logger = logging.getLogger(__name__)

LARGEST_STEP = 0.5  # of a border, in lengths of a zone that it shortens
MOST_ITERATIONS = 30
STRAIGHT = 0.02  # of the same, up to which the way of nodes on the pulley may be straight
FRAMES = 2.0**20  # to a radian: angles to which frames of cells are rounded
SETTLED = 0.1  # of the same, that the last step may take
# Iterations and PETSc's solvers are shared by all solves of the process, of which one thread at a time is at work here:
# Python's own lock would let another one in between two steps.
TURNS = threading.RLock()


class Iteration:
    """Newton's iteration on the residual of one list of zones, cells and degree.

    It is a type of SNES, with SNES's options and monitors, that is written here: the callbacks of PETSc's own type took
    a third of a step's time. The Jacobian is never a PETSc matrix: PETSc's own LU meets zero pivots here, and MUMPS,
    the one sparse solver with pivoting that all builds of PETSc have, took 0.7 to 2 ms for a step where the elimination
    cell by cell in `condensed` took 0.3 to 1 ms.

    Attributes:
        values: Unknowns of each cell ``(n, 5 k + 6)``, as in a state, but for theta, of which they are what it is more
            than the angle of the cell's frame, and for the stretch in stick, of which they are the elongation.
        chords: Data of each cell's chord ``(n, len(CHORD))``.
        ends: Ends of the zones ``(z + 1,)``.
        residuals: Computes the residual of each cell.
        jacobians: Computes the Jacobian of each cell.
    """

    def __init__(self, mesh: Mesh, degree: int, friction: bool) -> None:
        self.condensed = Condensed(mesh, degree, friction)
        (n, dofs), on = self.condensed.numbers.shape, switches(mesh).reshape(mesh.zone.size, -1)
        coefficients = np.empty((n, dofs + on.shape[1] + len(CHORD)))
        self.values, switched, self.chords = np.split(coefficients, [dofs, dofs + on.shape[1]], axis=1)
        # In the complex plane, a turn is a product.
        self._positions = slice(2 * (degree + 1))
        self._deviation, self._chords = self.values[:, self._positions].view(complex), self.chords[:, :4].view(complex)
        switched[:] = on
        self._constants = np.zeros(len(CONSTANTS))
        compiled, (jacobians, residuals) = forms(degree, friction), self.condensed.cells
        self.residuals = compiled.F.on(residuals, coefficients, self._constants)
        self.jacobians = compiled.J.on(jacobians.reshape(n, -1), coefficients, self._constants)
        at = local(degree)
        self._touches = mesh.touches
        self._zone, self._length, self._nodes = mesh.zone, at.sigma[1], points(degree)[0]
        self._turn, self._elongation = slice(at.theta[0], at.theta[-1] + 1), at.D[0]
        self._before, self._after = slice(mesh.ends[0]), slice(mesh.ends[-1], n)
        self._contact = slice(mesh.ends[0], mesh.ends[-1])
        self._weights = np.empty((n, 2, 2))

    def load(self, scene: Scene, state: State, arrived: float, *, held: bool = False, monitored: bool = False) -> None:
        """Sets the parameters of a scene, the state to start from, and when to end.

        Args:
            scene: The dimensionless scene.
            state: Where it starts.
            arrived: Largest step of a border, in lengths of the shortest cell, or of the stretch in stick, at which the
                iteration ends.
            held: Whether the first step holds the borders, so that all others know the forces that move them.
            monitored: Whether the norm of the residual is asked for.
        """
        belt, pulley = scene.belt, scene.pulleys[0]
        given = {
            "a": belt.bending_stiffness, "b1": belt.extensional_stiffness, "b2": belt.shear_stiffness,
            "R": pulley.radius, "mu": pulley.friction,
            "x_trans": 0.0 if pulley.x_trans is None or isinstance(pulley.x_trans, str) else
                pulley.x_trans - pulley.center[0],
            "elongation_given": pulley.omega * pulley.radius - 1.0 if pulley.drive == "omega" else 0.0,
            "force_given": -pulley.torque / pulley.radius if pulley.drive == "torque" else 0.0,
        }  # fmt: skip
        self._constants[:] = [given[name] for name in CONSTANTS]
        self._radius = pulley.radius
        self._arrived, self._held, self._monitored = arrived, held, monitored
        self.values[:], self.chords[:, :4], self.ends, self._cells = state.values, state.chords, state.ends, state.cells
        self.values[:, self._elongation] -= 1.0
        # Rounded so that cells that meet at a node agree on its angle to the last bit.
        turn = self.values[:, self._turn]
        self._frame = np.round(turn[:, 0] * FRAMES) / FRAMES
        turn -= self._frame[:, None]
        self._axis = np.exp(1j * self._frame.astype(np.longdouble))
        self.chords[:, 6], self.chords[:, 7] = self._axis.real, self._axis.imag
        self._bulge = self._arcs()
        self.chords[:, 11], self.chords[:, 12] = self._bulge.real, self._bulge.imag
        self._deviation -= self._over_chords()
        self._measure()
        self._weights[..., 0], self._weights[..., 1] = 1.0 - state.cells, state.cells

    def solve(self, snes: PETSc.SNES, _b: PETSc.Vec, _x: PETSc.Vec) -> None:
        """The iteration; called by SNES."""
        reasons = PETSc.SNES.ConvergedReason
        reason, held = reasons.DIVERGED_MAX_IT, self._held
        watched = self._monitored or logger.isEnabledFor(logging.INFO)
        for iteration in range(snes.max_it):
            self.residuals()
            if watched:
                residual = self.condensed.residual_norm()
                snes.monitor(iteration, residual)
            self.jacobians()
            try:
                step, scalars = self.condensed.step(self._weights, held=held)
                change = float(np.abs(scalars).max())
            except np.linalg.LinAlgError:
                change = math.nan
            snes.setIterationNumber(iteration + 1)
            if not math.isfinite(change):
                reason = reasons.DIVERGED_LINEAR_SOLVE
                break
            moved, shortening = self._moved(step, scalars[:-1])
            if watched:
                borders = " ".join(f"{end:.6f}" for end in self.ends[1:-1])
                logger.info(
                    "iteration %d: residual %.1e, step %.1e, borders %s Ls", iteration, residual, change, borders
                )
            if change <= self._arrived * self.values[:, self._length].min() and shortening <= SETTLED and not held:
                reason = reasons.CONVERGED_SNORM_RELATIVE
                break
            if shortening > STRAIGHT:
                self._onto_pulley(moved)
            self._measure()
            held = False
        snes.setConvergedReason(reason)

    def state(self, start: State) -> State:
        """The state where it stands, which is of the kind of the one that it started from."""
        values = self.values.copy()
        values[:, self._turn] += self._frame[:, None]
        values[:, self._elongation] += 1.0
        values[:, self._positions].view(complex)[:] += self._over_chords()
        return replace(start, ends=self.ends, chords=self.chords[:, :4].copy(), values=values)

    def _arcs(self) -> Array:
        """Bulge of the parabola over each chord that is as high as the pulley's arc, in the complex plane ``(n,)``."""
        arm, along = self._chords.T
        length = np.abs(along)
        depth = np.sqrt(np.maximum(self._radius**2 - (length / 2) ** 2, 0.0))
        outwards = 1j * along / length
        side = np.sign((outwards * arm.conj()).real)
        return np.where(self._touches, side * length**2 / (self._radius + depth), 0.0) * outwards

    def _over_chords(self) -> Array:
        """The parabolas over the chords, at the nodes, in the complex plane ``(n, k + 1)``."""
        return self._bulge[:, None] * (self._nodes * (1.0 - self._nodes))

    def _measure(self) -> None:
        """Computes the chords' small differences of large numbers to less than the rounding error of these.

        NumPy's long double has eleven bits more than a double on x86, and never fewer.
        """
        length = self.values[:, self._length]
        arm, along = self._chords.T.astype(np.clongdouble)
        q = along * self._axis.conj() / length - 1.0
        for column, end in ((4, arm), (5, arm + along)):
            self.chords[:, column] = np.longdouble(self._radius) ** 2 - end.real**2 - end.imag**2
        self.chords[:, 8], self.chords[:, 9], self.chords[:, 10] = q.real, q.imag, length
        over = self._bulge.conj()
        self.chords[:, 13] = along.real**2 + along.imag**2 - 2.0 * (over * arm).real
        self.chords[:, 14] = (over * along).real

    def _moved(self, step: Array, borders: Array) -> tuple[Array, float]:
        """Takes a step, shortened where a border would come too close to the next one.

        Returns:
            The step of the nodes, in the complex plane ``(n, k + 1)``, and the largest part that the full step takes
            from a zone.
        """
        way = np.zeros(self.ends.size)
        way[1:-1] = borders
        shortening = float(((way[:-1] - way[1:]) / (self.ends[1:] - self.ends[:-1])).max())
        if shortening > LARGEST_STEP:
            step, way = step * (LARGEST_STEP / shortening), way * (LARGEST_STEP / shortening)
        self.ends = self.ends + way
        moved, others = step[:, self._positions].view(complex), slice(self._positions.stop, None)
        self._shifted(moved)
        self.values[:, others] += step[:, others]
        lengths = (self.ends[1:] - self.ends[:-1])[self._zone]
        self.values[:, self._length] = lengths * (self._cells[:, 1] - self._cells[:, 0])
        return moved, shortening

    def _shifted(self, shift: Array) -> None:
        """Shifts nodes, in the complex plane ``(n, k + 1)``; what sums lose by rounding is kept in the deviation."""
        change = shift[:, :2].copy()
        change[:, 1] -= shift[:, 0]
        chords = self._chords + change
        lost = sum_error(self._chords, change, chords)
        deviation = shift - on_chords(change, self._nodes)
        deviation[:, 0], deviation[:, 1] = 0.0, sum_error(shift[:, 1], -shift[:, 0], change[:, 1])
        self._deviation += deviation + on_chords(lost, self._nodes)
        self._chords[:] = chords

    def _onto_pulley(self, moved: Array) -> None:
        """Bends the way of nodes that moved on the pulley to the pulley, and lets the free zones follow its ends.

        A straight step leaves the circle, and stretches the belt, by the square of its length. Where a border moves
        through a short zone, the pressure and the friction that would mend this are larger than those by which the next
        step has to place the border.

        Args:
            moved: Step of the nodes, in the complex plane ``(n, k + 1)``.
        """
        contact, shift = self._contact, np.empty_like(moved)
        straight = moved[contact]
        on_parabolas = on_chords(self._chords[contact], self._nodes) + self._over_chords()[contact]
        arm = on_parabolas + self._deviation[contact] - straight
        distance = np.abs(arm)
        turn = np.exp(1j * (straight * arm.conj()).imag / distance**2)
        shift[contact] = arm * (turn * (self._radius / distance) - 1.0) - straight
        # A free zone follows its moving end as a sheared bar does: by the square of the distance from the clamp.
        place = self._cells[:, :1] + (self._cells[:, 1:] - self._cells[:, :1]) * self._nodes
        shift[self._before] = place[self._before] ** 2 * shift[contact][0, 0]
        shift[self._after] = (1.0 - place[self._after]) ** 2 * shift[contact][-1, 1]
        # Cells that meet at a node shift it alike, to the last bit.
        shift[1:, 0] = shift[:-1, 1]
        self._shifted(shift)


@functools.lru_cache(maxsize=64)
def iteration_on(mesh: Mesh, degree: int, friction: bool) -> Iteration:
    """The iteration on one list of zones, cells and degree; made once in a process."""
    return Iteration(mesh, degree, friction)


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
        # PETSc itself ends after Python, when the iteration, which is in Python, is gone.
        atexit.register(self.snes.destroy)

    def solve(self, scene: Scene, start: State, arrived: float, *, held: bool = False) -> tuple[State, int]:
        """Iterates until a step is below ``arrived``, and small against the zones that it shortens.

        Returns:
            The new state, and the number of iterations; negative where they did not converge.
        """
        with TURNS:
            iteration = iteration_on(start.mesh, start.degree, scene.pulleys[0].friction > 0.0)
            iteration.load(scene, start, arrived, held=held, monitored=self._monitored)
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
