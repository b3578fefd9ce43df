"""Which faces meet at an edge: what the silhouette search walks over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mvtn_cli.core.store import StoredShape


@dataclass(frozen=True)
class Topology:
    """Edges of one mesh, vertices at the same place counted as one.

    Attributes:
        face_edges: (F, 3) int32; column s is the edge opposite to corner s.
        edge_starts: (E + 1,) int32; edge e is shared by edge_faces[edge_starts[e]:edge_starts[e + 1]].
        edge_faces: (3F,) int32.
    """

    face_edges: np.ndarray
    edge_starts: np.ndarray
    edge_faces: np.ndarray


def find_topology(vertices: np.ndarray, faces: np.ndarray) -> Topology:
    """Group the 3F half-edges of a mesh by the two places they join.

    Args:
        vertices: (V, 3) float32; bit-equal rows are one place, so that a crease with split normals is still one edge.
        faces: (F, 3) int32.
    """
    if len(faces) == 0:
        return Topology(np.zeros((0, 3), np.int32), np.zeros(1, np.int32), np.zeros(0, np.int32))
    place = _places(vertices)[faces].astype(np.int64)
    ends = np.stack([place[:, [1, 2, 0]], place[:, [2, 0, 1]]], -1).reshape(-1, 2)
    key = ends.min(1) * (place.max() + 1) + ends.max(1)
    _, edge = np.unique(key, return_inverse=True)
    edge = edge.reshape(-1)
    order = np.argsort(edge, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(edge))])
    return Topology(edge.reshape(-1, 3).astype(np.int32), starts.astype(np.int32), (order // 3).astype(np.int32))


def _places(vertices: np.ndarray) -> np.ndarray:
    """Number the distinct places; -0.0 and 0.0 are one."""
    rows = np.ascontiguousarray(vertices + np.float32(0.0), np.float32).view(np.dtype((np.void, 12))).reshape(-1)
    return np.unique(rows, return_inverse=True)[1].reshape(-1)


def topology_of(shape: StoredShape) -> Topology:
    """The topology of a stored shape, found once and kept with it for as long as it is in memory."""
    known = shape.__dict__.get("_topology")
    if known is None:
        known = find_topology(shape.vertices, shape.faces)
        object.__setattr__(shape, "_topology", known)
    return known
