"""The belt as a boundary-value problem, solved by collocation: an independent check without finite elements.

Each zone of the belt has its own ordinary differential equations (section 18.3, `bvp_zones`), and each is mapped to
[0, 1] (`bvp_problem`). The unknown constants are the borders of the zones, the stretch in stick and the forces in the
free spans. With these forces the source's nineteen equations are fifteen: two of the six in each free span are
integrated by hand, which makes the collocation's matrices smaller and keeps the force constant to rounding.

A taut string on a coarse mesh is the first guess. Where Newton's iteration does not find an answer from it, it goes
there in steps: from a belt that bends more easily, which is more like a string, or from one that bends less easily,
whose layers are wider. Finer meshes then make the answer as accurate as wanted (`bvp_collocation`).
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace

import numpy as np

from belt_fenicsx.bvp_answer import answer, plausible, speed
from belt_fenicsx.bvp_collocation import COARSE, Discrete, graded, newton, refined
from belt_fenicsx.bvp_problem import FIRST, LAST, Condition, Problem, component, moment
from belt_fenicsx.bvp_zones import Free, Rod, Slip, Stick, ZoneEquations
from belt_fenicsx.certificate import SENSE, certified, check_transition
from belt_fenicsx.scene import RUN_OFF, RUN_UP, Pulley, Scene, SceneError, Units, number
from belt_fenicsx.scene import Slip as Sense
from belt_fenicsx.solution import Contact, Solution, Stage, Status, finish
from belt_fenicsx.taut_string import LEAST_STRAIN, taut_string

METHOD = "bvp"
CONTINUATIONS = ((0.1, 0.3, 1.0), (10.0, 3.0, 1.0))  # bending stiffnesses on the way, over the belt's
TOLERANCE = 1e-7  # of the certificate, at least


@dataclass(frozen=True)
class State:
    """What a warm start needs: the zones and their solution."""

    zones: tuple[ZoneEquations, ...]
    discrete: Discrete


@dataclass
class Log:
    """The stages of a solve, timed one after another."""

    stages: list[Stage] = field(default_factory=list)
    since: float = field(default_factory=time.perf_counter)

    def ran(self, name: str, why: str, iterations: int) -> None:
        """Adds a stage that has just ended."""
        now = time.perf_counter()
        self.stages.append(Stage(name=name, why=why, iterations=iterations, seconds=now - self.since))
        self.since = now

    def skipped(self, name: str, why: str) -> None:
        """Adds a stage that the scene does not need."""
        self.stages.append(Stage(name=name, why=why))


class Stopped(Exception):
    """A solve that ends without an answer.

    Attributes:
        status: How it ended.
        message: What was seen.
    """

    def __init__(self, status: Status, message: str) -> None:
        self.status, self.message = status, message
        super().__init__(status, message)


def solve(scene: Scene, *, rtol: float = 1e-8, initial: Solution | None = None, throw: bool = True) -> Solution:
    """Solves a scene.

    Args:
        scene: The scene.
        rtol: Wanted relative accuracy of the angular velocity, from 1e-12 to 0.1 [-].
        initial: A solution by this method from which to start; it needs to have the same zones.
        throw: Whether to raise where there is no admissible answer, instead of returning what there is.

    Returns:
        The solution. Where the angular velocity is given, the estimated error is that of the belt's speed at the
        run-off instead.

    Raises:
        SceneError: The transition lies outside of the contact, or an argument is out of its range.
        SolveError: There is no admissible answer and ``throw`` is true.
    """
    if not 1e-12 <= number("rtol", rtol, "-") <= 0.1:
        raise SceneError("rtol", "lie in [1e-12, 0.1] [-]", rtol)
    # A step too far may leave the equations' domain; what it leaves there is judged by its residual.
    with np.errstate(all="ignore"):
        solution = _solve(scene, rtol, initial.state if initial is not None else None)
    if solution.status is Status.SOLVED:
        solution = certified(solution, tolerance=max(TOLERANCE, rtol))
    return finish(solution, throw=throw)


def _solve(scene: Scene, rtol: float, initial: State | None) -> Solution:
    dimensionless, units = scene.dimensionless()
    pulley, log = dimensionless.pulleys[0], Log()
    solution = Solution(scene=scene, method=METHOD, status=Status.SOLVED)
    try:
        if taut_string(dimensionless) is None:
            raise Stopped(Status.CONTACT_LOST, "The straight belt is clear of the pulley.")
        aim = dimensionless if pulley.drive == "x_trans" else _aim(dimensionless, units, log)
        problem = pose(aim, pulley)
        coarse = _started(problem, aim, initial, log)
        if plausible(problem, coarse):
            log.skipped("continuation", "the first guess sufficed")
        else:
            if pulley.drive == "x_trans":
                _check_transition(scene, dimensionless, units)
            coarse = _continued(problem, aim, log)
        end = LAST if pulley.drive == "omega" else FIRST
        fine, error, iterations = refined(problem, coarse, lambda discrete: speed(problem, discrete, end), rtol)
        log.ran("refinement", f"to {fine.mesh.size - 1} intervals in each zone", iterations)
        if not (fine.converged and error <= rtol):
            raise Stopped(Status.NEWTON_DIVERGED, f"The finest mesh leaves {_left(fine)} and an error of {error:.1g}.")
        contact, zones, fields = answer(problem, dimensionless, fine, pulley.omega)
        solution = replace(
            solution,
            contacts=(contact,),
            zones=zones,
            fields=fields,
            error_estimate=error,
            measures={"residual": fine.residual},
            state=State(problem.zones, fine),
        ).in_units(scene, units)
    except Stopped as stopped:
        solution = replace(solution, status=stopped.status, message=stopped.message)
    iterations = sum(stage.iterations or 0 for stage in log.stages)
    return replace(solution, stages=tuple(log.stages), iterations=iterations)


def _left(discrete: Discrete) -> str:
    return f"a residual of {discrete.residual:.1g} on {discrete.mesh.size - 1} intervals"


def pose(scene: Scene, drive: Pulley | None = None) -> Problem:
    """The boundary-value problem of the zones of a dimensionless scene.

    Args:
        scene: The scene, driven by ``x_trans``, which says what zones there are.
        drive: The pulley as it is really driven, if in another way.
    """
    pulley, belt = scene.pulleys[0], scene.belt
    rod = Rod(
        a=belt.bending_stiffness,
        b1=belt.extensional_stiffness,
        b2=belt.shear_stiffness,
        radius=pulley.radius,
        center=pulley.center,
    )
    slip = Slip(SENSE[pulley.slip] * pulley.friction)
    if pulley.x_trans == RUN_UP or pulley.friction == 0.0:
        return Problem(rod, scene.span, (Free(), slip, Free()), ())
    if pulley.x_trans == RUN_OFF:
        return Problem(rod, scene.span, (Free(), Stick(), Free()), ())
    drive = drive or pulley
    match drive.drive:
        case "x_trans":
            condition = Condition(((1, LAST, component(0)),), drive.x_trans)
        case "omega":
            condition = Condition(((1, LAST, component(5)),), rod.radius * drive.omega)
        case "torque":
            condition = Condition(((1, FIRST, moment(rod, 1.0)), (2, LAST, moment(rod, -1.0))), drive.torque)
    return Problem(rod, scene.span, (Free(), Stick(), slip, Free()), (condition,))


def _aim(scene: Scene, units: Units, log: Log) -> Scene:
    """A scene driven by ``x_trans`` with about the given speed or torque, from the limits of pure stick and slip."""
    pulley, quantity = scene.pulleys[0], scene.pulleys[0].drive
    asked, limits = getattr(pulley, quantity), Log()

    def limit(x_trans: str, slip: Sense) -> tuple[Scene, Contact]:
        driven = replace(scene, pulleys=(replace(pulley, x_trans=x_trans, slip=slip, omega=None, torque=None),))
        problem, discrete = _coarse(driven, limits)
        return driven, answer(problem, driven, discrete)[0]

    stuck, stick = limit(RUN_OFF, "forward")
    beyond_stick = asked - getattr(stick, quantity)
    # A pulley that the belt drives along is slower than the belt that leaves it.
    forward = beyond_stick > 0.0 if quantity == "torque" else beyond_stick < 0.0
    sliding, slide = limit(RUN_UP, "forward" if forward else "backward")
    log.ran("limits", f"`{quantity}` is given, not `x_trans`", sum(stage.iterations or 0 for stage in limits.stages))
    reach = getattr(slide, quantity) - getattr(stick, quantity)
    if beyond_stick == 0.0:
        return stuck
    if abs(beyond_stick) >= abs(reach):
        if quantity == "torque":
            capacity = slide.torque * units.of(length=1, force=1)
            raise Stopped(Status.NOT_ADMISSIBLE, f"The torque is beyond the {capacity:.6g} N m of sliding all along.")
        return sliding
    x_trans = stick.x_off + beyond_stick / reach * (stick.x_up - stick.x_off)
    return replace(sliding, pulleys=(replace(sliding.pulleys[0], x_trans=x_trans),))


def _coarse(scene: Scene, log: Log) -> tuple[Problem, Discrete]:
    """The problem of a scene driven by ``x_trans``, and its solution on the coarse mesh."""
    problem = pose(scene)
    discrete = _started(problem, scene, None, log)
    return problem, discrete if plausible(problem, discrete) else _continued(problem, scene, log)


def guess(problem: Problem, scene: Scene) -> Discrete:
    """The taut string on the coarse mesh."""
    rod, string = problem.rod, taut_string(scene)
    borders = string.borders if len(problem.zones) == 4 else string.borders[[0, 2]]
    ends = np.array([-0.5, *borders, 0.5])
    strains = np.maximum(string.strain, LEAST_STRAIN)
    layers = [
        math.sqrt(rod.a / (rod.b1 * np.mean(strains))) if zone.kind == "free" else math.sqrt(rod.a / rod.b2)
        for zone in problem.zones
    ]
    width = float(np.clip(2.0 * np.min(layers / np.diff(ends)), 1e-4, 1.0))
    mesh = graded(width, COARSE)
    y, constants = [], []
    for i, zone in enumerate(problem.zones):
        sigma = ends[i] + mesh * (ends[i + 1] - ends[i])
        phi, D = string.phi(sigma), string.D(sigma)
        if zone.kind == "free":
            side = 0 if i == 0 else -1
            phi = np.full_like(sigma, string.angles[side])
            y += [*string.r(sigma).T, phi, np.zeros_like(sigma)]
            force = rod.b1 * strains[side]
            constants += [force * math.cos(phi[0]), force * math.sin(phi[0])]
        else:
            y += [phi, phi, -D / rod.radius]
            if zone.kind == "stick":
                constants.append(1.0 + strains[0])
            else:
                y.append(D)
    return Discrete(width=width, mesh=mesh, y=np.array(y), p=np.array([*borders, *constants]))


def _started(problem: Problem, scene: Scene, initial: State | None, log: Log) -> Discrete:
    """A solution on the coarse mesh, from a given one or from the taut string."""
    if initial is None or [type(zone) for zone in initial.zones] != [type(zone) for zone in problem.zones]:
        log.skipped("warm start", "no solution with the same zones was given")
    else:
        coarse = newton(problem, initial.discrete.on(COARSE))
        log.ran("warm start", "from the given solution", coarse.iterations)
        if plausible(problem, coarse):
            log.skipped("taut string", "the warm start sufficed")
            return coarse
    coarse = newton(problem, guess(problem, scene))
    log.ran("taut string", "no plausible solution yet", coarse.iterations)
    return coarse


def _continued(problem: Problem, scene: Scene, log: Log) -> Discrete:
    """A solution on the coarse mesh, from the taut string along belts of other bending stiffness."""
    iterations = 0
    for factors in CONTINUATIONS:
        coarse = guess(problem, scene)
        for factor in factors:
            rod = replace(problem.rod, a=factor * problem.rod.a)
            coarse = newton(replace(problem, rod=rod), coarse)
            iterations += coarse.iterations
            if not coarse.converged:
                break
        if plausible(problem, coarse):
            break
    log.ran("continuation", "the first guess did not lead to a plausible solution", iterations)
    if not coarse.converged:
        raise Stopped(Status.NEWTON_DIVERGED, f"The continuation leaves {_left(coarse)}.")
    return coarse


def _check_transition(scene: Scene, dimensionless: Scene, units: Units) -> None:
    """Where no plausible solution was found: is it that the transition lies outside of the contact of pure stick?"""
    stuck = replace(dimensionless, pulleys=(replace(dimensionless.pulleys[0], x_trans=RUN_OFF),))
    problem, discrete = _coarse(stuck, Log())
    if plausible(problem, discrete):
        contact, _, _ = answer(problem, stuck, discrete)
        check_transition(scene, contact.x_up * units.length, contact.x_off * units.length)
