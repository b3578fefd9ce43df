"""`builtin:shapes`: twelve everyday classes, made on the spot.

The classes overlap in their overall proportions (bookshelf and wardrobe draw their sizes from one range, the
vessels from similar ones), so that the distances inside a shape alone tell little and a picture tells much.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from mvtn_cli.core.datasets.builtin import furniture, storage, vehicles, vessels
from mvtn_cli.core.datasets.builtin.mesh import Mesh, welded
from mvtn_cli.core.shapes import Shape
from mvtn_cli.errors import choose_error

VERSION = 2
"""Goes up with each change that moves a vertex; stored shapes of another version are made again."""

STRETCH = 0.15
"""Each axis is stretched by exp(U(-STRETCH, STRETCH))."""

_GENERATORS: dict[str, Callable[[Generator], Mesh]] = {
    "airplane": vehicles.airplane,
    "bed": furniture.bed,
    "bookshelf": storage.bookshelf,
    "bottle": vessels.bottle,
    "car": vehicles.car,
    "chair": furniture.chair,
    "mug": vessels.mug,
    "sofa": furniture.sofa,
    "table": furniture.table,
    "teapot": vessels.teapot,
    "vase": vessels.vase,
    "wardrobe": storage.wardrobe,
}

CLASSES = tuple(_GENERATORS)


def build(class_name: str, index: int, seed: int = 0, split: str = "train") -> Shape:
    """Make one shape; the four arguments decide every coordinate.

    Args:
        class_name: One of `CLASSES`.
        index: Which one of its class and split, from 0; more shapes never change the earlier ones.
        seed: Of the whole set, from 0.
        split: `train` and `test` are independent draws.

    Raises:
        UsageError: No class has this name.

    Returns:
        A mesh with y up, turned about y by a uniform angle, in its own units (not normalised), uncoloured.
    """
    if class_name not in _GENERATORS:
        raise choose_error("class", class_name, CLASSES)
    rng = shape_rng(seed, split, class_name, index)
    mesh = welded(_GENERATORS[class_name](rng))
    mesh = mesh.scaled(*np.exp(rng.uniform(-STRETCH, STRETCH, 3))).turned("y", rng.uniform(0, 360))
    name = f"{class_name}/{split}_{index:04d}"
    return Shape(vertices=mesh.vertices, faces=mesh.faces, name=name, source=f"builtin:shapes {name}, seed {seed}")


def shape_rng(seed: int, split: str, word: str, index: int) -> Generator:
    """Return the random stream that belongs to one shape and to no other."""
    key = (zlib.crc32(split.encode()), zlib.crc32(word.encode()), index)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
