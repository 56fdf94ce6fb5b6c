"""How a solve of the fitted method begins: with the zones that a scene asks for, at the lowest degree.

1. From a solution that is given.
2. From the taut string; for a given speed or moment, by way of the belt in pure stick. It has one border less to be
   found, shows where the contact is, and in which sense and about how far the belt slides.
3. Where Newton's iteration fails, from a belt that bends more easily, or from pure stick.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from belt_fenicsx.fitted.elimination import local
from belt_fenicsx.fitted.newton import Newton
from belt_fenicsx.fitted.order import SHORTEST, transition
from belt_fenicsx.fitted.state import State, from_fields, from_string
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import SENSE, STICK, Part
from belt_fenicsx.layout.layers import bending_layer
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered, posed
from belt_fenicsx.scene.pulley import RUN_OFF, Slip
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.scene.units import Units
from belt_fenicsx.solution.certificate import DRIVE, ROUNDING, transmissible
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.solution import Solution, Status
from belt_fenicsx.solution.stages import Stages, Stopped
from belt_fenicsx.taut_string.string import TautString, taut_string

METHOD = "fitted"
LOWEST = 4  # degree
FINE = 8  # degree, with which a moment is said to be too large
ARRIVED = 2e-2  # largest step of a border, in lengths of the shortest cell, after which the degree may rise
NEGATIVE = 0.1  # pressure, relative to the largest, that no error of a coarse state explains
PLACED = 1e-8  # the same where pure stick or pure slip is to be known well
# Degrees that a given solution starts with, one after another, and one by another method. Where friction is little, or
# zones are short, a low degree knows it too coarsely to place a border by it.
WARM, RESCUE = (6, 8), (8, 12)
NEARLY = 0.95  # of the contact, at most, slides in the first guess of a contact that sticks somewhere
SOFTER = 1 / 20  # in bending, of a belt that is more like a string
PRESSED = 2.0  # bending layers, in the free span of a belt that its clamp presses onto the pulley
BUDGET = 300  # Newton iterations of all starts
SHORT_SLIP = 0.05  # of the contact, below which pure stick has to be known well to tell where a slip zone begins

Start = Callable[["Run"], State]


@dataclass
class Run:
    """A solve that is under way.

    Attributes:
        asked: The scene, in its own units.
        scene: The dimensionless scene.
        units: The units of the latter.
        elements: Number of cells; None for as many as the layers call for.
        solver: The solver of Newton's iterations.
        stages: What was done so far.
        most: Newton iterations, counted from the first stage on, after which it ends.
    """

    asked: Scene
    scene: Scene
    units: Units
    elements: int | None
    solver: Newton
    stages: Stages = field(default_factory=Stages)
    most: int = BUDGET

    def once_more(self) -> Run:
        """The same run with as many iterations again."""
        return replace(self, most=self.stages.iterations + BUDGET)

    def newton(self, state: State, why: str, *, arrived: float = ARRIVED, held: bool = False) -> State:
        """Newton's iteration from a state, with elements of its degree; its first step may hold the borders.

        Raises:
            Stopped: It does not converge, or there were too many iterations already.
        """
        if self.stages.iterations >= self.most:
            tried = ", ".join(dict.fromkeys(stage.why for stage in self.stages if stage.iterations))
            message = (
                f"At degree {state.degree}, from {why}: {self.most} iterations are spent, tried were {tried}. "
                "Start from a solution nearby (`initial`)."
            )
            raise Stopped(Status.NEWTON_DIVERGED, message)
        result, iterations = self.solver.solve(self.scene, state, arrived, held=held)
        self.stages.ran(f"degree {state.degree}", why, abs(iterations))
        if iterations <= 0:
            message = f"At degree {state.degree}, after {-iterations} iterations from {why}."
            raise Stopped(Status.NEWTON_DIVERGED, message)
        return result

    def on(self, zones: Layout, ends: Array, old: Fields | State, why: str, *, degree: int = LOWEST) -> State:
        """Newton's iteration on zones, from another solution."""
        return self.newton(from_fields(self.scene, old, zones, ends, degree, self.elements), why)

    def driven_by(self, x_trans: str) -> Run:
        """The same run for a belt that sticks, or slides, all along."""
        pulley = replace(self.scene.pulleys[0], omega=None, torque=None, x_trans=x_trans)
        return replace(self, scene=replace(self.scene, pulleys=(pulley,)))


