"""ScanObjectNN's scans: CLASS/SCENE_OBJECT.bin with all points of each object, split by `main_split.txt`. Y up."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mvtn_cli.core.datasets.dataset import Dataset, Item
from mvtn_cli.core.datasets.files import file_names
from mvtn_cli.core.datasets.layouts import where
from mvtn_cli.core.datasets.listed import absent_parts, missing_words, share_words
from mvtn_cli.core.datasets.official import OFFICIAL
from mvtn_cli.core.shapes import Shape, cloud
from mvtn_cli.core.shapes.source import read_bytes, shown, unreadable
from mvtn_cli.errors import DataError

CLASSES = tuple(OFFICIAL["scanobjectnn-raw"].classes)  # in the order of the labels
LISTS = ("main_split.txt", "split_new.txt")  # the official one, and its copy in the archive of the paper's code
COLUMNS = 11  # x y z, normal, colour, instance, semantic label
NOT_OBJECTS = (0, 1, 2)  # semantic labels: nothing, wall, floor


class Place(NamedTuple):
    """Where the scans are: the folder of the class folders, and their list (None if it is missing)."""

    folder: Path
    listing: Path | None


@dataclass(frozen=True)
class ReadScan:
    """Reads one scan as a point cloud, with its background or without."""

    path: str
    background: bool

    def __call__(self) -> Shape:
        path = Path(self.path)
        table = _table(path)
        if not self.background:
            table = table[_of_object(path, table[:, -1])]
        return cloud(table[:, :3].astype(np.float64), name=shown(path.stem), source=shown(path))


@dataclass(frozen=True)
class ScanContent:
    """A scan's bytes, with what is taken of them."""

    path: str
    background: bool

    def __call__(self) -> bytes:
        return f"scan background={self.background} up=y\n".encode() + Path(self.path).read_bytes()


def find_scans(root: Path) -> Place | None:
    """Return where the scans below `root` are, or None if it holds no class folder with a .bin file."""
    for folder in (root, root / "object_dataset"):
        if any(_has_scan(folder / name) for name in CLASSES):
            parents = (folder, folder.absolute().parent, root / "training_data")
            lists = (parent / name for parent in parents for name in LISTS)
            return Place(folder, next((path for path in lists if path.is_file()), None))
    return None


def open_scans(place: Place, *, background: bool, variant: str, spec: str) -> Dataset:
    """Open the listed scans, each with all points that its file has.

    Args:
        place: Where they are.
        background: Keep the points around the object.
        variant: The word for that, in the title.
        spec: The word that opens it again.

    Raises:
        DataError: The list is missing or damaged.
    """
    folder, listing = place
    if listing is None:
        raise DataError(
            f"{folder} lacks {LISTS[0]}, which labels and splits the scans",
            hint=f"put it into {folder}; {where('scanobjectnn')}",
            code="dataset.missing-part",
        )
    there = {name: file_names(folder / name) for name in CLASSES}
    items: list[Item] = []
    absent: dict[str, list[str]] = {}
    for file, label, split in _rows(listing):
        name = f"{CLASSES[label]}/{os.path.splitext(file)[0]}"
        if file in there[CLASSES[label]]:
            items.append(_item(folder, file, name, label, split, background))
        else:
            absent.setdefault(f"class {CLASSES[label]}", []).append(name)
    missing = absent_parts(absent, present={f"class {CLASSES[item.label]}" for item in items})
    counts = Counter(item.split for item in items)
    kind = f"ScanObjectNN {variant} (scans, {listing.name})"
    counted = f"{len(items)} shapes in {len(CLASSES)} classes ({share_words(counts)})"
    title = f"{kind}, y up: {counted}{missing_words(missing)}; {folder}"
    return Dataset(spec, title, CLASSES, tuple(items), release="scanobjectnn-raw", missing=missing)


def _item(folder: Path, file: str, name: str, label: int, split: str, background: bool) -> Item:
    path = os.path.join(folder.absolute(), CLASSES[label], file)
    return Item(name, label, split, path, ReadScan(path, background), ScanContent(path, background), Path(path))


def _has_scan(folder: Path) -> bool:
    return any(name.endswith(".bin") for name in file_names(folder))


def _rows(listing: Path) -> Iterator[tuple[str, int, str]]:
    """Yield file, label and split of each line: `005_00020.bin<TAB>0<TAB>t`, where t marks a test object."""
    for number, line in enumerate(listing.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        cells = line.split()
        if not cells:
            continue
        label = cells[1] if len(cells) > 1 else ""
        if not label.isdecimal() or int(label) >= len(CLASSES) or cells[2:] not in ([], ["t"]):
            raise DataError(
                f"{listing}, line {number}: '{line[:60]}' is not a file, a label below {len(CLASSES)}, and t for test",
                hint=where("scanobjectnn"),
                code="dataset.bad-list",
            )
        yield cells[0], int(label), "test" if len(cells) > 2 else "train"


def _table(path: Path) -> np.ndarray:
    """Return the (P, 11) float32 rows of a scan; its first number says how many there are."""
    data = read_bytes(path)
    values = np.frombuffer(data[: len(data) // 4 * 4], dtype="<f4")
    count = float(values[0]) if len(values) else 0.0
    if len(data) % 4 or len(values) != 1 + COLUMNS * count:
        raise unreadable(
            path,
            f"has {len(data)} bytes and says that it holds {count:g} points",
            expected=f"4 bytes for the number of points, and {4 * COLUMNS} for each",
        )
    return values[1:].reshape(-1, COLUMNS)


def _of_object(path: Path, semantic: np.ndarray) -> np.ndarray:
    """Return which points have the commonest semantic label that is not a wall, the floor or nothing."""
    labels, counts = np.unique(semantic[~np.isin(semantic, NOT_OBJECTS)], return_counts=True)
    if not len(labels):
        raise unreadable(path, "has no point of the object, all are background")
    return np.asarray(semantic == labels[counts.argmax()])
