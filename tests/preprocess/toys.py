"""Ten-line shapes that count how often they are read."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mvtn_cli.console import Console
from mvtn_cli.core.datasets import Dataset, Item
from mvtn_cli.core.preprocess import Settings
from mvtn_cli.core.shapes import Shape

SETTINGS = Settings(max_vertices=100, num_points=32, seed=0)
QUIET = Console(quiet=True)


@dataclass(frozen=True)
class ReadBox:
    """A tetrahedron of its own; each reading leaves a byte in `log`."""

    number: int
    log: str
    delay_s: float = 0.0

    def __call__(self) -> Shape:
        with open(self.log, "a") as log:
            log.write(".")
        time.sleep(self.delay_s)
        vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, self.number + 2.0]])
        faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.int32)
        return Shape(vertices, faces, name=str(self.number))


@dataclass(frozen=True)
class Content:
    """The number stands for the shape."""

    number: int

    def __call__(self) -> bytes:
        return f"toy {self.number}".encode()


def toys(count: int, log: Path | str, *, delay_s: float = 0.0, read: Callable[..., Callable[[], Shape]] = ReadBox):
    """Return a data set of `count` tetrahedra, every fourth a test shape."""
    items = tuple(
        Item(
            name=f"toy/{number}",
            label=number % 2,
            split="test" if number % 4 == 3 else "train",
            source=f"toy {number}",
            read=read(number, str(log), delay_s),
            content=Content(number),
        )
        for number in range(count)
    )
    return Dataset("toys:", f"{count} toys", ("even", "odd"), items)


def reads(log: Path) -> int:
    """Return how many shapes were read."""
    return os.path.getsize(log) if log.exists() else 0


def tree_bytes(root: Path) -> dict[str, bytes]:
    """Return every stored shape below `root` by its path; unfinished temporary files are none."""
    return {str(path.relative_to(root)): path.read_bytes() for path in sorted((root / "shapes").rglob("[!.]*.npz"))}
