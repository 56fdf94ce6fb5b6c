"""What an answer on a fixed mesh is worth: estimated errors from coarser meshes, and the layers that it has to resolve.

Where contact begins and ends, the mesh knows to a part of an element only. So errors fall with the elements'
size by and large, but jump by ten times from mesh to mesh, and change their sign. A difference of two meshes is
small by chance once in a while; four of them, in the same unit, hardly ever.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layers import bending_layer, shear_layer
from belt_fenicsx.scene.pulley import RUN_UP
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.solution import Solution

OMEGA, TORQUE, CLAMP_MOMENT = "error of omega", "error of torque", "error of clamp moment"
# Factor on the differences of three meshes, and of two, which are small by chance more often. Of 287 meshes of 50 to
# 400 elements that resolve their layers (random scenes, thick and thin), one error of a torque was above its estimate
# from three meshes, by half; the median estimate is ten times the error, for omega twenty times. Friction 0.01 on 800
# elements leaves one that is too low by a third.
SAFETY = {3: 2.0, 2: 4.0}

# Estimated error of a torque or a clamp moment from which on it is no answer. On the same meshes it kept errors above
# 5 % from being answers, but for one of 6 %.
LARGEST_ERROR = 0.2

# Length of the longest element that resolves a layer, in the layer's lengths. Measured on random scenes: with elements
# of 0.5, 1, 2 and 4 bending layers the clamp moment is 0.15, 0.9, 4 and 18 % off; with elements of more than 8 shear
# layers the torque often is, by more than a tenth.
LONGEST = {"bending": 1.5, "shear": 8.0}


@dataclass(frozen=True)
class Layer:
    """A layer that a mesh has to resolve.

    Attributes:
        name: ``"bending"`` or ``"shear"``.
        x: Where it is [m].
        length: Its length [m].
        element: Length of the mesh's element there [m].
    """

    name: str
    x: float
    length: float
    element: float

    @property
    def excess(self) -> float:
        """Length of the element over the longest one that resolves the layer."""
        return self.element / (LONGEST[self.name] * self.length)


def errors(solutions: Sequence[Solution]) -> dict[str, float]:
    """Estimated relative errors of omega, torque and clamp moment, by name.

    Errors of the stretch in stick and of the torque come from the same force that a mesh gets wrong. So the largest
    force that one of them shows is taken for both.

    Args:
        solutions: Dimensionless solutions on two or three meshes of the same scene, each with about twice as many
            elements as the one before.

    Returns:
        The error of omega relative to omega; that of the torque relative to R times the friction summed up without its
        sign; that of the moments at the clamps relative to the larger of the two.
    """
    last, scene = solutions[-1], solutions[-1].scene
    belt = scene.belt
    stretches, forces, moments = (
        np.array(rows) for rows in zip(*(_seen(solution) for solution in solutions), strict=True)
    )
    # Halving the elements halves a difference.
    halvings = 2.0 ** np.arange(2 - len(solutions), 1)
    steps = np.maximum(belt.extensional_stiffness * np.abs(np.diff(stretches)), np.abs(np.diff(forces)))
    force = float(np.max(halvings * steps))
    friction = float(last.fields.weight @ np.abs(last.fields.f))
    moment = float(np.max(np.abs(moments[-1] - moments[-2])) / np.max(np.abs(moments[-1])))
    # At a clamp M grows with the root of the tension, once its layer is resolved.
    tension = float(np.min(np.abs(last.fields.Q[[0, -1], 0])))
    safety = SAFETY[len(solutions)]
    return {
        OMEGA: safety * force / (belt.extensional_stiffness * stretches[-1]),
        TORQUE: safety * force / friction if friction else 0.0,
        CLAMP_MOMENT: safety * max(moment, force / (2.0 * tension)),
    }


def errors_of_fields(solution: Solution, omega: float) -> dict[str, float]:
    """Estimated largest errors of fields, relative to their largest values: of the sliding speed alone.

    Its two parts, c D and R omega, are taken to have the same error. Pressure, friction and forces are resolved in the
    layers as well as these are by the elements, of which this mesh and a coarser one tell little.

    Args:
        solution: The dimensionless solution.
        omega: Estimated relative error of omega.
    """
    speed = solution.scene.pulleys[0].radius * solution.contacts[0].omega
    return {"v_rel": float(2.0 * omega * speed / np.max(np.abs(solution.fields.v_rel)))}


def _seen(solution: Solution) -> tuple[float, float, Array]:
    """The stretch in stick, the resultant of friction, and the moments at the clamps ``(2,)``."""
    contact, radius = solution.contacts[0], solution.scene.pulleys[0].radius
    stretch = contact.omega * radius / solution.scene.transport_rate
    return stretch, contact.torque / radius, solution.fields.M[[0, -1]]


def least_resolved(solution: Solution, nodes: Array) -> Layer:
    """The layer for which the mesh is coarsest: bending at the clamps and beside contact, shear inside of it.

    Args:
        solution: A solution with fields.
        nodes: Positions of the mesh's nodes ``(n,)`` [m].
    """
    return max(_layers(solution.scene, solution, nodes), key=lambda layer: layer.excess)


def _layers(scene: Scene, solution: Solution, nodes: Array) -> Iterator[Layer]:
    fields, sizes = solution.fields, np.diff(nodes)
    ends = [zone.sigma[0] for zone in solution.zones] + [nodes[-1]]
    for index, sigma in enumerate((ends[0], ends[1], ends[-2], ends[-1])):
        element = float(sizes[np.clip(np.searchsorted(nodes, sigma) - 1, 0, len(sizes) - 1)])
        near = int(np.argmin(np.abs(fields.sigma - sigma)))
        x, strain = float(fields.x[near]), float(fields.D[near]) - 1.0
        yield Layer("bending", x, bending_layer(scene, strain), element)
        if index in (1, 2):
            yield Layer("shear", x, shear_layer(scene, strain), element)


def shortcoming(solution: Solution, nodes: Array) -> str:
    """Why a mesh is too coarse for its answer, and which one would do; empty where it is not.

    Args:
        solution: A solution with fields, and estimated errors among its measures where there are any.
        nodes: Positions of the mesh's nodes ``(n,)`` [m].
    """
    layer, length, pulley = least_resolved(solution, nodes), nodes[-1] - nodes[0], solution.scene.pulleys[0]
    if layer.excess > 1.0:
        longest = LONGEST[layer.name] * layer.length
        return (
            f"The mesh is too coarse for the {layer.name} layer of {layer.length:.3g} m at x = {layer.x:.6g} m, where "
            f"its element is {layer.element:.3g} m long. It should be {longest:.3g} m at most: "
            f"{math.ceil(length / longest)} equal elements, or a mesh that is finer there."
        )
    sticks = pulley.friction > 0.0 and pulley.x_trans != RUN_UP
    if sticks and all(zone.kind != "stick" for zone in solution.zones):
        longest = float(np.diff(nodes).max())
        return f"No stick zone was found before the transition: it is shorter than two elements of {longest:.3g} m."
    name = max((TORQUE, CLAMP_MOMENT), key=lambda name: solution.measures.get(name, 0.0))
    error = solution.measures.get(name, 0.0)
    if error <= LARGEST_ERROR:
        return ""
    wanted = math.ceil(error / LARGEST_ERROR * (len(nodes) - 1))
    return (
        f"The estimated {name} is {error:.2g}, more than {LARGEST_ERROR:g}: {wanted} equal elements would do, or a "
        f"mesh that is finer at the {layer.name} layer of {layer.length:.3g} m at x = {layer.x:.6g} m, where its "
        f"element is {layer.element:.3g} m long."
    )
