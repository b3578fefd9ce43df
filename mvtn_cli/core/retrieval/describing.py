"""From shapes to descriptors, and to the files that keep them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.console import Console
from mvtn_cli.core.store import Store
from mvtn_cli.core.store.atomic import write_bytes
from mvtn_cli.core.store.shape_file import DamagedFile
from mvtn_cli.core.store.views_file import decode, encode

if TYPE_CHECKING:
    from mvtn_cli.core.networks.recogniser import Recogniser
    from mvtn_cli.core.preprocess import Part, Prepared
    from mvtn_cli.core.training.run import Run

Arrays = dict[str, NDArray[Any]]


def compute(
    model: Recogniser,
    run: Run,
    shapes: Prepared | Part,
    indices: Sequence[int],
    batch_size: int,
    seed: int,
    console: Console,
) -> Arrays:
    """Describe some shapes: `descriptors` (N, D) float32 and `predicted` (N,) int64.

    Args:
        model: Of the run.
        run: Gives the settings.
        shapes: Where they are.
        indices: N of their records.
        batch_size: Shapes a step.
        seed: Of random views.
        console: For what can't be kept.
    """
    from mvtn_cli.core.training.fixed_views import with_kept_views
    from mvtn_cli.core.training.predict import predict

    settings = run.config.model_copy(update={"seed": seed})
    drawn = with_kept_views(shapes, settings, console, model.device)
    found = predict(model, drawn, indices, settings, batch_size=batch_size)
    return {"descriptors": found.descriptors, "predicted": found.logits.argmax(axis=1).astype(np.int64)}


def read_descriptors(store: Store, address: str) -> Arrays | None:
    """Return what is kept under an address, or None where it is missing or damaged."""
    try:
        return decode(address, _path(store, address).read_bytes())
    except (OSError, DamagedFile):
        return None


def write_descriptors(store: Store, address: str, arrays: Arrays) -> None:
    """Store them atomically.

    Raises:
        MvtnError: The store can't be written.
    """
    write_bytes(_path(store, address), encode(address, arrays), durable=False)


def _path(store: Store, address: str) -> Path:
    return store.root / "descriptors" / address[:2] / f"{address}.npz"
