# %% [markdown]
# # Stress test: scenes at random, two methods, no silent error
#
# Each scene is solved by finite elements with fitted zones and by the boundary-value problem, which share the scene and
# the first guess and nothing else. It ends in one of three ways: both have an admissible answer and agree; both refuse
# it with the same status; or it is a failure that is listed with its cause.
#
#     python demos/stress.py                  500 scenes
#     python demos/stress.py --count 50 --seed 7
#     python demos/stress.py --readme         writes the table into the README, too

# %%
from __future__ import annotations

import argparse
import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from readme import write_into_readme

from belt_fenicsx import Belt, Pulley, Scene, SceneError, Solution, bvp, solve
from belt_fenicsx.taut_string import taut_string

# DOLFINx 0.5 tells of each form that it compiles, by the root logger.
logging.basicConfig(level=logging.WARNING)
logging.getLogger().addFilter(lambda record: record.levelno > logging.INFO)

AGREEMENT = 1e-7
# The moment is the difference of two tensions: by collocation it needs a tighter tolerance of omega than by elements.
FITTED_RTOL, BVP_RTOL = 1e-9, 1e-11
AGREED, SAME_REFUSAL = "agreed", "refused by both for the same reason"
SLOWEST = 3  # scenes that are named


# %% [markdown]
# ## Scenes
#
# Thickness, friction and strain are spread evenly over their logarithm. The belt's length follows from the mean strain
# of the string around the pulley. Where a clamp would lie inside of the pulley, or the string is clear of it, the scene
# is drawn again.


# %%
def scenes(count: int, seed: int) -> Iterator[Scene]:
    """Draws scenes."""
    draw = np.random.default_rng(seed)

    def logarithmic(low: float, high: float) -> float:
        return float(np.exp(draw.uniform(np.log(low), np.log(high))))

    drawn = 0
    while drawn < count:
        radius, top, shift = draw.uniform(0.25, 2.0), draw.uniform(0.03, 0.35), draw.uniform(-0.1, 0.1)
        thickness, friction, nu = logarithmic(0.004, 0.08), logarithmic(0.01, 1.0), draw.uniform(0.0, 0.49)
        strain, part, slip = logarithmic(0.005, 0.08), draw.uniform(0.15, 0.85), draw.choice(["forward", "backward"])
        place = {"radius": float(radius), "center": (float(shift), float(top - radius)), "friction": friction}
        try:
            string = taut_string(Scene(pulleys=(Pulley(**place),)))
        except SceneError:
            continue
        if string is None:
            continue
        path = float(np.sum(string.stretches * np.diff(string.sigma)))
        angle = string.angles[0] + part * (string.angles[-1] - string.angles[0])
        x_trans = float(shift - radius * np.sin(angle))
        belt = Belt(length=path / (1.0 + strain), thickness=thickness, poisson_ratio=float(nu))
        yield Scene(belt=belt, pulleys=(Pulley(**place, x_trans=x_trans, slip=str(slip)),))
        drawn += 1


# %% [markdown]
# ## Extremes, one at a time


# %%
def extremes() -> dict[str, Scene]:
    """The source's scene with one thing taken far."""

    def belt(**changed: float) -> Scene:
        return Scene(belt=Belt(**changed))

    def pulley(**changed: object) -> Scene:
        return Scene(pulleys=(Pulley(**changed),))

    return {
        **{f"thickness {h:g} m": belt(thickness=h) for h in (0.001, 0.002, 0.005, 0.1)},
        **{f"friction {mu:g}": pulley(friction=mu) for mu in (1e-4, 1e-3, 1.0, 3.0)},
        **{f"length {length:g} m": belt(length=length) for length in (1.02, 0.95)},
        **{f"pulley top {top:g} m": pulley(center=(0.0, top - 0.7)) for top in (0.001, 0.01, 0.19)},
        "nearly a half turn": Scene(
            belt=Belt(length=1.55, thickness=0.02), pulleys=(Pulley(radius=0.35, center=(0.0, 0.25)),)
        ),
        "Poisson ratio 0": belt(poisson_ratio=0.0),
        "pure stick, friction 0.03": pulley(friction=0.03, x_trans="run-off"),
    }


# %% [markdown]
# ## Outcomes


# %%
@dataclass(frozen=True)
class Outcome:
    """How a scene ended.

    Attributes:
        number: Number of the scene.
        scene: The scene.
        cause: `AGREED`, `SAME_REFUSAL`, or what went wrong.
        difference: Largest relative difference of omega, borders and torque; NaN without two answers.
        seconds: Wall time of the two methods [s].
    """

    number: int
    scene: Scene
    cause: str
    difference: float
    seconds: tuple[float, float]


