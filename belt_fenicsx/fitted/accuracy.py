"""How far a state is from the exact answer, from what the last degree changed.

From one even degree to the next, errors fall by factors of 7 to 3000 (measured on scenes at random). So what a degree
changes is the error of the degree before, and a part of it is left. That part is taken from how fast the changes fall:

    left = min(LEFT, GAIN change of p / change of p by the degree before)

Where rounding is reached, changes fall no further and the part is the largest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from belt_fenicsx.fitted.dofs import local
from belt_fenicsx.fitted.elements import gauss_weights
from belt_fenicsx.fitted.reading import sliding, surface_stretches
from belt_fenicsx.fitted.state import State
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.layers import LEAST_STRAIN, shear_layer
from belt_fenicsx.scene.scene import Scene

COARSEST = 1e-2  # A state is judged where its pressure changes by less, relative to the largest one.
# At most this part of the change by the last degree is left as error; less where the change of the pressure fell since
# the degree before, by this many times the factor of its fall.
LEFT, GAIN = 1 / 4, 15.0
# The speed is wrong by at least this part of the pressure's mean change: its own change can be small by accident.
LEAST = 2e-6
EPSILON = float(np.finfo(float).eps)  # The rounding error of a number.
ROUNDING = 5000.0  # The rounding error of the speed in units of `EPSILON`; mostly it is less than a tenth of this.
# The rounding error of a bending force in the shortest cell, in units of `EPSILON`, for each cell; it is the larger one
# from a thousand cells on.
BENDING = 4.0
# These parts of a field's change are left: of stretches, whose errors fall by more, and of all others; of stretches
# less where the change of the pressure fell since the degree before, by this many times the factor of its fall.
LEFT_OF_STRETCHES, LEFT_OF_FIELDS, STRETCH_GAIN = 1 / 12, 1 / 5, 2.0
# The same for pressure and friction, in units of the factor by which their change fell, and at most: changes that fall
# no further are rounding, of which the first of two can be the smaller.
TRACTION_GAIN, TRACTION_MOST = 4.0, 3.0
STRETCH = 5e-12  # The rounding error of a stretch at any point.
TRACTION = 1e-9  # That of pressure and friction, relative to the largest, for each shear layer along the radius.
# That of friction, over the radius, as a part of what is doubted of its integral: however little it is, it is known no
# better. Where it was measured, with a friction coefficient of 3e-8 to 1e-6, it was 0.002 to 0.1 of that.
FRICTION = 1 / 16
# The estimated error of the torque that goes with an rtol, over the rtol; the true one is a third of it, or less.
OF_TORQUE = 30.0
# Where the pressure changes by more than this times the accuracy of the fields, estimates are not trusted.
TRUSTED = 20.0
STRETCHES = ("D", "eps", "v_rel")


@dataclass(frozen=True)
class Accuracy:
    """How far a state is from the exact answer.

    Attributes:
        state: The state.
        error: Estimated relative error of its angular velocity.
        error_of_torque: That of its torque, relative to the radius times the tension.
        errors_of_fields: Those of its fields, relative to their largest values; empty where the first is not known.
        change_of_p: Largest change of its pressure by the last degree, relative to the largest pressure.
        known: Whether the angular velocity and the fields are known, the latter well enough to judge by them.
    """

    state: State
    error: float
    error_of_torque: float
    errors_of_fields: Mapping[str, float]
    change_of_p: float
    known: bool

    def of(self, state: State) -> Accuracy:
        """That of a state with which the search ended: of other rows than this one's, nothing is known."""
        return (
            self
            if state is self.state
            else replace(self, state=state, error=math.inf, error_of_torque=math.inf, known=False)
        )

    def missed(self, rtol: float) -> str:
        """What is not as accurate as wanted; empty where all is."""
        if self.error > rtol:
            return f"The angular velocity is known to {self.error:.1g} of itself, {rtol:.1g} was asked for."
        if self.error_of_torque > OF_TORQUE * rtol:
            reached = f"{self.error_of_torque:.1g} of the radius times the tension"
            return f"The torque is known to {reached}, {OF_TORQUE * rtol:.1g} goes with rtol {rtol:.1g}."
        worst = max(self.errors_of_fields, key=lambda name: self.errors_of_fields[name])
        if self.errors_of_fields[worst] > of_fields(rtol):
            reached = f"{self.errors_of_fields[worst]:.1g} of its largest value"
            return f"The field {worst} is known to {reached}, {of_fields(rtol):.1g} goes with rtol {rtol:.1g}."
        return ""


