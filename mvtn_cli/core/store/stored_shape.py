"""A shape as the rest of the house uses it: normalised, simplified, sampled, in float32."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class StoredShape:
    """One preprocessed shape: box centre at the origin, farthest vertex at distance 1, y up.

    Attributes:
        vertices: (V, 3) float32; (0, 3) for a point cloud.
        faces: (F, 3) int32 indices into `vertices`.
        normals: (V, 3) float32, unit length.
        colors: (V, 3) float32 in [0, 1], or None.
        points: (P, 3) float32, on the surface.
        point_colors: (P, 3) float32 in [0, 1], or None.
        center: (3,) float64: what was subtracted, in the file's units.
        radius: What was divided by: `file = stored * radius + center`.
        known_azimuth_deg: Azimuth of the best view in degrees, NaN if none is known.
    """

    vertices: Float32
    faces: NDArray[np.int32]
    normals: Float32
    colors: Float32 | None
    points: Float32
    point_colors: Float32 | None
    center: NDArray[np.float64]
    radius: float
    known_azimuth_deg: float = float("nan")

    @property
    def has_mesh(self) -> bool:
        """Whether there is a surface to draw; a point cloud has none."""
        return len(self.faces) > 0

    @property
    def nbytes(self) -> int:
        """Bytes that the arrays take in memory."""
        arrays = (
            self.vertices,
            self.faces,
            self.normals,
            self.colors,
            self.points,
            self.point_colors,
            self.center,
        )
        return sum(array.nbytes for array in arrays if array is not None)
