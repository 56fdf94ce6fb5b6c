# %% [markdown]
# # Run time against error
#
# Three methods answer the same scene in one process: the fixed mesh (more and more elements), the fitted zones and
# the boundary-value problem (tighter and tighter tolerances). Beside them runs a clock that no change of this project
# moves: the same scene as one page of code for SciPy's solve_bvp (`plain_bvp.py`), which finds no zones and checks
# nothing. The error of omega is the true one, against a reference on which two methods agree. Each setting is run once
# to warm up, and then in turn with all others; the tables show medians.
#
#     python demos/studies/benchmark.py            prints the tables and draws the figure
#     python demos/studies/benchmark.py --readme   writes them into the README, too

# %%
import argparse
import logging
import math
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

import dolfinx
import numpy as np
import scipy
from plain_bvp import plain
from readme import write_into_readme

from belt_fenicsx import Scene, bvp, solve, sweep
from belt_fenicsx.fitted.method import solve as solve_fitted
from belt_fenicsx.fitted.newton import iteration_on, newton
from belt_fenicsx.solution.plot import NAMES, STYLES

# DOLFINx 0.5 tells of each form that it compiles, by the root logger.
logging.basicConfig(level=logging.WARNING)
logging.getLogger().addFilter(lambda record: record.levelno > logging.INFO)

DEMOS = Path(__file__).parents[1]
FIGURE = DEMOS / "figures" / "benchmark.png"
FIXED, FITTED, BVP, PLAIN = "augmented-lagrangian", "fitted", "bvp", "plain"
TITLES = {**NAMES, PLAIN: "plain solve_bvp"}
LINES = {**STYLES, PLAIN: {"color": "0.6", "linestyle": (0, (1, 1))}}
PLAIN_TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
ELEMENTS = (25, 50, 100, 200, 400, 800, 1600)
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11)
DEGREE = 6
TARGETS = (1e-4, 1e-6, 1e-8, 1e-10)

scene = Scene()

# %% [markdown]
# ## The reference
#
# Finite elements with fitted zones and collocation share neither code nor discretisation. Where both are pushed to
# their limit, they have to agree.


# %%
def reference() -> float:
    """Angular velocity of the source's scene [rad/s]."""
    first, second = bvp.solve(scene, rtol=1e-12).omega, solve(scene, rtol=1e-11).omega
    assert abs(first / second - 1.0) < 2e-12, (first, second)
    return (first + second) / 2


# %% [markdown]
# ## Runs


# %%
@dataclass
class Run:
    """A method at one setting."""

    method: str
    setting: str
    omega: Callable[[], float]
    error: float = float("nan")
    seconds: list[float] = field(default_factory=list)

    @property
    def time(self) -> float:
        """Median wall time [s]."""
        return median(self.seconds)


def all_runs() -> list[Run]:
    """Every method at every setting."""
    runs = [
        Run(FIXED, f"{n} elements", lambda n=n: solve(scene, method=FIXED, elements=n, throw=False).omega)
        for n in ELEMENTS
    ]
    runs += [Run(FITTED, f"rtol {tol:g}", lambda tol=tol: solve(scene, rtol=tol).omega) for tol in TOLERANCES]
    runs += [Run(BVP, f"rtol {tol:g}", lambda tol=tol: bvp.solve(scene, rtol=tol).omega) for tol in TOLERANCES]
    runs += [Run(PLAIN, f"tol {tol:g}", lambda tol=tol: plain(tol)) for tol in PLAIN_TOLERANCES]
    return runs


def measured(runs: list[Run], omega: float, repeats: int) -> list[Run]:
    """Fills in errors and times; the runs take turns, so that all see the same machine."""
    for run in runs:
        run.error = max(abs(run.omega() / omega - 1.0), 1e-16)
    for _ in range(repeats):
        for run in runs:
            began = time.perf_counter()
            run.omega()
            run.seconds.append(time.perf_counter() - began)
    return runs


