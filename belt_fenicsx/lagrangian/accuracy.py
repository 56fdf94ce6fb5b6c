"""What an answer on a fixed mesh is worth: estimated errors from coarser meshes, and the layers that it has to resolve.

Where contact begins and ends, the mesh knows to a part of an element only. So errors fall with the elements'
size by and large, but jump by ten times from mesh to mesh, and change their sign. A difference of two meshes is
small by chance once in a while; four of them, in the same unit, hardly ever.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layers import bending_layer, shear_layer
from belt_fenicsx.scene.pulley import RUN_UP, Pulley
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.solution import Solution

OMEGA, TORQUE, CLAMP_MOMENT = "error of omega", "error of torque", "error of clamp moment"
# Differences of three meshes get this factor, and those of two, which are small by chance more often. Of 287 meshes of
# 50 to 400 elements that resolve their layers (random scenes, thick and thin), one error of a torque was above its
# estimate from three meshes, by half; the median estimate is ten times the error, for omega twenty times. Friction 0.01
# on 800 elements leaves one that is too low by a third.
SAFETY = {3: 2.0, 2: 4.0}

# An element resolves a layer if it is at most this number of the layer's lengths long. Measured on random scenes: with
# elements of 0.5, 1, 2 and 4 bending layers the clamp moment is 0.15, 0.9, 4 and 18 % off; with elements of more than 8
# shear layers the torque often is, by more than a tenth.
# A contact has so many elements at least.
FEWEST = 4
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
    def longest(self) -> float:
        """Length of the longest element that resolves it [m]."""
        return LONGEST[self.name] * self.length

    @property
    def excess(self) -> float:
        """Length of the element over the longest one that resolves the layer."""
        return self.element / self.longest

    def __str__(self) -> str:
        return f"{self.name} layer of {self.length:.3g} m at x = {self.x:.6g} m"


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
    scene, fields = solutions[-1].scene, fields_of(solutions[-1])
    b1, radii = scene.belt.extensional_stiffness, np.array([pulley.radius for pulley in scene.pulleys])
    stretches = np.array([[c.omega / other.transport_rate for c in other.contacts] for other in solutions]) * radii
    forces = np.array([[c.torque for c in other.contacts] for other in solutions]) / radii
    moments = np.array([fields_of(other).M[[0, -1]] for other in solutions])
    # Halving the elements halves a difference.
    halvings = 2.0 ** np.arange(2 - len(solutions), 1)[:, np.newaxis]
    changes = np.maximum(b1 * np.abs(np.diff(stretches, axis=0)), np.abs(np.diff(forces, axis=0)))
    force = float(np.max(halvings * changes))
    friction = float(fields.weight @ np.abs(fields.f))
    safety = SAFETY[len(solutions)]
    found = {
        OMEGA: safety * force / (b1 * float(stretches[-1].min())),
        TORQUE: safety * force / friction if friction else 0.0,
    }
    if scene.closed:
        return found
    moment = float(np.max(np.abs(moments[-1] - moments[-2])) / np.max(np.abs(moments[-1])))
    # At a clamp M grows with the root of the tension, once its layer is resolved.
    tension = float(np.min(np.abs(fields.Q[[0, -1], 0])))
    return found | {CLAMP_MOMENT: safety * max(moment, force / (2.0 * tension))}


def with_errors(solutions: Sequence[Solution]) -> Solution:
    """The last of the solutions with its estimated errors; argument as that of `errors`.

    Of the fields it is that of the sliding speed alone, whose two parts, c D and R omega, are taken to have the same
    error. Pressure, friction and forces are resolved in the layers as well as these are by the elements, of which this
    mesh and a coarser one tell little.
    """
    solution, measures = solutions[-1], errors(solutions)
    speed = max(solution.scene.pulleys[c.pulley].radius * abs(c.omega) for c in solution.contacts)
    v_rel = float(2.0 * measures[OMEGA] * speed / np.max(np.abs(fields_of(solution).v_rel)))
    return replace(
        solution,
        error_estimate=measures[OMEGA],
        field_errors={"v_rel": v_rel},
        measures={**solution.measures, **measures},
    )


def fields_of(solution: Solution) -> Fields:
    """The fields of a solution that has some."""
    if solution.fields is None:
        raise ValueError("A solution without fields has no errors.")
    return solution.fields


def least_resolved(solution: Solution, nodes: Array) -> Layer:
    """The layer for which the mesh is coarsest: bending at the clamps and beside contact, shear inside of it.

    Args:
        solution: A solution with fields.
        nodes: Positions of the mesh's nodes ``(n,)`` [m].
    """
    return max(_layers(solution, nodes), key=lambda layer: layer.excess)


def _layers(solution: Solution, nodes: Array) -> Iterator[Layer]:
    scene, fields, sizes = solution.scene, fields_of(solution), np.diff(nodes)
    clamps = [] if scene.closed else [(nodes[0], False), (nodes[-1], False)]
    ends = [(zone.sigma[end], True) for c in solution.contacts for zone, end in ((c.zones[0], 0), (c.zones[-1], 1))]
    for sigma, in_contact in (*clamps[:1], *ends, *clamps[1:]):
        element = float(sizes[np.clip(np.searchsorted(nodes, sigma) - 1, 0, len(sizes) - 1)])
        near = int(np.argmin(np.abs(fields.sigma - sigma)))
        x, strain = float(fields.x[near]), float(fields.D[near]) - 1.0
        yield Layer("bending", x, bending_layer(scene, strain), element)
        if in_contact:
            yield Layer("shear", x, shear_layer(scene, strain), element)


def _sticks(pulley: Pulley) -> bool:
    """Whether the belt has to stick somewhere on a pulley: only next to a given speed it may slide all along."""
    return pulley.friction > 0.0 and pulley.x_trans != RUN_UP and pulley.omega is None


def shortcoming(solution: Solution, nodes: Array, largest_error: float) -> str:
    """Why a mesh is too coarse for its answer, and which one would do; empty where it is not.

    Args:
        solution: A solution with fields, and estimated errors among its measures where there are any.
        nodes: Positions of the mesh's nodes ``(n,)`` [m].
        largest_error: Estimated error of a torque or a clamp moment from which on it is no answer.
    """
    layer = least_resolved(solution, nodes)
    if layer.excess > 1.0:
        return (
            f"The mesh is too coarse for the {layer}, where its element is {layer.element:.3g} m long. It should be "
            f"{layer.longest:.3g} m at most: {math.ceil((nodes[-1] - nodes[0]) / layer.longest)} equal elements, or a "
            "mesh that is finer there."
        )
    lengths = [(c.zones[-1].sigma[1] - c.zones[0].sigma[0], c) for c in solution.contacts]
    for length, contact in lengths:
        middle = (contact.zones[0].sigma[0] + contact.zones[-1].sigma[1]) / 2.0
        element = float(np.interp(middle, (nodes[1:] + nodes[:-1]) / 2.0, np.diff(nodes)))
        if length < FEWEST * element:
            wanted = math.ceil(FEWEST * element / length * (len(nodes) - 1))
            return (
                f"The contact with pulley {contact.pulley} is {length:.3g} m long, fewer than {FEWEST} elements of "
                f"{element:.3g} m: {wanted} elements would do."
            )
    sticking = [c for c in solution.contacts if _sticks(solution.scene.pulleys[c.pulley])]
    if any(all(zone.kind != "stick" for zone in contact.zones) for contact in sticking):
        longest = float(np.diff(nodes).max())
        return f"No stick zone was found before the transition: it is shorter than two elements of {longest:.3g} m."
    error, name = max((solution.measures.get(name, 0.0), name) for name in (TORQUE, CLAMP_MOMENT))
    if error <= largest_error:
        return ""
    wanted = math.ceil(error / largest_error * (len(nodes) - 1))
    return (
        f"The estimated {name} is {error:.2g}, more than {largest_error:g}: {wanted} equal elements would do, or a "
        f"mesh that is finer at the {layer}, where its element is {layer.element:.3g} m long."
    )
