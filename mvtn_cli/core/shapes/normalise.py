"""Bring a shape to the origin and to radius 1."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mvtn_cli.core.shapes.geometry import box_frame, referenced
from mvtn_cli.core.shapes.shape import FloatArray, Shape


def normalise(shape: Shape) -> tuple[Shape, FloatArray, float]:
    """Move the centre of the bounding box to the origin, and the farthest vertex to distance 1.

    Only vertices that a face uses count, for the box and for the distance; of a point cloud, all points.
    A mesh and points that it carries get one transform. `normalised * radius + center` gives file units back.

    Returns:
        The normalised shape, center (3,) and radius, both in file units.

    Raises:
        ValueError: The shape has no extent; `validate` finds that before.
    """
    if shape.is_cloud and shape.points is not None:
        counted = shape.points
    else:
        counted = shape.vertices[referenced(shape.faces, len(shape.vertices))]
    if not len(counted):
        raise ValueError("a shape without points has no size; validate it first")
    center, half = box_frame(counted)
    if not half > 0:
        raise ValueError("a shape of one point has no size; validate it first")
    # Two divisions: the squares in the norm are of numbers of at most 1, at any scale of the file.
    farthest = float(np.linalg.norm((counted - center) / half, axis=1).max())
    points = None if shape.points is None else (shape.points - center) / half / farthest
    vertices = (shape.vertices - center) / half / farthest
    return replace(shape, vertices=vertices, points=points), center, half * farthest
