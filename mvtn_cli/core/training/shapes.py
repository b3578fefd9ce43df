"""From indices of a prepared data set to packed batches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Protocol

from mvtn_cli.core.render import ShapeBatch, pack
from mvtn_cli.core.store import StoredShape
from mvtn_cli.errors import DataError


class Shapes(Protocol):
    """What is needed of a data set to train on it or to judge it: a Prepared."""

    @property
    def records(self) -> Sequence[Any]:
        """One a shape: name, label, known azimuth."""

    def load(self, index: int) -> StoredShape:
        """Read one shape."""


def load_batch(shapes: Shapes, indices: Sequence[int], render: str) -> tuple[ShapeBatch, str]:
    """Pack some shapes, and say whether they are drawn as `mesh` or as `points`.

    Args:
        shapes: The data set.
        indices: Which of its records.
        render: As `--render`: auto, mesh or points.

    Raises:
        DataError: They can't all be drawn the same way.
    """
    loaded = [shapes.load(i) for i in indices]
    records = [shapes.records[i] for i in indices]
    bare = [record.name for record, shape in zip(records, loaded, strict=True) if not shape.has_mesh]
    batch = pack(loaded, labels=[record.label for record in records], names=[record.name for record in records])
    if render == "points" or (render == "auto" and len(bare) == len(loaded)):
        return batch, "points"
    if bare:
        raise DataError(
            f"{bare[0]} has no mesh to draw, only points",
            hint="draw all shapes as points: --render points",
            code="dataset.no-mesh",
        )
    return batch, "mesh"


def drawn_kind(shapes: Shapes, index: int, render: str) -> str:
    """How a shape is drawn: "mesh" or "points"."""
    return "points" if render == "points" or not shapes.load(index).has_mesh else "mesh"


def alike_batches(shapes: Shapes, indices: Sequence[int], batch_size: int, render: str) -> Iterator[list[int]]:
    """Cut indices into batches, in order; with `auto`, meshes and point clouds do not share one."""
    chunk: list[int] = []
    has_mesh = True
    for index in indices:
        mine = shapes.load(index).has_mesh if render == "auto" else True
        if chunk and (len(chunk) == batch_size or mine != has_mesh):
            yield chunk
            chunk = []
        chunk.append(index)
        has_mesh = mine
    if chunk:
        yield chunk
