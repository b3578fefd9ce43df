"""What bad scans do to a shape: noise, missing points, another size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mvtn_cli.core.robustness.occlusion import Corrupted, removed_count, select_points
from mvtn_cli.core.shapes.normals import vertex_normals
from mvtn_cli.core.store import StoredShape


def with_noise(shape: StoredShape, sd: float, random: np.random.Generator) -> StoredShape:
    """Move each point and each vertex by normal noise.

    Vertices at one place move together, so that the surface does not tear; normals are found anew. How rough a mesh
    gets depends on its triangles: a box has eight corners to move, a scan thousands.

    Args:
        shape: Any.
        sd: Standard deviation along each axis, shape radii; 0 gives the very same shape.
        random: The same state gives the same directions at every `sd`.
    """
    if sd == 0:
        return shape
    points = (shape.points + sd * random.standard_normal(shape.points.shape)).astype(np.float32)
    if not shape.has_mesh:
        return replace(shape, points=points)
    _, place = np.unique(shape.vertices, axis=0, return_inverse=True)
    place = place.reshape(-1)
    noise = random.standard_normal((int(place.max()) + 1, 3))
    vertices = (shape.vertices + sd * noise[place]).astype(np.float32)
    normals = vertex_normals(vertices.astype(np.float64), shape.faces)
    return replace(shape, points=points, vertices=vertices, normals=normals)


def without_points(shape: StoredShape, share: float, random: np.random.Generator) -> Corrupted:
    """Remove a share of the points, chosen by chance; a mesh is left alone.

    Those that stay are repeated in order, as after an occlusion. A larger share removes what a smaller one removes,
    and more.

    Args:
        shape: Any.
        share: In [0, 1); 0 gives the very same shape.
        random: Chooses.
    """
    if share == 0:
        return Corrupted(shape)
    count = len(shape.points)
    stay = np.sort(random.permutation(count)[removed_count(share, count) :])
    return Corrupted(select_points(shape, stay), len(stay) / count)


def scaled(shape: StoredShape, factor: float) -> StoredShape:
    """Make a shape larger or smaller about the origin; 1 gives the very same shape."""
    if factor == 1:
        return shape

    def times(rows: np.ndarray) -> np.ndarray:
        return (rows.astype(np.float64) * factor).astype(np.float32)

    return replace(shape, vertices=times(shape.vertices), points=times(shape.points))
