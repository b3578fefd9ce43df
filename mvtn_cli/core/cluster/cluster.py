"""A map over pieces of work on a Dask cluster, a window of them at a time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from itertools import islice
from typing import Any, TypeVar

from mvtn_cli.core.cluster.badge import Badge
from mvtn_cli.errors import MvtnError

Piece = TypeVar("Piece")
Result = TypeVar("Result")
Things = TypeVar("Things", bound=Sequence[Any])

AHEAD = 3  # pieces that wait for each thread, so that none is idle while results travel
LOOK_S = 5.0  # how often workers are counted: they come and go
LARGEST = 64  # things in a piece: what a worker that dies can cost


class Cluster:
    """Workers that have been checked.

    Args:
        client: Of Dask.
        address: Of its scheduler.
        badge: What each worker must have, those that join later too.
    """

    def __init__(self, client: Any, address: str, badge: Badge) -> None:
        self._client = client
        self._address = address
        self._badge = badge
        self._counted, self._looked = 1, -LOOK_S

    @property
    def threads(self) -> int:
        """How many pieces are worked on at once; counted anew every few seconds."""
        if time.monotonic() - self._looked >= LOOK_S:
            self._counted = max(1, sum(self._client.nthreads().values()))
            self._looked = time.monotonic()
        return self._counted

    def map(self, work: Callable[[Piece], Result], pieces: Iterable[Piece]) -> Iterator[Result]:
        """Do the work on all pieces and yield results as they come, in no particular order.

        The pieces of a worker that dies are done again by others. Whatever ends this early takes back what was sent.

        Args:
            work: Picklable by name, as are pieces and results; it may run twice.
            pieces: Taken when there is room for them.

        Raises:
            MvtnError: Of the work; or the scheduler is gone, or a piece kills every worker.
        """
        from distributed import as_completed

        rest = iter(pieces)
        flying = {self._send(work, piece) for piece in islice(rest, self._room(0))}
        done = as_completed(list(flying))
        try:
            for future in done:
                flying.discard(future)
                result = self._result(future)
                more = [self._send(work, piece) for piece in islice(rest, self._room(len(flying)))]
                flying.update(more)
                done.update(more)
                yield result
        finally:
            if flying:
                self._client.cancel(list(flying), force=True)

    def _room(self, flying: int) -> int:
        return max(0, (1 + AHEAD) * self.threads - flying)

    def _send(self, work: Callable[[Piece], Result], piece: Piece) -> Any:
        return self._client.submit(_work_there, self._badge, work, piece, pure=False)

    def _result(self, future: Any) -> Any:
        from distributed import KilledWorker

        try:
            return future.result()
        except KilledWorker:
            raise MvtnError(
                "a piece of work ended one worker after the other, most likely by its memory",
                hint="give workers more (dask worker --memory-limit), or start fewer on each machine",
                code="cluster.killed",
            ) from None
        except CancelledError:
            raise MvtnError(
                f"the scheduler at {self._address} is gone",
                hint="what was done is kept; start it again, and the same command goes on",
                code="cluster.lost",
            ) from None


def cut(things: Things, threads: int) -> Iterator[Things]:
    """Cut things into pieces: at least 16 for each thread, as the last ones must end together, of at most 64."""
    size = min(max(len(things) // (threads * 16), 1), LARGEST)
    for begin in range(0, len(things), size):
        yield things[begin : begin + size]  # type: ignore[misc]


def _work_there(badge: Badge, work: Callable[[Piece], Result], piece: Piece) -> Result:
    """What a worker is sent: it may have joined after all others were checked."""
    from distributed import get_worker

    badge.check(f"the worker at {get_worker().address}")
    return work(piece)
