# %% [markdown]
# # One scene on many elements, many scenes on many ranks
#
# The fixed mesh takes more and more elements, on one rank and on two; a sweep takes many scenes, each solved by one
# rank. Every run is a process (or an mpirun) of its own. Time is that of the solve, or of the sweep, after the forms
# were compiled. Memory is the largest that a rank ever held; for each element, what it was more than after a first
# small solve. Fine meshes need few Newton iterations, as the coarser mesh before left little to do: so the table has
# their number, too, and below it what each of the meshes on the way to the finest one took.
#
# What ranks can gain at most is for the machine to say: two processes that share nothing, at the same time, show it.
#
#     python demos/studies/benchmark_parallel.py            prints the tables
#     python demos/studies/benchmark_parallel.py --table "parallel drives" --repeats 1
#     python demos/studies/benchmark_parallel.py --readme   writes them into the README, too

# %%
import argparse
import json
import logging
import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from readme import write_into_readme

ELEMENTS = (1_000, 10_000, 100_000, 1_000_000)
FITTED = 10_000  # elements from which on powers are fitted
RANKS = (1, 2)
SCENES = 2000
REPEATS = 3
OMEGA = 1.4807092526223
SECONDS = 600  # of the longest run that is waited for

TWO_PULLEYS = Path(__file__).parents[1] / "two_pulleys.toml"
OMEGA_OF_TWO = 11.3084625313
ON_A_LOOP, DRIVES = 100_000, 1000

# %% [markdown]
# ## What one rank of a run does


# %%
def elements(count: int) -> dict[str, float]:
    """Solves the source's scene on a fixed mesh."""
    from belt_fenicsx import Scene

    return on_fixed_mesh(Scene(), count, 100, OMEGA)


def loop(count: int) -> dict[str, float]:
    """Solves a drive of two pulleys on a fixed mesh that is a ring."""
    from belt_fenicsx import load_scene

    return on_fixed_mesh(load_scene(TWO_PULLEYS), count, 400, OMEGA_OF_TWO)


def on_fixed_mesh(scene: Any, count: int, few: int, omega: float) -> dict[str, float]:
    """Solves a scene on a fixed mesh, after once on one of few elements."""
    from belt_fenicsx import solve

    solve(scene, method="augmented-lagrangian", elements=few)
    before, began = held(), time.perf_counter()
    solution = solve(scene, method="augmented-lagrangian", elements=count)
    seconds = time.perf_counter() - began
    (last,) = [stage for stage in solution.stages if stage.name == "frictional"]
    return {
        "seconds": seconds,
        "error": abs(solution.contacts[-1].omega / omega - 1.0),
        "iterations": last.iterations,
        "bytes each": (held() - before) / count,
    }


def meshes(count: int) -> dict[str, list[tuple[int, int, float]]]:
    """Elements, Newton iterations and microseconds for each element, of all meshes on the way to a fine one."""
    from belt_fenicsx import Scene, solve

    rows = []
    for stage in solve(Scene(), method="augmented-lagrangian", elements=count).stages:
        # Called "frictional, 62500 elements" on the way, "frictional" at its end.
        name, _, where = stage.name.partition(", ")
        if name == "frictional":
            n = int(where.split()[0]) if where else count
            rows.append((n, stage.iterations, 1e6 * stage.seconds / n))
    return {"meshes": rows}


def held() -> int:
    """Largest memory that this process ever held [bytes]."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def scenes(count: int) -> dict[str, float]:
    """Sweeps over the place where stick ends, in fitted zones."""
    from belt_fenicsx import Scene

    return swept(Scene(), "pulleys.0.x_trans", np.linspace(-0.2, 0.2, count))


def drives(count: int) -> dict[str, float]:
    """Sweeps over the torque of a drive of two pulleys, in fitted zones."""
    from belt_fenicsx import load_scene

    return swept(load_scene(TWO_PULLEYS), "pulleys.1.torque", np.linspace(10.0, 30.0, count))


def swept(scene: Any, over: str, values: np.ndarray) -> dict[str, float]:
    """Sweeps over some values, after one solve, on all ranks."""
    from mpi4py import MPI

    from belt_fenicsx import solve, sweep

    solve(scene, comm=MPI.COMM_SELF)
    MPI.COMM_WORLD.Barrier()
    began = time.perf_counter()
    comm = MPI.COMM_WORLD if MPI.COMM_WORLD.size > 1 else None
    assert sweep(scene, over=over, values=values, comm=comm, keep_fields=False).success
    return {"seconds": time.perf_counter() - began}


MEASURED = {"elements": elements, "elements on a loop": loop, "scenes": scenes, "drives": drives, "meshes": meshes}


def run_rank(what: str, count: int) -> None:
    """Runs and tells rank 0's measures, with the largest memory of all ranks, as the last line of output."""
    from mpi4py import MPI

    logging.basicConfig(level=logging.WARNING)
    logging.getLogger().addFilter(lambda record: record.levelno > logging.INFO)
    measures = MEASURED[what](count)
    most = MPI.COMM_WORLD.allreduce(held(), MPI.MAX)
    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps({**measures, "bytes": most}))


# %% [markdown]
# ## The runs, and the table of them


# %%
Runs = dict[tuple[int, str], list[dict[str, float]]]  # of each row, on each number of ranks


