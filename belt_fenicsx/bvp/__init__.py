"""The belt as a boundary-value problem, solved by collocation: no FEniCS, no PETSc, no MPI."""

from __future__ import annotations

from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solver import answer

__all__ = ["solve"]


def solve(
    scene: Scene, *, rtol: float = 1e-8, find_zones: bool = True, initial: Solution | None = None, throw: bool = True
) -> Solution:
    """Solves a scene; the same as ``belt_fenicsx.solve(scene, method="bvp")``.

    Args:
        scene: The scene.
        rtol: Wanted relative accuracy of the angular velocity, from 1e-13 to 0.1 [-]. Rounding leaves about 1e-13 of
            thick belts and 1e-12 of those that are 1e4 times thinner than the pulley's radius.
        find_zones: Whether to look for the order of stick and slip that Coulomb's law calls for, instead of taking
            it for one stick zone and one slip zone after it.
        initial: A solution by any method from which to start.
        throw: Whether to raise where there is no admissible answer, instead of returning what there is.

    Returns:
        The solution; with the status ``ACCURACY_NOT_REACHED``, its message says what is less accurate than wanted.

    Raises:
        SceneError: The transition lies where stick cannot end, or an argument is out of its range.
        SolveError: There is no admissible answer and ``throw`` is true.
    """
    return answer(scene, "bvp", {"find_zones": find_zones}, rtol=rtol, initial=initial, throw=throw)
