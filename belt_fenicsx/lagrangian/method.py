"""The source's finite element method (18.2): a fixed mesh, and contact multipliers that an outer loop updates.

Where the contact zone ends is not known before, so a fine mesh starts from the solution on a coarser one
(`loop.Run`, on each of them), from which its errors are estimated, too (`accuracy`). Ranks share the meshes that are
large enough for it; small ones the first rank solves alone. The answer is as good as the mesh, which knows the contact
zone to a part of an element.

What the source leaves out, several pulleys, loops, loads, a fibre that touches, speeds and torques, changes what drives
ask for (`drives`); pulleys that a force pushes stand still in one solve and move between two (`take_ups`).
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from mpi4py import MPI

from belt_fenicsx.backend.ranks import agreed, on_first
from belt_fenicsx.lagrangian.accuracy import fields_of, shortcoming, with_errors
from belt_fenicsx.lagrangian.forms import Terms
from belt_fenicsx.lagrangian.loop import Run, Task
from belt_fenicsx.lagrangian.nodes import coarsen, node_positions
from belt_fenicsx.lagrangian.problems import problems, taking_turns
from belt_fenicsx.lagrangian.take_ups import tensioned
from belt_fenicsx.lagrangian.taut import TautBelt
from belt_fenicsx.lagrangian.tolerances import Tolerances
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.scene.units import Units
from belt_fenicsx.solution.certificate import certified, check_transition
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stage, Stages
from belt_fenicsx.solution.status import Status

TOLERANCES = Tolerances()

# Where neither a number of elements nor a mesh is given, the first number is taken for the source's scene. For others
# it is the second for each pulley, or more where their layers ask for them.
ELEMENTS, DRIVE_ELEMENTS = 100, 200

# Errors are estimated from at most HALVINGS coarser meshes of half as many elements each, and of COARSEST at least.
HALVINGS, COARSEST = 2, 8
# A mesh of more than FINE nodes for each pulley starts from one of fewer elements by the factor COARSENING. From the
# string, Newton's iteration would have to move its ends over many small elements; from a coarser mesh over few.
FINE, COARSENING = 200, 4


def solve(
    scene: Scene,
    *,
    elements: int | None = None,
    mesh: Any = None,
    rtol: float = 1e-8,
    comm: MPI.Comm | None = None,
    options: Mapping[str, Any] = MappingProxyType({}),
    initial: Solution | None = None,
    tolerances: Tolerances | None = None,
) -> Solution:
    """Solves a scene on a fixed mesh by the augmented-Lagrangian method (18.2).

    Its arguments are those of `belt_fenicsx.solve`, which checks what all methods share, and ``tolerances``, where
    these are to be others than the method's own.

    Returns:
        The solution, or what there is of it, as its status says, with fields at the clamps and at two Gauss points in
        each element. Its ``measures`` have estimated errors, see `accuracy.errors`; where there is no coarser mesh to
        take them from, a stage says why. Its status is ``ACCURACY_NOT_REACHED`` where the mesh is too coarse, and its
        message says which one would do.

    Raises:
        SceneError: A transition is not in the contact zone, the mesh is none of this belt,
            ranks that solve together ask for different things, or do so from a thread.
    """
    comm = MPI.COMM_WORLD if comm is None else comm
    tolerances = TOLERANCES if tolerances is None else tolerances

    def pose() -> tuple[Task, Units]:
        plain, units = scene.dimensionless()
        taut = TautBelt.of(plain)
        nodes = _nodes(scene, plain, units, taut, elements, mesh)
        start, rate = None, 1.0
        if initial is not None and initial.fields is not None:
            before = initial.scene.dimensionless()[1]
            start, rate = initial.fields.in_units(before.inverse()), initial.transport_rate / before.rate
        return Task(plain, nodes, start, rtol, tuple(options.items()), tolerances, taut, rate), units

    def text(posed: tuple[Task, Units]) -> str:
        # Starts may differ by rounding, so that only whether there is one has to be the same on all ranks.
        task, _ = posed
        return f"{(scene, task.start is None, rtol, task.options, tolerances)!r} {task.nodes.tobytes().hex()}"

    with taking_turns(comm):
        task, units = agreed(comm, pose, text)
        solution = tensioned(task, functools.partial(_solve_on_meshes, comm))
    return _judge(solution.in_units(scene, units), task.nodes * units.length, tolerances)


def _nodes(scene: Scene, plain: Scene, units: Units, taut: TautBelt, elements: int | None, mesh: Any) -> Array:
    """Positions of the nodes ``(elements + 1,)`` in the belt's length; those of a loop as `TautBelt` counts them."""
    if not scene.is_published and mesh is None:
        return taut.nodes(plain, elements or max(DRIVE_ELEMENTS * len(scene.pulleys), taut.elements(plain)))
    nodes = _positions(scene, elements, mesh) / units.length
    return taut.turned_nodes(nodes) if scene.closed else nodes


