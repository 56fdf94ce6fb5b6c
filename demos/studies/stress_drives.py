# %% [markdown]
# # Stress test of drives: closed loops at random
#
# Loops of two to six pulleys on either side of the belt: thin and thick, fast and at rest, hardly loaded and near their
# capacity, with gravity and with a touching fibre off the middle line. The load is a part of what the exact string
# transmits. Each is solved by collocation and by fitted finite elements, and by collocation at a tighter tolerance,
# so that an answer that is silently wrong shows. The load may also be said by a slip angle or grow with the speed, and
# an idler may be pushed by a force.
#
#     python demos/studies/stress_drives.py             300 loops
#     python demos/studies/stress_drives.py --load "slip angle" --count 60
#     python demos/studies/stress_drives.py --readme    writes the tables of all loads into the README

# %%
from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from readme import write_into_readme
from stress import Draw

from belt_fenicsx import Belt, Pulley, Scene, SceneError, Solution, bvp, solve
from belt_fenicsx.scene.path import taut_path
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.taut_string.capacity import capacities
from belt_fenicsx.taut_string.drive import string_drive

RTOL, TIGHT, AGREEMENT = 1e-8, 1e-10, 1e-7
METHODS = ("bvp", "fitted")
SLOWEST = 3  # loops that are named
LEAST_WRAP = math.radians(5.0)
LOADS = {
    "torque": 300,
    "slip angle": 60,
    "torque and drag": 60,
    "take-up": 60,
}  # How the load is said, and of how many.
MARGIN = 1.2  # Of a wrap over that at which a stiff belt touches its pulley at a point.
SPEED = 10.0  # of the first pulley's surface [m/s]


# %% [markdown]
# ## Loops
#
# Some pulleys lie inside of the loop, on a polygon. Between two of them, an idler may press on the belt's back.
# One pulley is given its speed, one or two have a torque, the others turn freely.


# %%
def places(draw: Draw) -> list[Pulley] | None:
    """Pulleys of a loop, in the order of travel; None where there is no room for them."""
    inside = int(draw.one_of(("2", "2", "3", "4")))
    turns = sorted((draw.even(0.0, 2.0 * math.pi) for _ in range(inside)), reverse=True)
    centers = [draw.even(0.5, 1.0) * np.array([math.cos(turn), draw.even(0.3, 1.0) * math.sin(turn)]) for turn in turns]
    radii = [draw.logarithmic(0.05, 0.35) for _ in range(inside)]
    friction = draw.logarithmic(0.02, 1.0)
    pulleys = []
    for i, (center, radius) in enumerate(zip(centers, radii, strict=True)):
        pulleys.append(Pulley(radius=radius, center=tuple(center.tolist()), friction=friction))
        if len(pulleys) < 6 and draw.even(0.0, 1.0) < 0.4:
            following, along = centers[(i + 1) % inside], draw.even(0.35, 0.65)
            way = following - center
            aside = np.array([-way[1], way[0]]) / math.hypot(*way)
            idler = draw.logarithmic(0.04, 0.15)
            edge = (1.0 - along) * radius + along * radii[(i + 1) % inside]
            pressed = center + along * way + aside * (edge + idler - draw.even(0.05, 0.6) * edge)
            pulleys.append(Pulley(radius=idler, center=tuple(pressed.tolist()), friction=friction, side="left"))
    return pulleys


