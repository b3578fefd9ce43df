"""Descriptors on a Dask cluster: each worker opens the run by itself, and stores and sends back what it finds."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

from mvtn_cli.console import Console
from mvtn_cli.core.cluster import connect
from mvtn_cli.core.preprocess import Part
from mvtn_cli.core.retrieval.describing import Arrays, compute, write_descriptors
from mvtn_cli.core.store import Store, file_stamp
from mvtn_cli.core.training.run import Run

if TYPE_CHECKING:
    from mvtn_cli.core.networks.recogniser import Recogniser

ONE_AT_A_TIME = threading.Lock()  # a worker may have several threads, and the renderer's are not to be shared


@dataclass(frozen=True)
class Manner:
    """How shapes are described.

    Attributes:
        run: Its folder is the same on all machines.
        checkpoint: `best` or `last`.
        device: Where the network works, on each machine.
        batch_size: Shapes a step.
        seed: Of random views.
        threads: CPU threads of a worker; None leaves them as they are.
        no_skip: What is not to be left out.
    """

    run: Run
    checkpoint: str
    device: str
    batch_size: int
    seed: int
    threads: int | None
    no_skip: tuple[str, ...]


@dataclass(frozen=True)
class Errand:
    """Some shapes, as a worker is sent them.

    Attributes:
        manner: How they are described.
        shapes: All of which are described.
        address: Where their descriptors are kept.
    """

    manner: Manner
    shapes: Part
    address: str


def describe_on_cluster(
    manner: Manner, parts: Mapping[str, Part], scheduler: str, store: Store, console: Console
) -> Iterator[tuple[str, Arrays]]:
    """Describe and store parts of a data set, by address, in no particular order.

    Raises:
        DataError: The weights of the run don't fit.
        MvtnError: The cluster can't do it, see `core/cluster`.
    """
    errands = (Errand(manner, part, address) for address, part in parts.items())
    with connect(scheduler, store.root, console, needs=[manner.run.weights_path(manner.checkpoint)]) as cluster:
        yield from cluster.map(run_errand, errands)


def run_errand(errand: Errand) -> tuple[str, Arrays]:
    """Describe and store one part; called on a worker."""
    from mvtn_cli.core.render.skips import use_skips
    from mvtn_cli.core.training.device import use_threads

    manner, shapes = errand.manner, errand.shapes
    with ONE_AT_A_TIME:
        use_threads(manner.threads)
        use_skips(manner.no_skip)
        weights = manner.run.require_weights(manner.checkpoint)
        model = _model(manner.run, manner.checkpoint, manner.device, file_stamp(weights))
        indices, quiet = range(len(shapes.records)), Console(quiet=True)
        arrays = compute(model, manner.run, shapes, indices, manner.batch_size, manner.seed, quiet)
    write_descriptors(shapes.store, errand.address, arrays)
    return errand.address, arrays


@lru_cache(maxsize=1)
def _model(run: Run, checkpoint: str, device: str, _stamp: tuple[int, int] | None) -> Recogniser:
    """The last model that this worker used; other weights under the same name are another model."""
    from mvtn_cli.core.training.predict import load_model

    return load_model(run, checkpoint, device)
