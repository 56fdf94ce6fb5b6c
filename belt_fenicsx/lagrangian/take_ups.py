"""Pulleys that a force pushes: where they stand, by the hub loads of solves in which they stand still.

1. The string says where the pulleys are, and how their hub loads change as they move.
2. A solve with fixed centres tells by what each hub load misses its force. The pulleys move by the string's step, which
   is nearly Newton's, until no hub load misses more than the mesh knows of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from belt_fenicsx.lagrangian.loop import NAME, Task
from belt_fenicsx.lagrangian.taut import TautBelt
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.contact import Contact
from belt_fenicsx.solution.reading import along
from belt_fenicsx.solution.solution import Solution
from belt_fenicsx.solution.stages import Stages, Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.drive import pushed, string_drive

STEP = 1e-6  # of a pulley, in belt lengths, by which the string's hub loads are differentiated
MOST = 12  # Solves, at most.


def tensioned(task: Task, solve: Callable[[Task], Solution]) -> Solution:
    """The dimensionless solution in which each take-up has its force, from solves of scenes without any; collective.

    Args:
        task: What is to be solved.
        solve: Solves a scene whose pulleys stand still.
    """
    scene, stages = task.scene, Stages()
    moving = [i for i, pulley in enumerate(scene.pulleys) if pulley.take_up is not None]
    if not moving:
        return solve(task)
    try:
        moves = np.array([string_drive(scene).take_ups[i] for i in moving])
        jacobian = _string_jacobian(scene, moving, moves)
    except Stopped as stopped:
        return Solution(scene=scene, method=NAME, status=stopped.status, message=stopped.message)
    wanted = np.array([scene.pulleys[i].force or 0.0 for i in moving])
    for _ in range(MOST):
        standing = _standing(scene, moving, moves)
        task = task._replace(scene=standing, taut=TautBelt.of(standing))
        solution = solve(task)
        stages += solution.stages
        if solution.status is not Status.SOLVED and task.start is not None:
            # A pulley that has moved far may be too deep in the belt where it was.
            solution = solve(task._replace(start=None))
            stages += solution.stages
        if solution.status is not Status.SOLVED:
            break
        contacts = {contact.pulley: contact for contact in solution.contacts}
        missed = wanted + np.array([_pushed(scene, contacts[i]) for i in moving])
        tension = max(max(span.tension) for span in solution.spans)
        if np.all(np.abs(missed) <= task.tolerances.balance * tension):
            break
        moves = moves - np.linalg.solve(jacobian, missed)
        task = task._replace(start=solution.fields, rate=solution.transport_rate)
    else:
        message = "The hub loads do not reach the forces of the take-ups. Choose more elements."
        solution = replace(solution, status=Status.NEWTON_DIVERGED, message=message)
    moved = dict(zip(moving, moves.tolist(), strict=True))
    there = tuple(replace(contact, take_up=moved.get(contact.pulley, 0.0)) for contact in solution.contacts)
    return replace(solution, contacts=there, stages=tuple(stages), iterations=stages.iterations)


def _standing(scene: Scene, moving: list[int], moves: Array) -> Scene:
    """The scene with its take-ups displaced, and standing still there."""
    pulleys = list(scene.pulleys)
    for i, move in zip(moving, moves.tolist(), strict=True):
        direction = complex(*(pulleys[i].take_up or (1.0, 0.0)))
        center = complex(*pulleys[i].center) + move * direction / abs(direction)
        pulleys[i] = replace(pulleys[i], center=(center.real, center.imag), take_up=None, force=None)
    return scene.altered(pulleys=tuple(pulleys))


def _pushed(scene: Scene, contact: Contact) -> float:
    """Hub load along a take-up."""
    return along(scene.pulleys[contact.pulley].take_up, complex(*contact.hub_force))


def _string_jacobian(scene: Scene, moving: list[int], moves: Array) -> Array:
    """Derivatives of the string's hub loads by the displacements of the take-ups."""

    def loads(moves: Array) -> Array:
        string = string_drive(_standing(scene, moving, moves))
        return np.array([pushed(scene, string, i) for i in moving])

    columns = [(loads(moves + step) - loads(moves - step)) / (2.0 * STEP) for step in STEP * np.eye(len(moving))]
    return np.stack(columns, axis=-1)
