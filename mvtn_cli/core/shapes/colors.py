"""Vertex and point colours, brought to [0, 1]."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mvtn_cli.core.shapes.shape import ColorArray, FloatArray


def scaled_colors(raw: npt.NDArray[np.floating]) -> ColorArray:
    """Bring (n, 3) colours to [0, 1]: if one is above 1, they are bytes. NaN (no colour) stays."""
    finite = raw[np.isfinite(raw)]
    scale = 255.0 if len(finite) and finite.max() > 1.0 else 1.0
    return (raw / scale).astype(np.float32)


def extra_colors(extra: FloatArray) -> ColorArray | None:
    """Find colours among a cloud's further columns; they have no name, so they must look the part.

    Three columns are colours if all lie in [0, 1], or are whole and in [0, 255], and are not unit vectors
    (then they are normals). Seven columns in all are x y z, intensity, r g b.
    """
    starts = (1, 0) if extra.shape[1] == 4 else range(0, extra.shape[1] - 2, 3)
    for start in starts:
        rgb = extra[:, start : start + 3]
        if rgb.shape[1] < 3 or not np.isfinite(rgb).all() or rgb.min() < 0 or rgb.max() > 255:
            continue
        if np.abs(np.linalg.norm(rgb, axis=1) - 1).max() < 0.01:
            continue
        if rgb.max() <= 1:
            return rgb.astype(np.float32)
        if (rgb == np.rint(rgb)).all():
            return (rgb / 255).astype(np.float32)
    return None
