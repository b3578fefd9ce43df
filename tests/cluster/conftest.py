"""Fixtures: a real cluster on this machine, as long as the tests last."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from threads import one_thread  # noqa: F401

sys.path.append(str(Path(__file__).parent.parent / "preprocess"))  # for its toys

from dask_processes import PATIENCE, Processes, wait_until


@pytest.fixture(scope="session")
def processes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Processes]:
    """A scheduler, which lives as long as the tests."""
    pytest.importorskip("distributed", reason="the extra cluster is not installed")
    processes = Processes(tmp_path_factory.mktemp("dask"))
    try:
        processes.start_scheduler()
        yield processes
    finally:
        processes.end()


@pytest.fixture
def cluster(processes: Processes) -> Processes:
    """The scheduler with two workers; what a test has killed is replaced."""
    while len(processes.workers) < 2:
        processes.start_worker()
    from distributed import Client

    with Client(processes.address, timeout=PATIENCE) as client:
        client.wait_for_workers(2, timeout=PATIENCE)
        wait_until(lambda: len(client.nthreads()) == 2, "dead workers to be forgotten")
    return processes
