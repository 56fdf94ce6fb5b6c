# %% [markdown]
# # A belt drive: two pulleys, string and belt
#
# A closed belt runs round two pulleys. The first one is turned at a given speed and drives the belt; the second one is
# driven by it, against a torque that grows with its speed. On each pulley, the belt first sticks and then slides before
# it runs off: forward, faster than the pulley, where its tension grows, and backward where it falls. How far it slides
# is what the torque asks for. The ratio of both speeds, the creep of the drive, follows.
#
# The drive is a published one, computed there as a transient motion by finite elements in time, until it is steady.
# Here, its steady motion is solved for at once.

# %%
from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from belt_fenicsx import Scene, Solution, load_scene, solve
from belt_fenicsx.solution.plot import deformed_belt, field

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# DOLFINx 0.5 tells of each form that it compiles, by the root logger.
logging.basicConfig(level=logging.WARNING)
logging.getLogger().addFilter(lambda record: record.levelno > logging.INFO)

HERE = Path(__file__).parent
OUTPUT = HERE / "output"
# Tensions of both spans [N] and speed of the second pulley [rad/s] at the end of the published transients.
PUBLISHED = {"480 elements": (664.52, 186.27, 11.32501), "60 elements": (667.3, 188.6, 11.366)}


# %% [markdown]
# ## The string
#
# A string neither bends nor shears. On a pulley, its tension F grows by exp(mu angle) where it slides; with the torque
# T = R (F1 - F2) and its length, that is all there is to it. `method="string"` solves it exactly, and also says what
# each pulley can transmit at most: there, the belt would slide all along.


# %%
def tensions(solution: Solution) -> tuple[float, float, float]:
    """Tension in the middle of the tight and of the slack span [N], and speed of the second pulley [rad/s]."""
    slack, tight = sorted(span.tension[1] for span in solution.spans)
    return tight, slack, solution.contacts[1].omega


# %% [markdown]
# ## The belt
#
# The belt bends where it runs up, and its shear and bending die out within a length of sqrt(a / F), here half a
# millimetre. So a thread is nearly a string, and both agree. For a belt of the same stretch that is a hundred times as
# stiff in bending, they do so no more: the pressure has peaks at both ends of the contact.


# %%
def stiffer(scene: Scene, factor: float) -> Scene:
    """The drive with a belt that is stiffer in bending."""
    return replace(scene, belt=replace(scene.belt, bending_stiffness=factor * scene.belt.bending_stiffness))


def draw(thread: Solution, fixed: Solution, stiff: Solution, string: Solution) -> Figure:
    """The drive with its zones, and tension and pressure along the belt."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    axes = figure.subplot_mosaic([["drive"], ["tension"], ["p"]], height_ratios=[1.3, 1.0, 1.0])
    deformed_belt(thread, axes["drive"]).legend(loc="center", fontsize="small")
    styles = {
        "string": (string, {"linestyle": "-", "linewidth": 1.0, "color": "0.5"}),
        "FEM, fixed mesh": (fixed, {"linestyle": (0, (5, 2)), "linewidth": 3.0, "color": "tab:orange", "alpha": 0.75}),
        "BVP": (thread, {"linestyle": ":", "linewidth": 1.8, "color": "black"}),
        "BVP, 100 times as stiff": (stiff, {"linestyle": "-.", "linewidth": 1.2, "color": "tab:red"}),
    }
    for label, (solution, style) in styles.items():
        along = solution.fields
        axes["tension"].plot(along.sigma, along.tension, label=label, **style)
        field(solution, axes["p"], "p", label=label, **style)
    axes["tension"].set_ylabel("tension [N]")
    axes["tension"].set_xlabel("$\\sigma$ [m]")
    axes["p"].set_ylim(0.0, 2.5 * float(np.max(string.fields.p)))
    axes["tension"].legend(fontsize="small")
    return figure


# %%
scene = load_scene(HERE / "two_pulleys.toml")
string, thread = solve(scene, method="string"), solve(scene, method="bvp", rtol=1e-10)
stiff = solve(stiffer(scene, 100.0), method="bvp")
fitted, fixed = solve(scene), solve(scene, method="augmented-lagrangian")
found = {
    "string": tensions(string),
    "BVP": tensions(thread),
    "FEM, fitted zones": tensions(fitted),
    "FEM, fixed mesh": tensions(fixed),
    "BVP, 100 times as stiff": tensions(stiff),
}

# %% [markdown]
# The published transients end up to 0.9 % off in tension and up to 0.6 % off in speed; the finer mesh is nearer.

# %%
assert math.isclose(thread.contacts[1].omega, 11.3084625313, rel_tol=1e-10)
assert math.isclose(string.contacts[1].omega, thread.contacts[1].omega, rel_tol=1e-5)
for name, off in (("string", 5e-4), ("FEM, fitted zones", 1e-8), ("FEM, fixed mesh", 1e-3)):
    assert all(math.isclose(a, b, rel_tol=off) for a, b in zip(found[name], found["BVP"], strict=True)), name
for off, published in zip((4e-3, 1e-2), PUBLISHED.values(), strict=True):
    assert max(abs(a / b - 1.0) for a, b in zip(published, found["BVP"], strict=True)) < off
# What is put in is taken out, or lost by sliding.
assert math.isclose(thread.power, thread.contacts[1].power + thread.losses, rel_tol=1e-10)


# %%
def table() -> str:
    """Tensions of both spans and the speed of the second pulley, by each way."""
    rows = {**found, **{f"published, {name}": values for name, values in PUBLISHED.items()}}
    lines = [f"{'':<26}{'tight [N]':>13}{'slack [N]':>13}{'omega [rad/s]':>15}"]
    lines += [f"{name:<26}{a:>13.6g}{b:>13.6g}{c:>15.7g}" for name, (a, b, c) in rows.items()]
    lines.append(f"torque {thread.contacts[1].torque:.6g} of at most {string.contacts[1].capacity:.6g} N m")
    lines.append(
        f"power {thread.power:.6g} W, lost by sliding {thread.losses:.4g} W: efficiency {thread.efficiency:.4%}"
    )
    return "\n".join(lines)


def headline() -> str:
    """What there is to remember."""
    return (
        f"{found['BVP'][0]:.1f} and {found['BVP'][1]:.1f} N in the spans, where the published transients end at 664.5 "
        f"and 186.3; efficiency {100.0 * thread.efficiency:.2f} %."
    )


if __name__ == "__main__":
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        print(table())
        print(headline())
        OUTPUT.mkdir(exist_ok=True)
        draw(thread, fixed, stiff, string).savefig(OUTPUT / "two_pulleys.png", dpi=120)
        print(f"Figure: {OUTPUT / 'two_pulleys.png'}")