def attempt(solver: Callable[..., Solution], scene: Scene, rtol: float) -> tuple[Solution | SceneError, float]:
    """The solution, or the error that says why the scene cannot be meant, and the wall time."""
    began = time.perf_counter()
    try:
        answer = solver(scene, rtol=rtol, throw=False)
    except SceneError as error:
        answer = error
    return answer, time.perf_counter() - began


def status(answer: Solution | SceneError) -> str:
    """Name of the status; that of a refused scene is the field that it names."""
    return f"SceneError {answer.field}" if isinstance(answer, SceneError) else answer.status.name


def difference(fem: Solution, reference: Solution) -> float:
    """Largest difference of the answers, relative to omega, the span, and the radius times the tension."""
    (a,), (b,), scene = fem.contacts, reference.contacts, fem.scene
    tension = float(np.max(np.abs(reference.fields.Q[:, 0])))
    return max(
        abs(a.omega / b.omega - 1.0),
        abs(a.x_up - b.x_up) / scene.span,
        abs(a.x_off - b.x_off) / scene.span,
        abs(a.torque - b.torque) / (scene.pulleys[0].radius * tension),
    )


def outcome(number: int, scene: Scene) -> Outcome:
    """Solves a scene by both methods and compares them."""
    fem, fem_seconds = attempt(solve, scene, FITTED_RTOL)
    reference, bvp_seconds = attempt(bvp.solve, scene, BVP_RTOL)
    seconds, names = (fem_seconds, bvp_seconds), (status(fem), status(reference))
    if names == ("SOLVED", "SOLVED"):
        apart = difference(fem, reference)
        cause = AGREED if apart <= AGREEMENT else f"both solved, apart by more than {AGREEMENT:g}"
        return Outcome(number, scene, cause, apart, seconds)
    same = names[0] == names[1]
    cause = f"{SAME_REFUSAL}: {names[0]}" if same else f"fitted: {names[0]}, BVP: {names[1]}"
    return Outcome(number, scene, cause, float("nan"), seconds)


# %%
def report(outcomes: list[Outcome]) -> str:
    """Table of the outcomes by cause, the slowest scenes, and the largest difference."""
    counts = Counter(result.cause for result in outcomes)
    lines = ["| outcome | scenes |", "| --- | --- |", *(f"| {cause} | {n} |" for cause, n in counts.most_common()), ""]
    agreed = [result for result in outcomes if result.cause == AGREED]
    solvable = sum(not result.cause.startswith(SAME_REFUSAL) for result in outcomes)
    fem, reference = (np.array([result.seconds[i] for result in outcomes]) for i in (0, 1))
    lines += [
        f"Agreed: {len(agreed)} of {solvable} scenes that were not refused by both.",
        f"Largest difference among them: {max((result.difference for result in agreed), default=0.0):.1e}.",
        f"Median time {1e3 * np.median(fem):.1f} ms (fitted) and {1e3 * np.median(reference):.1f} ms (BVP).",
        f"Slowest: {slowest(fem, outcomes)} (fitted); {slowest(reference, outcomes)} (BVP).",
    ]
    return "\n".join(lines)


def slowest(seconds: np.ndarray, outcomes: list[Outcome]) -> str:
    """The slowest scenes, each with its number."""
    worst = np.argsort(seconds)[::-1][:SLOWEST]
    return ", ".join(f"scene {outcomes[i].number} in {1e3 * seconds[i]:.0f} ms" for i in worst)


def failures(outcomes: list[Outcome]) -> list[Outcome]:
    """The scenes that ended in neither of the two good ways."""
    return [result for result in outcomes if result.cause != AGREED and not result.cause.startswith(SAME_REFUSAL)]


# %%
if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Solves scenes at random by two methods.")
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=18)
    parser.add_argument("--readme", action="store_true", help="write the table into the README")
    arguments = parser.parse_args()
    for name, scene in extremes().items():
        result = outcome(0, scene)
        print(f"{name}: {result.cause}, difference {result.difference:.1e}")
    finished = [outcome(number, scene) for number, scene in enumerate(scenes(arguments.count, arguments.seed))]
    text = report(finished)
    print(text)
    for failed in failures(finished):
        print(f"\n{failed.number}: {failed.cause}, difference {failed.difference:.1e}\n   {failed.scene}")
    if arguments.readme:
        write_into_readme("stress", f"{arguments.count} scenes, seed {arguments.seed}.\n\n{text}")