def of_fields(rtol: float) -> float:
    """Accuracy of the fields, relative to their largest values, that goes with one of the angular velocity.

    Energy methods know a functional to about the square of the error of their fields.
    """
    return math.sqrt(rtol)


def estimate(
    scene: Scene, before: State, start: State, state: State, change_before: float, rtol: float, *, last: bool
) -> Accuracy:
    """The accuracy of a state that may be accurate enough.

    Args:
        scene: The dimensionless scene.
        before: The state of the degree before.
        start: The same in elements of this degree.
        state: The state.
        change_before: Change of the pressure by the degree before; zero where there is none.
        rtol: Wanted relative accuracy of the angular velocity; fields are of interest only where it is reached.
        last: Whether there is no higher degree, so that they always are.
    """
    change = change_of_pressure(start, state)
    rounded = rounding(scene, state)
    error = max(error_of_known(scene, before, start, state, change, change_before), rounded)
    of_torque = max(error_of_torque(before, state, change, change_before) - rounded, 0.0) / _strain(state)
    known = error <= max(rtol, rounded) and of_torque <= OF_TORQUE * rtol
    known = known and change <= min(COARSEST, TRUSTED * of_fields(rtol))
    errors = errors_of_fields(scene, before, state, change, change_before) if known or last else {}
    return Accuracy(state, error, of_torque, errors, change, known and max(errors.values()) <= of_fields(rtol))


def coarse(start: State, state: State) -> Accuracy:
    """That of a state of a degree that is too low, of whose error nothing has to be known but the pressure's change."""
    return Accuracy(state, math.inf, math.inf, {}, change_of_pressure(start, state), False)


def change_of_pressure(start: State, end: State) -> float:
    """Largest change of the pressure, relative to its largest value."""
    p, p_start = (state.values[:, local(end.degree).p] for state in (end, start))
    return float(np.abs(p - p_start).max() / p.max())


def mean_change_of_pressure(start: State, end: State) -> float:
    """Integral of the pressure's change, relative to that of the pressure: in short cells, a change weighs little."""
    weighted = gauss_weights(end.degree) * end.length[:, None]
    p, p_start = (state.values[:, local(end.degree).p] for state in (end, start))
    return float((weighted * np.abs(p - p_start)).sum() / (weighted * p).sum())


def error_of_known(
    scene: Scene, before: State, start: State, state: State, change: float, change_before: float
) -> float:
    """Estimated relative error of the angular velocity, but for rounding.

    Where that is given, it is the error of the stretch that makes the torque.

    Args:
        scene: The dimensionless scene.
        before: The state of the degree before.
        start: The same in elements of this degree.
        state: The state.
        change: Change of the pressure by the last degree.
        change_before: That by the degree before; zero where there is none.
    """
    left = part_left(change, change_before)
    change_of_known = np.abs(_known(scene, state) - _known(scene, before))
    # Relative to stretches of the belt: a pulley that stands still has no speed.
    change_of_known[: state.stretches.size] /= state.stretches
    return max(left * float(change_of_known.max()), LEAST * mean_change_of_pressure(start, state))


def error_of_torque(before: State, state: State, change: float, change_before: float) -> float:
    """Estimated error of the torque, over the radius."""
    return part_left(change, change_before) * float(np.abs(state.friction_forces - before.friction_forces).max())


def part_left(change: float, change_before: float) -> float:
    """Part of what the last degree changed that is left as error of what is asked for."""
    return min(LEFT, GAIN * change / change_before) if change_before else LEFT


def _known(scene: Scene, state: State) -> Array:
    """What the estimate is of: the angular velocities; where one is given, the stretch behind the pulley of a string.

    They are those of a unit transport rate. That rate and the displacements of pulleys come on top.
    """
    given = np.array([pulley.drive.kind == "omega" for pulley in scene.pulleys])
    speeds = surface_stretches(scene, state) - given * state.friction_forces
    return speeds if scene.is_published else np.concatenate([speeds, [math.log(state.rate)], state.moves])


