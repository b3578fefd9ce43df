"""Rows of HDF5 files: `data` (N, P, 3 or more) with `label` (N,) or (N, 1), one row a shape."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.datasets.dataset import Item
from mvtn_cli.core.shapes import Shape, cloud
from mvtn_cli.errors import DataError

BLOCK_BYTES = 8 << 20  # rows are asked for one after the other, so that a block is read once and then used up


@dataclass(frozen=True)
class ReadRow:
    """Reads one row of `data` as a point cloud."""

    path: str
    row: int
    name: str

    def __call__(self) -> Shape:
        points = _points(self.path, self.row).astype(np.float64)
        return cloud(points, name=self.name, source=f"{self.path}[{self.row}]")


@dataclass(frozen=True)
class RowContent:
    """The bytes of one row of `data`."""

    path: str
    row: int

    def __call__(self) -> bytes:
        points = _points(self.path, self.row)
        return f"points {points.dtype.str} {points.shape} up=y\n".encode() + points.tobytes()


@dataclass(frozen=True)
class Table:
    """What a file holds, without its points.

    Attributes:
        labels: The label of each row, whatever its range.
        points: How many points each row has.
    """

    labels: list[int]
    points: int


def read_table(path: Path, kind: str) -> Table:
    """Read a file's labels and check the shape of its points, which stay where they are.

    Args:
        path: The file.
        kind: What the file should be, for the error: `the ModelNet40 point release`.

    Raises:
        DataError: Not HDF5, a key is missing, or `data`, `label` and `mask` don't fit together.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            shape, labels = file["data"].shape, np.asarray(file["label"]).reshape(-1)
            mask = file["mask"].shape if "mask" in file else None
    except (OSError, KeyError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise _bad_file(path, kind, reason) from error
    if len(shape) != 3 or shape[2] < 3 or shape[0] != len(labels):
        raise _bad_file(path, kind, f"data has shape {shape} and label has {len(labels)} entries")
    if mask is not None and mask[:2] != shape[:2]:
        raise _bad_file(path, kind, f"data has shape {shape} and mask {mask}")
    if labels.dtype.kind not in "iu" and not (labels == np.rint(labels)).all():
        raise _bad_file(path, kind, "label holds fractions")
    return Table([int(label) for label in labels], shape[1])


def row_items(
    path: Path, table: Table, split: str, names: Sequence[str], stem: str, kept: Sequence[str] | None = None
) -> list[Item]:
    """Return an item for each row, called `CLASS/STEM_ROW`.

    Args:
        path: The file.
        table: Its labels.
        split: Of all its rows.
        names: Class names in the order of the file's labels.
        stem: What tells rows of several files apart.
        kept: Leave out rows of all other classes; labels count these. By default all.

    A label that no name belongs to is kept as it is, for whoever judges the data set.
    """
    label_of = {name: index for index, name in enumerate(names if kept is None else kept)}
    path = path.absolute()
    file, items = str(path), []
    for row, label in enumerate(table.labels):
        known = 0 <= label < len(names)
        name = names[label] if known else f"label {label}"
        if known and name not in label_of:
            continue
        key = f"{name}/{stem}_{row:04d}"
        read, content = ReadRow(file, row, key), RowContent(file, row)
        items.append(Item(key, label_of.get(name, label), split, f"{file}[{row}]", read, content, path))
    return items


def _points(path: str, row: int) -> NDArray[Any]:
    status = os.stat(path)
    rows = _rows_per_block(path, status.st_size, status.st_mtime_ns)
    return _block(path, status.st_size, status.st_mtime_ns, row // rows, rows)[row % rows]


@lru_cache(maxsize=64)
def _rows_per_block(path: str, size: int, mtime_ns: int) -> int:
    import h5py

    with h5py.File(path, "r") as file:
        data = file["data"]
        return max(BLOCK_BYTES // max(data.dtype.itemsize * data.shape[1] * data.shape[2], 1), 1)


@lru_cache(maxsize=4)
def _block(path: str, size: int, mtime_ns: int, block: int, rows: int) -> NDArray[Any]:
    import h5py

    with h5py.File(path, "r") as file:
        return np.ascontiguousarray(file["data"][block * rows : (block + 1) * rows, :, :3])


def _bad_file(path: Path, kind: str, reason: str) -> DataError:
    return DataError(
        f"{path} is not a file of {kind}: {reason}",
        hint="expected `data` (N, P, 3) and `label` (N, 1), labels counting the class names from 0",
        code="dataset.bad-hdf5",
    )
