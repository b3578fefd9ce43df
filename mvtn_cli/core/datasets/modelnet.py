"""ModelNet40 and ModelNet10 as distributed: OFF files in `CLASS/{train,test}/`, z up."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mvtn_cli.core.datasets.dataset import Dataset
from mvtn_cli.core.datasets.files import Parts, readable, suffix_of, walk
from mvtn_cli.core.datasets.folder import Layout, labelled, no_shapes, recognise
from mvtn_cli.core.datasets.point_release import is_point_release, open_point_release
from mvtn_cli.errors import DataError

# fmt: off
MODELNET40 = (
    "airplane", "bathtub", "bed", "bench", "bookshelf", "bottle", "bowl", "car", "chair", "cone",
    "cup", "curtain", "desk", "door", "dresser", "flower_pot", "glass_box", "guitar", "keyboard",
    "lamp", "laptop", "mantel", "monitor", "night_stand", "person", "piano", "plant", "radio",
    "range_hood", "sink", "sofa", "stairs", "stool", "table", "tent", "toilet", "tv_stand", "vase",
    "wardrobe", "xbox",
)
MODELNET10 = (
    "bathtub", "bed", "chair", "desk", "dresser", "monitor", "night_stand", "sofa", "table",
    "toilet",
)
# fmt: on
KINDS = {"modelnet40": MODELNET40, "modelnet10": MODELNET10}


def looks_like_modelnet(layout: Layout | None) -> bool:
    """Tell whether split folders, suffixes and every class name are ModelNet's."""
    if layout is None or layout.pattern != "CLASS/SPLIT/file":
        return False
    return set(layout.classes()) <= set(MODELNET40) and all(suffix_of(p[-1]) == ".off" for p in layout.files)


def open_modelnet(kind: str, root: Path) -> Dataset:
    """Open `modelnet40` or `modelnet10` below `root`, as OFF folders or as the point release.

    Raises:
        DataError: Nothing of the kind is there.
    """
    names = KINDS[kind]
    spec = f"{kind}:{root.absolute()}"
    if is_point_release(root):
        return open_point_release(root, MODELNET40, keep=names, spec=spec)
    files = walk(root)
    layout = recognise(readable(files, [".off"]) or _nothing(root, files))
    if layout is None or layout.split_part is None:
        raise DataError(
            f"{root} is not laid out as ModelNet: looked for {root}/<class>/{{train,test}}/*.off",
            hint=f"for another layout use folder:{root}",
            code="dataset.not-modelnet",
        )
    return labelled(root, _only(root, layout, names, kind), up="z", spec=spec, kind=f"{kind} (OFF)")


def _nothing(root: Path, files: Sequence[Parts]) -> list[Parts]:
    raise no_shapes(root, files, [".off"])


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