def _strain(state: State) -> float:
    """Strain of the belt in stick, of the pulley where it is smallest."""
    return max(float(state.stretches.min()) - 1.0, LEAST_STRAIN)


def rounding(scene: Scene, state: State) -> float:
    """Rounding error of the angular velocity: that of stretches, and of forces by bending in the shortest cells.

    On a pulley that the belt leaves in stick, no equation places a joint by what friction transmits: what rounding
    makes of that is a difference of the forces in the spans before and behind, of which each has a half.
    """
    shortest, belt = float(state.length.min()), scene.belt
    bending = len(state.cells) * belt.bending_stiffness / belt.extensional_stiffness
    idle = [i for i in state.layout.pulleys if scene.closed and not state.layout.slides_behind(i)]
    unplaced = max(state.doubts[idle].tolist(), default=0.0) / 2.0 / belt.extensional_stiffness
    return EPSILON * (ROUNDING + BENDING * bending / shortest) + unplaced


def errors_of_fields(
    scene: Scene, before: State, state: State, change: float, change_before: float
) -> dict[str, float]:
    """Estimated largest error of each field, relative to its largest value on the belt.

    In stick all along, friction may be next to nothing; its errors are relative to what it could be at most, mu p.

    Args:
        scene: The dimensionless scene.
        before: The state of the degree before, on the same cells.
        state: The state.
        change: Change of the pressure by the last degree.
        change_before: That by the degree before; zero where there is none.
    """
    fall = change / change_before if change_before else 0.0
    part_of_tractions = min(max(TRACTION_GAIN * fall, LEFT_OF_FIELDS), TRACTION_MOST)
    part_of_stretches = min(STRETCH_GAIN * fall, LEFT_OF_STRETCHES) if fall else LEFT_OF_STRETCHES
    left = {**dict.fromkeys(STRETCHES, part_of_stretches), "p": part_of_tractions, "f": part_of_tractions}
    old, new = _table(scene, before), _table(scene, state)
    changes, sizes = _largest(scene, new - old), _largest(scene, new)
    sizes["f"] = max(sizes["f"], max(pulley.friction for pulley in scene.pulleys) * sizes["p"])
    slender = max(pulley.radius for pulley in scene.pulleys) / shear_layer(scene, float(state.stretches.max()) - 1.0)
    least = dict.fromkeys(STRETCHES, STRETCH) | {name: TRACTION * slender * sizes[name] for name in "pf"}
    least["f"] = max(least["f"], FRICTION * float((state.doubts / [pulley.radius for pulley in scene.pulleys]).max()))
    errors = {}
    for name, change_of_field in changes.items():
        error = max(left.get(name, LEFT_OF_FIELDS) * change_of_field, least.get(name, 0.0))
        # Without friction, the traction f is zero, and so is its error.
        errors[name] = error / (sizes[name] or 1.0)
    return errors


def _table(scene: Scene, state: State) -> Array:
    """Components of fields densely in all cells, those of which others are multiples ``(10, n, POINTS)``."""
    dense = state.dense
    v_rel = sliding(scene, state, np.arange(len(dense.D))[:, None], dense.D)
    r, strain = dense.r, dense.strain
    return np.array(
        [r.real, r.imag, dense.theta, dense.D, strain.real, strain.imag, dense.kappa, dense.p, dense.f, v_rel]
    )


def _largest(scene: Scene, table: Array) -> dict[str, float]:
    """Largest component of each field, from a table of such; the bending moment in units of its stiffness."""
    x, y, theta, D, eps, Gamma, kappa, p, f, v_rel = np.abs(table).max(axis=(1, 2)).tolist()
    Q = max(scene.belt.extensional_stiffness * eps, scene.belt.shear_stiffness * Gamma)
    return {
        "r": max(x, y), "theta": theta, "D": D, "eps": eps, "Gamma": Gamma, "kappa": kappa, "Q": Q, "p": p, "f": f,
        "v_rel": v_rel, "M": kappa,
    }  # fmt: skip
