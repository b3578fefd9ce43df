"""What a labelled set of shapes is: a list of items that can be read one by one, in any process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mvtn_cli.core.shapes import Shape

SPLITS = ("train", "val", "test")
UNLABELLED = -1


@dataclass(frozen=True)
class Item:
    """One shape that has not been read yet.

    Attributes:
        name: Unique in its data set, e.g. `chair/chair_0001`.
        label: Index into the data set's classes, -1 where there is none.
        split: `train`, `val` or `test`.
        source: What a person is shown: a path, or a path and a row.
        read: Makes the shape; picklable, so that another process can call it.
        content: The bytes that decide what `read` makes (a file's bytes, a generator's parameters);
            picklable.
        path: The file behind the item, if it is one file: its size and time tell whether it changed.
        subclass: The finer label, where the release has one (ShapeNet's sub-synset), else empty.
    """

    name: str
    label: int
    split: str
    source: str
    read: Callable[[], Shape]
    content: Callable[[], bytes]
    path: Path | None = None
    subclass: str = ""


@dataclass(frozen=True)
class Missing:
    """Shapes that a data set's own list names, but the disk does not have.

    Attributes:
        part: What they belong to, e.g. `synset 02954340 (cap)`.
        names: As items would be called.
        whole: Nothing of that part is there: it was never unpacked.
    """

    part: str
    names: tuple[str, ...] = field(repr=False)
    whole: bool


@dataclass(frozen=True)
class Dataset:
    """A named list of items.

    Attributes:
        spec: The word that opens it again, e.g. `folder:/data/chairs`.
        title: One sentence: which layout was recognised, and how many of what.
        classes: Class names in the order of the labels; empty where nothing is labelled.
        items: Train before val before test is not promised; the order is the same at each opening.
        known_view: Each shape has an azimuth from which it is best seen (`Shape.known_azimuth_deg`).
        release: Which distribution this is, one of `official.OFFICIAL`; empty for anybody's own shapes.
        missing: What its own list names but is not there.
    """

    spec: str
    title: str
    classes: tuple[str, ...]
    items: tuple[Item, ...] = field(repr=False)
    known_view: bool = False
    release: str = ""
    missing: tuple[Missing, ...] = field(default=(), repr=False)

    def count(self, split: str) -> int:
        """Return how many items belong to `split`."""
        return sum(item.split == split for item in self.items)