def measured(what: str, count: int, repeats: int) -> list[dict[str, float]]:
    """Measures on each number of ranks: medians of runs that take turns, so that all see the same machine."""
    runs = [[measured_once(what, count, ranks) for ranks in RANKS] for _ in range(repeats)]
    return [{name: median(run[name] for run in own) for name in own[0]} for own in zip(*runs, strict=True)]


def measured_once(what: str, count: int, ranks: int) -> dict[str, Any]:
    """Measures of a run."""
    (measures,) = at_once(what, count, ["mpirun", "-n", str(ranks)] if ranks > 1 else [], 1)
    return measures


def at_once(what: str, count: int, launcher: list[str], processes: int) -> list[dict[str, Any]]:
    """Measures of runs that start together and know nothing of each other."""
    command = [*launcher, sys.executable, __file__, "--rank", what, "--count", str(count)]
    started = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(processes)]
    try:
        outputs = [process.communicate(timeout=SECONDS)[0] for process in started]
    finally:
        for process in started:
            process.terminate()
    if any(process.returncode for process in started):
        raise RuntimeError(f"`{' '.join(command)}` failed")
    return [json.loads(output.splitlines()[-1]) for output in outputs]


def ceiling() -> float:
    """What two processes that share nothing gain over one: the most that this machine lets two ranks gain."""
    gains = []
    for _ in range(REPEATS):
        (alone,), both = (at_once("scenes", SCENES // 2, [], n) for n in (1, 2))
        gains.append(2.0 * alone["seconds"] / max(run["seconds"] for run in both))
    return median(gains)


def row(count: int, what: str, runs: list[dict[str, float]]) -> str:
    """A line of the table: times on each number of ranks, the gain, and what one rank took for each element."""
    times, memory = ([run[name] for run in runs] for name in ("seconds", "bytes"))
    cells = [f"{count:.0e} {what}", *(f"{t:.3g}" for t in times), f"{times[0] / times[1]:.2f}"]
    cells += [f"{1e6 * times[0] / count:.0f}", " / ".join(f"{m / 1e6:.0f}" for m in memory)]
    if "bytes each" in runs[0]:
        cells += [f"{runs[0]['bytes each'] / 1e3:.1f}", f"{runs[0]['iterations']}", f"{runs[0]['error']:.0e}"]
    else:
        cells += [""] * 3
    return f"| {' | '.join(cells)} |"


def power(counts: Sequence[int], values: Sequence[float]) -> float:
    """Fitted power with which values grow with the counts."""
    return float(np.polyfit(np.log(counts), np.log(values), 1)[0])


def rows(asked: Sequence[tuple[int, str]], repeats: int) -> tuple[list[str], Runs]:
    """Lines of a table, with the machine's load when it was begun, and what they are made from."""
    load = f"{os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f} before the first run; medians of {repeats}."
    runs = {}
    for count, what in asked:
        print(f"{count} {what} ...", file=sys.stderr)
        runs[count, what] = measured(what, count, repeats)
    times = [f"ranks {n} [s]" for n in RANKS]
    each = ["1 rank, each [us]", "memory of a rank [MB]", "1 rank, each [kB]", "iterations on this mesh", "error"]
    head = ["run", *times, "gain", *each]
    lines = [f"| {' | '.join(head)} |", f"|{' --- |' * len(head)}"]
    return [load, "", *lines, *(row(count, what, runs[count, what]) for count, what in asked)], runs


def table(repeats: int) -> str:
    """The chapter's scene on more and more elements, and many of its like."""
    lines, runs = rows([*((count, "elements") for count in ELEMENTS), (SCENES, "scenes")], repeats)
    fitted = [count for count in ELEMENTS if count >= FITTED]
    one = [runs[count, "elements"][0] for count in fitted]
    seconds = power(fitted, [run["seconds"] for run in one])
    memory = power(fitted, [run["bytes each"] * count for count, run in zip(fitted, one, strict=True)])
    finest = ELEMENTS[-1]
    way = measured_once("meshes", finest, 1)["meshes"]
    text = [
        f"Fitted powers from {FITTED:.0e} elements on, one rank: time {seconds:.2f}, memory {memory:.2f}.",
        "",
        f"Two processes of {SCENES // 2} scenes that share nothing gain {ceiling():.2f} over one of them.",
        "",
        f"Meshes on the way to {finest:.0e} elements: "
        + ", ".join(f"{n} ({iterations} iterations, {each:.1f} us each)" for n, iterations, each in way)
        + ".",
    ]
    return "\n".join([*lines, "", *text])


def table_of_drives(repeats: int) -> str:
    """A loop on many elements, and many drives."""
    return "\n".join(rows([(ON_A_LOOP, "elements on a loop"), (DRIVES, "drives")], repeats)[0])


TABLES = {"parallel": table, "parallel drives": table_of_drives}


# %%
if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Large meshes and many scenes, on one rank and on two.")
    parser.add_argument("--readme", action="store_true", help="write the table into the README")
    parser.add_argument("--table", choices=TABLES, help="one of them alone")
    parser.add_argument("--repeats", type=int, default=REPEATS, help="of each run, of which the median is taken")
    parser.add_argument("--rank", choices=[*MEASURED], help=argparse.SUPPRESS)
    parser.add_argument("--count", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.rank is not None:
        run_rank(arguments.rank, arguments.count)
    else:
        for name in [arguments.table] if arguments.table else TABLES:
            text = TABLES[name](arguments.repeats)
            print(text)
            if arguments.readme:
                write_into_readme(name, text)
