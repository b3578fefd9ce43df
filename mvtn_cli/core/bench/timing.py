"""Wall time, with compilation and the machine's moods kept out."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

import numba
import torch

from mvtn_cli.core.training.device import use_threads


@dataclass
class Timing:
    """Seconds of one piece of work.

    Attributes:
        first: Of the first call, which compiles or loads kernels.
        seconds: Of all later calls.
    """

    first: float = 0.0
    seconds: list[float] = field(default_factory=list)

    @property
    def median(self) -> float:
        """Of the later calls."""
        return statistics.median(self.seconds)

    @property
    def compiling(self) -> float:
        """How much longer the first call took."""
        return max(0.0, self.first - self.median)


def interleaved(works: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, Timing]:
    """Time several pieces of work A B C A B C …, so that a loaded minute hits all alike.

    Args:
        works: Name and what to call.
        repeats: Calls of each after the first, which is kept apart.
    """
    timings = {name: Timing() for name in works}
    for name, work in works.items():
        timings[name].first = timed(work)
    for _ in range(repeats):
        for name, work in works.items():
            timings[name].seconds.append(timed(work))
    return timings


def timed(work: Callable[[], object]) -> float:
    """Seconds that one call takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Let networks and renderer use `count` threads for a while."""
    before = torch.get_num_threads(), numba.get_num_threads()
    use_threads(count)
    try:
        yield
    finally:
        numba.set_num_threads(before[1])
        torch.set_num_threads(before[0])


def most_threads() -> int:
    """The most that the renderer can be given in this process."""
    return int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]
