"""The string of a belt that a clamp next to a pulley presses onto it.

Within its bending layer, the belt comes from the clamp to the pulley as a cubic parabola, whatever its tension: it goes
down by the clamp's distance from the pulley, and turns by the angle from the clamp's direction to the tangent. So it
touches the pulley nearer to the clamp than a string does.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import replace

from belt_fenicsx.layout.layers import bending_layer
from belt_fenicsx.scene.path import Line, tangent_path
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.taut_string.bent import BentSpan
from belt_fenicsx.taut_string.forces import Chain
from belt_fenicsx.taut_string.shape import StringDrive, drawn_on

PRESSED = 2.0  # A clamp presses the belt onto the pulley where the free span is shorter than this in bending layers.


def pressed(scene: Scene, string: StringDrive) -> StringDrive:
    """The string of a dimensionless scene with contact up to where clamps press the belt; itself where none does."""
    if scene.closed:
        return string
    path, layer = tangent_path(scene, string.centers), bending_layer(scene, string.strain)
    arcs, lines, bows = [*path.arcs], [*path.lines], dict[int, tuple[float, float]]()
    for end, way in ((0, 1.0), (-1, -1.0)):
        (x, y, angle), arc = scene.ends[end], arcs[end]
        # From the clamp, in its direction.
        across = way * complex(arc.center[0] - x, arc.center[1] - y) * cmath.exp(-1j * angle)
        turned = math.atan2(across.real, -way * arc.turn * across.imag)
        length = 3.0 * (abs(across) - arc.radius) / turned
        if length >= PRESSED * layer:
            continue
        touched = angle + way * arc.turn * (turned - length / arc.radius)
        if end == 0:
            arcs[end], bows[end] = replace(arc, start=touched), (angle, touched)
            lines[end] = Line((x, y), arc.at(touched), touched)
        else:
            arcs[end], bows[end] = replace(arc, end=touched), (touched, angle)
            lines[end] = Line(arc.at(touched), (x, y), touched)
    if not bows or any(arc.wrap <= 0.0 for arc in arcs):
        return string
    path = replace(path, arcs=tuple(arcs), lines=tuple(lines))
    drawn = drawn_on(path, scene, Chain(scene, path, 0).solved(slack=True), string.centers)
    parts = [*drawn.parts]
    for end, angles in bows.items():
        parts[end] = BentSpan(**{**vars(parts[end]), "angles": angles, "layer": layer})
    return replace(drawn, parts=tuple(parts), pressed=True)
