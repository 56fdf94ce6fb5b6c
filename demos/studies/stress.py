# %% [markdown]
# # Stress test: scenes at random, two methods, no silent error
#
# Each scene is solved by finite elements with fitted zones and by the boundary-value problem, which share the scene,
# the first guess and the certificate. Where the first finds no answer, it starts once more from the zones of the
# second; how often is told. A scene ends in one of three ways: both have an admissible answer and agree; both refuse it
# with the same status; or it is a failure that is listed with its cause.
#
#     python demos/studies/stress.py                  500 scenes like the chapter's
#     python demos/studies/stress.py --kind thin --count 50 --seed 7
#     python demos/studies/stress.py --readme         writes the tables of all kinds into the README

# %%
from __future__ import annotations

import argparse
import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from readme import write_into_readme

from belt_fenicsx import Belt, Pulley, Scene, SceneError, Solution, bvp, solve
from belt_fenicsx.scene.path import tangent_path
from belt_fenicsx.taut_string.straight import touches

# DOLFINx 0.5 tells of each form that it compiles, by the root logger.
logging.basicConfig(level=logging.WARNING)
logging.getLogger().addFilter(lambda record: record.levelno > logging.INFO)

AGREEMENT = 1e-7
# The moment is the difference of two tensions: by collocation it needs a tighter tolerance of omega than by elements.
FITTED_RTOL, BVP_RTOL = {"chapter": 1e-9, "thin": 1e-8, "wide": 1e-8}, 1e-11
AGREED, SAME_REFUSAL = "agreed", "refused by both for the same reason"
SLOWEST = 3  # scenes that are named
# Kind, number and seed of the scenes in the README.
RUNS = (("chapter", 500, 18), ("thin", 300, 1), ("thin", 300, 2), ("wide", 400, 1), ("wide", 400, 2))
RESCUE = "method bvp"  # stage of a solve that starts from its zones


# %% [markdown]
# ## Scenes
#
# Thickness, friction and strain are spread evenly over their logarithm. The belt's length follows from the mean strain
# of the string around the pulley. Where a clamp would lie inside of the pulley, or the string is clear of it, the scene
# is drawn again.


# %%
class Draw:
    """Random numbers of scenes, the same for the same seed."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng(seed)

    def even(self, low: float, high: float) -> float:
        """A number spread evenly over an interval."""
        return float(self._random.uniform(low, high))

    def logarithmic(self, low: float, high: float) -> float:
        """A number whose logarithm is spread evenly."""
        return float(np.exp(self._random.uniform(np.log(low), np.log(high))))

    def one_of(self, choices: Sequence[str]) -> str:
        """One of several words."""
        return str(self._random.choice(choices))


def chapter_like(draw: Draw) -> Scene | None:
    """A scene like the chapter's: a thick belt over a large pulley; None where there is none."""
    radius, top, shift = draw.even(0.25, 2.0), draw.even(0.03, 0.35), draw.even(-0.1, 0.1)
    thickness, friction, nu = draw.logarithmic(0.004, 0.08), draw.logarithmic(0.01, 1.0), draw.even(0.0, 0.49)
    strain, part = draw.logarithmic(0.005, 0.08), draw.even(0.15, 0.85)
    place = {"radius": radius, "center": (shift, top - radius), "friction": friction}
    drive = ("x_trans", draw.one_of(("forward", "backward")), part)
    return _taut(1.0, strain, place, drive, thickness=thickness, poisson_ratio=nu)


def thin(draw: Draw) -> Scene | None:
    """A flat belt or a steel band: thin against its pulley, stiff, little strained; None where there is none."""
    radius = draw.logarithmic(0.02, 0.25)
    span = radius * draw.even(2.5, 12.0)
    thickness, modulus = radius * draw.logarithmic(4e-4, 0.03), draw.logarithmic(0.1e9, 200e9)
    strain, friction, nu = draw.logarithmic(5e-4, 0.03), draw.even(0.05, 0.8), draw.even(0.0, 0.49)
    top, shift, part = radius * draw.logarithmic(0.05, 3.0), span * draw.even(-0.15, 0.15), draw.even(0.15, 0.85)
    place = {"radius": radius, "center": (shift, top - radius), "friction": friction}
    drive = ("x_trans", draw.one_of(("forward", "backward")), part)
    belt = {"thickness": thickness, "youngs_modulus": modulus, "poisson_ratio": nu, "width": 0.05}
    return _taut(span, strain, place, drive, **belt)


