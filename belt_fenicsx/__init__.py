"""Steady motion of a shear-deformable belt in frictional contact with a rotating pulley.

Names are loaded when they are first used, so that a scene costs no FEniCS and a solve no Matplotlib.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from belt_fenicsx import bvp
    from belt_fenicsx.scene import Belt, Pulley, Scene, SceneError, StiffnessBelt
    from belt_fenicsx.scene_file import load_scene
    from belt_fenicsx.solution import Solution, SolveError, Status
    from belt_fenicsx.solver import solve
    from belt_fenicsx.sweeps import Sweep, sweep

_HOMES = {
    "Belt": "scene",
    "StiffnessBelt": "scene",
    "Pulley": "scene",
    "Scene": "scene",
    "SceneError": "scene",
    "Solution": "solution",
    "Status": "solution",
    "SolveError": "solution",
    "load_scene": "scene_file",
    "solve": "solver",
    "sweep": "sweeps",
    "Sweep": "sweeps",
    "bvp": None,
}

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
    "solve",
    "sweep",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = _HOMES[name]
    value = getattr(import_module(f"{__name__}.{home}"), name) if home else import_module(f"{__name__}.{name}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
