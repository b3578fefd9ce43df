"""A data set of eight tiny meshes, and settings small enough to train on it in a second."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from threads import one_thread  # noqa: F401

from mvtn_cli.config import TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.preprocess import Settings
from mvtn_cli.core.store import StoredShape

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
# two triangles a side; the corners of a side in the order of a walk around it
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
FACES = np.array([(a, *pair) for a, b, c, d in SIDES for pair in ((b, c), (c, d))], np.int32)
EXTENTS = ((1, 1, 1), (1, 0.2, 1), (0.2, 1, 0.2), (1, 0.5, 0.2))
CLASSES = ("cube", "plate", "post", "board")


@dataclass(frozen=True)
class ToyRecord:
    """One box."""

    name: str
    label: int
    split: str
    known_azimuth_deg: float = float("nan")


@dataclass
class ToyPrepared:
    """Boxes of four proportions; what a Prepared has, without files."""

    records: list[ToyRecord]
    address: str = "0123abcd"
    spec: str = "builtin:boxes"
    title: str = "boxes"
    classes: tuple[str, ...] = CLASSES
    known_view: bool = False
    settings: Settings = field(default_factory=lambda: Settings(max_vertices=1000, num_points=64, seed=0))
    shapes: list[StoredShape] = field(default_factory=list)

    def load(self, index: int) -> StoredShape:
        """Build box number `index`."""
        return box(self.records[index].label, index)

    def split(self, name: str) -> list[int]:
        """Indices of a split."""
        return [i for i, record in enumerate(self.records) if record.split == name]


def box(label: int, seed: int) -> StoredShape:
    """A box of its class's proportions, a little stretched, turned about y."""
    random = np.random.default_rng(seed)
    extents = np.array(EXTENTS[label]) * random.uniform(0.9, 1.1, 3)
    turn = random.uniform(0, 2 * np.pi)
    rotation = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    scale = np.linalg.norm(extents)
    vertices = (CORNERS * extents @ rotation.T / scale).astype(np.float32)
    on_surface = random.uniform(-1, 1, (64, 3))
    axis = random.integers(0, 3, 64)
    on_surface[np.arange(64), axis] = np.sign(on_surface[np.arange(64), axis])
    return StoredShape(
        vertices=vertices,
        faces=FACES,
        normals=(vertices / np.linalg.norm(vertices, axis=1, keepdims=True)).astype(np.float32),
        colors=None,
        points=(on_surface * extents @ rotation.T / scale).astype(np.float32),
        point_colors=None,
        center=np.zeros(3),
        radius=1.0,
    )


def make_boxes() -> ToyPrepared:
    """Eight boxes to train on, four to validate with and four to test with."""
    records = [
        ToyRecord(f"{CLASSES[i % 4]}/{split}{i}", i % 4, split)
        for split, count in (("train", 8), ("val", 4), ("test", 4))
        for i in range(count)
    ]
    return ToyPrepared(records)


@pytest.fixture
def boxes() -> ToyPrepared:
    """A toy data set of one's own."""
    return make_boxes()


@pytest.fixture
def settings(tmp_path: Path) -> Callable[..., TrainConfig]:
    """Build tiny settings; any field can be changed."""

    def build(**changed: Any) -> TrainConfig:
        small = {
            "runs": tmp_path / "runs",
            "image_size": 16,
            "supersample": 1,
            "num_views": 2,
            "encoder_points": 32,
            "batch_size": 4,
            "epochs": 2,
            "color": "white",
            "light": "headlight",
            "device": "cpu",
            "threads": 1,
        }
        return TrainConfig(**{**small, **changed})

    return build


@pytest.fixture
def quiet() -> Console:
    """A console that only keeps warnings."""
    return Console(quiet=True)
