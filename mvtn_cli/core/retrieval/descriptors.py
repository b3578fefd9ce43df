"""What a trained network makes of shapes, worked out once for the same weights, shapes and settings."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mvtn_cli import __version__
from mvtn_cli.console import Console, dumps
from mvtn_cli.core.preprocess import Part
from mvtn_cli.core.render.tally import tally
from mvtn_cli.core.retrieval.describing import Arrays, compute, read_descriptors, write_descriptors
from mvtn_cli.core.retrieval.many_machines import Manner, describe_on_cluster
from mvtn_cli.core.store import Store, digest
from mvtn_cli.core.training.run import NOT_SETTINGS, Run
from mvtn_cli.errors import DataError

if TYPE_CHECKING:
    from mvtn_cli.core.networks.recogniser import Recogniser
    from mvtn_cli.core.preprocess import Prepared

CHUNK = 128  # shapes whose descriptors are kept in one file: what an interruption can cost


@dataclass(frozen=True)
class Described:
    """Descriptors of N shapes.

    Attributes:
        descriptors: (N, D) float32, what the last layer of the classifier sees.
        predicted: (N,) int64 class that the network takes each for.
    """

    descriptors: NDArray[np.float32]
    predicted: NDArray[np.int64]


@dataclass
class Describer:
    """Describes shapes with the weights of a run.

    Attributes:
        run: Has weights.
        checkpoint: Which ones, `best` or `last`.
        device: Where the network works.
        batch_size: Shapes a step.
        seed: Of random views.
        store: Where descriptors are kept.
        console: For progress.
        scheduler: Of a Dask cluster that does the work, as `tcp://host:8786`.
        threads, no_skip: Of each worker there, as `--threads` and `--no-skip`; here they hold already.
        computed: How many shapes were not found in the store so far.
    """

    run: Run
    checkpoint: str
    device: str
    batch_size: int
    seed: int
    store: Store
    console: Console
    scheduler: str | None = None
    threads: int | None = None
    no_skip: tuple[str, ...] = ()
    computed: int = 0

    def describe(self, prepared: Prepared, indices: Sequence[int]) -> Described:
        """Return the descriptors of some shapes, in this order.

        Each file of the store holds those of up to 128 consecutive shapes, under an address made of the weights, the
        settings and the shapes.

        Raises:
            DataError: The run has no such weights, or there are no shapes.
        """
        if not len(indices):
            raise DataError("no shapes to describe", code="dataset.empty-split")
        chunks = [list(indices[begin : begin + CHUNK]) for begin in range(0, len(indices), CHUNK)]
        addresses = [digest(self._settings, *(prepared.records[i].address for i in chunk)) for chunk in chunks]
        parts: dict[str, Arrays] = {}
        with self.console.progress("describing", len(indices)) as ticker:
            missing: dict[str, list[int]] = {}
            for address, chunk in zip(addresses, chunks, strict=True):
                known = read_descriptors(self.store, address)
                tally().count("eval-cache", len(chunk) if known else 0, len(chunk))
                if known is None:
                    missing[address] = chunk
                else:
                    parts[address] = known
                    ticker.advance(len(chunk))
            with closing(self._describe_all(prepared, missing)) as described:
                for address, arrays in described:
                    parts[address] = arrays
                    self.computed += len(missing[address])
                    ticker.advance(len(missing[address]))
        names = ("descriptors", "predicted")
        return Described(*(np.concatenate([parts[address][name] for address in addresses]) for name in names))

    def _describe_all(
        self, prepared: Prepared, chunks: Mapping[str, list[int]]
    ) -> Generator[tuple[str, Arrays], None, None]:
        """Describe chunks, by address, and store them: on the cluster, if it is worth the way there, else here."""
        if self.scheduler is None or len(chunks) < 2:
            for address, chunk in chunks.items():
                arrays = compute(self._model, self.run, prepared, chunk, self.batch_size, self.seed, self.console)
                write_descriptors(self.store, address, arrays)
                yield address, arrays
            return
        there = Manner(
            Run(self.run.path.absolute()), self.checkpoint, self.device, self.batch_size, self.seed,
            self.threads, self.no_skip,
        )  # fmt: skip
        parts = {address: Part.of(prepared, chunk) for address, chunk in chunks.items()}
        yield from describe_on_cluster(there, parts, self.scheduler, self.store, self.console)

    @cached_property
    def _model(self) -> Recogniser:
        from mvtn_cli.core.render.warming import compile_renderer
        from mvtn_cli.core.training.predict import load_model

        model = load_model(self.run, self.checkpoint, self.device)
        compile_renderer(self.console, model.device)
        return model

    @cached_property
    def _settings(self) -> str:
        """Everything but the shapes that has a say in a descriptor."""
        weights = self.run.require_weights(self.checkpoint).read_bytes()
        config = self.run.config
        chosen = config.model_dump(mode="json", exclude=set(NOT_SETTINGS))
        steps = self.batch_size if config.views in ("random", "jittered") else None  # random views differ by the step
        parts = {"version": __version__, "config": chosen, "seed": self.seed, "batch_size": steps}
        return digest(weights, dumps(parts))


def labelled(prepared: Prepared, split: str) -> list[int]:
    """Find the labelled shapes of a split, as the data set has it.

    Raises:
        DataError: There are none.
    """
    indices = [i for i in prepared.split(split) if prepared.records[i].label >= 0]
    if not indices:
        raise DataError(
            f"no labelled shapes for split '{split}' in {prepared.spec}",
            hint="retrieval needs shapes to search and to learn from: give the data set a train and a test split",
            code="dataset.empty-split",
        )
    return indices