def _positions(scene: Scene, elements: int | None, mesh: Any) -> Array:
    """Positions of the nodes ``(elements + 1,)`` [m]."""
    if mesh is None:
        return np.linspace(-scene.belt.length / 2, scene.belt.length / 2, (elements or ELEMENTS) + 1)
    if elements is not None:
        raise SceneError("elements", "be left out with a mesh", elements)
    return node_positions(mesh, length=scene.belt.length)


def _solve_on_meshes(comm: MPI.Comm, task: Task) -> Solution:
    """The dimensionless solution on the last of the meshes that lead to it, with its estimated errors; collective."""
    stages, solutions, start, rate = Stages(), [], task.start, task.rate
    for nodes in _coarser_meshes(task):
        solution = _solve_on_ranks(
            comm, task._replace(nodes=nodes, start=start, rate=rate, rtol=task.tolerances.coarse_rtol)
        )
        stages += [replace(stage, name=f"{stage.name}, {len(nodes) - 1} elements") for stage in solution.stages]
        solutions.append(solution)
        if task.start is None:
            start, rate = solution.fields, solution.transport_rate
    solution = _solve_on_ranks(comm, task._replace(start=start, rate=rate))
    stages += solution.stages
    if solution.fields is None and start is not None and task.start is None:
        # Pulleys that a coarse mesh hardly sees may lead a fine one astray.
        solution = _solve_on_ranks(comm, task)
        stages += solution.stages
    finest_first = [solution, *reversed(solutions[-HALVINGS:])]
    usable = list(itertools.takewhile(lambda other: other.status is Status.SOLVED, finest_first))
    if len(usable) > 1:
        solution = with_errors(usable[::-1])
        stages.append(Stage(name="error estimate", why=f"from {len(usable) - 1} coarser meshes", iterations=0))
    elif usable:
        why = f"no answer on a mesh of half as many elements, of which {COARSEST} are the fewest"
        stages.skipped("error estimate", why)
    return replace(solution, stages=tuple(stages), iterations=stages.iterations)


def _coarser_meshes(task: Task) -> list[Array]:
    """Nodes of the coarser meshes on which a solution begins, and from which its errors are estimated."""
    meshes = [task.nodes]
    # With a start as good as another mesh's, each further mesh is one more to pay for.
    while len(meshes) <= (HALVINGS if task.start is None else 1) and len(meshes[0]) > 2 * COARSEST:
        meshes.insert(0, coarsen(meshes[0], 2))
    while task.start is None and len(meshes[0]) > FINE * len(task.scene.pulleys):
        meshes.insert(0, coarsen(meshes[0], COARSENING))
    return meshes[:-1]


def _solve_on_ranks(comm: MPI.Comm, task: Task) -> Solution:
    """The dimensionless solution on one mesh, by all ranks or by the first one; collective."""
    if comm.size == 1 or task.elements >= task.tolerances.shared * comm.size:
        return _solve_on_mesh(task, comm)
    solution = on_first(comm, functools.partial(_solve_on_mesh, task, MPI.COMM_SELF))
    why = f"{task.elements} elements are too few for {comm.size} ranks: the first solves all"
    return replace(solution, stages=(Stage(name="sharing", why=why), *solution.stages))


def _solve_on_mesh(task: Task, comm: MPI.Comm) -> Solution:
    stages = Stages()
    with problems(comm.py2f()).using(task.elements, task.options, Terms.of(task.scene)) as problem:
        stages.ran("set-up", "forms and spaces")
        return Run(problem, task, stages).solve()


def _nodes_of(solution: Solution, nodes: Array) -> Array:
    """Nodes in the coordinate of the solution, to half an element in a loop, where it begins at the first run-up."""
    if not solution.scene.closed:
        return nodes
    weight = fields_of(solution).weight
    half = solution.scene.belt.length / 2.0
    return np.append(0.0, np.cumsum(weight[weight > 0.0]))[::2] - half


def _judge(solution: Solution, nodes: Array, tolerances: Tolerances) -> Solution:
    """Certifies a solution, and takes the success back where the mesh is too coarse."""
    if solution.status is not Status.SOLVED:
        return solution
    for contact in solution.contacts:
        check_transition(solution.scene, contact.x_up, contact.x_off, contact.pulley)
    solution = certified(solution, tolerance=tolerances.margin, balance=tolerances.balance, hub=tolerances.balance)
    message = shortcoming(solution, _nodes_of(solution, nodes), tolerances.largest_error)
    if not message:
        return solution
    status = Status.ACCURACY_NOT_REACHED if solution.success else solution.status
    return replace(solution, status=status, message=message)
