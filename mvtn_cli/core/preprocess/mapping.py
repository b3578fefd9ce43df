"""The map over the items of a data set: here, in several processes or on many machines."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TypeAlias, TypeVar

from mvtn_cli.console import Console
from mvtn_cli.core.cluster import connect, cut
from mvtn_cli.core.datasets import Item

Numbered: TypeAlias = tuple[int, Item]  # an item with its place in the data set
Result = TypeVar("Result")
Work: TypeAlias = Callable[[Sequence[Numbered]], list[tuple[int, Result]]]  # picklable, for other processes
Spread: TypeAlias = Callable[[Work[Result], Sequence[Numbered]], Generator[list[tuple[int, Result]], None, None]]

START_UP_S = 1.5  # what a worker process costs before its first shape
LARGEST_BATCH = 64


def spread_of(workers: int | None, scheduler: str | None, shared: Path, console: Console) -> Spread[Result]:
    """Say who does the work: the Dask cluster of a scheduler, else processes of this machine.

    Args:
        workers: Processes; None is one a core.
        scheduler: As `tcp://host:8786`.
        shared: Artifact directory, which all machines of the cluster must see.
        console: For what is worth knowing about the cluster.
    """
    if scheduler is None:
        return partial(map_items, workers=worker_count(workers))
    return partial(map_on_cluster, scheduler=scheduler, shared=shared, console=console)


def map_on_cluster(
    work: Work[Result], items: Sequence[Numbered], scheduler: str, shared: Path, console: Console
) -> Generator[list[tuple[int, Result]], None, None]:
    """Do the work on all items on a Dask cluster; yields like `map_items`.

    Raises:
        MvtnError: The cluster can't do it, see `core/cluster`.
    """
    source = next((item.path for _, item in items if item.path is not None), None)
    with connect(scheduler, shared, console, needs=() if source is None else (source,)) as cluster:
        yield from cluster.map(work, cut(items, cluster.threads))


def map_items(
    work: Work[Result], items: Sequence[Numbered], workers: int
) -> Generator[list[tuple[int, Result]], None, None]:
    """Do the work on all items and yield results, batch by batch, as they come, in no particular order.

    Work begins in this process; only what is left after the time that starting others would take goes to
    them. So a few small shapes never wait for a worker, and a few huge ones still share the cores.
    """
    start = time.monotonic()
    for done, item in enumerate(items):
        if workers > 1 and len(items) - done > 1 and time.monotonic() - start >= START_UP_S:
            yield from _map_in_processes(work, items[done:], workers)
            return
        yield work([item])


def _map_in_processes(
    work: Work[Result], items: Sequence[Numbered], workers: int
) -> Iterator[list[tuple[int, Result]]]:
    from joblib import Parallel, delayed
    from joblib.externals.loky import get_reusable_executor

    size = min(max(len(items) // (workers * 16), 1), LARGEST_BATCH)
    batches = [items[start : start + size] for start in range(0, len(items), size)]
    parallel = Parallel(n_jobs=min(workers, len(batches)), batch_size=1, return_as="generator_unordered")
    with _deaf_to_ctrl_c():
        results = parallel(delayed(work)(batch) for batch in batches)
    yield from results
    get_reusable_executor().shutdown(wait=False)  # a training that follows would carry idle workers along


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Ignore Ctrl-C while workers start, which inherit that: this process alone answers, and ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def worker_count(asked: int | None) -> int:
    """Return the number of processes: what was asked for, else one a core that this process may use."""
    if asked:
        return asked
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
