# %% [markdown]
# # Run time of drives
#
# The same drives by all methods that solve them, one after another in the same run: a loop round two equal pulleys,
# whose transport rate is known to twelve digits, and rings of two to sixteen pulleys.
#
#     python demos/studies/benchmark_drives.py             prints the tables
#     python demos/studies/benchmark_drives.py --readme    writes them into the README

# %%
from __future__ import annotations

import argparse
import logging
import math
import statistics
import time
from collections.abc import Sequence
from functools import partial

from readme import write_into_readme

from belt_fenicsx import Belt, Pulley, Scene, Solution, StiffnessBelt, solve

# DOLFINx 0.5 tells of each form that it compiles, by the root logger.
logging.basicConfig(level=logging.WARNING)
logging.getLogger().addFilter(lambda record: record.levelno > logging.INFO)

METHODS = ("string", "fitted", "bvp")
RUNS = 15
TRANSPORT_RATE = 0.968991732716  # of two equal pulleys [m/s]
PUBLISHED_SECONDS = (100.0, 955.0)  # of transient finite elements for a drive of two pulleys, until steady [s]


# %%
def two_equal() -> Scene:
    """A loop round two equal pulleys: speed of the first one, torque of the second one given."""
    belt = StiffnessBelt(
        length=1.386717020114523, bending_stiffness=0.41666666666666674, extensional_stiffness=50000.0,
        shear_stiffness=17241.37931034483,
    )  # fmt: skip
    first = Pulley(radius=0.1, center=(0.0, 0.0), friction=0.5, omega=10.0)
    second = Pulley(radius=0.1, center=(0.4, 0.0), friction=0.5, torque=20.0)
    return Scene(belt=belt, pulleys=(first, second), closed=True)


def ring(count: int) -> Scene:
    """A loop round pulleys on a circle: one drives, the others are driven and drive by turns."""
    pulleys = []
    for i in range(count):
        angle, reach = -2.0 * math.pi * i / count, 0.06 * count
        drive = {"omega": 10.0} if i == 0 else {"torque": (4.0 if i % 2 else -2.0) / count}
        center = (reach * math.cos(angle), reach * math.sin(angle))
        pulleys.append(Pulley(radius=0.05, center=center, friction=0.5, **drive))
    belt = Belt(youngs_modulus=5e7, poisson_ratio=0.45, thickness=0.003, width=0.03)
    return Scene(belt=belt, pulleys=tuple(pulleys), closed=True, elongation=0.03)


def medians(scene: Scene, methods: Sequence[str], rtol: float) -> dict[str, tuple[float, Solution]]:
    """Median times of methods that take turns, each warm [s], and their answers."""
    solvers = {method: partial(solve, scene, method=method, rtol=rtol) for method in methods}
    answers = {method: solver() for method, solver in solvers.items()}
    seconds: dict[str, list[float]] = {method: [] for method in methods}
    for _ in range(RUNS):
        for method, solver in solvers.items():
            began = time.perf_counter()
            solver()
            seconds[method].append(time.perf_counter() - began)
    return {method: (statistics.median(seconds[method]), answers[method]) for method in methods}


# %%
def tables() -> str:
    """Both tables."""
    lines = ["| two equal pulleys, rtol 1e-8 | time [ms] | error of the transport rate |", "| --- | --- | --- |"]
    for method, (seconds, solution) in medians(two_equal(), METHODS, 1e-8).items():
        error = abs(solution.transport_rate / TRANSPORT_RATE - 1.0)
        lines.append(f"| {method} | {1e3 * seconds:.2f} | {error:.0e} |")
    low, high = PUBLISHED_SECONDS
    lines.append(f"| published transients of such a drive | {1e3 * low:.0f} to {1e3 * high:.0f} | 2e-03 to 5e-03 |")
    lines += ["", f"| pulleys | {' | '.join(f'{method} [ms]' for method in METHODS)} |", "| --- | --- | --- | --- |"]
    for count in (2, 4, 8, 16):
        found = medians(ring(count), METHODS, 1e-8)
        lines.append(f"| {count} | {' | '.join(f'{1e3 * seconds:.3g}' for seconds, _ in found.values())} |")
    return "\n".join(lines)


# %%
if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Times drives by all methods that solve them.")
    parser.add_argument("--readme", action="store_true", help="write the tables into the README")
    text = tables()
    print(text)
    if parser.parse_args().readme:
        write_into_readme("drives", text)
