"""Which faces meet at an edge: what the silhouette search walks over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mvtn_cli.core.render.solids import find_solids
from mvtn_cli.core.store import StoredShape

# Cosine between neighbours that count as one plane.
FLAT = 0.9998


@dataclass(frozen=True)
class Topology:
    """Edges of one mesh, vertices at the same place counted as one.

    Attributes:
        face_edges: (F, 3) int32; column s is the edge opposite to corner s.
        edge_starts: (E + 1,) int32; edge e is shared by edge_faces[edge_starts[e]:edge_starts[e + 1]].
        edge_faces: (3F,) int32.
        creases: (F,) uint8; bit s is set where the edge opposite to corner s breaks smooth shading: a neighbour has
            other vertices, and so other normals, there. Bit 3 + s is set where it breaks flat shading: a neighbour lies
            in another plane.
        solid: (F,) uint8, 1 where the face belongs to a body that is proved closed (`solids.py`).
        radius: Largest distance of a finite vertex from the origin: cameras beyond it are outside of all bodies.
    """

    face_edges: np.ndarray
    edge_starts: np.ndarray
    edge_faces: np.ndarray
    creases: np.ndarray
    solid: np.ndarray
    radius: float


def find_topology(vertices: np.ndarray, faces: np.ndarray) -> Topology:
    """Group the 3F half-edges of a mesh by the two places they join.

    Args:
        vertices: (V, 3) float32; bit-equal rows are one place, so that a crease with split normals is still one edge.
        faces: (F, 3) int32.
    """
    if len(faces) == 0:
        none = np.zeros(0, np.uint8)
        return Topology(np.zeros((0, 3), np.int32), np.zeros(1, np.int32), np.zeros(0, np.int32), none, none, 0.0)
    place = _places(vertices)[faces].astype(np.int64)
    ends = np.stack([place[:, [1, 2, 0]], place[:, [2, 0, 1]]], -1).reshape(-1, 2)
    key = ends.min(1) * (place.max() + 1) + ends.max(1)
    _, edge = np.unique(key, return_inverse=True)
    edge = edge.reshape(-1)
    order = np.argsort(edge, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(edge))])
    creases = _creases(vertices, faces, edge, order, starts)
    return Topology(
        edge.reshape(-1, 3).astype(np.int32),
        starts.astype(np.int32),
        (order // 3).astype(np.int32),
        creases,
        find_solids(vertices, faces, edge.reshape(-1, 3)),
        _radius(vertices),
    )


def _radius(vertices: np.ndarray) -> float:
    length = np.linalg.norm(vertices.astype(np.float64), axis=1)
    return float(np.max(length, where=np.isfinite(length), initial=0.0))


def _creases(
    vertices: np.ndarray, faces: np.ndarray, edge: np.ndarray, order: np.ndarray, starts: np.ndarray
) -> np.ndarray:
    """Hold each half-edge against the first one of its edge; where one differs, all of the edge are creases."""
    ends = np.sort(np.stack([faces[:, [1, 2, 0]], faces[:, [2, 0, 1]]], -1).reshape(-1, 2), axis=1)
    corners = vertices[faces].astype(np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    first = order[starts[:-1]][edge]
    split = (ends != ends[first]).any(axis=1)
    bent = ~(np.abs((normal[np.arange(len(edge)) // 3] * normal[first // 3]).sum(axis=1)) > FLAT)
    bits = np.zeros(len(edge), np.uint8)
    for bit, differs in ((0, split), (3, bent)):
        bits |= (np.bincount(edge, differs, len(starts) - 1) > 0)[edge].astype(np.uint8) << bit
    return (bits.reshape(-1, 3) << np.arange(3, dtype=np.uint8)).sum(axis=1).astype(np.uint8)


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