def starts(run: Run, initial: Solution | None) -> list[Start]:
    """Ways to a state of the lowest degree, of which each is for scenes in which those before it fail."""
    pulley = run.scene.pulleys[0]
    degrees = () if initial is None else WARM if initial.method == METHOD else RESCUE
    ways: list[Start] = [functools.partial(warm, initial=initial, degree=degree) for degree in degrees]
    if pulley.drive != "x_trans" and pulley.friction > 0.0:
        return [*ways, _driven]
    if len(posed(run.scene).parts) == 3:
        return [*ways, _from_string, _bent, _from_softer]
    return [*ways, _from_string, _bent, _from_softer, _from_pure_stick]


def _from_string(run: Run) -> State:
    """From the string, which knows where a belt touches that is short of bending stiffness, or of clamps near by."""
    return _bent(run, held=False)


def _bent(run: Run, *, held: bool = True) -> State:
    """From the string, by a first step that bends the belt and leaves the borders where they are."""
    pulley = run.scene.pulleys[0]
    if pulley.friction == 0.0 and pulley.torque:
        raise Stopped(Status.CAPACITY_EXCEEDED, "Without friction, the belt transmits 0 N m.")
    string = taut_string(run.scene)
    if string is None:
        raise Stopped(Status.CONTACT_LOST, "The straight belt is clear of the pulley.")
    if string.slack:
        raise Stopped(Status.CONTACT_LOST, string.slack)
    pressed = _pressed(run.scene, string)
    if pressed is not None:
        string, held = taut_string(run.scene, pressed) or string, True
    start = from_string(run.scene, string, posed(run.scene), LOWEST, run.elements)
    run.stages.ran("taut string", "first guess")
    return run.newton(start, "the taut string", held=held)


def _pressed(scene: Scene, string: TautString) -> tuple[float, float] | None:
    """Angles at which contact begins and ends, where a clamp next to the pulley presses the belt onto it.

    Within its bending layer, the belt comes from the clamp to the pulley as a cubic parabola, whatever its tension: it
    goes down by the clamp's distance from the pulley, and turns by the angle from the clamp's direction to the tangent.
    """
    pulley, layer = scene.pulleys[0], bending_layer(scene, float(np.mean(string.strain)))
    angles = [float(string.angles[0]), float(string.angles[-1])]
    pressed = False
    for end, sign in enumerate((1.0, -1.0)):
        across = scene.span / 2 + sign * pulley.center[0]
        turn = math.atan2(across, -pulley.center[1])
        length = 3.0 * (math.hypot(across, pulley.center[1]) - pulley.radius) / turn
        if length < PRESSED * layer:
            angles[end], pressed = sign * (turn - length / pulley.radius), True
    return (angles[0], angles[1]) if pressed else None


def _from_softer(run: Run) -> State:
    """By way of a belt that bends more easily and so is more like a string."""
    belt = run.scene.belt
    softer = replace(belt, bending_stiffness=SOFTER * belt.bending_stiffness)
    way = replace(run, scene=replace(run.scene, belt=softer))
    state = _bent(way)
    return run.on(posed(run.scene), state.ends, state, "a belt that bends more easily")


def warm(run: Run, initial: Solution, degree: int) -> State:
    """From a given solution, whatever its method, with elements of this degree."""
    contact = [Part(zone.kind, zone.slip) for zone in initial.zones[1:-1]]
    if initial.fields is None or not _fits(run.scene, contact):
        run.stages.skipped("warm start", "the given solution has other zones")
        raise Stopped(Status.NEWTON_DIVERGED, "The given solution has other zones.")
    old, zones, why = initial.state, ordered(run.scene, contact), "the given solution"
    if isinstance(old, State):
        ends = old.ends
    else:
        units = initial.scene.dimensionless()[1].inverse()
        ends = np.array([zone.sigma[0] for zone in initial.zones] + [initial.zones[-1].sigma[1]]) * units.length
        old = initial.fields.in_units(units)
    run.stages.skipped("taut string", "a solution was given to start from")
    return run.on(zones, ends, old, why, degree=degree)


def _fits(scene: Scene, contact: list[Part]) -> bool:
    """Whether zones that were found can be those of a scene: from stick on, they are those that it asks for.

    A given speed or torque leaves them open; whether it is met is seen afterwards.
    """
    if not contact or scene.pulleys[0].drive != "x_trans":
        return bool(contact)
    wanted = list(posed(scene).parts[1:-1])
    if STICK not in wanted:
        return contact == wanted
    first = contact.index(STICK) if STICK in contact else 0
    after = contact[first + 1 :]
    return after[: len(wanted) - 1] == wanted[1:]


