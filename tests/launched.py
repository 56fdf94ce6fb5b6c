"""Programs on several ranks, started from a test in one process."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

LAUNCHER = shutil.which("mpirun", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
ENVIRONMENT = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    "OMPI_MCA_btl_vader_single_copy_mechanism": "none",
    "OMP_NUM_THREADS": "1",
}
START = """
from mpi4py import MPI
from belt_fenicsx import Pulley, Scene, SceneError, solve, sweep
rank, wait = MPI.COMM_WORLD.rank, MPI.COMM_WORLD.Barrier
fixed = dict(method="augmented-lagrangian", elements=60)
lines = []
def tell(*told):
    lines.append(" ".join(map(str, (f"rank {rank}:", *told))))
"""
END = """
for line in sum(MPI.COMM_WORLD.gather(lines) or [], []):
    print(line)
"""


def run_on_ranks(*argv, ranks=2):
    """What comes of Python with these arguments on some ranks."""
    if LAUNCHER is None:
        pytest.skip("there is no mpirun")
    command = ["timeout", "100", LAUNCHER, "-n", str(ranks), sys.executable, *argv]
    return subprocess.run(command, env=os.environ | ENVIRONMENT, capture_output=True, text=True, check=False)


def on_ranks(*argv, ranks=2, code=0):
    """What Python with these arguments tells."""
    result = run_on_ranks(*argv, ranks=ranks)
    assert result.returncode == code, (result.returncode, result.stdout, result.stderr)
    return result.stdout


def told(code, *, ranks=2):
    """Lines that the ranks tell, those of rank 0 first."""
    return on_ranks("-c", f"{START}{code}{END}", ranks=ranks).splitlines()
