"""Turn a stored shape about the origin; nothing is re-centred, and it was centred on its box before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.store import StoredShape

Matrix = NDArray[np.float64]


def turn_about_y(angle_deg: float) -> Matrix:
    """Return the (3, 3) rotation that carries what an azimuth looks at to that azimuth plus `angle_deg`."""
    angle = np.radians(angle_deg)
    sine, cosine = np.sin(angle), np.cos(angle)
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


def draw_angle(limit_deg: float, random: np.random.Generator) -> float:
    """Draw an angle from U(-limit, limit), degrees: the paper's protocol, not the wider range of its released code."""
    return float(limit_deg * (2.0 * random.random() - 1.0))


def draw_rotation(random: np.random.Generator) -> Matrix:
    """Draw a (3, 3) rotation, uniform over SO(3): a normal quaternion brought to length 1.

    References:
        Marsaglia. Choosing a point from the surface of a sphere. Annals of Mathematical Statistics, 1972.
    """
    w, x, y, z = _unit(random.standard_normal(4))
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def turned(shape: StoredShape, rotation: Matrix) -> StoredShape:
    """Turn vertices, normals and points.

    Args:
        shape: Any.
        rotation: (3, 3), orthonormal, determinant 1.

    Returns:
        A new shape with the same faces and colours; its `center` and `radius` still lead to the file's units, but
        to the turned shape there.
    """
    return replace(
        shape,
        vertices=_rows_turned(shape.vertices, rotation),
        normals=_rows_turned(shape.normals, rotation),
        points=_rows_turned(shape.points, rotation),
    )


def _rows_turned(rows: NDArray[np.float32], rotation: Matrix) -> NDArray[np.float32]:
    # Not with @: a matrix product may round equal rows differently, and seams between equal vertices would open.
    return (rows.astype(np.float64)[:, None, :] * rotation).sum(axis=2).astype(np.float32)


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return vector / np.linalg.norm(vector)
