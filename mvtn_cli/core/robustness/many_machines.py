"""Evaluations on a Dask cluster: each worker opens the run by itself and is sent what to do to which shapes."""

from __future__ import annotations

import threading
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from mvtn_cli.console import Console, Ticker
from mvtn_cli.core.cluster import connect
from mvtn_cli.core.preprocess import Part
from mvtn_cli.core.render.skips import use_skips
from mvtn_cli.core.robustness.cells import Cell
from mvtn_cli.core.robustness.corruption import Corruption
from mvtn_cli.core.robustness.evaluating import evaluate, words_of
from mvtn_cli.core.store import file_stamp
from mvtn_cli.core.training.device import use_threads
from mvtn_cli.core.training.predict import load_model
from mvtn_cli.core.training.run import Run
from mvtn_cli.robustness_config import RobustnessConfig

if TYPE_CHECKING:
    from mvtn_cli.core.networks.recogniser import Recogniser

ONE_AT_A_TIME = threading.Lock()  # a worker may have several threads, and the renderer's are not to be shared


@dataclass(frozen=True)
class Errand:
    """One evaluation, as a worker is sent it.

    Attributes:
        key: Of its cell.
        run: Its folder is the same on all machines.
        corruption: What is done to the shapes.
        shapes: All that are evaluated.
        config: Of the command.
    """

    key: str
    run: Run
    corruption: Corruption
    shapes: Part
    config: RobustnessConfig


def evaluate_on_cluster(
    run: Run,
    prepared: Any,
    indices: Sequence[int],
    missing: Mapping[str, Corruption],
    config: RobustnessConfig,
    console: Console,
    ticker: Ticker,
) -> Generator[tuple[str, Cell], None, None]:
    """Like `evaluate_here`, in no particular order.

    Raises:
        DataError: The weights of the run don't fit.
        MvtnError: The cluster can't do it, see `core/cluster`.
    """
    if not missing:
        return
    assert config.scheduler is not None
    there, shapes = Run(run.path.absolute()), Part.of(prepared, indices)
    errands = (Errand(key, there, corruption, shapes, config) for key, corruption in missing.items())
    with connect(
        config.scheduler, prepared.store.root, console, needs=[run.weights_path(config.checkpoint)]
    ) as cluster:
        for key, cell in cluster.map(run_errand, errands):
            ticker.note(words_of(missing[key]))
            ticker.advance(len(indices))
            yield key, cell


def run_errand(errand: Errand) -> tuple[str, Cell]:
    """Do one evaluation; called on a worker."""
    run, config = errand.run, errand.config
    with ONE_AT_A_TIME:
        use_threads(config.threads)
        use_skips(config.no_skip)
        weights = run.require_weights(config.checkpoint)
        model = _model(run, config.checkpoint, config.device, file_stamp(weights))
        indices = range(len(errand.shapes.records))
        return errand.key, evaluate(run, model, errand.shapes, indices, errand.corruption, config, Ticker())


@lru_cache(maxsize=1)
def _model(run: Run, checkpoint: str, device: str, _stamp: tuple[int, int] | None) -> Recogniser:
    """The last model that this worker used; other weights under the same name are another model."""
    return load_model(run, checkpoint, device)
