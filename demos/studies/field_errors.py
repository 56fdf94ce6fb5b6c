# %% [markdown]
# # Are the errors of the fields known?
#
# Scenes at random, half of them like the chapter's and half of them thin belts, are solved at the default accuracy.
# Each field is then compared with that of the boundary-value problem at its tightest, at all of its points; the largest
# difference, relative to the field's largest value on the belt, is the true error. The estimate is honest where it lies
# between the true error and a hundred times it.
#
#     python demos/studies/field_errors.py             100 scenes
#     python demos/studies/field_errors.py --readme    writes the table into the README, too

# %%
from __future__ import annotations

import argparse
import logging
from collections.abc import Iterator

import numpy as np
from readme import write_into_readme
from stress import scenes

from belt_fenicsx import Scene, SceneError, Solution, bvp, solve

# DOLFINx 0.5 tells of each form that it compiles, by the root logger.
logging.basicConfig(level=logging.WARNING)
logging.getLogger().addFilter(lambda record: record.levelno > logging.INFO)

REFERENCE = 1e-12  # rtol of the reference
KNOWN = 1e-10  # relative error below which the reference does not tell the truth from its own
LIMIT = 1e-4  # for every field at the default accuracy

# %% [markdown]
# ## True errors
#
# The borders of zones differ by their own small error. So points are compared that lie at the same part of their zone.


# %%
def true_errors(fem: Solution, reference: Solution) -> dict[str, float]:
    """Largest difference of each field, relative to its largest value on the belt."""
    exact, errors = reference.fields, dict.fromkeys(fem.field_errors, 0.0)
    half = fem.scene.belt.length / 2
    for index, (ours, theirs) in enumerate(zip(fem.zones, reference.zones, strict=True)):
        on = exact.zone == index
        part = (exact.sigma[on] - theirs.sigma[0]) / (theirs.sigma[1] - theirs.sigma[0])
        sigma = np.clip(ours.sigma[0] + part * (ours.sigma[1] - ours.sigma[0]), -half, half)
        inside, end = fem.evaluate(sigma[:-1]), fem.evaluate(sigma[-1:], side="left")
        for name in errors:
            found = np.concatenate([getattr(inside, name), getattr(end, name)])
            known = getattr(exact, name)
            size = np.abs(known).max()
            if name == "f":
                size = max(size, fem.scene.pulleys[0].friction * exact.p.max())
            errors[name] = max(errors[name], float(np.abs(found - known[on]).max() / (size or 1.0)))
    return errors


def compared(count: int, seed: int) -> Iterator[tuple[Scene, Solution, dict[str, float]]]:
    """Scenes with an answer by both methods, the answer by finite elements, and the true errors of its fields."""
    kinds = (scenes(2 * count, seed, kind) for kind in ("chapter", "thin"))
    drawn = [scene for pair in zip(*kinds, strict=True) for scene in pair]
    done = 0
    for scene in drawn:
        try:
            fem, reference = solve(scene, throw=False), bvp.solve(scene, rtol=REFERENCE, throw=False)
        except SceneError:
            continue
        if done < count and fem.success and reference.success and len(fem.zones) == len(reference.zones):
            yield scene, fem, true_errors(fem, reference)
            done += 1


# %%
def report(cases: list[tuple[Scene, Solution, dict[str, float]]]) -> str:
    """A table with a row for each field."""
    lines = [
        "| field | true error, median | largest | estimate, largest | estimates from 1 to 100 times the truth |",
        "| --- | --- | --- | --- | --- |",
    ]
    every = []
    for name in cases[0][2]:
        truth = np.array([max(errors[name], KNOWN) for _, _, errors in cases])
        estimate = np.array([fem.field_errors[name] for _, fem, _ in cases])
        honest = (truth <= np.maximum(estimate, KNOWN)) & (estimate <= 100.0 * truth)
        every.append(honest)
        numbers = f"{np.median(truth):.0e} | {truth.max():.0e} | {estimate.max():.0e} | {100 * honest.mean():.0f} %"
        lines.append(f"| {name} | {numbers} |")
    lines += ["", f"Of all {np.size(every)} estimates, {100 * np.mean(every):.0f} % are in this band."]
    return "\n".join(lines)


# %%
if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Compares estimated and true errors of fields.")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--readme", action="store_true", help="write the table into the README")
    arguments = parser.parse_args()
    found = list(compared(arguments.count, arguments.seed))
    text = report(found)
    print(text)
    assert all(max(errors.values()) <= LIMIT for _, _, errors in found)
    if arguments.readme:
        write_into_readme("fields", f"{len(found)} scenes, seed {arguments.seed}, rtol 1e-8.\n\n{text}")
