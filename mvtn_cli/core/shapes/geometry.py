"""Sizes, areas and groups of equal rows; nothing is squared before it is brought to unit size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from mvtn_cli.core.shapes.shape import FaceArray, FloatArray

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


def box_frame(xyz: FloatArray) -> tuple[FloatArray, float]:
    """Return the centre (3,) of the bounding box of (n, 3) points, and its largest half edge.

    Halves are taken before sums, so that no finite coordinate overflows.
    """
    low, high = xyz.min(axis=0) / 2, xyz.max(axis=0) / 2
    return low + high, float((high - low).max())


def finite_rows(xyz: npt.NDArray[np.floating]) -> BoolArray:
    """Return which points (n,) have finite coordinates only."""
    return np.asarray(np.isfinite(xyz).all(axis=1))


def referenced(faces: npt.NDArray[np.integer], n_vertices: int) -> BoolArray:
    """Return which vertices a face uses, (V,)."""
    used = np.zeros(n_vertices, bool)
    used[faces.ravel()] = True
    return used


def doubled_normals(vertices: FloatArray, faces: FaceArray) -> FloatArray:
    """Return (F, 3) face normals, twice the area long. Exact to rounding only for vertices of unit size."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)


def longest_edges(vertices: FloatArray, faces: FaceArray) -> FloatArray:
    """Return the length (F,) of each face's longest edge."""
    corners = vertices[faces]
    edges = corners - np.roll(corners, 1, axis=1)
    return np.sqrt((edges**2).sum(axis=2).max(axis=1))


def first_equal(columns: Sequence[npt.NDArray[np.generic]]) -> IntArray:
    """Return, for each row of a table given by its columns, the first row that equals it (n,)."""
    order = np.lexsort(tuple(columns))  # stable: within a group, the first row comes first
    new = np.zeros(len(order), bool)
    new[:1] = True
    for column in columns:
        ordered = column[order]
        new[1:] |= ordered[1:] != ordered[:-1]
    first = np.zeros(len(order), np.int64)
    first[order] = order[np.flatnonzero(new)][np.cumsum(new) - 1]
    return first


def repeated_faces(faces: FaceArray) -> BoolArray:
    """Return which faces (F,) have the corners of an earlier face, in any order or orientation."""
    corners = np.sort(faces, axis=1)
    return first_equal([corners[:, 0], corners[:, 1], corners[:, 2]]) != np.arange(len(faces))
