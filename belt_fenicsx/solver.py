"""The front door: which method answers a scene, and what is checked before anything is set up."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from belt_fenicsx import interrupts
from belt_fenicsx.fields import Fields
from belt_fenicsx.petsc_start import start_alone
from belt_fenicsx.scene import Scene, SceneError, number
from belt_fenicsx.solution import Solution, Stage, Status, Zone, finish

if TYPE_CHECKING:
    from mpi4py import MPI

METHODS = ("fitted", "augmented-lagrangian")
RTOL_RANGE = (1e-13, 1e-1)


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
    """Solves a scene by finite elements.

    Args:
        scene: The scene.
        method: ``"fitted"``, zones bounded by nodes that move; or ``"augmented-lagrangian"``, the source's method on
            a fixed mesh (18.2).
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
    if method not in METHODS:
        raise SceneError("method", f"be one of {', '.join(METHODS)}", method)
    # Only whoever has loaded mpi4py can have a communicator.
    if comm is not None and not hasattr(comm, "allgather"):
        raise SceneError("comm", "be an MPI communicator", comm)
    common: dict[str, Any] = {"rtol": rtol, "comm": comm, "options": options, "initial": initial, "throw": throw}
    if elements is not None:
        common["elements"] = elements
    if method != "fitted":
        with interrupts.held():
            start_alone()
            from belt_fenicsx import augmented_lagrangian

            return augmented_lagrangian.solve(scene, mesh=mesh, **common)
    check_asked(scene, rtol)
    if not touches(scene):
        return finish(clear_of_pulley(scene, method), throw=throw)
    if mesh is not None:
        raise SceneError("mesh", "be left out with the method fitted, which moves its own nodes", mesh)
    with interrupts.held():
        start_alone()
        from belt_fenicsx import fitted

        return fitted.solve(scene, **common)


def check_asked(scene: object, rtol: float) -> None:
    """Checks what every method is given: a scene, and a relative tolerance.

    Raises:
        SceneError: It is no scene; or the tolerance is no number, or outside of what double precision can give.
    """
    if not isinstance(scene, Scene):
        raise SceneError("scene", "be a Scene", scene)
    low, high = RTOL_RANGE
    if not low <= number("rtol", rtol, "-") <= high:
        raise SceneError("rtol", f"lie in [{low:g}, {high:g}] [-]", rtol)


def touches(scene: Scene) -> bool:
    """Whether the pulley reaches above the straight line between the clamps."""
    pulley = scene.pulleys[0]
    xc, H = pulley.center
    nearest = math.hypot(max(0.0, abs(xc) - scene.span / 2), H)
    return H >= 0.0 or nearest < pulley.radius


def clear_of_pulley(scene: Scene, method: str) -> Solution:
    """The straight belt above a pulley that it does not touch: nothing to solve."""
    import numpy as np

    belt = scene.belt
    stretch = scene.span / belt.length
    sigma = np.array([-0.5, 0.5]) * belt.length
    zero = np.zeros(2)
    fields = Fields.from_state(
        belt,
        zone=np.zeros(2, dtype=int),
        sigma=sigma,
        r=np.column_stack([stretch * sigma, zero]),
        theta=zero,
        phi=zero,
        D=np.full(2, stretch),
        kappa=zero,
        p=zero,
        f=zero,
        v_rel=np.full(2, np.nan),
    )
    half = scene.span / 2
    return Solution(
        scene=scene,
        method=method,
        status=Status.NO_CONTACT,
        zones=(Zone(kind="free", sigma=(float(sigma[0]), float(sigma[1])), x=(-half, half)),),
        fields=fields,
        stages=(Stage(name="contact", why="skipped: the straight belt does not touch the pulley"),),
    )
