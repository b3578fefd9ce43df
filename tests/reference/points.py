"""The image of a point cloud in float64: every point is held against every pixel, from front to back."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial

NEAR = 0.01
OPAQUE = 0.999
KERNEL = Polynomial([1, 0, -1]) ** 2  # (1 - u^2)^2 on |u| <= 1
INTEGRAL = KERNEL.integ()
# A disc of the radial kernel and its separable stand-in have the same variance and the same mass.
SIGMA = np.sqrt(7 / 8)
AMPLITUDE = (np.pi / 3) / (SIGMA * 16 / 15) ** 2


def shares(centre: np.ndarray, sigma: np.ndarray, size: int) -> np.ndarray:
    """Return (P, size): the integral of the kernel of each point over each pixel of one axis."""
    edges = (np.arange(size + 1) - centre[:, None]) / sigma[:, None]
    upto = INTEGRAL(np.clip(edges, -1, 1)) * sigma[:, None]
    return upto[:, 1:] - upto[:, :-1]


def draw_points(
    points: np.ndarray,
    colors: np.ndarray,
    rt: np.ndarray,
    focal: float,
    size: int,
    radius: float | np.ndarray,
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    cue: float = 0.0,
) -> np.ndarray:
    """Return the (3, H, W) image of P points with P colours, one radius or P; equally near ones in their own order.

    A point keeps all of its light up to one radius of the shape before its centre, 1 - cue from one radius behind.
    """
    right, up, back = (points.astype(np.float64) @ rt[:, :3].T + rt[:, 3]).T
    ahead = -back
    seen = np.flatnonzero(ahead > NEAR)
    seen = seen[np.argsort(ahead[seen], kind="stable")]
    scale = focal / ahead[seen]
    sigma = np.broadcast_to(radius, len(points))[seen] * scale * SIGMA
    across, down = (shares(size / 2 + at[seen] * scale, sigma, size) for at in (right, -up))
    shade = 1 - cue * np.clip((ahead[seen] + rt[2, 3] + 1) / 2, 0, 1)
    image, left = np.zeros((size, size, 3)), np.ones((size, size))
    for row, column, color in zip(down, across, colors[seen] * shade[:, None], strict=True):
        alpha = np.minimum(AMPLITUDE * np.outer(row, column), OPAQUE)
        image += (left * alpha)[:, :, None] * color
        left *= 1 - alpha
    return (image + left[:, :, None] * background).transpose(2, 0, 1)
