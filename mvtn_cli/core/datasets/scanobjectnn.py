"""ScanObjectNN in all its variants: the HDF5 files of points, or the scans themselves (`scans.py`). Y up."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mvtn_cli.core.datasets.dataset import Dataset, Item
from mvtn_cli.core.datasets.hdf5 import read_table, row_items
from mvtn_cli.core.datasets.layouts import where
from mvtn_cli.core.datasets.listed import share_words
from mvtn_cli.core.datasets.official import OFFICIAL
from mvtn_cli.core.datasets.scans import CLASSES, find_scans, open_scans
from mvtn_cli.errors import DataError, choose_error


@dataclass(frozen=True)
class Variant:
    """One of ScanObjectNN's files: its suffix after `objectdataset`, and whether the background was cut away."""

    suffix: str
    background: bool
    name: str  # as papers write it


VARIANTS = {
    "obj_only": Variant("", False, "OBJ_ONLY"),
    "with_bg": Variant("", True, "OBJ_BG"),
    "hardest": Variant("_augmentedrot_scale75", True, "PB_T50_RS"),
    "pb_t25": Variant("_augmented25_norot", True, "PB_T25"),
    "pb_t25_r": Variant("_augmented25rot", True, "PB_T25_R"),
    "pb_t50_r": Variant("_augmentedrot", True, "PB_T50_R"),
    "hardest_nobg": Variant("_augmentedrot_scale75", False, "PB_T50_RS without background"),
}
ALIASES = {"obj_bg": "with_bg", "pb_t50_rs": "hardest"}
DEFAULT = "obj_only"  # as in the released code of the paper
SPLITS = {"train": "training", "test": "test"}  # the file's first word; released loaders that look for `train_` fail
NO_BACKGROUND = "_nobg"


def is_scanobjectnn(root: Path) -> bool:
    """Tell whether `root` holds the release's HDF5 files, or scans with their list."""
    return next(_split_folders(root), None) is not None or find_scans(root) is not None


def open_scanobjectnn(root: Path, variant: str | None = None) -> Dataset:
    """Open one variant below `root`.

    Args:
        root: The folder of `main_split` and `main_split_nobg`, or one of those or of `split1` to `split4` itself, or
            the folder of the scans, or any of these folders' parents. Where both HDF5 files and scans are there,
            the files are taken.
        variant: One of `VARIANTS` or a paper's name of it, in any case; `obj_only` if None.

    Raises:
        UsageError: An unknown variant.
        DataError: Its files are not there, or are damaged; says which are there.
    """
    key = (variant or DEFAULT).lower().replace("-", "_")
    key = ALIASES.get(key, key)
    if key not in VARIANTS:
        raise choose_error("variant of scanobjectnn", variant or "", [*VARIANTS, *ALIASES])
    spec = f"scanobjectnn:{root.absolute()}@{key}"
    folder = _folder(root, VARIANTS[key])
    if folder is not None:
        return _open_files(root, folder, key, spec)
    scans = find_scans(root)
    if scans is None or key not in ("obj_only", "with_bg"):
        raise _no_files(root, key)
    return open_scans(scans, background=VARIANTS[key].background, variant=key, spec=spec)


def _open_files(root: Path, folder: Path, key: str, spec: str) -> Dataset:
    variant = VARIANTS[key]
    items: list[Item] = []
    points = set[int]()
    for split, word in SPLITS.items():
        path = folder / f"{word}_objectdataset{variant.suffix}.h5"
        if not path.is_file():
            raise DataError(f"{folder} lacks {path.name}", hint=where("scanobjectnn"), code="dataset.missing-part")
        table = read_table(path, "ScanObjectNN")
        points.add(table.points)
        items += row_items(path, table, split, CLASSES, split)
    counts = Counter(item.split for item in items)
    sizes = " or ".join(f"{count:,}" for count in sorted(points))
    files = f"{folder.name}/{{training,test}}_objectdataset{variant.suffix}.h5"
    counted = f"{len(items)} shapes of {sizes} points in {len(CLASSES)} classes ({share_words(counts)})"
    title = f"ScanObjectNN {key} ({variant.name}, {files}), y up: {counted}; {root}"
    main = folder.name.removesuffix(NO_BACKGROUND) == "main_split"
    release = f"scanobjectnn-{key}" if main and f"scanobjectnn-{key}" in OFFICIAL else ""
    return Dataset(spec, title, CLASSES, tuple(items), release=release)


def _folder(root: Path, variant: Variant) -> Path | None:
    """Return the split folder that holds a file of the variant, or None."""
    for folder in _split_folders(root):
        if folder.name.endswith(NO_BACKGROUND) == variant.background:
            continue
        if any((folder / f"{word}_objectdataset{variant.suffix}.h5").is_file() for word in SPLITS.values()):
            return folder
    return None


def _split_folders(root: Path) -> Iterator[Path]:
    """Yield the split folders: those in `root` or its `h5_files`, or `root` and its twin if it is one itself."""
    absolute = root.absolute()
    if any(root.glob("*objectdataset*.h5")):
        yield absolute
        base = absolute.name.removesuffix(NO_BACKGROUND)
        twin = absolute.parent / (base if absolute.name != base else base + NO_BACKGROUND)
        if any(twin.glob("*objectdataset*.h5")):
            yield twin
        return
    for parent in (absolute, absolute / "h5_files"):
        for name in ("main_split", f"main_split{NO_BACKGROUND}"):
            if any((parent / name).glob("*objectdataset*.h5")):
                yield parent / name


def _no_files(root: Path, key: str) -> DataError:
    variant = VARIANTS[key]
    folder = "main_split" if variant.background else f"main_split{NO_BACKGROUND}"
    there = [name for name, other in VARIANTS.items() if _folder(root, other)]
    if find_scans(root) is not None:
        there = sorted({*there, "obj_only", "with_bg"})
    found = f"; there: {', '.join(there)}" if there else ""
    return DataError(
        f"{root} lacks ScanObjectNN {key}: {folder}/training_objectdataset{variant.suffix}.h5 and test_…{found}",
        hint=where("scanobjectnn"),
        code="dataset.missing-part",
    )
