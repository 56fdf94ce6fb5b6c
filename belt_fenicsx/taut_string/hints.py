"""What the taut string knows of a scene for which an iteration failed: first scenes mostly do for few reasons."""

from __future__ import annotations

import math
from dataclasses import replace

from belt_fenicsx.scene.belt import Belt
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.path import Path, tangent_path
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.taut_string.straight import touches

# What no belt and no pulley has in metres and pascals, but many have in other units.
THICKEST, LARGEST_RADIUS, LONGEST, SOFTEST = 0.3, 10.0, 100.0, 1e5
LARGEST_STRAIN = 0.3
THICK = 0.5  # thickness over radius


def hints(scene: Scene) -> tuple[str, ...]:
    """Sentences on what may be wrong with a scene, the likeliest first.

    Args:
        scene: The scene.

    Returns:
        One sentence for each thing that is unusual, and one on where a string would touch the pulley.
    """
    said = [*_units(scene), *(line for pulley in scene.pulleys for line in _side(pulley))]
    if touches(scene):
        path = tangent_path(scene)
        said += [*_tension(scene, path), *_contact(scene, path)]
    return tuple(said)


def _units(scene: Scene) -> list[str]:
    """Values that look as if they were meant in other units."""
    belt, (pulley,), said = scene.belt, scene.pulleys, []
    lengths = {"belt.length": (belt.length, LONGEST), "span": (scene.span, LONGEST)}
    lengths["pulleys.0.radius"] = (pulley.radius, LARGEST_RADIUS)
    if isinstance(belt, Belt):
        lengths["belt.thickness"] = (belt.thickness, THICKEST)
        if belt.youngs_modulus < SOFTEST:
            said.append(f"`belt.youngs_modulus` is in Pa: {belt.youngs_modulus:g} looks like MPa or GPa.")
        if belt.thickness > THICK * pulley.radius:
            said.append(
                f"The belt is thick for its pulley: `belt.thickness` is {belt.thickness:g} m, `pulleys.0.radius` "
                f"{pulley.radius:g} m."
            )
    large = [f"`{name}` = {value:g}" for name, (value, largest) in lengths.items() if value > largest]
    return [*([f"Lengths are in m: {', '.join(large)} may be meant in mm."] if large else []), *said]


def _side(pulley: Pulley) -> list[str]:
    """A centre above the clamps, round which the belt has to go all the same."""
    xc, H = pulley.center
    if H <= 0.0:
        return []
    return [
        f"The belt runs over the pulley, whose centre is {H:g} m above the clamps; a pulley that presses on the belt "
        f"from above is the mirror image of one with `center` = ({xc:g}, {-H:g})."
    ]


def _tension(scene: Scene, path: Path) -> list[str]:
    """A belt that is longer than its path, or much shorter."""
    strain = path.length / scene.belt.length - 1.0
    lengths = (
        f"`belt.length` is {scene.belt.length:.6g} m, the way from clamp to clamp over the pulley {path.length:.6g} m"
    )
    if strain <= 0.0:
        return [f"The belt is slack by {scene.belt.length - path.length:.3g} m: {lengths}."]
    if strain > LARGEST_STRAIN:
        return [f"The belt is stretched by {100.0 * strain:.3g} %: {lengths}."]
    return []


def _contact(scene: Scene, path: Path) -> list[str]:
    """Where contact is to be expected, and whether the transition lies there."""
    (pulley,), ends = scene.pulleys, _bent_ends(scene, path)
    before, after = path.lines
    text = f"A string would touch the pulley from x = {before.end[0]:.4g} to {after.start[0]:.4g} m"
    if ends is None:
        return [f"{text}."]
    if not ends[0] < ends[1]:
        return [
            f"{text}, but the belt is so stiff in bending that it touches it at hardly more than a point: raise the "
            "pulley, or stretch the belt more."
        ]
    text = f"{text}, a belt of this bending stiffness from about {ends[0]:.4g} to {ends[1]:.4g} m"
    if isinstance(pulley.x_trans, float) and not ends[0] < pulley.x_trans < ends[1]:
        return [f"{text}; `pulleys.0.x_trans` = {pulley.x_trans:g}, where stick is to end, lies outside."]
    return [f"{text}."]


def _bent_ends(scene: Scene, path: Path) -> tuple[float, float] | None:
    """Ends of contact of a thin belt in bending, in reverse where there is none.

    A beam of bending stiffness a that leaves a circle of radius R under a force F turns by acos(1 - a/(2 F R^2)) before
    it is straight, on a line that passes the centre at the distance R + a/(2 F R); a clamp in the direction of x moves
    the place where this line crosses its height inwards by the bending layer sqrt(a/F).

    Returns:
        Their global coordinates [m]; None where the layers of clamp and pulley meet in a free span.
    """
    (pulley,), a = scene.pulleys, scene.belt.bending_stiffness
    R = pulley.radius
    strain = path.length / scene.belt.length - 1.0
    if strain <= 0.0:
        return None
    force = strain * scene.belt.extensional_stiffness
    layer, farther = math.sqrt(a / force), a / (2.0 * force * R)
    if 2.0 * layer >= min(line.length for line in path.lines) or farther >= R:
        return None
    turn = math.acos(1.0 - farther / R)
    try:
        tangents = replace(scene, span=scene.span - 2.0 * layer, pulleys=(replace(pulley, radius=R + farther),))
    except SceneError:
        return None
    if not touches(tangents):
        return pulley.center[0], pulley.center[0]
    (arc,) = tangent_path(tangents).arcs
    up, off = arc.start - turn, arc.end + turn
    return pulley.center[0] - R * math.sin(up), pulley.center[0] - R * math.sin(off)
