"""Which faces can't be seen from behind: those of bodies that are proved to be closed.

A connected piece of a mesh is taken as a body where each of its edges joins exactly two faces that run through it in
opposite directions, and where all its faces look away from one inner point (its centroid) and surround it once: it is
star-shaped, so it does not cut itself. Whoever stands outside of it sees the back of none of its faces, whatever else
is in the scene: the body's own front is nearer. Boxes, cylinders and spheres, of which much CAD is made, are such
bodies; no open or inconsistently wound sheet is.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

# An inner point that is this close to a face's plane, in body sizes, proves nothing.
CLEAR = 1e-4


def find_solids(vertices: np.ndarray, faces: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return (F,) uint8: 1 for the faces of proved bodies, wound counter-clockwise seen from outside.

    Args:
        vertices: (V, 3).
        faces: (F, 3).
        edges: (F, 3) number of the edge opposite to each corner; the same places have the same edge.
    """
    count = len(faces)
    flat = edges.reshape(-1)
    face_of = np.repeat(np.arange(count), 3)
    # Faces and edges are nodes of one graph, so that an edge of many faces costs no more than its half-edges.
    size = count + int(flat.max()) + 1
    joined = coo_array((np.ones(len(flat)), (face_of, count + flat)), shape=(size, size))
    pieces, nodes = connected_components(joined, directed=False)
    piece = nodes[:count]
    corners = vertices[faces].astype(np.float64)
    with np.errstate(all="ignore"):
        good = _closed(corners, flat, piece, pieces) & _star_shaped(corners, piece, pieces)
    return good[piece].astype(np.uint8)


def _closed(corners: np.ndarray, flat: np.ndarray, piece: np.ndarray, pieces: int) -> np.ndarray:
    """Which pieces have two faces at each edge, running through it in opposite directions."""
    start, end = corners[:, [1, 2, 0]].reshape(-1, 3), corners[:, [2, 0, 1]].reshape(-1, 3)
    # Along the first axis in which the ends differ: +1 one way, -1 the other, so that opposite runs cancel.
    differs = np.sign(end - start)
    run = np.where(differs[:, 0] != 0, differs[:, 0], np.where(differs[:, 1] != 0, differs[:, 1], differs[:, 2]))
    edges = int(flat.max()) + 1
    good = (np.bincount(flat, minlength=edges) == 2) & (np.bincount(flat, run, edges) == 0)
    good &= np.bincount(flat, np.abs(run), edges) == 2
    return np.bincount(np.repeat(piece, 3), ~good[flat], pieces) == 0


def _star_shaped(corners: np.ndarray, piece: np.ndarray, pieces: int) -> np.ndarray:
    """Which pieces turn every face away from their centroid and surround it exactly once."""
    share = np.bincount(piece, minlength=pieces)
    centre = np.stack([np.bincount(piece, corners[:, :, k].mean(axis=1), pieces) / share for k in range(3)], axis=1)
    arms = corners - centre[piece][:, None]
    reach = np.zeros(pieces)
    np.maximum.at(reach, piece, np.abs(arms).max(axis=(1, 2)))
    normal = np.cross(arms[:, 1] - arms[:, 0], arms[:, 2] - arms[:, 0])
    volume = (normal * arms[:, 0]).sum(axis=1)
    height = volume / np.linalg.norm(normal, axis=1)
    clear = height > CLEAR * reach[piece]
    a, b, c = (arms[:, k] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    angle = np.bincount(piece, 2 * np.arctan2(volume, below), pieces)  # Van Oosterom and Strackee (1983)
    return (np.bincount(piece, ~clear, pieces) == 0) & (np.abs(angle - 4 * np.pi) < 1e-6)