def fastest(runs: list[Run], method: str, target: float) -> Run | None:
    """The fastest run of a method with a true error below the target."""
    good = [run for run in runs if run.method == method and run.error <= target]
    return min(good, key=lambda run: run.time, default=None)


# %% [markdown]
# ## Cost against size
#
# Time of a Newton iteration against the number of unknowns. On the fixed mesh it is the last stage of a solve, with its
# updates of multipliers, divided by its iterations; the elements are many, and their matrix is a sparse one. The fitted
# zones need some twenty elements, but take as many as are asked for.


# %%
@dataclass(frozen=True)
class Sized:
    """Newton's iteration at one size."""

    method: str
    unknowns: int
    seconds: float


def against_size(repeats: int) -> list[Sized]:
    """Median time of a Newton iteration of both finite element methods, over the number of unknowns."""
    rows = []
    for elements in (16, 64, 256, 1024, 4096, 16384):
        times = []
        for _ in range(repeats + 1):
            stages = solve(scene, method=FIXED, elements=elements, throw=False).stages
            last = [stage for stage in stages if stage.iterations][-1]
            times.append(last.seconds / last.iterations)
        rows.append(Sized(FIXED, 6 * (elements + 1), median(times[1:])))
    dimensionless, _ = scene.dimensionless()
    for elements in (12, 24, 96, 384, 1536, 4096):
        state = solve_fitted(scene, degree=DEGREE, elements=elements).state
        times = []
        for _ in range(3 * repeats):
            began = time.perf_counter()
            _, iterations = newton(()).solve(dimensionless, state, math.inf)
            times.append((time.perf_counter() - began) / iterations)
        unknowns = iteration_on(state.mesh, DEGREE, state.terms).condensed.table.count
        rows.append(Sized(FITTED, unknowns, median(times)))
    return rows


def slope(rows: list[Sized], method: str, least: int) -> float:
    """Fitted power of the number of unknowns, from ``least`` unknowns on."""
    own = [row for row in rows if row.method == method and row.unknowns >= least]
    return float(np.polyfit(np.log([row.unknowns for row in own]), np.log([row.seconds for row in own]), 1)[0])


# %% [markdown]
# ## Orders of convergence
#
# Fitted powers of the size of elements, with which the error of omega falls; and the factor by which it falls from one
# degree to the next but one. On the fixed mesh, the borders of contact lie inside of elements, which limits the order.


# %%
def orders(runs: list[Run], omega: float) -> list[tuple[str, str]]:
    """What is refined, and how the error of omega falls."""

    def power(counts: tuple[int, ...], errors: list[float]) -> str:
        return f"order {-np.polyfit(np.log(counts), np.log(errors), 1)[0]:.1f}"

    def error(**settings: int) -> float:
        return abs(solve_fitted(scene, **settings).omega / omega - 1.0)

    counts, fixed = ELEMENTS[1:], [run.error for run in runs if run.method == FIXED][1:]
    rows = [(f"{NAMES[FIXED]}, {counts[0]} to {counts[-1]} elements", power(counts, fixed))]
    for degree, cells in ((6, (16, 24, 32, 48, 64)), (8, (12, 16, 20, 24))):
        errors = [error(degree=degree, elements=n) for n in cells]
        rows.append((f"{NAMES[FITTED]}, degree {degree}, {cells[0]} to {cells[-1]} elements", power(cells, errors)))
    degrees = (6, 8, 10)
    errors = [error(degree=k) for k in degrees]
    factor = np.exp(-2.0 * np.polyfit(degrees, np.log(errors), 1)[0])
    return [*rows, (f"{NAMES[FITTED]}, degrees {', '.join(map(str, degrees))}", f"factor {factor:.0f} each")]


