"""The map over shapes, here or in several processes."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from mvtn_cli.core.preprocess.making import Numbered, Outcome, make_all
from mvtn_cli.core.preprocess.settings import Settings
from mvtn_cli.core.store import Store

START_UP_S = 1.5  # what a worker process costs before its first shape
LARGEST_BATCH = 64


def map_items(
    store: Store, items: Sequence[Numbered], settings: Settings, workers: int
) -> Iterator[list[tuple[int, Outcome]]]:
    """Make the items' shapes and yield outcomes as they come, in no particular order.

    Work begins in this process; only what is left after the time that starting others would take goes to
    them. So a few small shapes never wait for a worker, and a few huge ones still share the cores.
    """
    start = time.monotonic()
    for done, item in enumerate(items):
        if workers > 1 and len(items) - done > 1 and time.monotonic() - start >= START_UP_S:
            yield from _map_in_processes(store, items[done:], settings, workers)
            return
        yield make_all(store, [item], settings)


def _map_in_processes(
    store: Store, items: Sequence[Numbered], settings: Settings, workers: int
) -> Iterator[list[tuple[int, Outcome]]]:
    from joblib import Parallel, delayed
    from joblib.externals.loky import get_reusable_executor

    size = min(max(len(items) // (workers * 16), 1), LARGEST_BATCH)
    batches = [items[start : start + size] for start in range(0, len(items), size)]
    parallel = Parallel(n_jobs=min(workers, len(batches)), batch_size=1, return_as="generator_unordered")
    with _deaf_to_ctrl_c():
        outcomes = parallel(delayed(make_all)(store, batch, settings) for batch in batches)
    yield from outcomes
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
