"""The HDF5 point release of ModelNet40: `ply_data_{train,test}N.h5`, y up, labels as in `shape_names.txt`."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.datasets.dataset import Dataset, Item
from mvtn_cli.core.shapes import Shape, cloud
from mvtn_cli.errors import DataError

SPLITS = ("train", "test")


def is_point_release(root: Path) -> bool:
    """Tell whether `root` holds files named as in the release."""
    return root.is_dir() and any(root.glob("ply_data_*.h5"))


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


def _points(path: str, row: int) -> NDArray[Any]:
    status = os.stat(path)
    return _rows(path, status.st_size, status.st_mtime_ns)[row]


@lru_cache(maxsize=2)
def _rows(path: str, size: int, mtime_ns: int) -> NDArray[Any]:
    """Return `data` (N, P, 3) of a whole file: rows are asked for one after the other."""
    import h5py

    with h5py.File(path, "r") as file:
        return np.ascontiguousarray(file["data"][:, :, :3])


def open_point_release(
    root: Path, default_names: Sequence[str], *, keep: Sequence[str] | None = None, spec: str = ""
) -> Dataset:
    """Open the release below `root`.

    Args:
        root: Folder of the HDF5 files.
        default_names: Class names in the order of the labels where `shape_names.txt` is missing.
        keep: Leave out every class whose name is not among these.
        spec: The word that opens it again.

    Raises:
        DataError: A file or key is missing, a label is out of range, or a split is empty.
    """
    names = _class_names(root, default_names)
    kept = [name for name in names if keep is None or name in keep]
    items: list[Item] = []
    for split in SPLITS:
        for path in _listed(root, split):
            items += _file_items(path, split, names, kept)
    counts = Counter(item.split for item in items)
    shares = ", ".join(f"{counts[split]} {split}" for split in SPLITS)
    counted = f"{len(items)} shapes in {len(kept)} classes ({shares})"
    title = f"ModelNet40 point release (HDF5), y up: {counted}; {root}"
    return Dataset(spec or f"modelnet40:{root.absolute()}", title, tuple(kept), tuple(items))


def _class_names(root: Path, default: Sequence[str]) -> list[str]:
    path = root / "shape_names.txt"
    if not path.is_file():
        return list(default)
    return path.read_text(encoding="utf-8", errors="replace").split()


def _listed(root: Path, split: str) -> list[Path]:
    """Return the split's files: as `train_files.txt` lists them, without folders, else all there are."""
    listing = root / f"{split}_files.txt"
    if listing.is_file():
        lines = listing.read_text(encoding="utf-8", errors="replace").split()
        paths = [root / re.split(r"[/\\]", line)[-1] for line in lines]
    else:
        paths = sorted(root.glob(f"ply_data_{split}*.h5"), key=lambda path: (len(path.name), path.name))
    missing = [path.name for path in paths if not path.is_file()]
    if missing or not paths:
        what = f"{missing[0]}, which {listing.name} lists" if missing else f"ply_data_{split}*.h5"
        raise DataError(
            f"no shapes for split '{split}' in {root}: {what}, is not there",
            hint="unpack modelnet40_ply_hdf5_2048.zip again",
            code="dataset.empty-split",
        )
    return paths


def _file_items(path: Path, split: str, names: Sequence[str], kept: Sequence[str]) -> list[Item]:
    stem = path.stem.removeprefix("ply_data_")
    label_of = {name: index for index, name in enumerate(kept)}
    path = path.absolute()
    file, items = str(path), []
    for row, label in enumerate(_labels(path, len(names))):
        name = names[label]
        if name not in label_of:
            continue
        key = f"{name}/{stem}_{row:04d}"
        read, content = ReadRow(file, row, key), RowContent(file, row)
        items.append(Item(key, label_of[name], split, f"{file}[{row}]", read, content, path))
    return items


def _labels(path: Path, classes: int) -> list[int]:
    import h5py

    try:
        with h5py.File(path, "r") as file:
            shape, labels = file["data"].shape, np.asarray(file["label"]).reshape(-1).astype(np.int64)
    except (OSError, KeyError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise _bad_file(path, reason) from error
    if len(shape) != 3 or shape[2] < 3 or shape[0] != len(labels):
        raise _bad_file(path, f"data has shape {shape} and label has {len(labels)} entries")
    if len(labels) and (labels.min() < 0 or labels.max() >= classes):
        raise _bad_file(path, f"label {labels.max()} is out of range for {classes} class names")
    return [int(label) for label in labels]


def _bad_file(path: Path, reason: str) -> DataError:
    return DataError(
        f"{path} is not a file of the ModelNet40 point release: {reason}",
        hint="expected `data` (N, P, 3) and `label` (N, 1), labels counting the lines of shape_names.txt",
        code="dataset.bad-hdf5",
    )