def wide(draw: Draw) -> Scene | None:
    """A scene far from the chapter's in any way, driven in any way; None where there is none."""
    radius, top, shift = draw.logarithmic(0.1, 10.0), draw.logarithmic(0.005, 0.45), draw.even(-0.3, 0.3)
    thickness, friction, nu = draw.logarithmic(5e-4, 0.15), draw.logarithmic(1e-3, 3.0), draw.even(-0.5, 0.5)
    strain, part = draw.logarithmic(1e-4, 0.3), draw.even(0.05, 0.95)
    kind, slip = draw.one_of(("x_trans", "run-up", "run-off", "omega", "torque")), draw.one_of(("forward", "backward"))
    place = {"radius": radius, "center": (shift, top - radius), "friction": friction}
    return _taut(1.0, strain, place, (kind, slip, part), thickness=thickness, poisson_ratio=nu)


def _taut(
    span: float, strain: float, place: dict[str, Any], drive: tuple[str, str, float], **belt: float
) -> Scene | None:
    """The scene with this mean strain of its string; None where the string is clear of the pulley or has no room.

    Args:
        span: Distance of the clamps [m].
        strain: The mean strain.
        place: Radius, centre and friction of the pulley.
        drive: The drive; the sense of sliding; the part of the contact that sticks, or what of the string's torque and
            excess of speed in pure slip is given.
        belt: Thickness and material.
    """
    try:
        around = Scene(span=span, belt=Belt(length=span), pulleys=(Pulley(**place),))
    except SceneError:
        return None
    if not touches(around):
        return None
    path = tangent_path(around)
    taut = Belt(length=path.length / (1.0 + strain), **belt)
    (kind, slip, part), radius = drive, place["radius"]
    sense = 1.0 if slip == "forward" else -1.0
    first, last = path.arcs[0].start, path.arcs[0].end
    given: dict[str, Any] = {"x_trans": kind, "slip": slip}
    if kind == "x_trans":
        given["x_trans"] = float(place["center"][0] - radius * np.sin(first + part * (last - first)))
    elif kind in ("omega", "torque"):
        force = taut.extensional_stiffness * strain * sense * part * np.expm1(place["friction"] * (first - last))
        speed = (1.0 + strain * (1.0 - sense * part * place["friction"] * (first - last) / 2.0)) / radius
        given = {kind: float(force * radius if kind == "torque" else speed)}
    try:
        return Scene(span=span, belt=taut, pulleys=(Pulley(**place, **given),))
    except SceneError:
        return None


# Kinds of scenes, by name.
KINDS: dict[str, Callable[[Draw], Scene | None]] = {"chapter": chapter_like, "thin": thin, "wide": wide}


def scenes(count: int, seed: int, kind: str = "chapter") -> Iterator[Scene]:
    """Draws scenes of a kind."""
    draw, drawn = Draw(seed), 0
    while drawn < count:
        scene = KINDS[kind](draw)
        if scene is not None:
            yield scene
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
        rescued: Whether the first started from the zones of the second.
    """

    number: int
    scene: Scene
    cause: str
    difference: float
    seconds: tuple[float, float]
    rescued: bool


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


def outcome(number: int, scene: Scene, kind: str = "chapter") -> Outcome:
    """Solves a scene by both methods and compares them."""
    fem, fem_seconds = attempt(solve, scene, FITTED_RTOL[kind])
    reference, bvp_seconds = attempt(bvp.solve, scene, BVP_RTOL)
    seconds, names = (fem_seconds, bvp_seconds), (status(fem), status(reference))
    rescued = isinstance(fem, Solution) and RESCUE in [stage.name for stage in fem.stages]
    if names == ("SOLVED", "SOLVED"):
        apart = difference(fem, reference)
        cause = AGREED if apart <= AGREEMENT else f"both solved, apart by more than {AGREEMENT:g}"
        return Outcome(number, scene, cause, apart, seconds, rescued)
    same = names[0] == names[1]
    cause = f"{SAME_REFUSAL}: {names[0]}" if same else f"fitted: {names[0]}, BVP: {names[1]}"
    return Outcome(number, scene, cause, float("nan"), seconds, rescued)


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
        f"Started from the zones of the other method: {sum(result.rescued for result in agreed)} of them.",
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
    parser.add_argument("--kind", choices=tuple(KINDS), default="chapter", help="kind of scenes")
    parser.add_argument("--readme", action="store_true", help="write the table into the README")
    arguments = parser.parse_args()
    for name, scene in extremes().items():
        result = outcome(0, scene)
        print(f"{name}: {result.cause}, difference {result.difference:.1e}")
    texts = []
    for kind, count, seed in RUNS if arguments.readme else ((arguments.kind, arguments.count, arguments.seed),):
        finished = [outcome(number, scene, kind) for number, scene in enumerate(scenes(count, seed, kind))]
        texts.append(f"{count} scenes, kind {kind}, seed {seed}.\n\n{report(finished)}")
        print(texts[-1])
        for failed in failures(finished):
            print(f"\n{failed.number}: {failed.cause}, difference {failed.difference:.1e}\n   {failed.scene}")
    if arguments.readme:
        write_into_readme("stress", "\n\n".join(texts))
