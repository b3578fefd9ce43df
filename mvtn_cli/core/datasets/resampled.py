"""`modelnet40_normal_resampled`: ModelNet as text, 10,000 lines of x,y,z,nx,ny,nz a shape, y up."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from mvtn_cli.core.datasets.dataset import Dataset, Item
from mvtn_cli.core.datasets.files import file_names
from mvtn_cli.core.datasets.layouts import where
from mvtn_cli.core.datasets.listed import absent_parts, missing_words, share_words
from mvtn_cli.core.datasets.official import MODELNET10
from mvtn_cli.core.shapes import Shape, cloud
from mvtn_cli.core.shapes.rows import Rows, floats
from mvtn_cli.core.shapes.source import read_text, shown
from mvtn_cli.errors import DataError

COLUMNS = 6
SPLITS = ("train", "test")


def is_resampled(root: Path) -> bool:
    """Tell whether `root` holds one of the release's lists."""
    return any((root / f"modelnet{number}_{split}.txt").is_file() for number in (40, 10) for split in SPLITS)


@dataclass(frozen=True)
class ReadResampled:
    """Reads one file as a point cloud; its normals are left, because they are found again from any surface."""

    path: str

    def __call__(self) -> Shape:
        path = Path(self.path)
        data = read_text(path, "point")
        lines = len(data.splitlines())
        tokens = data.replace(b",", b" ").split()
        try:
            if len(tokens) != COLUMNS * lines or data.count(b",") != (COLUMNS - 1) * lines:
                raise ValueError
            table = floats(tokens, len(tokens)).reshape(-1, COLUMNS)
        except ValueError:  # line by line, for the error; blank lines are no harm
            table = Rows.parse(path, data.replace(b",", b" ")).numbers("a line of x,y,z,nx,ny,nz", least=COLUMNS)
        return cloud(table[:, :3], name=shown(path.stem), source=shown(path))


@dataclass(frozen=True)
class ResampledContent:
    """A file's bytes."""

    path: str

    def __call__(self) -> bytes:
        return b"normal_resampled up=y\n" + Path(self.path).read_bytes()


def open_resampled(root: Path, number: int, *, spec: str) -> Dataset:
    """Open the ModelNet40 (`number` 40) or ModelNet10 (10) of the release below `root`.

    ModelNet10 without lists of its own is taken out of ModelNet40's.

    Raises:
        DataError: A list is missing, or names a shape of no class.
    """
    lists = number if _list(root, number, "train").is_file() else 40
    names = _class_names(root, lists)
    kept = [name for name in names if number == 40 or name in MODELNET10]
    label_of = {name: index for index, name in enumerate(kept)}
    there = {name: file_names(root / name) for name in kept}
    items: list[Item] = []
    absent: dict[str, list[str]] = {}
    for split in SPLITS:
        for class_name, shape in _shapes(_list(root, lists, split), names):
            if class_name not in label_of:
                continue
            if f"{shape}.txt" in there[class_name]:
                items.append(_item(root, class_name, shape, label_of[class_name], split))
            else:
                absent.setdefault(f"class {class_name}", []).append(f"{class_name}/{shape}")
    missing = absent_parts(absent, present={f"class {name}" for name in _classes_of(items, kept)})
    counts = Counter(item.split for item in items)
    counted = f"{len(items)} shapes in {len(kept)} classes ({share_words(counts)})"
    kind = f"ModelNet{number} points with normals (normal_resampled, text)"
    title = f"{kind}, y up: {counted}{missing_words(missing)}; {root}"
    return Dataset(spec, title, tuple(kept), tuple(items), release=f"modelnet{number}", missing=missing)


def _item(root: Path, class_name: str, shape: str, label: int, split: str) -> Item:
    path = os.path.join(root.absolute(), class_name, f"{shape}.txt")
    name = f"{class_name}/{shape}"
    return Item(name, label, split, path, ReadResampled(path), ResampledContent(path), Path(path))


def _classes_of(items: Sequence[Item], names: Sequence[str]) -> set[str]:
    return {names[item.label] for item in items}


def _list(root: Path, number: int, split: str) -> Path:
    return root / f"modelnet{number}_{split}.txt"


def _class_names(root: Path, number: int) -> list[str]:
    """Return the class names in the order of the labels; the file's name has changed over the years."""
    for name in (f"modelnet{number}_shape_names.txt", "shape_names.txt"):
        if (root / name).is_file():
            return (root / name).read_text(encoding="utf-8", errors="replace").split()
    raise DataError(
        f"{root} lacks modelnet{number}_shape_names.txt, which names the classes in the order of the labels",
        hint=f"unpack modelnet40_normal_resampled.zip again; {where('modelnet40')}",
        code="dataset.missing-part",
    )


def _shapes(path: Path, names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield class and shape of each line: a class name may hold underscores, the number follows the last."""
    known = frozenset(names)
    if not path.is_file():
        raise DataError(
            f"{path.parent} lacks {path.name}, which says what belongs to the split",
            hint=f"unpack modelnet40_normal_resampled.zip again; {where('modelnet40')}",
            code="dataset.missing-part",
        )
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        shape = line.strip()
        class_name = shape.rpartition("_")[0]
        if shape and class_name not in known:
            raise DataError(
                f"{path}, line {number}: '{shape[:60]}' belongs to no class of shape_names.txt",
                hint="a line looks like: night_stand_0001",
                code="dataset.bad-list",
            )
        if shape:
            yield class_name, shape
