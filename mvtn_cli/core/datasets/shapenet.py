"""ShapeNet Core55: the SHREC'17 tree of OBJ files, or ShapeNetCore.v2, both split by SHREC'17's list. Y up."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

from mvtn_cli.core.datasets.dataset import SPLITS, Dataset, Item
from mvtn_cli.core.datasets.files import entries, file_item
from mvtn_cli.core.datasets.layouts import where
from mvtn_cli.core.datasets.listed import absent_parts, missing_words, share_words
from mvtn_cli.core.datasets.official import OFFICIAL
from mvtn_cli.core.datasets.shapenet_list import Row, find_lists, is_shapenet_list, read_lists
from mvtn_cli.errors import DataError, choose_error

# fmt: off
SYNSETS = (
    "02691156", "02747177", "02773838", "02801938", "02808440", "02818832", "02828884", "02843684", "02871439",
    "02876657", "02880940", "02924116", "02933112", "02942699", "02946921", "02954340", "02958343", "02992529",
    "03001627", "03046257", "03085013", "03207941", "03211117", "03261776", "03325088", "03337140", "03467517",
    "03513137", "03593526", "03624134", "03636649", "03642806", "03691459", "03710193", "03759954", "03761084",
    "03790512", "03797390", "03928116", "03938244", "03948459", "03991062", "04004475", "04074963", "04090263",
    "04099429", "04225987", "04256520", "04330267", "04379243", "04401088", "04460130", "04468005", "04530566",
    "04554684",
)
# fmt: on
CLASSES = tuple(OFFICIAL["shapenet55"].classes)  # in the order of the synsets
VARIANTS = ("normal", "perturbed")
V2_FOLDER = "ShapeNetCore.v2"
V2_FILE = "models/model_normalized.obj"
_NAME = dict(zip(SYNSETS, CLASSES, strict=True))
_LABEL = {synset: label for label, synset in enumerate(SYNSETS)}

Find: TypeAlias = Callable[[Row], str | None]  # the file of a row of the list, None if it is not there


def is_shapenet(root: Path) -> bool:
    """Tell whether `root` holds synset folders, or SHREC'17's split folders beside its list."""
    folders = _folders(root)
    if any(f"{split}_{variant}" in folders for split in SPLITS for variant in VARIANTS):
        return True
    if folders & {*SYNSETS, V2_FOLDER}:
        return True
    return bool(folders & set(SPLITS)) and any(is_shapenet_list(path) for path in find_lists(root))


def open_shapenet(root: Path, variant: str | None = None) -> Dataset:
    """Open ShapeNet Core55 below `root`; the classes are the 55 synsets, whichever are there.

    Each model is looked up once: the SHREC'17 folders are listed, in ShapeNetCore.v2 each listed file is asked for.

    Args:
        root: Folder of the split folders, or of the synset folders.
        variant: `normal` (the default) or `perturbed`; SHREC'17 alone has both.

    Raises:
        UsageError: An unknown variant, or one that the tree does not have.
        DataError: The list or every model is missing, or the list is damaged.
    """
    if variant not in (None, *VARIANTS):
        raise choose_error("variant of shapenet55", variant or "", VARIANTS)
    folders = _folders(root)
    shrec = bool(folders & {*SPLITS, *(f"{split}_{kind}" for split in SPLITS for kind in VARIANTS)})
    base = root if shrec or folders & set(SYNSETS) or V2_FOLDER not in folders else root / V2_FOLDER
    lists = find_lists(base) or find_lists(root)
    if not lists:
        raise _no_list(root)
    rows = read_lists(lists, SYNSETS)
    if shrec:
        return _shrec17(root, rows, variant or "normal", variant)
    if not _folders(base) & set(SYNSETS):
        raise DataError(
            f"{root} holds neither synset folders (02691156, …) nor train_normal, val_normal and test_normal",
            hint=where("shapenet55"),
            code="dataset.no-shapes",
        )
    if variant == "perturbed":
        raise choose_error("variant of ShapeNetCore.v2", variant, ["normal"])
    return _core_v2(root, base, rows, variant)


def _core_v2(root: Path, base: Path, rows: Sequence[Row], variant: str | None) -> Dataset:
    text = str(base.absolute())

    def find(row: Row) -> str | None:
        path = f"{text}/{row.synset}/{row.model}/{V2_FILE}"
        return path if os.path.isfile(path) else None

    title = "ShapeNet Core55 (ShapeNetCore.v2, split by SHREC'17's list)"
    return _dataset(root, rows, find, lambda row: _synset_words(row.synset), title, "shapenet55-v2", variant)


def _shrec17(root: Path, rows: Sequence[Row], kind: str, variant: str | None) -> Dataset:
    folders = {split: _split_folder(root, split, kind) for split in SPLITS}
    files = {split: _by_id(folder) for split, folder in folders.items()}

    def find(row: Row) -> str | None:
        return files[row.split].get(row.id)

    title = f"ShapeNet Core55 (SHREC'17, {kind})"
    return _dataset(root, rows, find, lambda row: f"folder {folders[row.split].name}", title, "shapenet55", variant)


def _split_folder(root: Path, split: str, kind: str) -> Path:
    """Return `train_normal`, or `train` where nobody told the two kinds apart."""
    plain, named = root / split, root / f"{split}_{kind}"
    return plain if kind == "normal" and plain.is_dir() and not named.is_dir() else named


def _by_id(folder: Path) -> dict[str, str]:
    """Return the OBJ files of a split folder by their six digits, from `000003.obj` or `model_000003.obj`."""
    paths = [entry.path for entry in entries(folder.absolute()) if entry.name.lower().endswith(".obj")]
    return {os.path.basename(path)[:-4].removeprefix("model_"): path for path in paths}


def _dataset(
    root: Path,
    rows: Iterable[Row],
    find: Find,
    part: Callable[[Row], str],
    title: str,
    release: str,
    variant: str | None,
) -> Dataset:
    items: list[Item] = []
    absent: dict[str, list[str]] = {}
    present: set[str] = set()
    for row in rows:
        path, name = find(row), f"{_NAME[row.synset]}/{row.id}"
        if path is None:
            absent.setdefault(part(row), []).append(name)
            continue
        present.add(part(row))
        item = file_item(path, name=name, label=_LABEL[row.synset], split=row.split, up="y")
        items.append(replace(item, subclass=row.subsynset))
    missing = absent_parts(absent, present)
    counted = f"{len(items)} shapes in {len(CLASSES)} classes ({share_words(Counter(item.split for item in items))})"
    spec = f"shapenet55:{root.absolute()}" + (f"@{variant}" if variant else "")
    whole = f"{title}, y up: {counted}{missing_words(missing)}; {root}"
    return Dataset(spec, whole, CLASSES, tuple(items), release=release, missing=missing)


def _synset_words(synset: str) -> str:
    return f"synset {synset} ({_NAME[synset]})"


def _folders(root: Path) -> set[str]:
    return {entry.name for entry in entries(root) if entry.is_dir()}


def _no_list(root: Path) -> DataError:
    return DataError(
        f"{root} lacks SHREC'17's list all.csv (id,synsetId,subSynsetId,modelId,split), which splits the shapes",
        hint=f"put it into {root}, or use a split by chance with folder:{root}; {where('shapenet55')}",
        code="dataset.missing-part",
    )
