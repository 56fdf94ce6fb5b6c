"""The source's finite element method (18.2): a fixed mesh, and contact multipliers that an outer loop updates.

Where the borders of the contact zone are is not known before, so a fine mesh starts from the solution on a coarser one
(`lagrangian_run`, on each of them), from which its errors are estimated, too (`lagrangian_accuracy`). Ranks share the
meshes that are large enough for it; small ones the first rank solves alone. The answer is as good as the mesh, which
knows the contact zone to a part of an element.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from mpi4py import MPI

from belt_fenicsx.backend.ranks import agreed, on_first
from belt_fenicsx.lagrangian import reading as recognition
from belt_fenicsx.lagrangian.accuracy import OMEGA, errors, errors_of_fields, shortcoming
from belt_fenicsx.lagrangian.loop import NAME, Run
from belt_fenicsx.lagrangian.multipliers import Penalties
from belt_fenicsx.lagrangian.nodes import node_positions
from belt_fenicsx.lagrangian.problems import Options, problems, taking_turns
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.scene.units import Units
from belt_fenicsx.solution.certificate import certified, check_transition
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stage, Stages
from belt_fenicsx.solution.status import Status

DEFAULT = 100  # elements
FINE, COARSENING, COARSE_RTOL = 200, 4, 1e-6
HALVINGS, COARSEST = 2, 8  # coarser meshes for the estimated errors, and their fewest elements
SHARED = 1000  # elements of a rank, from which on ranks that share a mesh are faster than one of them alone


def solve(
    scene: Scene,
    *,
    elements: int | None = None,
    mesh: Any = None,
    rtol: float = 1e-8,
    penalty_scale: float = 1.0,
    comm: MPI.Comm | None = None,
    options: Mapping[str, Any] = MappingProxyType({}),
    initial: Solution | None = None,
) -> Solution:
    """Solves a scene on a fixed mesh by the augmented-Lagrangian method (18.2).

    Args:
        scene: The scene; its pulley is driven by ``x_trans``.
        elements: Number of equal elements; 100 where neither they nor a mesh are given.
        mesh: Nodes of a mesh of other elements, as positions ``(n,)`` [m] or a file, see `node_positions`.
        rtol: Relative change of omega that the last updates may still make; its error is the mesh's.
        penalty_scale: Factor on the full penalty, which is chosen from the scene's stiffnesses.
        comm: MPI communicator; all ranks by default.
        options: PETSc options of the Newton solver, without their prefix ``belt_``; the command line's go first.
        initial: A solution to start from, of any method; the first phase is then left out.

    Returns:
        The solution, or what there is of it, as its status says, with fields at the clamps and at two Gauss points in
        each element. Its ``measures`` have estimated errors, see `accuracy.errors`; where there is no coarser mesh to
        take them from, a stage says why. Its status is ``ACCURACY_NOT_REACHED`` where the mesh is too coarse, and its
        message says which one would do.

    Raises:
        SceneError: The pulley is driven in another way, the transition is not in the contact zone, the mesh is none of
            this belt, ranks that solve together ask for different things, or do so from a thread.
    """
    comm = MPI.COMM_WORLD if comm is None else comm
    ask = functools.partial(_Asked.of, scene, elements, mesh, rtol, penalty_scale, options, initial)
    with taking_turns(comm):
        asked = agreed(comm, ask, _Asked.told)
        solution = _on_meshes(comm, asked)
    solution = solution.in_units(scene, asked.units)
    if solution.status is Status.SOLVED:
        check_transition(scene, solution.contacts[0].x_up, solution.contacts[0].x_off)
        solution = certified(solution, tolerance=recognition.TOLERANCE, balance=recognition.BALANCE)
        solution = _resolved(solution, asked.nodes * asked.units.length)
    return solution


@dataclass(frozen=True)
class _Asked:
    """What is to be solved, checked.

    Attributes:
        scene: The scene as it was given.
        plain: The dimensionless scene.
        units: Units of the scene.
        nodes: Dimensionless positions of the nodes ``(elements + 1,)``.
        start: Dimensionless fields to start from; None for the taut string.
        rtol: Relative change of omega that the last updates may still make.
        penalty_scale: Factor on the full penalty.
        options: The caller's PETSc options, in alphabetical order.
    """

    scene: Scene
    plain: Scene
    units: Units
    nodes: Array
    start: Fields | None
    rtol: float
    penalty_scale: float
    options: Options

    @classmethod
    def of(
        cls,
        scene: Scene,
        elements: int | None,
        mesh: Any,
        rtol: float,
        penalty_scale: float,
        options: Mapping[str, Any],
        initial: Solution | None,
    ) -> _Asked:
        """Checks the arguments of `solve`.

        Raises:
            SceneError: One of them cannot be meant.
        """
        pulley = scene.pulleys[0]
        if pulley.drive.kind != "x_trans":
            expected = f"be left out with the method {NAME}, which needs `x_trans`"
            raise SceneError(f"pulleys.0.{pulley.drive.kind}", expected, pulley.drive.value)
        plain, units = scene.dimensionless()
        nodes = _nodes(scene, elements, mesh) / units.length
        start = None
        if initial is not None and initial.fields is not None:
            start = initial.fields.in_units(initial.scene.dimensionless()[1].inverse())
        return cls(scene, plain, units, nodes, start, rtol, penalty_scale, tuple(options.items()))

    def told(self) -> str:
        """What has to be the same on all ranks; of the start, which rounding may tell apart, whether there is one."""
        given = (self.scene, self.start is None, self.rtol, self.penalty_scale, self.options)
        return f"{given!r} {self.nodes.tobytes().hex()}"


def _on_meshes(comm: MPI.Comm, asked: _Asked) -> Solution:
    """The dimensionless solution on the last of the meshes that lead to it, with its estimated errors; collective."""
    from_string, start = asked.start is None, asked.start
    stages, found = Stages(), []
    meshes = _coarser_meshes(asked.nodes, from_string=from_string)
    for nodes in meshes:
        last, count = nodes is meshes[-1], len(nodes) - 1
        on_mesh = functools.partial(_on_mesh, asked, nodes, start, asked.rtol if last else COARSE_RTOL)
        if comm.size == 1 or count >= SHARED * comm.size:
            solution, own = on_mesh(comm), []
        else:
            solution = on_first(comm, functools.partial(on_mesh, MPI.COMM_SELF))
            why = f"{count} elements are too few for {comm.size} ranks: the first solves all"
            own = [Stage(name="sharing", why=why)]
        own += solution.stages
        stages += own if last else [replace(stage, name=f"{stage.name}, {count} elements") for stage in own]
        found.append(solution)
        if from_string:
            start = solution.fields
    return replace(_with_errors(found, stages), stages=tuple(stages), iterations=stages.iterations)


def _coarser_meshes(nodes: Array, *, from_string: bool) -> list[Array]:
    """The mesh, behind coarser ones on which its solution begins and from which its errors are estimated."""
    meshes = [nodes]
    # With a start as good as another mesh's, each further mesh is one more to pay for.
    while len(meshes) <= (HALVINGS if from_string else 1) and len(meshes[0]) > 2 * COARSEST:
        meshes.insert(0, _coarser(meshes[0], 2))
    # From the string, Newton has to move the borders over many small elements; from a coarser mesh over few.
    while from_string and len(meshes[0]) > FINE:
        meshes.insert(0, _coarser(meshes[0], COARSENING))
    return meshes


def _with_errors(found: list[Solution], stages: Stages) -> Solution:
    """The last of the solutions with its estimated errors, from those before it."""
    solution, name = found[-1], "error estimate"
    if solution.status is not Status.SOLVED:
        return solution
    usable = list(itertools.takewhile(lambda one: one.status is Status.SOLVED, reversed(found[-1 - HALVINGS :])))[::-1]
    if len(usable) == 1:
        stages.skipped(name, f"no answer on a mesh of half as many elements, of which {COARSEST} are the fewest")
        return solution
    measures = errors(usable)
    stages.append(Stage(name=name, why=f"from {len(usable) - 1} coarser meshes", iterations=0))
    return replace(
        solution,
        error_estimate=measures[OMEGA],
        field_errors=errors_of_fields(solution, measures[OMEGA]),
        measures={**solution.measures, **measures},
    )


def _resolved(solution: Solution, nodes: Array) -> Solution:
    """Takes the success back where the mesh is too coarse, and says so."""
    message = shortcoming(solution, nodes)
    if not message:
        return solution
    status = Status.ACCURACY_NOT_REACHED if solution.success else solution.status
    return replace(solution, status=status, message=message)


def _on_mesh(asked: _Asked, nodes: Array, start: Fields | None, rtol: float, comm: MPI.Comm) -> Solution:
    """The dimensionless solution on one mesh."""
    scene, stages = asked.plain, Stages()
    penalties = Penalties.of(scene, float(np.min(np.diff(nodes))), asked.penalty_scale)
    frictional = scene.pulleys[0].friction > 0.0
    with problems(comm.py2f()).using(len(nodes) - 1, asked.options, frictional=frictional) as problem:
        stages.ran("set-up", "forms and spaces")
        return Run(problem, scene, nodes, penalties, stages).solve(start, rtol)


def _nodes(scene: Scene, elements: int | None, mesh: Any) -> Array:
    """Positions of the nodes ``(elements + 1,)`` [m]."""
    length = scene.belt.length
    if mesh is not None:
        if elements is not None:
            raise SceneError("elements", "be left out with a mesh", elements)
        return node_positions(mesh, length=length)
    elements = elements or DEFAULT
    return np.linspace(-length / 2, length / 2, elements + 1)


def _coarser(nodes: Array, factor: int) -> Array:
    """Nodes of fewer cells, graded alike."""
    last = len(nodes) - 1
    return np.interp(np.linspace(0.0, last, last // factor + 1), np.arange(last + 1), nodes)
