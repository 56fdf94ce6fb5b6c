"""The same tests, in one process and under mpirun."""

from __future__ import annotations

import gc
import os
import sys

import pytest

# From the launcher's environment: a test that needs no MPI must not load it.
SIZE = int(next((os.environ[n] for n in ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE") if n in os.environ), 1))
RANK = int(next((os.environ[n] for n in ("OMPI_COMM_WORLD_RANK", "PMI_RANK") if n in os.environ), 0))


def pytest_configure(config: pytest.Config) -> None:
    if RANK > 0:
        config.option.verbose = -2


def pytest_report_teststatus(report: pytest.TestReport) -> tuple[str, str, str] | None:
    """Every rank tells its failures, rank 0 alone its progress."""
    if RANK == 0 or report.failed:
        return None
    return (report.outcome if report.when == "call" or report.skipped else "", "", "")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if SIZE > 1 and item.get_closest_marker("serial"):
            item.add_marker(pytest.mark.skip(reason="needs no more than one process"))


@pytest.fixture(scope="session", autouse=True)
def shared_meshes():
    """Lets ranks share small meshes, too, so that tests of a moment see what they do together."""
    with pytest.MonkeyPatch.context() as patch:
        if SIZE > 1:
            from belt_fenicsx.lagrangian.tolerances import Tolerances

            patch.setattr("belt_fenicsx.lagrangian.method.TOLERANCES", Tolerances(shared=1))
        yield


@pytest.fixture(autouse=True)
def collective_teardown():
    """Frees PETSc's objects, whose destruction is collective, at the same place on all ranks."""
    yield
    mpi = sys.modules.get("mpi4py.MPI")
    if SIZE > 1 and mpi is not None:
        gc.collect()
        mpi.COMM_WORLD.Barrier()
