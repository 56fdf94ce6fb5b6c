"""Steady motion of a shear-deformable belt in frictional contact with a rotating pulley.

Names are loaded when they are first used, so that a scene costs no FEniCS and a solve no Matplotlib.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from belt_fenicsx import bvp
    from belt_fenicsx.safety import slip_safety
    from belt_fenicsx.scene.belt import Belt, StiffnessBelt
    from belt_fenicsx.scene.checks import SceneError
    from belt_fenicsx.scene.file import load_scene
    from belt_fenicsx.scene.pulley import Pulley
    from belt_fenicsx.scene.scene import Scene
    from belt_fenicsx.solution import plot
    from belt_fenicsx.solution.solution import Solution
    from belt_fenicsx.solution.status import SolveError, Status
    from belt_fenicsx.solver import solve
    from belt_fenicsx.sweeps.sweep import Sweep, sweep

_HOMES = {
    "Belt": "scene.belt",
    "StiffnessBelt": "scene.belt",
    "Pulley": "scene.pulley",
    "Scene": "scene.scene",
    "SceneError": "scene.checks",
    "Solution": "solution.solution",
    "Status": "solution.status",
    "SolveError": "solution.status",
    "load_scene": "scene.file",
    "slip_safety": "safety",
    "solve": "solver",
    "sweep": "sweeps.sweep",
    "Sweep": "sweeps.sweep",
}
_MODULES = {"bvp": "bvp", "plot": "solution.plot"}

__all__ = [
    "Belt",
    "Pulley",
    "Scene",
    "SceneError",
    "Solution",
    "SolveError",
    "Status",
    "StiffnessBelt",
    "Sweep",
    "bvp",
    "load_scene",
    "plot",
    "slip_safety",
    "solve",
    "sweep",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        value = import_module(f"{__name__}.{_MODULES[name]}")
    elif name in _HOMES:
        value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
