# %% [markdown]
# # A polyamide belt over nine feet: sag, and a ratio that thickness makes
#
# A motor of 1750 rpm drives a pulley of 4 inches by one of 2 inches and a belt of 0.05 by 6 inches, 2.74 m long between
# the centres: 653.9 and 253.5 N by the textbook, and a sag at rest of w l^2 / (8 F) = 3.84 mm. Thickness over radius is
# 0.05, so that this belt is no string.

# %%
from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from effects import effects, table

from belt_fenicsx import Solution, bvp, load_scene, slip_safety, solve

# DOLFINx 0.5 tells of each form that it compiles, by the root logger.
logging.basicConfig(level=logging.WARNING)
logging.getLogger().addFilter(lambda record: record.levelno > logging.INFO)

HERE = Path(__file__).parent
OUTPUT = HERE / "output"


# %% [markdown]
# ## From the string to the belt
#
# Each row adds one effect to the row above. Bending brings the most: the belt takes a longer way round the pulleys,
# and its spans are tighter by 7 N. The speeds have no ratio of 2, as the radii of the pulleys do: the middle line is
# farther out, by 2.5 % of the small radius and by 1.2 % of the large one, and creep adds 0.2 %. The touching fibre
# slides forward where the belt bends onto a pulley; that costs 0.06 % of the power.

# %%
scene = load_scene(HERE / "polyamide.toml")
found = effects(scene)
belt = solve(scene)


def ratio(solution: Solution) -> float:
    """Ratio of the speeds."""
    return solution.contacts[0].omega / solution.contacts[1].omega


NUMBERS = {
    "tight [N]": lambda solution: max(span.tension[1] for span in solution.spans),
    "slack [N]": lambda solution: min(span.tension[1] for span in solution.spans),
    "hub load [N]": lambda solution: solution.contacts[1].hub_load,
    "ratio [-]": ratio,
    "efficiency [%]": lambda solution: 100.0 * solution.efficiency,
}
safety, of_string = slip_safety(belt, 1), slip_safety(found["string"], 1)

# %% [markdown]
# ## Sag
#
# At rest, nothing is transmitted: a belt that moves as slowly as one likes, idle, hangs by its weight. Its stiffness
# lets it leave the small pulley early, so that it is curved without weight, too; the sag is the way between both.

# %%
still = (scene.pulleys[0].driven(omega=1e-3), scene.pulleys[1].driven(torque=1e-3))
hanging = bvp.solve(replace(scene, pulleys=still, tension=449.7))
straight = bvp.solve(replace(scene, pulleys=still, tension=449.7, gravity=(0.0, 0.0)))
weight = 9.81 * scene.belt.line_density
textbook = weight * scene.pulleys[1].center[0] ** 2 / (8.0 * 449.7)


def height(solution: Solution) -> float:
    """Height of the upper span half-way between the centres [m]."""
    half = scene.pulleys[1].center[0] / 2.0
    crossings = np.flatnonzero(np.diff(np.sign(solution.fields.x - half)))
    return max(np.interp(half, *_ascending(solution, i)) for i in crossings)


def _ascending(solution: Solution, i: int) -> tuple[np.ndarray, np.ndarray]:
    """Two points next to each other, from left to right."""
    order = sorted((i, i + 1), key=lambda at: solution.fields.x[at])
    return solution.fields.x[order], solution.fields.y[order]


sag = height(straight) - height(hanging)

# %%
tight, slack = (pick(span.tension[1] for span in belt.spans) for pick in (max, min))
assert math.isclose(tight, 653.9, rel_tol=0.02) and math.isclose(slack, 253.5, rel_tol=0.06)
assert math.isclose(ratio(belt), 1.98034, rel_tol=1e-5) and math.isclose(ratio(found["string"]), 1.97964, rel_tol=1e-4)
assert math.isclose(textbook, 3.84e-3, rel_tol=3e-3) and math.isclose(sag, textbook, rel_tol=0.05)
assert math.isclose(safety, 1.447, abs_tol=1e-3) and math.isclose(of_string, 1.511, abs_tol=1e-3)


# %%
def headline() -> str:
    """What there is to remember."""
    return (
        f"{tight:.1f} and {slack:.1f} N, where the textbook has 653.9 and 253.5; sag {1e3 * sag:.2f} mm at rest, where "
        f"it has {1e3 * textbook:.2f}; safety {safety:.2f} instead of the string's {of_string:.2f}."
    )


if __name__ == "__main__":
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        print(table(found, NUMBERS))
        print(f"\n{headline()}")
        OUTPUT.mkdir(exist_ok=True)
        belt.plot("polar").savefig(OUTPUT / "polyamide.png", dpi=80)
        print(f"Figure: {OUTPUT / 'polyamide.png'}")
