"""Closed meshes and point clouds of any proportions, as the store holds them, and a toy data set of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from mvtn_cli.core.preprocess import Settings
from mvtn_cli.core.shapes.normals import vertex_normals
from mvtn_cli.core.shapes.sample import draw_on_faces
from mvtn_cli.core.store import StoredShape

OCTAHEDRON = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
TRIANGLES = np.array(
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]], np.int32
)  # outwards


def solid(seed: int, *, seams: bool = False, points: int = 64) -> StoredShape:
    """A dented ball of 128 faces, closed, wound outwards; with seams every face has its own three vertices."""
    return replace(_solid(seed, seams, points))  # without what was kept with it


@cache
def _solid(seed: int, seams: bool, points: int) -> StoredShape:
    random = np.random.default_rng(seed)
    vertices, faces = _refined(*_refined(OCTAHEDRON, TRIANGLES))
    vertices *= random.uniform(0.6, 1.0, (len(vertices), 1)) * random.uniform(0.3, 1.0, 3)
    vertices = (vertices / np.linalg.norm(vertices, axis=1).max()).astype(np.float32)
    if seams:
        vertices, faces = vertices[faces].reshape(-1, 3), np.arange(faces.size, dtype=np.int32).reshape(-1, 3)
    face, weights = draw_on_faces(vertices.astype(float), faces, points, random)
    colors = random.random((len(vertices), 3)).astype(np.float32)
    return StoredShape(
        vertices=vertices,
        faces=faces,
        normals=vertex_normals(vertices.astype(float), faces),
        colors=colors,
        points=np.einsum("nk,nkd->nd", weights, vertices[faces[face]].astype(float)).astype(np.float32),
        point_colors=np.einsum("nk,nkd->nd", weights, colors[faces[face]].astype(float)).astype(np.float32),
        center=np.zeros(3),
        radius=1.0,
    )


def cloud(seed: int, points: int = 64) -> StoredShape:
    """The points of a solid alone."""
    shape = solid(seed, points=points)
    nothing = np.zeros((0, 3), np.float32)
    return replace(shape, vertices=nothing, faces=np.zeros((0, 3), np.int32), normals=nothing, colors=None)


def _refined(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cut each face into four, all vertices on the unit sphere."""
    number: dict[tuple[int, int], int] = {}
    rows = list(vertices)

    def middle(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in number:
            number[key] = len(rows)
            between = vertices[a] + vertices[b]
            rows.append(between / np.linalg.norm(between))
        return number[key]

    finer = []
    for a, b, c in faces.tolist():
        ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
        finer += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.array(rows), np.array(finer, np.int32)


@dataclass(frozen=True)
class ToyRecord:
    """One solid."""

    name: str
    label: int
    split: str
    address: str
    source: str = "toy"
    known_azimuth_deg: float = float("nan")


@dataclass
class Toy:
    """Sixteen solids of two classes; what a Prepared has, without files."""

    address: str = "abc"
    spec: str = "toy"
    title: str = "dented balls"
    classes: tuple[str, ...] = ("even", "odd")
    known_view: bool = False
    as_clouds: bool = False
    settings: Settings = field(default_factory=lambda: Settings(max_vertices=1000, num_points=64, seed=0))
    records: list[Any] = field(
        default_factory=lambda: [
            ToyRecord(f"{split}/{i}", i % 2, split, f"{n}{i}" * 20)
            for n, split in enumerate(("train", "test"))
            for i in range(8)
        ]
    )

    def load(self, index: int) -> StoredShape:
        """Make solid number `index`."""
        return (cloud if self.as_clouds else solid)(index)

    def split(self, name: str) -> list[int]:
        """Indices of a split."""
        return [i for i, record in enumerate(self.records) if record.split == name]
