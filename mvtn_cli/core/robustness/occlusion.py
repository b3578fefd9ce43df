"""Take a part of a shape away from one of six directions: its points by selection, its mesh by a true cut.

Three ways to say how much is taken away (`crop`):

- `quantile`: exactly that share of the stored points, the first ones that a plane from outside meets;
- `extent`: that share of the shape's own bounding box along the axis;
- `cube`: that share of the fixed cube [-1, 1], as the paper's released code does it: 0.1 may remove nothing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.robustness.cutting import Plane, cut_mesh, surface_area
from mvtn_cli.core.store import StoredShape

DIRECTIONS = ("+x", "-x", "+y", "-y", "+z", "-z")
CROPS = ("quantile", "extent", "cube")


class Corrupted(NamedTuple):
    """A shape, and how much of the original is left of it.

    Attributes:
        shape: The corrupted shape.
        points_left: Share of its stored points, in [0, 1].
        area_left: Share of its surface, NaN without one.
    """

    shape: StoredShape
    points_left: float = 1.0
    area_left: float = float("nan")


def occlude(shape: StoredShape, ratio: float, direction: str, crop: str = "quantile") -> Corrupted:
    """Take away what lies on the side that `direction` names.

    Points that stay are repeated in order until there are as many as before, so that shapes still make a batch (the
    released code does the same); where none stays, all lie at the origin. Of a mesh that vanishes, a face without
    area stays, so that it is still drawn as a mesh: an empty picture. Nothing is re-centred or re-scaled.

    Args:
        shape: Any.
        ratio: How much, in [0, 1); 0 gives the very same shape.
        direction: One of `DIRECTIONS`: `+x` takes away what has the largest x.
        crop: One of `CROPS`: what `ratio` is a share of.
    """
    if ratio == 0:
        return Corrupted(shape, 1.0, 1.0 if shape.has_mesh else float("nan"))
    axis, side = "xyz".index(direction[1]), 1 if direction[0] == "+" else -1
    if crop == "quantile":
        stay, plane = _by_quantile(shape, ratio, axis, side)
    else:
        plane = _by_position(shape, ratio, axis, side, crop)
        stay = np.flatnonzero(plane.depth(shape.points) >= 0)
    left = select_points(shape, stay)
    if not shape.has_mesh:
        return Corrupted(left, len(stay) / len(shape.points))
    cut = _never_empty(cut_mesh(left, plane), plane)
    return Corrupted(cut, len(stay) / len(shape.points), _share(surface_area(cut), surface_area(shape)))


def select_points(shape: StoredShape, stay: NDArray[np.int64]) -> StoredShape:
    """Keep these points, in order, repeated until there are as many as before; none kept: all at the origin."""
    if not len(stay):
        return replace(shape, points=np.zeros_like(shape.points))
    rows = np.resize(stay, len(shape.points))
    colors = None if shape.point_colors is None else shape.point_colors[rows]
    return replace(shape, points=shape.points[rows], point_colors=colors)


def removed_count(ratio: float, count: int) -> int:
    """How many of `count` points a ratio removes: rounded half up; one at least stays."""
    return min(int(np.floor(ratio * count + 0.5)), count - 1)


def _by_quantile(shape: StoredShape, ratio: float, axis: int, side: int) -> tuple[NDArray[np.int64], Plane]:
    """The points that stay, in their old order, and the plane through the outermost of them.

    Among points at the same height the first ones go first; the mesh, which the plane cuts, keeps that height whole.
    """
    height = side * shape.points[:, axis].astype(np.float64)
    order = np.argsort(-height, kind="stable")
    stay = np.sort(order[removed_count(ratio, len(order)) :])
    return stay, Plane.across(axis, side * float(height[stay].max()), -side)


def _by_position(shape: StoredShape, ratio: float, axis: int, side: int, crop: str) -> Plane:
    places = shape.vertices[np.unique(shape.faces)] if shape.has_mesh else shape.points
    low, high = (-1.0, 1.0) if crop == "cube" else (float(places[:, axis].min()), float(places[:, axis].max()))
    outer, inner = (high, low) if side > 0 else (low, high)
    return Plane.across(axis, outer + ratio * (inner - outer), -side)


def _never_empty(shape: StoredShape, plane: Plane) -> StoredShape:
    if len(shape.faces):
        return shape
    speck = np.zeros((1, 3), np.float32)
    speck[0, plane.axis] = plane.at
    up = np.array([[0, 1, 0]], np.float32)
    colors = None if shape.colors is None else np.ones((1, 3), np.float32)
    return replace(shape, vertices=speck, normals=up, colors=colors, faces=np.zeros((1, 3), np.int32))


def _share(part: float, whole: float) -> float:
    return part / whole if whole > 0 else float("nan")
