"""What a trained network makes of shapes, worked out once for the same weights, shapes and settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mvtn_cli import __version__
from mvtn_cli.console import Console, dumps
from mvtn_cli.core.render.tally import tally
from mvtn_cli.core.store import Store, digest
from mvtn_cli.core.store.atomic import write_bytes
from mvtn_cli.core.store.shape_file import DamagedFile
from mvtn_cli.core.store.views_file import decode, encode
from mvtn_cli.core.training.run import NOT_SETTINGS
from mvtn_cli.errors import DataError

if TYPE_CHECKING:
    from mvtn_cli.core.networks.recogniser import Recogniser
    from mvtn_cli.core.preprocess import Prepared
    from mvtn_cli.core.training.run import Run

CHUNK = 128  # shapes whose descriptors are kept in one file: what an interruption can cost
Arrays = dict[str, NDArray[Any]]


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
        computed: How many shapes were not found in the store so far.
    """

    run: Run
    checkpoint: str
    device: str
    batch_size: int
    seed: int
    store: Store
    console: Console
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
        parts = []
        with self.console.progress("describing", len(indices)) as ticker:
            for chunk in chunks:
                parts.append(self._chunk(prepared, chunk))
                ticker.advance(len(chunk))
        return Described(*(np.concatenate([part[name] for part in parts]) for name in ("descriptors", "predicted")))

    def _chunk(self, prepared: Prepared, chunk: list[int]) -> Arrays:
        address = digest(self._settings, *(prepared.records[i].address for i in chunk))
        path = self.store.root / "descriptors" / address[:2] / f"{address}.npz"
        try:
            known = decode(address, path.read_bytes())
            tally().count("eval-cache", len(chunk), len(chunk))
            return known
        except (OSError, DamagedFile):
            tally().count("eval-cache", 0, len(chunk))
            arrays = self._compute(prepared, chunk)
            write_bytes(path, encode(address, arrays), durable=False)
            return arrays

    def _compute(self, prepared: Prepared, chunk: list[int]) -> Arrays:
        from mvtn_cli.core.training.fixed_views import with_kept_views
        from mvtn_cli.core.training.predict import predict

        settings = self.run.config.model_copy(update={"seed": self.seed})
        shapes = with_kept_views(prepared, settings, self.console)
        found = predict(self._model, shapes, chunk, settings, batch_size=self.batch_size)
        self.computed += len(chunk)
        return {"descriptors": found.descriptors, "predicted": found.logits.argmax(axis=1).astype(np.int64)}

    @cached_property
    def _model(self) -> Recogniser:
        from mvtn_cli.core.render.warming import compile_renderer
        from mvtn_cli.core.training.predict import load_model

        compile_renderer(self.console)
        return load_model(self.run, self.checkpoint, self.device)

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
