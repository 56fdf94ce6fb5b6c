"""What bends, shears, weighs and touches: a drive without any of it, and with one after another. For the demos."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from belt_fenicsx import Scene, Solution, StiffnessBelt, bvp, solve

RIGID = 100.0  # by which a belt that hardly shears is stiffer in shear

Numbers = Mapping[str, Callable[[Solution], float]]


def effects(scene: Scene) -> dict[str, Solution]:
    """Solutions from the textbook's string to the whole belt, by the effect that each adds.

    Without a touching fibre, the radii are those of the middle line.
    """
    belt, offset = scene.belt, scene.belt.contact_offset
    middle = tuple(replace(pulley, radius=pulley.radius + offset) for pulley in scene.pulleys)
    bare = StiffnessBelt(
        length=belt.length,
        bending_stiffness=belt.bending_stiffness,
        extensional_stiffness=belt.extensional_stiffness,
        shear_stiffness=RIGID * belt.shear_stiffness,
    )
    shears = replace(bare, shear_stiffness=belt.shear_stiffness)
    heavy = replace(shears, line_density=belt.line_density, rotary_inertia=belt.rotary_inertia)
    still = replace(scene, pulleys=middle, gravity=(0.0, 0.0))
    found = {
        "string": solve(replace(still, belt=bare), method="string"),
        "bending": bvp.solve(replace(still, belt=bare)),
        "shear": bvp.solve(replace(still, belt=shears)),
    }
    if belt.line_density:
        found["inertia"] = bvp.solve(replace(still, belt=heavy))
    if any(scene.gravity):
        found["weight"] = bvp.solve(replace(scene, belt=heavy, pulleys=middle))
    if offset:
        found["touching fibre"] = bvp.solve(scene)
    return found


def table(found: Mapping[str, Solution], numbers: Numbers) -> str:
    """A row for each solution: what it adds, and its numbers."""
    lines = [f"{'':<18}" + "".join(f"{name:>18}" for name in numbers)]
    for added, solution in found.items():
        name = added if added == "string" else f"+ {added}"
        lines.append(f"{name:<18}" + "".join(f"{number(solution):>18.8g}" for number in numbers.values()))
    return "\n".join(lines)
