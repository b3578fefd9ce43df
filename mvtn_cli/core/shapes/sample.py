"""Draw points from a surface."""

from __future__ import annotations

import numpy as np

from mvtn_cli.core.shapes.geometry import IntArray, box_frame, doubled_normals
from mvtn_cli.core.shapes.shape import ColorArray, FaceArray, FloatArray, Shape


def sample_surface(shape: Shape, count: int, seed: int) -> tuple[FloatArray, ColorArray | None]:
    """Draw points uniformly by area; of a point cloud, take a subset, or repeat points to fill up.

    Args:
        shape: Validated.
        count: How many.
        seed: The same seed gives the same points, on any machine.

    Returns:
        Points (count, 3), and their colours (count, 3) in [0, 1] if the shape has colours.
    """
    generator = np.random.default_rng(seed)
    if shape.is_cloud and shape.points is not None:
        chosen = _chosen(len(shape.points), count, generator)
        return shape.points[chosen], None if shape.point_colors is None else shape.point_colors[chosen]
    face, weights = draw_on_faces(shape.vertices, shape.faces, count, generator)
    corners = shape.faces[face]
    points = np.einsum("nk,nkd->nd", weights, shape.vertices[corners])
    if shape.colors is None:
        return points, None
    colors = np.einsum("nk,nkd->nd", weights, shape.colors[corners].astype(np.float64))
    return points, np.clip(colors, 0, 1).astype(np.float32)


def draw_on_faces(
    vertices: FloatArray, faces: FaceArray, count: int, generator: np.random.Generator
) -> tuple[IntArray, FloatArray]:
    """Draw faces by area (count,), and barycentric coordinates uniform on each (count, 3).

    Raises:
        ValueError: No face has an area.
    """
    center, half = box_frame(vertices[faces].reshape(-1, 3)) if len(faces) else (np.zeros(3), 0.0)
    if not half > 0:
        raise ValueError("there is no surface to draw from; validate the shape first")
    area = np.linalg.norm(doubled_normals((vertices - center) / half, faces), axis=1)
    until = np.cumsum(area)
    if not until[-1] > 0:
        raise ValueError("the surface has no area; validate the shape first")
    face = np.searchsorted(until, generator.random(count) * until[-1], side="right")
    face = np.minimum(face, np.flatnonzero(area)[-1])  # rounding must not reach beyond the last
    u, v = generator.random((2, count))
    root = np.sqrt(u)  # Turk 1990: uniform on a triangle
    return face, np.stack([1 - root, root * (1 - v), root * v], axis=1)


def _chosen(available: int, count: int, generator: np.random.Generator) -> IntArray:
    """Return which points: all as often as they fit, then a random subset of the rest, in random order."""
    whole = np.repeat(np.arange(available), count // available)
    rest = generator.permutation(available)[: count % available]
    return generator.permutation(np.concatenate([whole, rest]))