# %% [markdown]
# ## What a process pays before its first solve
#
# Each in a process of its own: loading DOLFINx alone, loading this package, and one scene from the command line; with
# an empty cache of compiled forms, and with a full one. Parts of that, timed inside of a process: compiling the forms
# of the fitted zones or finding them compiled, and setting up each method's mesh, dof numbers and solver. And a sweep
# in a process that has done one before.


# %%
def wall(command: list[str], environment: dict[str, str]) -> float:
    """Wall time of a process [s]."""
    began = time.perf_counter()
    subprocess.run(command, env=environment, check=True, capture_output=True)
    return time.perf_counter() - began


INSIDE = """
import logging, time
logging.getLogger().addFilter(lambda record: record.levelno > logging.INFO)
{before}
began = time.perf_counter()
{timed}
print(time.perf_counter() - began)
"""
FORMS = (
    "from belt_fenicsx.fitted.dofs import Terms; from belt_fenicsx.fitted.forms import forms",
    "for degree in (4, 6, 8): forms(degree, Terms())",
)
FITTED_SET_UP = (
    "from belt_fenicsx import Scene, solve\nfrom belt_fenicsx.fitted.dofs import Terms\n"
    "from belt_fenicsx.fitted.newton import Iteration\n"
    "mesh = solve(Scene()).state.mesh",
    "for degree in (4, 6, 8): Iteration(mesh, degree, Terms(), ())",
)
FIXED_SET_UP = (
    "from mpi4py import MPI\nfrom belt_fenicsx.lagrangian.forms import Problem, Terms",
    "Problem(100, MPI.COMM_SELF, {}, Terms())",
)


def inside(part: tuple[str, str], environment: dict[str, str]) -> float:
    """Wall time of a part of a process, which comes after another one [s]."""
    code = INSIDE.format(before=part[0], timed=part[1])
    output = subprocess.run(
        [sys.executable, "-c", code], env=environment, check=True, stdout=subprocess.PIPE, text=True
    ).stdout
    return float(output.split()[-1])


def one_sweep(repeats: int) -> float:
    """Median wall time of a sweep over 41 transitions, each started from the one before [s]."""
    seconds = []
    for _ in range(repeats + 1):
        began = time.perf_counter()
        table = sweep(scene, over="pulleys.0.x_trans", values=np.linspace(-0.2, 0.2, 41), rtol=1e-8)
        seconds.append(time.perf_counter() - began)
        assert table.success
    return median(seconds[1:])


def start_up(repeats: int) -> list[tuple[str, float]]:
    """Name and median wall time of what comes before, and with, the first solve of a process."""
    python = [sys.executable]
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "XDG_CACHE_HOME": cache, "DOLFINX_JIT_CACHE_DIR": cache, "OMP_NUM_THREADS": "1"}
        commands = {
            "`import dolfinx, dolfinx.fem.petsc`": [*python, "-c", "import dolfinx, dolfinx.fem.petsc"],
            "`import belt_fenicsx`": [*python, "-c", "import belt_fenicsx"],
            "`belt-fenicsx --method bvp`": [*python, "-m", "belt_fenicsx", "--method", "bvp"],
            "`belt-fenicsx`, forms compiled before": [*python, "-m", "belt_fenicsx"],
        }
        rows, cold = [], []
        for _ in range(repeats):
            with tempfile.TemporaryDirectory() as empty:
                cold.append(inside(FORMS, {**environment, "XDG_CACHE_HOME": empty}))
        first = wall(commands["`belt-fenicsx`, forms compiled before"], environment)
        for name, command in commands.items():
            wall(command, environment)
            rows.append((name, median(wall(command, environment) for _ in range(repeats))))
        rows += [
            ("`belt-fenicsx`, first run ever (forms are compiled)", first),
            ("JIT cold, forms of the fitted zones, degrees 4, 6 and 8", median(cold)),
        ]
        for name, part in (
            ("JIT warm, the same forms from the cache", FORMS),
            ("set-up of the fitted zones for one mesh, degrees 4, 6 and 8", FITTED_SET_UP),
            ("set-up of the fixed mesh, 100 elements, forms from the cache", FIXED_SET_UP),
        ):
            inside(part, environment)
            rows.append((name, median(inside(part, environment) for _ in range(repeats))))
    return [
        *rows,
        ("a sweep of 41 transitions in a process that is warm, fitted zones, rtol 1e-08", one_sweep(repeats)),
    ]


