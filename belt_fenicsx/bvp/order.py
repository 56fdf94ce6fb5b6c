"""The order of the zones on the pulley: what a scene asks for, what holds between zones, and what breaks an order.

On the pulley, the stretch obeys D' ~ f0 - f, where f0 is the friction that would keep it constant. Stick needs f = f0
and |f0| <= mu p; sliding has f = -s mu p, its sense s being the sign of D less the stretch in stick. So:

- Sliding passes into stick only where D' = 0, that is f0 = -s mu p: friction is continuous there.
- Stick can end anywhere and in both senses, with a jump of friction. Where it does is what the drive decides. It ends
  where |f0| = mu p at the latest: D' then has the sign of f0 whatever the friction, and so has the sliding.
- Where D comes back to the stretch in stick otherwise, it crosses it, and sliding goes on in the other sense.

Usually f0 breaks the bound next to the run-up, where it is negative, and next to the run-off, where it is positive, if
it does at all. Then the belt slides forward at both ends of the contact, and stick ends by backward sliding in between
where the pulley is braked, or turns freely.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from belt_fenicsx.bvp.equations import Free, Rod, Slip, Stick
from belt_fenicsx.bvp.newton import Discrete
from belt_fenicsx.bvp.problem import FIRST, LAST, Condition, Problem, component, moment, onset, places
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import SENSE
from belt_fenicsx.scene.pulley import RUN_OFF, RUN_UP, Pulley
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.contact import Zone

STICK = 0
NOTHING = 1e-12  # length of a zone that has shrunk to nothing, in belt lengths
LEAST = 1e-3  # length of a new zone that nothing else tells, in lengths of the contact
FINER = 16  # pieces of each interval of the mesh in which a new border is looked for
BROKEN = 1e-8  # by how much a bound is broken, relative to the largest one
SLACK = 1e-5  # of the sense of sliding on a coarse mesh, relative to the largest speed of the zone
ROUNDING = 1e-14  # of the stretch


@dataclass(frozen=True)
class Order:
    """What the belt does along the contact, in the direction of travel.

    Attributes:
        senses: One number for each zone: +1 forward and -1 backward sliding, 0 stick.
        longest: Whether stick ends where Coulomb's bound does, instead of where the drive says.
    """

    senses: tuple[int, ...]
    longest: bool = False

    @staticmethod
    def of(zones: tuple[Zone, ...]) -> Order:
        """The order of the zones of a solution."""
        return Order(tuple(int(SENSE.get(zone.slip or "", STICK)) for zone in zones[1:-1]))

    @property
    def transition(self) -> int | None:
        """The zone at whose end the belt leaves the pulley's speed for good; None where no sliding follows."""
        first = self.senses.index(STICK) if STICK in self.senses else 0
        return first if first + 1 < len(self.senses) else None

    def __str__(self) -> str:
        return " | ".join({0: "stick", 1: "forward slip", -1: "backward slip"}[sense] for sense in self.senses)


@dataclass(frozen=True)
class Revision:
    """A change of an order that does not hold.

    Attributes:
        why: What was seen.
        order: The new order; None where the drive asks for a transition that cannot be.
        borders: Where its zones begin and end, about ``(len(senses) + 1,)``.
    """

    why: str
    order: Order | None = None
    borders: Array | None = None


def asked(pulley: Pulley) -> Order:
    """The order that a pulley driven by ``x_trans`` asks for."""
    sense = int(SENSE[pulley.slip or "forward"])
    if pulley.friction == 0.0 or pulley.x_trans == RUN_UP:
        return Order((sense,))
    return Order((STICK,)) if pulley.x_trans == RUN_OFF else Order((STICK, sense))


def pose(scene: Scene, order: Order | None = None) -> Problem:
    """The boundary-value problem of a dimensionless scene, with the order that it asks for if not another."""
    pulley, belt = scene.pulleys[0], scene.belt
    rod = Rod(
        a=belt.bending_stiffness,
        b1=belt.extensional_stiffness,
        b2=belt.shear_stiffness,
        radius=pulley.radius,
        center=pulley.center,
    )
    order = order or asked(pulley)
    contact = tuple(Slip(sense * pulley.friction) if sense else Stick() for sense in order.senses)
    return Problem(rod, scene.span, (Free(), *contact, Free()), tuple(_conditions(order, pulley, rod)))


