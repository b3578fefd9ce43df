"""Vertex normals that are unit vectors whatever the mesh."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mvtn_cli.core.shapes.geometry import box_frame, doubled_normals, repeated_faces
from mvtn_cli.core.shapes.shape import ColorArray, FaceArray, FloatArray

_CANCELLED = 1e-6  # of the summed angles: what is shorter is rounding, not a direction


def vertex_normals(vertices: FloatArray, faces: FaceArray) -> ColorArray:
    """Average the normals of the faces around each vertex, weighted by the angle each has there.

    Robust where the plain sum fails: a face that occurs twice counts once (its reverse would cancel it);
    faces without area, or with a vertex that is not finite, count nothing; where the sum cancels, as between
    two faces of opposite orientation, the first face's normal stands; a vertex without such a face points up.

    Args:
        vertices: (V, 3), any scale.
        faces: (F, 3), indices in range.

    Returns:
        (V, 3) float32 unit vectors.

    References:
        Thürmer, Wüthrich. Computing vertex normals from polygonal facets. Journal of Graphics Tools, 1998.
    """
    count = len(vertices)
    up = np.zeros((count, 3))
    up[:, 1] = 1.0
    faces = faces[np.isfinite(vertices[faces]).all(axis=(1, 2))]
    faces = faces[~repeated_faces(faces)]
    if not len(faces):
        return up.astype(np.float32)
    local = _local(vertices, faces)
    face_normals, has_area = _unit(doubled_normals(local, faces))
    faces, face_normals = faces[has_area], face_normals[has_area]

    angles = _corner_angles(local, faces)
    total, weight = np.zeros((count, 3)), np.zeros(count)
    for corner in range(3):
        at, angle = faces[:, corner], angles[:, corner]
        weight += np.bincount(at, angle, count)
        for axis in range(3):
            total[:, axis] += np.bincount(at, angle * face_normals[:, axis], count)

    first = np.full(count, -1)
    flat = faces.ravel()[::-1]
    first[flat] = (np.arange(len(flat)) // 3)[::-1]  # written backwards: the first face is what stays
    normals, _ = _unit(total)
    cancelled = np.linalg.norm(total, axis=1) <= _CANCELLED * weight
    normals[cancelled] = np.where(first[cancelled, None] >= 0, _rows(face_normals, first[cancelled]), up[cancelled])
    return normals.astype(np.float32)


def _local(vertices: FloatArray, faces: FaceArray) -> FloatArray:
    """Bring the vertices that faces use to unit size, so that products neither overflow nor vanish."""
    used = np.unique(faces)
    center, half = box_frame(vertices[used])
    local = np.zeros((len(vertices), 3))
    local[used] = (vertices[used] - center) / (half if half > 0 else 1.0)
    return local


def _unit(vectors: FloatArray) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Scale to length one; say which have a length at all. Twice, because squares of tiny numbers vanish."""
    largest = np.abs(vectors).max(axis=1, keepdims=True)
    usable = largest[:, 0] > 0
    scaled = vectors / np.where(largest > 0, largest, 1.0)
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    return scaled / np.where(length > 0, length, 1.0), usable


def _corner_angles(vertices: FloatArray, faces: FaceArray) -> FloatArray:
    """Return (F, 3) angles in radians, well conditioned also near 0 and 180 degrees."""
    corners = vertices[faces]
    to_next, to_last = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    sine = np.linalg.norm(np.cross(to_next, to_last), axis=2)
    return np.arctan2(sine, (to_next * to_last).sum(axis=2))


def _rows(table: FloatArray, at: npt.NDArray[np.int64]) -> FloatArray:
    """Take rows; any row for a negative index, none of an empty table."""
    return table[np.maximum(at, 0)] if len(table) else np.zeros((len(at), 3))
