"""Three stretched tetrahedra, and settings small enough to recognise them in no time."""

from __future__ import annotations

from typing import Any

import numpy as np

from mvtn_cli.config import TrainConfig
from mvtn_cli.core.render import Look
from mvtn_cli.core.store import StoredShape

CLASSES = 3


def tetrahedron(stretch: float) -> StoredShape:
    """A tetrahedron with 40 points on its surface."""
    vertices = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], np.float32) / 3**0.5
    vertices[:, 0] *= stretch
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], np.int32)
    weights = np.random.default_rng(0).dirichlet(np.ones(4), 40).astype(np.float32)
    unit = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    return StoredShape(
        vertices=vertices,
        faces=faces,
        normals=unit,
        colors=None,
        points=weights @ vertices,
        point_colors=None,
        center=np.zeros(3),
        radius=1.0,
        known_azimuth_deg=float("nan"),
    )


def config(**more: Any) -> TrainConfig:
    """Tiny settings; any field can be given, also one that is no option of `mvtn train`."""
    plain = TrainConfig(image_size=16, num_views=4, encoder_points=16, supersample=1)
    return plain.model_copy(update=more)


def look(settings: TrainConfig, count: int = 3, kind: str = "mesh") -> Look:
    """As shapes are judged."""
    return Look.evaluation(settings, count, kind)
