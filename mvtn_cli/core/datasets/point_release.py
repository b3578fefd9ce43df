"""The HDF5 point release of ModelNet40: `ply_data_{train,test}N.h5`, y up, labels as in `shape_names.txt`."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from mvtn_cli.core.datasets.dataset import Dataset, Item
from mvtn_cli.core.datasets.hdf5 import read_table, row_items
from mvtn_cli.core.datasets.layouts import where
from mvtn_cli.core.datasets.official import MODELNET10
from mvtn_cli.errors import DataError

SPLITS = ("train", "test")


def is_point_release(root: Path) -> bool:
    """Tell whether `root` holds files named as in the release."""
    return root.is_dir() and any(root.glob("ply_data_*.h5"))


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
        DataError: A file or key is missing, or is not what it should be.
    """
    names = _class_names(root, default_names)
    kept = [name for name in names if keep is None or name in keep]
    items: list[Item] = []
    points: Counter[int] = Counter()
    for split in SPLITS:
        for path in _listed(root, split):
            table = read_table(path, "the ModelNet40 point release")
            points[table.points] += len(table.labels)
            items += row_items(path, table, split, names, path.stem.removeprefix("ply_data_"), kept)
    counts = Counter(item.split for item in items)
    shares = ", ".join(f"{counts[split]} {split}" for split in SPLITS)
    counted = f"{len(items)} shapes of {_either(points)} points in {len(kept)} classes ({shares})"
    title = f"ModelNet40 point release (HDF5), y up: {counted}; {root}"
    release = "modelnet10-hdf5" if keep is not None and set(keep) == set(MODELNET10) else "modelnet40-hdf5"
    return Dataset(spec or f"modelnet40:{root.absolute()}", title, tuple(kept), tuple(items), release=release)


def _either(points: Counter[int]) -> str:
    return " or ".join(f"{count:,}" for count in sorted(points))


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
            hint=f"unpack modelnet40_ply_hdf5_2048.zip again; {where('modelnet40')}",
            code="dataset.empty-split",
        )
    return paths