def loop(draw: Draw) -> Scene | None:
    """A loop at random; None where its pulleys have no room, or the load no taut string."""
    pulleys = places(draw)
    strain, ratio, nu = draw.logarithmic(0.003, 0.04), draw.logarithmic(0.005, 0.12), draw.even(0.0, 0.49)
    smallest = min(pulley.radius for pulley in pulleys)
    belt = Belt(
        youngs_modulus=draw.logarithmic(1e7, 1e10), poisson_ratio=nu, thickness=ratio * smallest, width=smallest / 2,
    )  # fmt: skip
    if draw.one_of(("middle", "surface")) == "surface":
        belt = replace(belt, contact_offset=belt.thickness / 2)
    if draw.one_of(("slow", "fast")) == "fast":
        # The centrifugal part rho c^2 of the stress, up to half of that of the pretension.
        belt = replace(belt, density=draw.even(0.01, 0.5) * strain * belt.youngs_modulus / SPEED**2)
    gravity = (0.0, draw.one_of(("0", "-9.81"))) if belt.density else (0.0, 0.0)
    count, load, second = len(pulleys), draw.even(0.05, 0.95), draw.even(-0.5, 0.5)
    driver, driven = sorted((int(draw.even(0, count)), int(draw.even(0, count))))
    if driver == driven:
        return None
    torques = [0.0] * count
    torques[driven] = 1.0
    if count > 2 and (other := int(draw.even(0, count))) not in (driver, driven):
        torques[other] = second
    try:

        def made(scale: float) -> Scene:
            given = [
                replace(p, omega=SPEED / p.radius) if i == driver else replace(p, torque=scale * torques[i])
                for i, p in enumerate(pulleys)
            ]
            down = (0.0, float(gravity[1]))
            return Scene(belt=belt, pulleys=tuple(given), closed=True, elongation=strain, gravity=down)

        small = made(1e-6 * belt.extensional_stiffness * strain * smallest)
        dimensionless, units = small.dimensionless()
        if not wrapped(dimensionless):
            return None
        transmitted = capacities(dimensionless, string_drive(dimensionless))
        # A pulley that never is the first one to slide all along transmits whatever the others do.
        limits = [abs(t / torque) for t, torque in zip(transmitted, torques, strict=True) if torque]
        limits.append(abs(transmitted[driver] / sum(torques)))
        least = min((limit for limit in limits if limit == limit), default=0.0)
        scene = made(load * least * units.of(length=1, force=1))
        string_drive(scene.dimensionless()[0])
        return scene
    except (SceneError, Stopped):
        return None


def wrapped(scene: Scene) -> bool:
    """Whether a belt of this bending stiffness touches each pulley along an arc.

    It turns by acos(1 - a / (2 F R^2)) where it leaves a pulley; a wrap of less than two such angles is a point.
    """
    string, a = string_drive(scene), scene.belt.bending_stiffness
    force = min(own.force[0] for own in string.parts)
    for arc in taut_path(scene).arcs:
        turned = 1.0 - a / (2.0 * force * scene.pulleys[arc.pulley].radius ** 2)
        if turned < -1.0 or arc.wrap < max(LEAST_WRAP, MARGIN * 2.0 * math.acos(turned)):
            return False
    return True


def loops(count: int, seed: int) -> Iterator[Scene]:
    """Draws loops."""
    draw, drawn = Draw(seed), 0
    while drawn < count:
        scene = loop(draw)
        if scene is not None:
            yield scene
            drawn += 1


# %% [markdown]
# ## Other loads
#
# The first load of a loop may be a slip angle, or grow with the speed; the first free idler may be pushed against the
# belt by a force close to that of the string. With a slip angle, what slides on the other pulleys follows, and may be
# more than there is.


# %%
def loaded(scene: Scene, load: str, draw: Draw) -> Scene | None:
    """A loop with its load said in another way; None where nothing is there to be loaded so."""
    pulleys, paths = list(scene.pulleys), taut_path(scene)
    driven = next(i for i, pulley in enumerate(pulleys) if pulley.torque)
    torque = pulleys[driven].torque or 0.0
    if load == "slip angle":
        angle = draw.even(0.05, 0.5) * paths.arcs[driven].wrap
        pulleys[driven] = pulleys[driven].driven(slip_angle=angle, slip="forward" if torque > 0.0 else "backward")
    elif load == "torque and drag":
        drag = abs(torque) * pulleys[driven].radius / SPEED
        pulleys[driven] = pulleys[driven].driven(torque=torque / 2.0, drag=drag / 2.0)
    elif load == "take-up":
        string = solve(scene, method="string", throw=False)
        idlers = [i for i, pulley in enumerate(pulleys) if pulley.torque == 0.0]
        if not (string.success and idlers):
            return None
        hub = string.contacts[idlers[0]]
        away = -math.cos(hub.hub_angle), -math.sin(hub.hub_angle)
        pulleys[idlers[0]] = replace(pulleys[idlers[0]], take_up=away, force=draw.even(0.8, 1.2) * hub.hub_load)
        belt = replace(scene.belt, length=paths.length / (1.0 + (scene.elongation or 0.0)))
        return replace(scene, pulleys=tuple(pulleys), belt=belt, elongation=None)
    return replace(scene, pulleys=tuple(pulleys))