def _conditions(order: Order, pulley: Pulley, rod: Rod) -> Iterator[Condition]:
    """One condition for each border between zones on the pulley."""
    transition = order.transition
    for i, (sense, following) in enumerate(pairwise(order.senses)):
        end = (i + 1, LAST)
        if following == STICK:
            yield Condition(((*end, onset(rod, Slip(sense * pulley.friction))),))
        elif i != transition:
            yield Condition(((*end, component(5)), (transition + 1, LAST, component(5, -1.0))))
        elif order.longest:
            yield Condition(((*end, onset(rod, Slip(-following * pulley.friction))),))
        elif pulley.drive.kind == "x_trans":
            yield Condition(((*end, component(0)),), pulley.x_trans)
        elif pulley.drive.kind == "omega":
            yield Condition(((*end, component(5)),), rod.radius * pulley.omega)
        else:
            on_pulley = (1, FIRST, moment(rod, 1.0)), (len(order.senses), LAST, moment(rod, -1.0))
            yield Condition(on_pulley, pulley.torque)


def revision(problem: Problem, order: Order, discrete: Discrete, pulley: Pulley, doubt: float = 0.0) -> Revision | None:
    """What the first broken bound of a solution calls for; None where all hold.

    Args:
        problem: The problem.
        order: The order of its zones.
        discrete: Its solution.
        pulley: The dimensionless pulley.
        doubt: Negative length of a zone that does not count, in lengths of the contact.
    """
    borders = problem.borders(discrete.p)[1:-1]
    shortest = int(np.argmin(np.diff(borders)))
    if borders[shortest + 1] - borders[shortest] <= (NOTHING if doubt == 0.0 else -doubt * (borders[-1] - borders[0])):
        return _without(order, borders, shortest, pulley, "has shrunk to nothing")
    slack = BROKEN if doubt == 0.0 else SLACK
    if (found := _broken(problem, order, discrete, discrete.mesh, pulley, slack)) is None:
        return None
    # A new border has to start close to where it will be.
    fine = discrete.finer(FINER)
    return _broken(problem, order, discrete, fine, pulley, slack) or found


def _broken(
    problem: Problem, order: Order, discrete: Discrete, xi: Array, pulley: Pulley, slack: float
) -> Revision | None:
    """What the first bound that breaks at some coordinates calls for."""
    borders, inside = problem.borders(discrete.p)[1:-1], places(discrete.widths, xi)[1:-1]
    parts = problem.parts(discrete.between(xi), discrete.p)[1:-1]
    stretches = [zone.state(problem.rod, functions, c)[5] for zone, functions, c in parts]
    for i, (zone, functions, c) in enumerate(parts):
        if borders[i + 1] <= borders[i]:
            continue
        sigma, found = borders[i] + (borders[i + 1] - borders[i]) * inside[i], None
        if order.senses[i] == STICK:
            pressure, friction = zone.tractions(problem.rod, functions, c)
            found = _bound(order, borders, i, pulley, sigma, friction, pulley.friction * pressure)
        elif order.transition is not None:
            found = _turn(order, borders, i, sigma, stretches[i] - stretches[order.transition][LAST], slack)
        elif pulley.drive.kind == "omega" and pulley.friction > 0.0:
            found = _turn(order, borders, i, sigma, stretches[i] - problem.rod.radius * pulley.omega, slack)
        if found is not None:
            return found
    return None


