"""The training shapes of a run, described and mapped: what is searched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.retrieval.descriptors import Described, Describer, labelled
from mvtn_cli.core.retrieval.lfda import LFDA, fit_lfda
from mvtn_cli.core.store import Store, cache_root
from mvtn_cli.core.training.split import stratified_subset

if TYPE_CHECKING:
    from mvtn_cli.console import Console
    from mvtn_cli.core.preprocess import Prepared
    from mvtn_cli.core.training.run import Run
    from mvtn_cli.retrieve_config import RetrieveConfig

Rows = NDArray[np.float64]


@dataclass(frozen=True)
class Searchable:
    """The training shapes of a run, ready to be searched.

    Attributes:
        describer: Describes further shapes in the same way.
        prepared: The data set of the run.
        indices: N of its records, the training shapes.
        labels: (N,) their classes.
        described: Their descriptors as they are.
        lfda: Fitted on them; None without.
        rows: (N, d) what is compared.
    """

    describer: Describer
    prepared: Prepared
    indices: list[int]
    labels: NDArray[np.int64]
    described: Described
    lfda: LFDA | None
    rows: Rows

    def map(self, described: Described) -> Rows:
        """Turn descriptors (M, D) of other shapes into what is compared, (M, d)."""
        plain = described.descriptors.astype(np.float64)
        return plain if self.lfda is None else self.lfda.transform(plain)


def open_searchable(run: Run, prepared: Prepared, config: RetrieveConfig, console: Console) -> Searchable:
    """Describe the training shapes of a run and fit LFDA on them.

    Raises:
        UsageError: The data set has other classes than the run.
        DataError: There are no weights or no training shapes, or LFDA can't be fitted.
    """
    run.check_classes(prepared)
    store = Store(cache_root(config.cache))
    batch_size = config.shapes_a_step(run.config.batch_size)
    describer = Describer(
        run, config.checkpoint, config.device, batch_size, config.seed, store, console,
        config.scheduler, config.threads, config.no_skip,
    )  # fmt: skip
    indices = limited(prepared, labelled(prepared, "train"), config.gallery_limit, config.seed)
    described = describer.describe(prepared, indices)
    labels = labels_of(prepared, indices)
    rows = described.descriptors.astype(np.float64)
    lfda = None if config.no_lfda else fit_lfda(rows, labels, config.lfda_dim)
    return Searchable(
        describer, prepared, indices, labels, described, lfda, rows if lfda is None else lfda.transform(rows)
    )


def labels_of(prepared: Prepared, indices: Sequence[int]) -> NDArray[np.int64]:
    """Classes of some shapes, (N,)."""
    return np.array([prepared.records[i].label for i in indices], np.int64)


def limited(prepared: Prepared, indices: list[int], limit: int | None, seed: int) -> list[int]:
    """Take at most `limit` of some shapes, of each class in turn; None takes all."""
    if limit is None:
        return indices
    return stratified_subset(indices, labels_of(prepared, indices).tolist(), limit, seed)