def _from_pure_stick(run: Run) -> State:
    stick = in_pure_stick(run)
    _, up, off, _ = stick.ends
    margin = (1.0 - NEARLY) * (off - up)
    place = np.clip(np.interp(run.scene.pulleys[0].x_trans, *stick.nodes.T[::-1]), up + margin, off - margin)
    return run.on(posed(run.scene), np.insert(stick.ends, 2, place), stick, "pure stick")


def in_pure_stick(run: Run) -> State:
    """The belt that sticks all along the contact."""
    pure = run.driven_by(RUN_OFF)
    stick = _first([functools.partial(way, pure) for way in (_from_string, _bent, _from_softer)])
    _, up, off, _ = stick.ends
    if off - up < SHORTEST or (p := stick.values[:, local(LOWEST).p]).min() < -NEGATIVE * p.max():
        raise Stopped(Status.NEWTON_DIVERGED, "Pure stick was not found from the taut string.")
    return stick


def _driven(run: Run) -> State:
    """The belt at a given speed or moment.

    Raises:
        Stopped: Friction cannot transmit the moment.
    """
    stick = in_pure_stick(run)
    if meets(run, stick):
        return stick
    slip, place = _transition(run, stick)
    if place is not None and stick.ends[2] - place < SHORT_SLIP * (stick.ends[2] - stick.ends[1]):
        why = "a short slip zone, which only a well known pure stick can place"
        stick = run.driven_by(RUN_OFF).newton(stick.of_degree(FINE), why, arrived=PLACED)
        if meets(run, stick):
            return stick
        slip, place = _transition(run, stick)
    zones = posed(run.scene, slip)
    if place is not None:
        try:
            return run.on(zones, np.insert(stick.ends, 2, place), stick, "pure stick", degree=stick.degree)
        except Stopped:
            run.stages.skipped("pure stick", "it led nowhere")
    slid = run.on(ordered(run.scene, [Part("slip", slip)]), stick.ends, stick, "pure stick, now sliding all along")
    if meets(run, slid):
        return slid
    _, up, off, _ = slid.ends
    ends = np.insert(slid.ends, 2, NEARLY * up + (1.0 - NEARLY) * off)
    return run.on(zones, ends, slid, "sliding all along")


def _transition(run: Run, stick: State) -> tuple[Slip, float | None]:
    """In which sense the belt slides at a given speed or torque, and from where on, seen from pure stick."""
    ahead = _ahead(run.scene, stick)
    slip: Slip = "forward" if ahead < 0.0 else "backward"
    return slip, transition(run.scene, stick, SENSE[slip], ahead)


def _first(ways: list[Callable[[], State]]) -> State:
    """The first state that one of several ways leads to."""
    *earlier, last = ways
    for way in earlier:
        try:
            return way()
        except Stopped as stopped:
            if stopped.status is not Status.NEWTON_DIVERGED:
                raise
    return last()


def meets(run: Run, state: State) -> bool:
    """Whether a state meets the given speed or moment, even if it has no transition that these could place.

    Raises:
        Stopped: Friction cannot transmit the moment.
    """
    zones, pulley = state.mesh.layout, run.scene.pulleys[0]
    if zones.slides_behind(0) or pulley.drive == "x_trans" or pulley.friction == 0.0:
        return True
    ahead = _ahead(run.scene, state)
    if STICK in zones.parts or zones.parts[1].sense * ahead > 0.0:
        return abs(ahead) <= DRIVE * transmissible(pulley.friction, state.pressure_force) + ROUNDING
    if pulley.drive == "omega":
        return True
    if state.degree < FINE:
        return meets(run, run.newton(state.of_degree(FINE), "the moment that friction can transmit", arrived=PLACED))
    capacity = -pulley.radius * state.friction_force * run.units.of(length=1, force=1)
    raise Stopped(Status.CAPACITY_EXCEEDED, f"Sliding all along, the belt transmits {capacity:.6g} N m.")


def _ahead(scene: Scene, state: State) -> float:
    """By how much the given stretch, or resultant of friction, exceeds that of a state."""
    pulley = scene.pulleys[0]
    if pulley.drive == "omega":
        return pulley.radius * pulley.omega - state.D_stick
    return -pulley.torque / pulley.radius - state.friction_force
