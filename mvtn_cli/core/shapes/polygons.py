"""Polygons of any size, as triangles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mvtn_cli.core.shapes.shape import FaceArray


def fan(corners: npt.NDArray[np.int64], counts: npt.NDArray[np.int64]) -> FaceArray:
    """Cut polygons into triangle fans from their first corner.

    A polygon of one or two corners becomes a triangle that repeats a corner, so that `validate` counts and
    drops it; one of no corners becomes nothing. A fan of a concave polygon may leave its outline, which is
    accepted: such files are rare, and the error is of the size of one polygon.

    Args:
        corners: All polygons' vertex indices, one polygon after the other; they must fit int32.
        counts: (polygons,) number of corners.

    Returns:
        Triangles (T, 3), in file order.
    """
    triangles = np.where(counts >= 3, counts - 2, np.minimum(counts, 1))
    polygon = np.repeat(np.arange(len(counts)), triangles)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    first, last = (np.cumsum(counts) - counts)[polygon], counts[polygon] - 1
    at = [first, first + np.minimum(step + 1, last), first + np.minimum(step + 2, last)]
    return corners[np.stack(at, axis=1)].astype(np.int32)
