"""Class folders: `CLASS/SPLIT/file`, `SPLIT/CLASS/file` or `CLASS/file`, in any readable format."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path

from mvtn_cli.core.datasets.dataset import Dataset
from mvtn_cli.core.datasets.files import (
    Parts,
    can_read,
    file_item,
    readable,
    suffix_census,
    unique_names,
    unlabelled,
    walk,
)
from mvtn_cli.core.shapes import SUFFIXES
from mvtn_cli.errors import DataError

SPLIT_FOLDERS = {"train": "train", "training": "train", "test": "test", "testing": "test"} | {
    "val": "val",
    "valid": "val",
    "validation": "val",
}
TEST_SHARE = 0.2


@dataclass(frozen=True)
class Layout:
    """Which part of a path is the class and which the split; the files are those that have both.

    Attributes:
        pattern: For people, e.g. `CLASS/SPLIT/file`.
        files: Paths below the root, as parts.
        class_part: Index of the class folder in the parts.
        split_part: Index of the split folder, None where there is none.
        outside: Readable files that don't fit.
    """

    pattern: str
    files: tuple[Parts, ...]
    class_part: int
    split_part: int | None
    outside: int

    def classes(self) -> tuple[str, ...]:
        """Return the class names, sorted."""
        return tuple(sorted({parts[self.class_part] for parts in self.files}))

    def splits(self) -> list[str]:
        """Return the split of each file: by its folder, else by the hash of its name."""
        if self.split_part is None:
            return hashed_split(self.files)
        return [SPLIT_FOLDERS[parts[self.split_part].lower()] for parts in self.files]


def recognise(files: Sequence[Parts]) -> Layout | None:
    """Return the layout of readable files, or None if most lie outside any class folder."""
    for depth in (0, 1):  # 1: the whole set lies in one more folder, as archives often unpack
        for pattern, class_part, split_part in (("CLASS/SPLIT/file", 0, 1), ("SPLIT/CLASS/file", 1, 0)):
            layout = _with_splits(files, pattern, depth + class_part, depth + split_part)
            if layout is not None:
                return layout
        if len({parts[0] for parts in files}) > 1:
            break
    nested = tuple(parts for parts in files if len(parts) > 1)
    outside = len(files) - len(nested)
    return Layout("CLASS/file", nested, 0, None, outside) if len(nested) > outside else None


def _with_splits(files: Sequence[Parts], pattern: str, class_part: int, split_part: int) -> Layout | None:
    deep = max(class_part, split_part) + 1
    fitting = tuple(p for p in files if len(p) > deep and p[split_part].lower() in SPLIT_FOLDERS)
    if 2 * len(fitting) <= len(files):
        return None
    return Layout(pattern, fitting, class_part, split_part, len(files) - len(fitting))


def hashed_split(files: Iterable[Parts]) -> list[str]:
    """Give each class's files whose names hash lowest, a fifth of them, to `test`; the rest are `train`.

    Depends on the names alone, so that it is the same on every machine; a class of one file stays in `train`.
    """
    listed = list(files)
    by_class: dict[str, list[Parts]] = {}
    for parts in listed:
        by_class.setdefault(parts[0], []).append(parts)
    test: set[Parts] = set()
    for members in by_class.values():
        count = max(1, round(TEST_SHARE * len(members))) if len(members) > 1 else 0
        test.update(sorted(members, key=_name_hash)[:count])
    return ["test" if parts in test else "train" for parts in listed]


def _name_hash(parts: Parts) -> bytes:
    return blake2b("/".join(parts).encode("utf-8", "surrogateescape"), digest_size=8).digest()


def open_folder(root: Path, *, up: str = "y", spec: str | None = None) -> Dataset:
    """Open a folder of shapes; one without class folders gives a data set without labels.

    Args:
        root: The folder.
        up: The axis that points up in all its files, `y` or `z`.
        spec: The word that opens it again, if it isn't `folder:ROOT`.

    Raises:
        DataError: Nothing readable is in it, or a split is empty.
    """
    spec = spec or f"folder:{root.absolute()}" + ("?up=z" if up == "z" else "")
    return open_listed(root, walk(root), up=up, spec=spec)


def open_listed(root: Path, files: Sequence[Parts], *, up: str, spec: str) -> Dataset:
    """Like `open_folder`, for a folder that was listed already."""
    chosen = readable(files)
    if not chosen:
        raise no_shapes(root, files, SUFFIXES)
    layout = recognise(chosen)
    if layout is None:
        return unlabelled([root.joinpath(*parts) for parts in chosen], up=up, spec=spec, where=str(root))
    return labelled(root, layout, up=up, spec=spec)


def labelled(
    root: Path, layout: Layout, *, up: str, spec: str, kind: str = "", remark: str = "", hint: str = ""
) -> Dataset:
    """Make the data set of a recognised layout.

    Args:
        root: The folder.
        layout: How its files lie.
        up: The axis that points up in them.
        spec: The word that opens it again.
        kind: What it is, for the title; by default the layout's pattern.
        remark: What else the title should say.
        hint: What to do if a split is empty; by default about shapes of one's own.

    Raises:
        DataError: `train` or `test` is empty.
    """
    classes, splits = layout.classes(), layout.splits()
    _both_splits(root, layout, Counter(splits), hint)
    label = {name: index for index, name in enumerate(classes)}
    names = unique_names(layout.files, drop=layout.split_part)
    base = str(root.absolute())
    items = tuple(
        file_item("/".join((base, *parts)), name=name, label=label[parts[layout.class_part]], split=split, up=up)
        for parts, name, split in zip(layout.files, names, splits, strict=True)
    )
    return Dataset(spec, _title(root, layout, Counter(splits), len(classes), up, kind, remark), classes, items)


def _title(root: Path, layout: Layout, counts: Counter[str], classes: int, up: str, kind: str, remark: str) -> str:
    shares = ", ".join(f"{counts[split]} {split}" for split in ("train", "val", "test") if counts[split])
    parts = [f"{kind or layout.pattern}, {up} up: {len(layout.files)} shapes in {classes} classes ({shares})"]
    if layout.split_part is None:
        parts.append("no split folders, so a fifth of each class was set aside as test by the hash of its names")
    if layout.outside:
        parts.append(f"{layout.outside} files outside that layout passed over")
    return "; ".join([*parts, *([remark] if remark else [])]) + f"; {root}"


def _both_splits(root: Path, layout: Layout, counts: Counter[str], hint: str) -> None:
    for split in ("train", "test"):
        if counts[split] or (layout.split_part is None and counts["train"]):
            continue
        looked = layout.pattern.replace("SPLIT", split).replace("CLASS", "<class>").replace("file", "*")
        there = ", ".join(f"{count} in '{name}'" for name, count in counts.items())
        raise DataError(
            f"no shapes for split '{split}' in {root}: looked for {root}/{looked}, 0 files matched ({there})",
            hint=hint or f"put some shapes into '{split}', or use no split folders: CLASS/file is split by itself",
            code="dataset.empty-split",
        )


def no_shapes(root: Path, files: Sequence[Parts], suffixes: Iterable[str]) -> DataError:
    """Build the error for a folder in which nothing can be read."""
    looked = " ".join(f"*{suffix}" for suffix in sorted(suffixes))
    return DataError(
        f"no readable shape in {root}: looked for {looked} in it and below, 0 of {len(files)} files matched",
        hint=f"{suffix_census(files)}; {can_read()}",
        code="dataset.no-shapes",
    )
