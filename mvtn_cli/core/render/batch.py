"""B shapes, packed for the renderer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch

from mvtn_cli.core.render.topology import topology_of
from mvtn_cli.core.store import StoredShape
from mvtn_cli.errors import DataError


@dataclass(frozen=True)
class ShapeBatch:
    """B normalised shapes of different sizes.

    Attributes:
        vertices: (ΣV, 3) float32, all shapes one after another.
        normals: (ΣV, 3) float32 unit vertex normals.
        colors: (ΣV, 3) float32 in [0, 1], or (0, 3) where no shape of the batch has colours.
        faces: (ΣF, 3) int32, indices within each shape.
        face_edges, edge_starts, edge_faces, creases: Each shape's `Topology`, one after another.
        solid: (ΣF,) uint8, 1 where a face seen from behind is hidden for certain.
        radii: (B,) largest distance of a vertex from the origin.
        offsets: (4, B + 1) int64: shape b owns vertices[offsets[0, b]:offsets[0, b + 1]]; rows 1 to 3 are the same for
            faces, edge_starts and edge_faces.
        points: (B, P, 3) float32 tensor, sampled on the surfaces.
        point_colors: (B, P, 3) float32 in [0, 1], or None.
        labels: (B,) int64 tensor, -1 where unknown.
        names: B names.
    """

    vertices: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    faces: np.ndarray
    face_edges: np.ndarray
    edge_starts: np.ndarray
    edge_faces: np.ndarray
    creases: np.ndarray
    solid: np.ndarray
    radii: np.ndarray
    offsets: np.ndarray
    points: torch.Tensor
    point_colors: np.ndarray | None
    labels: torch.Tensor
    names: tuple[str, ...] = field(default=())

    def __len__(self) -> int:
        return len(self.points)

    @property
    def has_meshes(self) -> bool:
        """Whether every shape of the batch has at least one face."""
        return bool((np.diff(self.offsets[1]) > 0).all())

    def with_points(self, points: torch.Tensor) -> ShapeBatch:
        """Return the same batch with other points for the encoder, (B, P', 3)."""
        return replace(self, points=points)

    def pinned(self) -> ShapeBatch:
        """Return the same batch in memory that a GPU copies from by itself, while its other work goes on."""
        changed: dict[str, Any] = {}
        for name, value in vars(self).items():
            if isinstance(value, torch.Tensor):
                changed[name] = value.pin_memory()
            elif isinstance(value, np.ndarray):
                changed[name] = torch.from_numpy(value).pin_memory().numpy()
        return replace(self, **changed)


def pack(
    shapes: Sequence[StoredShape], labels: Sequence[int] | None = None, names: Sequence[str] | None = None
) -> ShapeBatch:
    """Pack stored shapes into one batch.

    Raises:
        DataError: The shapes hold different numbers of points, or there are none.
    """
    counts = {len(shape.points) for shape in shapes}
    if len(counts) != 1:
        raise DataError(
            f"a batch needs shapes with equally many points, got {sorted(counts)}",
            hint="preprocess the data set again with one --num-points",
        )
    topologies = [topology_of(shape) for shape in shapes]
    return ShapeBatch(
        vertices=np.concatenate([shape.vertices for shape in shapes]).astype(np.float32, copy=False),
        normals=np.concatenate([shape.normals for shape in shapes]).astype(np.float32, copy=False),
        colors=_joined([shape.colors for shape in shapes], [len(shape.vertices) for shape in shapes]),
        faces=np.concatenate([shape.faces for shape in shapes]).astype(np.int32, copy=False),
        face_edges=np.concatenate([topology.face_edges for topology in topologies]),
        edge_starts=np.concatenate([topology.edge_starts for topology in topologies]),
        edge_faces=np.concatenate([topology.edge_faces for topology in topologies]),
        creases=np.concatenate([topology.creases for topology in topologies]),
        solid=np.concatenate([topology.solid for topology in topologies]),
        radii=np.array([topology.radius for topology in topologies]),
        offsets=np.stack(
            [
                _offsets([len(shape.vertices) for shape in shapes]),
                _offsets([len(shape.faces) for shape in shapes]),
                _offsets([len(topology.edge_starts) for topology in topologies]),
                _offsets([len(topology.edge_faces) for topology in topologies]),
            ]
        ),
        points=torch.from_numpy(np.stack([shape.points for shape in shapes]).astype(np.float32, copy=False)),
        point_colors=_stacked_point_colors(shapes),
        labels=torch.as_tensor([-1] * len(shapes) if labels is None else list(labels), dtype=torch.int64),
        names=tuple(names or ()),
    )


def _offsets(counts: Sequence[int]) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _joined(colors: Sequence[np.ndarray | None], counts: Sequence[int]) -> np.ndarray:
    """Shapes without colours are white, where any other of the batch has some."""
    if all(color is None for color in colors):
        return np.zeros((0, 3), np.float32)
    parts = [np.ones((n, 3)) if color is None else color for color, n in zip(colors, counts, strict=True)]
    return np.concatenate(parts).astype(np.float32)


def _stacked_point_colors(shapes: Sequence[StoredShape]) -> np.ndarray | None:
    if all(shape.point_colors is None for shape in shapes):
        return None
    parts = [np.ones_like(s.points) if s.point_colors is None else s.point_colors for s in shapes]
    return np.stack(parts).astype(np.float32)
