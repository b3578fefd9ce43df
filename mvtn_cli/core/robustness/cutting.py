"""Cut a mesh at a plane: triangles that cross it are clipped, and the hole stays open, as behind an occluder.

Exact where it matters: new vertices lie in the plane bit for bit, two triangles that share an edge get the same new
vertex there, and every triangle keeps its winding.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.store import StoredShape

Indices = NDArray[np.int64]


class Plane(NamedTuple):
    """A plane across an axis, and the side of it that is kept: sign * (coordinate - at) >= 0.

    Attributes:
        axis: 0, 1 or 2.
        at: Coordinate of the plane; a float32 number, so that stored vertices can lie in it.
        sign: 1 keeps what is above it, -1 what is below.
    """

    axis: int
    at: float
    sign: int

    @classmethod
    def across(cls, axis: int, at: float, sign: int) -> Plane:
        """Make a plane, its coordinate rounded to float32."""
        return cls(axis, float(np.float32(at)), sign)

    def depth(self, places: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return (N,) distances of places (N, 3) from the plane, positive on the kept side."""
        return self.sign * (places[:, self.axis].astype(np.float64) - self.at)


def cut_mesh(shape: StoredShape, plane: Plane) -> StoredShape:
    """Keep the part of a mesh on the kept side of a plane; points are left alone.

    Vertices in the plane count as kept, so that a face within it stays. New vertices have the mean position, normal
    (brought to length 1) and colour of their edge's ends, weighted by distance. Vertices without a face are left out.

    Args:
        shape: A shape with faces.
        plane: Where to cut.

    Returns:
        A new shape, or the same one if nothing is cut off; faces may be (0, 3).
    """
    depth = plane.depth(shape.vertices)
    inside = depth >= 0
    count = inside[shape.faces].sum(axis=1)
    if inside.all():
        return shape
    kept = np.flatnonzero(count == 3)
    crossed = np.flatnonzero((count == 1) | (count == 2))
    clipped, source, edges = _clip(shape.faces[crossed].astype(np.int64), depth, len(depth))
    whole = _with_vertices_on(shape, edges, depth, plane)
    spread = _have_three_places(whole.vertices[clipped])
    faces = np.concatenate([shape.faces[kept].astype(np.int64), clipped[spread]])
    order = np.argsort(np.concatenate([kept, crossed[source[spread]]]), kind="stable")  # as the faces stood
    return _compact(whole, faces[order])


def _clip(faces: Indices, depth: NDArray[np.float64], count: int) -> tuple[Indices, Indices, Indices]:
    """Clip triangles of which one or two corners are inside.

    Args:
        faces: (F, 3), each with one or two corners of depth >= 0.
        depth: (V,) of the vertices.
        count: V; new vertices are numbered from here.

    Returns:
        Triangles (K, 3), the row of `faces` each came from (K,), and the new vertices' edges (E, 2) as (inside,
        outside) vertex.
    """
    inside = depth[faces] >= 0
    one = inside.sum(axis=1) == 1
    # Each triangle is walked from its odd corner: the only one inside, or the only one outside.
    odd = np.where(one, inside.argmax(axis=1), (~inside).argmax(axis=1))
    a, b, c = (faces[np.arange(len(faces)), (odd + k) % 3] for k in range(3))
    ends = np.stack([np.where(one, a, b), np.where(one, b, a), np.where(one, a, c), np.where(one, c, a)], axis=1)
    pairs, number = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    # An inside end that lies in the plane is the new vertex itself.
    new = np.where(depth[pairs[:, 0]] > 0, count + np.arange(len(pairs)), pairs[:, 0])[number.reshape(-1, 2)]
    on_b, on_c = new[:, 0], new[:, 1]
    rows = np.arange(len(faces))
    triangles = np.concatenate(
        [
            np.stack([a, on_b, on_c], axis=1)[one],
            np.stack([on_b, b, c], axis=1)[~one],
            np.stack([on_b, c, on_c], axis=1)[~one],
        ]
    )
    return triangles, np.concatenate([rows[one], rows[~one], rows[~one]]), pairs


def _have_three_places(corners: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Whether triangles (F, 3, 3) have not shrunk to an edge or a point, beside the plane or by rounding."""
    apart = (corners != np.roll(corners, 1, axis=1)).any(axis=2)
    return apart.all(axis=1)


def _with_vertices_on(shape: StoredShape, edges: Indices, depth: NDArray[np.float64], plane: Plane) -> StoredShape:
    """Append a vertex where each edge (inside, outside) meets the plane."""
    near, far = edges.T
    part = (depth[near] / (depth[near] - depth[far]))[:, None]

    def between(rows: NDArray[np.float32]) -> NDArray[np.float64]:
        return (1.0 - part) * rows[near].astype(np.float64) + part * rows[far].astype(np.float64)

    places = between(shape.vertices)
    places[:, plane.axis] = plane.at
    normals = between(shape.normals)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 1e-6, normals / np.maximum(length, 1e-6), shape.normals[near])
    colors = None
    if shape.colors is not None:
        colors = np.concatenate([shape.colors, between(shape.colors).astype(np.float32)])
    return replace(
        shape,
        vertices=np.concatenate([shape.vertices, places.astype(np.float32)]),
        normals=np.concatenate([shape.normals, normals.astype(np.float32)]),
        colors=colors,
    )


def _compact(shape: StoredShape, faces: Indices) -> StoredShape:
    """Give the shape these faces, and leave out vertices that none of them uses."""
    used, numbers = np.unique(faces, return_inverse=True)
    return replace(
        shape,
        vertices=shape.vertices[used],
        normals=shape.normals[used],
        colors=None if shape.colors is None else shape.colors[used],
        faces=numbers.reshape(-1, 3).astype(np.int32),
    )


def surface_area(shape: StoredShape) -> float:
    """Area of all faces, in shape radii squared."""
    corners = shape.vertices[shape.faces].astype(np.float64)
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(doubled, axis=1).sum() / 2)
