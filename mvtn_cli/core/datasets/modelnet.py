"""ModelNet40 and ModelNet10 as distributed: OFF files in `CLASS/{train,test}/`, z up; or as points, y up."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

from mvtn_cli.core.datasets.dataset import Dataset
from mvtn_cli.core.datasets.files import Parts, readable, suffix_of, unwrapped, walk
from mvtn_cli.core.datasets.folder import Layout, labelled, no_shapes, recognise
from mvtn_cli.core.datasets.layouts import where
from mvtn_cli.core.datasets.official import MODELNET10, OFFICIAL
from mvtn_cli.core.datasets.point_release import is_point_release, open_point_release
from mvtn_cli.core.datasets.resampled import is_resampled, open_resampled
from mvtn_cli.errors import DataError

MODELNET40 = tuple(OFFICIAL["modelnet40"].classes)
KINDS = {"modelnet40": MODELNET40, "modelnet10": MODELNET10}


def looks_like_modelnet(layout: Layout | None) -> bool:
    """Tell whether split folders, suffixes and every class name are ModelNet's."""
    if layout is None or layout.pattern != "CLASS/SPLIT/file":
        return False
    return set(layout.classes()) <= set(MODELNET40) and all(suffix_of(p[-1]) == ".off" for p in layout.files)


def release_of(classes: Collection[str]) -> str:
    """Return which ModelNet has these classes, or the smaller one that has them all."""
    return "modelnet10" if set(classes) <= set(MODELNET10) else "modelnet40"


def open_modelnet(kind: str, root: Path) -> Dataset:
    """Open `modelnet40` or `modelnet10` below `root`: OFF folders, the HDF5 point release, or text with normals.

    Raises:
        DataError: Nothing of the kind is there.
    """
    names = KINDS[kind]
    spec = f"{kind}:{root.absolute()}"
    if folder := unwrapped(root, is_point_release):
        return open_point_release(folder, MODELNET40, keep=names, spec=spec)
    if folder := unwrapped(root, is_resampled):
        return open_resampled(folder, len(names), spec=spec)
    files = walk(root)
    layout = recognise(readable(files, [".off"]) or _nothing(root, files, kind))
    if layout is None or layout.split_part is None:
        raise DataError(
            f"{root} is not laid out as ModelNet: looked for {root}/<class>/{{train,test}}/*.off",
            hint=f"for another layout use folder:{root}; {where(kind)}",
            code="dataset.not-modelnet",
        )
    layout = _only(root, layout, names, kind)
    remark = _absent_words(names, layout.classes())
    dataset = labelled(root, layout, up="z", spec=spec, kind=f"{kind} (OFF)", remark=remark, hint=where(kind))
    return replace(dataset, release=kind)


def _absent_words(names: Sequence[str], found: Collection[str]) -> str:
    """Say which classes are not there; OFF folders have no list of their own, so that is no error."""
    absent = [name for name in names if name not in found]
    listed = ", ".join(absent[:5]) + (", …" if len(absent) > 5 else "")
    return f"{len(absent)} of the {len(names)} classes are not there: {listed}" if absent else ""


def _nothing(root: Path, files: Sequence[Parts], kind: str) -> list[Parts]:
    error = no_shapes(root, files, [".off"])
    error.hint += f"; {where(kind)}"
    raise error


def _only(root: Path, layout: Layout, names: Sequence[str], kind: str) -> Layout:
    files = tuple(parts for parts in layout.files if parts[layout.class_part] in names)
    if not files:
        found = ", ".join(layout.classes()[:5])
        raise DataError(
            f"no class folder in {root} has a name of {kind}: found {found}",
            hint=f"for classes of your own use folder:{root}?up=z",
            code="dataset.not-modelnet",
        )
    left_out = len(layout.files) - len(files)
    return Layout(layout.pattern, files, layout.class_part, layout.split_part, layout.outside + left_out)
