"""Before all methods: what is checked first, which one answers, and which one helps it out."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

from belt_fenicsx.backend import interrupts
from belt_fenicsx.backend.ranks import agreed, start_alone
from belt_fenicsx.scene.checks import (
    FEWEST_ELEMENTS,
    SceneError,
    named_options,
    relative_tolerance,
    whole_number,
)
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stages
from belt_fenicsx.solution.status import BLIND, UNFINISHED, Status, finish
from belt_fenicsx.taut_string.hints import hints
from belt_fenicsx.taut_string.straight import straight_belt, touches

if TYPE_CHECKING:
    from mpi4py import MPI


class Method(NamedTuple):
    """A way to solve a scene.

    Attributes:
        module: The module whose ``solve`` does it.
        shared: Whether the ranks of a communicator solve one scene together.
        knows: Its arguments besides the scene, ``rtol``, ``initial`` and ``comm``.
        why: What it does, so that other arguments mean nothing to it.
        helper: Method whose answer it starts from once more where it finds none itself; empty without one.
    """

    module: str
    shared: bool
    knows: tuple[str, ...]
    why: str
    helper: str = ""


METHODS = {
    "fitted": Method("fitted.method", False, ("elements", "options"), "which moves its own nodes", helper="bvp"),
    "augmented-lagrangian": Method("lagrangian.method", True, ("elements", "mesh", "options"), "whose mesh is fixed"),
    "bvp": Method("bvp.method", False, ("find_zones",), "which chooses its own meshes and uses no PETSc"),
    "string": Method("taut_string.method", False, (), "which is exact"),
}


def solve(
    scene: Scene,
    *,
    method: str = "fitted",
    rtol: float = 1e-8,
    elements: int | None = None,
    mesh: Any = None,
    comm: MPI.Comm | None = None,
    options: Mapping[str, Any] | None = None,
    initial: Solution | None = None,
    throw: bool = True,
) -> Solution:
    """Solves a scene.

    Args:
        scene: The scene.
        method: ``"fitted"``, finite elements in zones bounded by nodes that move; ``"augmented-lagrangian"``, the
            source's finite elements on a fixed mesh (18.2); ``"bvp"``, the differential equations (18.3) by
            collocation, which uses neither FEniCS nor PETSc; or ``"string"``, the exact string, the limit of a belt
            that neither bends nor shears.
        rtol: Relative tolerance of omega; on a fixed mesh, where the mesh sets the error, of the multipliers.
        elements: Number of elements; chosen by the method where it is left out.
        mesh: Nodes of a fixed mesh, as increasing positions ``(n,)`` in [-Ls/2, Ls/2] [m], or a file of them.
        comm: MPI communicator; all ranks by default. Those of it solve a fixed mesh together; with the method fitted,
            each rank solves its own scene, and needs no other.
        options: PETSc options of the Newton solver, without their prefix ``belt_``; the command line's go first.
        initial: A solution to start from; first stages are then left out.
        throw: Whether a failure raises; otherwise its solution is given back.

    Returns:
        The solution, the same on every rank.

    Raises:
        SceneError: The scene, or an argument, cannot be meant; on all ranks that solve a fixed mesh together.
        SolveError: No admissible solution was found and ``throw`` is true.
    """
    given = {"elements": elements, "mesh": mesh, "options": options}
    arguments = {name: value for name, value in given.items() if value is not None}
    return answer(scene, method, arguments, rtol=rtol, comm=comm, initial=initial, throw=throw)


def answer(
    scene: Scene,
    method: str,
    arguments: Mapping[str, Any],
    *,
    rtol: float,
    comm: MPI.Comm | None = None,
    initial: Solution | None = None,
    throw: bool = True,
) -> Solution:
    """`solve`, with the arguments that not all methods have by their names."""
    if method not in METHODS:
        raise SceneError("method", f"be one of {', '.join(METHODS)}", method)
    if comm is not None and not hasattr(comm, "allgather"):  # only whoever has loaded mpi4py can have one
        raise SceneError("comm", "be an MPI communicator", comm)
    row, check = METHODS[method], functools.partial(_checked, scene, method, arguments, rtol, initial)
    if "options" in row.knows:
        start_alone()
    if row.shared:
        from mpi4py import MPI

        comm = comm or MPI.COMM_WORLD
        checked = agreed(comm, check, lambda checked: repr((scene, checked)))
    else:
        checked = check()
    if scene.is_published and not touches(scene):
        return finish(straight_belt(scene, method), throw=throw)
    checked |= {"comm": comm, "initial": initial}
    with interrupts.defer():
        solution = _solved(scene, method, **checked)
        if row.helper and solution.status in UNFINISHED:
            solution = _helped(scene, method, row.helper, solution, checked)
    return finish(explained(solution), throw=throw)


def _checked(scene: object, method: str, arguments: Mapping[str, Any], rtol: object, initial: object) -> dict[str, Any]:
    """The arguments by their names, with their types.

    Raises:
        SceneError: One of them, or the scene, cannot be meant.
    """
    if not isinstance(scene, Scene):
        raise SceneError("scene", "be a Scene", scene)
    for name, value in arguments.items():
        if name not in METHODS[method].knows:
            raise SceneError(name, f"be left out with the method {method}, {METHODS[method].why}", value)
    checked = dict(arguments)
    if "elements" in checked:
        checked["elements"] = whole_number("elements", checked["elements"], FEWEST_ELEMENTS)
    if "options" in checked:
        checked["options"] = named_options(checked["options"])
    if initial is not None and not isinstance(initial, Solution):
        raise SceneError("initial", "be a Solution", initial)
    return {**checked, "rtol": relative_tolerance(rtol)}


def _solved(scene: Scene, method: str, **arguments: Any) -> Solution:
    """What a method makes of a scene, good or not."""
    solution: Solution = import_module(f"belt_fenicsx.{METHODS[method].module}").solve(scene, **arguments)
    return solution


def _helped(scene: Scene, method: str, helper: str, failed: Solution, arguments: Mapping[str, Any]) -> Solution:
    """The solution from the zones and fields of another method; the failed one where these do not lead on.

    The equations and the certificate are still the first method's own.
    """
    stages = Stages()
    other = _solved(scene, helper)
    stages.ran(f"method {helper}", f"{failed.status.name} so far; it may find the zones", other.iterations)
    before, solution = [*failed.stages, *stages], failed
    if other.success:
        solution = _solved(scene, method, **{**arguments, "initial": other})
    if solution.status in UNFINISHED:
        status = other.status if other.status is Status.CAPACITY_EXCEEDED else failed.status
        told = f"The method {helper}: {' '.join((other.status.value, other.message)).strip()}"
        if other.success:
            told = f"The method {helper} solves it: `solve(scene, method={helper!r})` gives its answer."
        solution = replace(failed, status=status, message=f"{failed.message} {told}".strip())
    after = () if solution.stages == failed.stages else solution.stages
    return replace(
        solution,
        stages=(*before, *after),
        iterations=sum(stage.iterations or 0 for stage in (*before, *after)),
    )


def explained(solution: Solution) -> Solution:
    """The solution with hints, where the iteration failed and cannot say why."""
    hinted = solution.status in BLIND and solution.scene.is_published
    return replace(solution, hints=hints(solution.scene)) if hinted else solution