def _without(order: Order, borders: Array, i: int, pulley: Pulley, how: str) -> Revision:
    """The order without zone ``i``."""
    senses, transition, last = order.senses, order.transition, len(order.senses) - 1
    placed = pulley.drive.kind == "x_trans" and transition is not None and not order.longest
    why = f"zone {i + 1} of {order} {how}"
    length = borders[i + 1] - borders[i]
    if length < -NOTHING and i == last == (transition or 0) + 1 and senses[i - 1] == STICK and not placed:
        length = max(-length, LEAST * (borders[-1] - borders[0]))
        return Revision(
            why, Order((*senses[:-1], -senses[-1])), np.array([*borders[:-2], borders[-1] - length, borders[-1]])
        )
    left = list(zip(senses, borders[:-1], strict=True))
    if i < last:
        left[i + 1] = (senses[i + 1], borders[i])
    del left[i]
    left = [zone for j, zone in enumerate(left) if j == 0 or zone[0] != left[j - 1][0]]
    shorter = Order(tuple(sense for sense, _ in left), order.longest and len(left) > 1)
    kept = shorter.transition
    if placed and (kept is None or shorter.senses[kept + 1] != SENSE[pulley.slip]):
        return Revision(why)
    return Revision(why, shorter, np.array([*(start for _, start in left), borders[-1]]))


def _bound(
    order: Order, borders: Array, i: int, pulley: Pulley, sigma: Array, f: Array, bound: Array
) -> Revision | None:
    """A slip zone next to stick where Coulomb's bound breaks at one of its ends."""
    excess = np.abs(f) - bound
    holds = np.flatnonzero(excess <= BROKEN * np.max(bound))
    if holds.size == 0:
        how = "breaks Coulomb's bound all along"
        if i > 0:
            return _without(order, borders, i, pulley, how)
        # The belt slides until the transition.
        sliding = Order((-int(np.sign(f[0])), *order.senses))
        return _without(sliding, np.insert(borders, 1, borders[1]), 1, pulley, how)
    why = "Coulomb's bound breaks where stick {}"
    if holds[0] > 0 and i == 0:
        place = _crossing(sigma, excess, holds[0] - 1)
        longer = Order((-int(np.sign(f[0])), *order.senses), order.longest)
        return Revision(why.format("begins"), longer, np.insert(borders, 1, place))
    if holds[-1] + 1 < sigma.size and not order.longest:
        place, sense = _crossing(sigma, excess, holds[-1]), int(np.sign(f[-1]))
        stuck = order.senses[: i + 1]
        if pulley.drive.kind != "x_trans":
            # The pulley's speed and torque change without a break where backward turns to forward sliding.
            back = min(borders[i + 1] - place, place - borders[i]) / 2.0
            turned = np.array([*borders[: i + 1], place - back, place + back, borders[-1]])
            return Revision(why.format("ends"), Order((*stuck, -sense, sense)), turned)
        if order.transition is None:
            longest = Order((*stuck, sense), longest=True)
            return Revision(why.format("ends"), longest, np.insert(borders, i + 1, place))
        return Revision(why.format("ends"))
    return None


def _turn(order: Order, borders: Array, i: int, sigma: Array, ahead: Array, slack: float) -> Revision | None:
    """Two slip zones in place of one in which the belt slides both ways."""
    wrong = order.senses[i] * ahead < -max(slack * np.max(np.abs(ahead)), ROUNDING)
    if not np.any(wrong):
        return None
    why = f"the belt slides the other way in a part of zone {i + 1} of {order}"
    sense, last = order.senses[i], sigma.size - 1
    if wrong[last]:
        crossing = int(np.max(np.flatnonzero(~wrong), initial=0))
        turned = (sense, -sense)
    else:
        crossing = int(np.max(np.flatnonzero(wrong)))
        turned = (-sense, sense)
    place = _crossing(sigma, ahead, crossing)
    senses = (*order.senses[:i], *turned, *order.senses[i + 1 :])
    return Revision(why, Order(senses, order.longest), np.insert(borders, i + 1, place))


def _crossing(sigma: Array, values: Array, i: int) -> float:
    """Where values change their sign between the nodes ``i`` and ``i + 1``."""
    part = np.clip(values[i] / (values[i] - values[i + 1]), 0.05, 0.95)
    return float(sigma[i] + part * (sigma[i + 1] - sigma[i]))
