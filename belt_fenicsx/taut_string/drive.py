"""The exact extensible string of any drive: its take-ups move to where they have their forces."""

from __future__ import annotations

import cmath
from collections.abc import Callable, Sequence

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.path import Path, Point, tangent_path, taut_path
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status
from belt_fenicsx.taut_string.shape import StringDrive
from belt_fenicsx.taut_string.standing import BeyondCapacity, standing_string

ITERATIONS = 50  # Newton's iterations, at most.
MET = 1e-12  # A take-up has its force with no larger error, relative to it.
MOST_CENTRIFUGAL = 0.5  # G / b1 for which a slack belt is made taut.
TAUT, NEAR = 1e-3, 1e-2  # Strain from which a slack belt starts, and how well it is met, relative to it.
LEAST_PART = 1e-4  # Of a step of Newton's iteration, at least this part is taken.
MOVED = 1e-7  # Displacement for differences, in lengths of the belt.


def string_drive(scene: Scene, *, slack: bool = False) -> StringDrive:
    """The string of a dimensionless scene.

    Args:
        scene: The scene.
        slack: Whether a belt that is longer than its path has a small force all the same, as a first guess of one that
            its bending holds.

    Raises:
        BeyondCapacity: A torque is more than friction can transmit.
        Stopped: There is no taut string.
    """
    moving = [index for index, pulley in enumerate(scene.pulleys) if pulley.take_up is not None]
    moves = _moves(scene, moving) if moving else np.zeros(0)
    return standing_string(scene, _centers(scene, moving, moves), slack=slack)


def _centers(scene: Scene, moving: Sequence[int], moves: Array) -> tuple[Point, ...]:
    """Centres of all pulleys, take-ups displaced."""
    ways = dict(zip(moving, moves.tolist(), strict=True))
    return tuple(pulley.displaced(ways.get(index, 0.0)) for index, pulley in enumerate(scene.pulleys))


def _moves(scene: Scene, moving: Sequence[int]) -> Array:
    """Displacements of take-ups at which they get their forces, by Newton's iteration with differences.

    Raises:
        Stopped: There are none, or with them something is in the belt's way.
    """

    def missed(moves: Array) -> Array:
        try:
            string = standing_string(scene, _centers(scene, moving, moves))
        except BeyondCapacity as beyond:
            string = beyond.drawn
        except SceneError as error:
            raise Stopped(
                Status.CONTACT_LOST, f"A take-up moves to where `{error.field}` cannot be.", final=True
            ) from None
        return np.array([pushed(scene, string, index) for index in moving])

    moves = _taut(scene, moving)
    now, allowed = missed(moves), MET * max(scene.pulleys[index].force or 0.0 for index in moving)
    for _ in range(ITERATIONS):
        if np.abs(now).max() <= allowed:
            break
        columns = [(missed(moves + MOVED * row) - now) / MOVED for row in np.eye(len(moving))]
        step = -np.linalg.solve(np.array(columns).T, now)
        moves, now = _nearer(moves, step, missed, float(np.abs(now).max()))
    else:
        raise Stopped(Status.NEWTON_DIVERGED, "The places of the take-ups were not found.", final=True)
    try:
        taut_path(scene, _centers(scene, moving, moves))
    except SceneError as error:
        message = f"Where the take-ups have their forces, `{error.field}` would have to {error.expected}."
        raise Stopped(Status.CONTACT_LOST, message, final=True) from None
    return moves


def _nearer(moves: Array, step: Array, missed: Callable[[Array], Array], now: float) -> tuple[Array, Array]:
    """Displacements after a step, or after a part of it, with which less is missing, and what is.

    Raises:
        Stopped: There are none.
    """
    part = 1.0
    while part > LEAST_PART:
        try:
            after = missed(moves + part * step)
        except (Stopped, SceneError):
            pass
        else:
            if np.abs(after).max() < now:
                return moves + part * step, after
        part /= 2.0
    raise Stopped(Status.NEWTON_DIVERGED, "The places of the take-ups were not found.", final=True)


def _taut(scene: Scene, moving: Sequence[int]) -> Array:
    """Displacements with which the belt is taut: none where it is so already, otherwise all of them equal."""
    # In units of its scene, a belt has a transport rate of one, or less where it is to be found.
    centrifugal = scene.belt.line_density / scene.belt.extensional_stiffness
    wanted, moves = scene.belt.length * (1.0 + TAUT) / (1.0 - min(centrifugal, MOST_CENTRIFUGAL)), np.zeros(len(moving))

    def path(moves: Array) -> Path:
        return tangent_path(scene, _centers(scene, moving, moves))

    def missing(moves: Array) -> Array:
        return np.array([wanted - path(moves).length])

    now = missing(moves)
    for _ in range(ITERATIONS):
        if now[0] <= NEAR * TAUT:
            break
        gain = sum(path(moves).arcs[i].gain(scene.pulleys[i]) for i in moving)
        moves, now = _nearer(moves, np.full(len(moving), now[0] / gain), missing, float(now[0]))
    return moves


def pushed(scene: Scene, string: StringDrive, index: int) -> float:
    """Hub load along a take-up, and the force that pushes it there."""
    pulley, on = scene.pulleys[index], string.on(index)
    load = cmath.rect(on[-1].force[1], on[-1].angles[1]) - cmath.rect(on[0].force[0], on[0].angles[0])
    return (load * complex(*pulley.direction).conjugate()).real + (pulley.force or 0.0)
