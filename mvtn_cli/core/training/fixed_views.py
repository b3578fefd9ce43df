"""Fixed views of meshes: seen in the first epoch, painted from what was kept in all others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch

from mvtn_cli.config import TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.render import ShapeBatch
from mvtn_cli.core.render.devices import drawing_device, is_gpu
from mvtn_cli.core.render.skips import FIXED_VIEWS, active_skips
from mvtn_cli.core.render.view_keeper import ViewKeeper, kept_batch
from mvtn_cli.core.store import StoredShape
from mvtn_cli.core.training import shapes as plain
from mvtn_cli.core.training.shapes import Shapes


@dataclass(frozen=True)
class KeptShapes:
    """A data set whose shapes are always drawn from the same cameras.

    Attributes:
        shapes: The data set; its records have addresses.
        keeper: Who keeps the views.
    """

    shapes: Shapes
    keeper: ViewKeeper

    @property
    def records(self) -> Sequence[Any]:
        """As the data set's."""
        return self.shapes.records

    def load(self, index: int) -> StoredShape:
        """As the data set's."""
        return self.shapes.load(index)


def with_kept_views(shapes: Shapes, config: TrainConfig, console: Console, device: torch.device) -> Shapes:
    """Keep the views of a training or its evaluation, where they are fixed and of meshes; else change nothing.

    A GPU that draws sees the faces anew faster than it is sent what was kept.

    Args:
        shapes: The data set; one that is in no artifact store has no addresses to keep views under.
        config: Of the training.
        console: Where it is said that something can't be kept.
        device: Where the networks are.
    """
    store = getattr(shapes, "store", None)
    if (
        is_gpu(drawing_device(device))
        or config.views != "fixed"
        or config.render == "points"
        or store is None
        or not active_skips() & FIXED_VIEWS
    ):
        return shapes
    return KeptShapes(shapes, ViewKeeper(store, console))


def load_batch(shapes: Shapes, indices: Sequence[int], render: str) -> tuple[ShapeBatch, str]:
    """Like `shapes.load_batch`; meshes come as a `KeptBatch` where their views are kept."""
    if not isinstance(shapes, KeptShapes):
        return plain.load_batch(shapes, indices, render)
    loaded = [shapes.load(i) for i in indices]
    if render == "points" or not all(shape.has_mesh for shape in loaded):
        return plain.load_batch(shapes, indices, render)
    records = [shapes.records[i] for i in indices]
    labels, names = [record.label for record in records], [record.name for record in records]
    return kept_batch(loaded, [record.address for record in records], shapes.keeper, labels, names), "mesh"
