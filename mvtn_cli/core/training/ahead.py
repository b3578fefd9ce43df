"""The next batch is loaded while the networks work on this one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import numba

Made = TypeVar("Made")


@contextmanager
def one_ahead(calls: Iterable[Callable[[], Made]]) -> Iterator[Iterator[Made]]:
    """Give what the calls give, in their order; each is made in a thread while its forerunner is in use.

    The thread's kernels have as many threads as those of the caller.

    What a call raises is raised where its result would have come. At the end, also after an error, the thread
    has ended: at most one call was made in vain.

    Args:
        calls: Must not draw from generators of others. If they start parallel kernels, the caller starts none.
    """
    kernels = numba.get_num_threads()  # a new thread would have all
    with ThreadPoolExecutor(1, "next-batch", numba.set_num_threads, (kernels,)) as thread:

        def results() -> Iterator[Made]:
            coming: Future[Made] | None = None
            for call in calls:
                following = thread.submit(call)
                if coming is not None:
                    yield coming.result()
                coming = following
            if coming is not None:
                yield coming.result()

        yield results()