def loads(count: int, seed: int, load: str) -> Iterator[Scene]:
    """Draws loops with a load that is said in one of several ways."""
    draw, drawn = Draw(seed), 0
    for scene in loops(10 * count, seed):
        other = loaded(scene, load, draw)
        if other is not None and drawn < count:
            yield other
            drawn += 1
        if drawn == count:
            return


# %% [markdown]
# ## Outcomes


# %%
@dataclass(frozen=True)
class Outcome:
    """How a loop ended: its number, its answer, its wall time [s], and how far a tighter answer is apart."""

    number: int
    scene: Scene
    answer: Solution
    seconds: float
    difference: float


def difference(one: Solution, other: Solution) -> float:
    """Largest difference of the transport rate, of speeds, and of torques over the radius times the tension."""
    tension = max(span.tension[1] for span in other.spans)
    found = [one.transport_rate / other.transport_rate - 1.0]
    for a, b, pulley in zip(one.contacts, other.contacts, one.scene.pulleys, strict=True):
        found += [a.omega / b.omega - 1.0, (a.torque - b.torque) / (pulley.radius * tension)]
    return max(map(abs, found))


def outcome(number: int, scene: Scene, method: str) -> Outcome:
    """Solves a loop by a method, and by collocation at a tighter tolerance."""
    began = time.perf_counter()
    answer = solve(scene, method=method, rtol=RTOL, throw=False)
    seconds = time.perf_counter() - began
    apart = math.nan
    if answer.success:
        tighter = bvp.solve(scene, rtol=TIGHT, throw=False)
        apart = difference(answer, tighter) if tighter.contacts else math.inf
    return Outcome(number, scene, answer, seconds, apart)


def report(outcomes: list[Outcome]) -> str:
    """Table of the outcomes, the slowest loops, and the largest difference."""
    counts = Counter(result.answer.status.name for result in outcomes)
    lines = ["| outcome | loops |", "| --- | --- |", *(f"| {cause} | {n} |" for cause, n in counts.most_common()), ""]
    apart = [result.difference for result in outcomes if result.answer.success]
    seconds = np.array([result.seconds for result in outcomes])
    worst = ", ".join(
        f"loop {outcomes[i].number} in {1e3 * seconds[i]:.0f} ms" for i in np.argsort(seconds)[::-1][:SLOWEST]
    )
    rescued = sum(any(stage.name == "method bvp" for stage in result.answer.stages) for result in outcomes)
    if outcomes[0].answer.method == "fitted":
        lines.append(f"Started from the zones of the other method: {rescued} of them.")
    lines += [
        f"Largest difference from the answer at rtol {TIGHT:g}: {max(apart, default=0.0):.1e}.",
        f"Median time {1e3 * np.median(seconds):.0f} ms. Slowest: {worst}.",
    ]
    return "\n".join(lines)


# %%
if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Solves closed loops at random.")
    parser.add_argument("--count", type=int, help="of loops of each load")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--load", choices=LOADS, help="one of them alone")
    parser.add_argument("--method", choices=METHODS, help="one of them alone")
    parser.add_argument("--readme", action="store_true", help="write the tables into the README")
    arguments = parser.parse_args()
    texts = []
    for load in [arguments.load] if arguments.load else LOADS:
        count = arguments.count or LOADS[load]
        drawn = [*enumerate(loads(count, arguments.seed, load))]
        for method in [arguments.method] if arguments.method else METHODS:
            finished = [outcome(number, scene, method) for number, scene in drawn]
            texts.append(f"{count} loops by {load}, seed {arguments.seed}, {method}.\n\n{report(finished)}")
            print(texts[-1])
            for result in finished:
                if not result.answer.success or not result.difference <= AGREEMENT:
                    said = " ".join((result.answer.message, *result.answer.violations))
                    print(f"\n{result.number}: {result.answer.status.name} {said}, difference {result.difference:.1e}")
    if arguments.readme:
        write_into_readme("stress of drives", "\n\n".join(texts))