# %% [markdown]
# ## Tables and figure


# %%
def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """A Markdown table."""
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def report(
    runs: list[Run], falling: list[tuple[str, str]], sizes: list[Sized], processes: list[tuple[str, float]]
) -> str:
    """All tables as Markdown."""

    def cell(run: Run | None) -> str:
        return "not reached" if run is None else f"{1e3 * run.time:.3g} ms ({run.setting})"

    rows = []
    for target in TARGETS:
        ours, *others = (fastest(runs, method, target) for method in (FITTED, BVP, PLAIN, FIXED))
        ratios = (f"{other.time / ours.time:.1f}" if ours and other else "" for other in others[:2])
        rows.append((f"{target:g}", cell(ours), *(cell(other) for other in others), *ratios))
    titles = (TITLES[method] for method in (FITTED, BVP, PLAIN, FIXED))
    head = ("true error of omega below", *titles, "BVP / fitted", "plain / fitted")
    every = [(TITLES[run.method], run.setting, f"{run.error:.1e}", f"{1e3 * run.time:.3g}") for run in runs]
    versions = (
        f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, "
        f"DOLFINx {dolfinx.__version__}, "
        f"NumPy {np.__version__}, SciPy {scipy.__version__}; medians of {len(runs[0].seconds)} runs."
    )
    return "\n\n".join(
        (
            versions,
            table(head, rows),
            table(("method", "setting", "true error", "time [ms]"), every),
            table(("refined", "error of omega falls by"), falling),
            table(
                ("method", "unknowns", "Newton iteration [ms]"),
                [(TITLES[row.method], str(row.unknowns), f"{1e3 * row.seconds:.3g}") for row in sizes],
            ),
            f"Fitted power of the unknowns: {slope(sizes, FIXED, 1000):.2f} on the fixed mesh (from 1000 unknowns on), "
            f"{slope(sizes, FITTED, 0):.2f} with fitted zones.",
            table(("process", "wall time [s]"), [(name, f"{seconds:.2g}") for name, seconds in processes]),
        )
    )


def draw(runs: list[Run], path: Path) -> None:
    """Draws run time against error."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    ax = figure.subplots()
    for method, marker in ((FIXED, "s"), (FITTED, "o"), (BVP, "^"), (PLAIN, "x")):
        own = [run for run in runs if run.method == method]
        style = {**LINES[method], "linewidth": 1.2, "alpha": 1.0}
        ax.loglog(
            [run.error for run in own], [1e3 * run.time for run in own], marker=marker, label=TITLES[method], **style
        )
    ax.invert_xaxis()
    ax.set_xlabel(r"true relative error of $\omega$ [-]")
    ax.set_ylabel("run time, warm [ms]")
    ax.grid(color="0.9", which="both", linewidth=0.5)
    ax.legend()
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=120)


# %%
if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Run time against error, for all methods.")
    parser.add_argument("--repeats", type=int, default=21, help="runs of each setting (default: %(default)s)")
    parser.add_argument("--readme", action="store_true", help="write tables and figure into the README")
    arguments = parser.parse_args()
    omega = reference()
    finished = measured(all_runs(), omega, arguments.repeats)
    text = report(finished, orders(finished, omega), against_size(3), start_up(min(arguments.repeats, 5)))
    print(text)
    draw(finished, FIGURE if arguments.readme else DEMOS / "output" / "benchmark.png")
    if arguments.readme:
        write_into_readme("benchmark", text)
