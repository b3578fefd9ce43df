"""Split vertices at creases, so that smooth shading rounds off only what is round."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from mvtn_cli.core.shapes.geometry import doubled_normals
from mvtn_cli.core.shapes.shape import FaceArray, FloatArray

CREASE_DEG = 50.0


def split_creases(
    vertices: FloatArray, faces: FaceArray, angle_deg: float = CREASE_DEG
) -> tuple[np.ndarray, FaceArray]:
    """Give each smooth fan of faces around a vertex a vertex of its own.

    Two faces are smooth over a shared edge if their planes meet at less than `angle_deg`, whichever way each is wound:
    CAD meshes of one solid are often wound both ways. Positions don't change, so neither does what covers a pixel.

    Args:
        vertices: (V, 3), normalised.
        faces: (F, 3), each with area.

    Returns:
        (V',) indices of the old vertex that each new one stands at, and (F, 3) faces into the new ones.
    """
    count = len(faces)
    if count == 0:
        return np.arange(len(vertices)), faces
    normals = doubled_normals(vertices, faces)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    first, second = _smooth_neighbours(faces, normals, np.cos(np.radians(angle_deg)))
    fans, fan = connected_components(
        coo_matrix((np.ones(len(first), np.int8), (first, second)), shape=(3 * count, 3 * count)),
        directed=False,
    )
    # Corners of one fan stand at one old vertex: number the fans in the order of their first corner.
    _, first_corner, fan = np.unique(fan, return_index=True, return_inverse=True)
    order = np.argsort(first_corner, kind="stable")
    rank = np.empty(fans, np.int64)
    rank[order] = np.arange(fans)
    return faces.reshape(-1)[first_corner[order]], rank[fan].reshape(-1, 3).astype(faces.dtype)


def _smooth_neighbours(faces: FaceArray, normals: FloatArray, cosine: float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of corners (as 3 * face + corner) that lie at one vertex, on both sides of one smooth edge."""
    corner = np.arange(3 * len(faces)).reshape(-1, 3)
    ends = np.stack([corner[:, [0, 1, 2]], corner[:, [1, 2, 0]]], -1).reshape(-1, 2)
    places = faces.reshape(-1)[ends]
    turned = places[:, 0] > places[:, 1]
    ends[turned], places[turned] = ends[turned][:, ::-1], places[turned][:, ::-1]
    order = np.lexsort((places[:, 1], places[:, 0]))
    ends, places = ends[order], places[order]
    # Neighbours in this order share the edge; of an edge with many faces each is compared with the next only.
    same = (places[1:] == places[:-1]).all(1)
    a, b = ends[:-1][same], ends[1:][same]
    smooth = np.abs((normals[a[:, 0] // 3] * normals[b[:, 0] // 3]).sum(1)) > cosine
    return a[smooth].reshape(-1), b[smooth].reshape(-1)
