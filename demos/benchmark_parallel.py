# %% [markdown]
# # One scene on many elements, many scenes on many ranks
#
# The fixed mesh takes more and more elements, on one rank and on two; a sweep takes many scenes, each solved by one
# rank. Every run is a process (or an mpirun) of its own. Time is that of the solve, or of the sweep, after the forms
# were compiled; memory is the largest that a rank ever held.
#
#     python demos/benchmark_parallel.py            prints the table
#     python demos/benchmark_parallel.py --readme   writes it into the README, too

# %%
import argparse
import json
import logging
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

README = Path(__file__).parent.parent / "README.md"
ELEMENTS = (1_000, 10_000, 100_000, 400_000)
RANKS = (1, 2)
SCENES = 2000
OMEGA = 1.4807092526223
SECONDS = 600  # of the longest run that is waited for

# %% [markdown]
# ## What one rank of a run does


# %%
def elements(count: int) -> dict[str, float]:
    """Solves the source's scene on a fixed mesh."""
    from belt_fenicsx import Scene, solve

    solve(Scene(), method="augmented-lagrangian", elements=100)
    began = time.perf_counter()
    solution = solve(Scene(), method="augmented-lagrangian", elements=count)
    return {"seconds": time.perf_counter() - began, "error": abs(solution.omega / OMEGA - 1.0)}


def scenes(count: int) -> dict[str, float]:
    """Sweeps over the place where stick ends, in fitted zones."""
    from mpi4py import MPI

    from belt_fenicsx import Scene, solve, sweep

    solve(Scene(), comm=MPI.COMM_SELF)
    values = np.linspace(-0.2, 0.2, count)
    MPI.COMM_WORLD.Barrier()
    began = time.perf_counter()
    comm = MPI.COMM_WORLD if MPI.COMM_WORLD.size > 1 else None
    result = sweep(Scene(), over="pulleys.0.x_trans", values=values, comm=comm, keep_fields=False)
    assert result.success
    return {"seconds": time.perf_counter() - began}


def run_rank(what: str, count: int) -> None:
    """Runs and tells rank 0's measures, with the largest memory of all ranks, as the last line of output."""
    from mpi4py import MPI

    logging.basicConfig(level=logging.WARNING)
    logging.getLogger().addFilter(lambda record: record.levelno > logging.INFO)
    measures = {"elements": elements, "scenes": scenes}[what](count)
    kilobytes = MPI.COMM_WORLD.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, MPI.MAX)
    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps({**measures, "bytes": 1024 * kilobytes}))


# %% [markdown]
# ## The runs, and the table of them


# %%
def measured(what: str, count: int, ranks: int) -> dict[str, float]:
    """Measures of a run."""
    command = [sys.executable, __file__, "--rank", what, "--count", str(count)]
    launcher = ["mpirun", "-n", str(ranks)] if ranks > 1 else []
    result = subprocess.run([*launcher, *command], check=True, stdout=subprocess.PIPE, text=True, timeout=SECONDS)
    return json.loads(result.stdout.splitlines()[-1])


def row(what: str, count: int) -> str:
    """A line of the table: times on each number of ranks, and the gain."""
    print(f"{count} {what} ...", file=sys.stderr)
    runs = [measured(what, count, ranks) for ranks in RANKS]
    times = [run["seconds"] for run in runs]
    each = 1e6 * times[0] / count
    error = f"{runs[0]['error']:.0e}" if "error" in runs[0] else ""
    memory = " / ".join(f"{run['bytes'] / 1e6:.0f}" for run in runs)
    cells = (f"{count:.0e} {what}", *(f"{t:.3g}" for t in times), f"{times[0] / times[1]:.2f}", f"{each:.0f}")
    return f"| {' | '.join((*cells, memory, error))} |"


def table() -> str:
    """The table, with the machine's load when it was begun."""
    head = ("run", *(f"ranks {n} [s]" for n in RANKS), "gain", "1 rank, each [us]", "memory of a rank [MB]", "error")
    lines = [f"| {' | '.join(head)} |", f"|{' --- |' * len(head)}"]
    load = f"{os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f} before the first run."
    lines += [row("elements", count) for count in ELEMENTS] + [row("scenes", SCENES)]
    return "\n".join([load, "", *lines])


def write_into_readme(text: str) -> None:
    """Replaces what stands between the README's two markers."""
    before, _, rest = README.read_text().partition("<!-- parallel -->\n")
    _, _, after = rest.partition("<!-- /parallel -->")
    README.write_text(f"{before}<!-- parallel -->\n{text}\n<!-- /parallel -->{after}")


# %%
if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Large meshes and many scenes, on one rank and on two.")
    parser.add_argument("--readme", action="store_true", help="write the table into the README")
    parser.add_argument("--rank", choices=("elements", "scenes"), help=argparse.SUPPRESS)
    parser.add_argument("--count", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.rank is not None:
        run_rank(arguments.rank, arguments.count)
    else:
        text = table()
        print(text)
        if arguments.readme:
            write_into_readme(text)
