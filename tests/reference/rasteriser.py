"""Every face is held against every sample: which one is seen?

The conventions are the renderer's: screen coordinates are rounded to 1/256 sample, a face is cut at the
near plane, a sample on an edge belongs to the face right of it (or below it, for level edges), the nearer
one wins, and among faces that are equally near to 5e-7 the first one. The arithmetic isn't: signs instead
of biases, ray and plane instead of increments, no bounding box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

GRID = 256
RANGE = 2**30
NEAR = 0.01
MARGIN = 5e-7


@dataclass(frozen=True)
class View:
    """Face ids (H, W), -1 for background; 1/depth (H, W); camera coordinates (V, 3) of the vertices."""

    ids: np.ndarray
    inverse_depth: np.ndarray
    camera: np.ndarray


def to_camera(vertices: np.ndarray, rt: np.ndarray) -> np.ndarray:
    """Return (V, 3) float64: right, down, ahead."""
    x, y, z = vertices.astype(np.float64).T[:, :, None]
    with np.errstate(invalid="ignore", over="ignore"):
        # In this order, and not by BLAS: at exact ties the last bit decides who is seen.
        right_up_back = x * rt[:, 0] + y * rt[:, 1] + z * rt[:, 2] + rt[:, 3]
    return right_up_back * [1, -1, -1]


def rays(focal: float, size: int) -> np.ndarray:
    """Return (H, W, 3): where the sample at row j, column i looks, in camera coordinates."""
    across = (np.arange(size) + 0.5 - size / 2) / focal
    x, y = np.meshgrid(across, across)
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def on_grid(point: np.ndarray, focal: float, size: int) -> tuple[int, int]:
    """Return where a point in camera coordinates is on the screen, in 1/256 samples."""
    place = (point[:2] * (focal / point[2]) + size / 2) * GRID
    x, y = np.floor(np.clip(place, -RANGE, RANGE) + 0.5)
    return int(x), int(y)


def outline(camera: np.ndarray, face: np.ndarray, focal: float, size: int) -> list[tuple[int, int]]:
    """Return the corners of what is left of a face in front of the near plane."""
    corners = []
    for i, j in zip(face, np.roll(face, -1), strict=True):
        if camera[i, 2] > NEAR:
            corners.append(on_grid(camera[i], focal, size))
        if (camera[i, 2] > NEAR) != (camera[j, 2] > NEAR):
            first, second = camera[min(i, j)], camera[max(i, j)]
            cut = first + (NEAR - first[2]) / (second[2] - first[2]) * (second - first)
            cut[2] = NEAR
            corners.append(on_grid(cut, focal, size))
    return corners


def covered(triangle: list[tuple[int, int]], size: int) -> np.ndarray:
    """Return (H, W) bool: the samples in a triangle, each moved a hair right and a hair of a hair down.

    So moved no sample lies on an edge, and nothing needs to be said about ties.
    """
    x, y = np.meshgrid(np.arange(size) * GRID + GRID // 2, np.arange(size) * GRID + GRID // 2)
    sides = []
    for (x0, y0), (x1, y1) in zip(triangle, triangle[1:] + triangle[:1], strict=True):
        dx, dy = x1 - x0, y1 - y0
        side = np.sign(dx * (y - y0) - dy * (x - x0))
        sides.append(np.where(side != 0, side, np.sign(-dy if dy != 0 else dx)))
    return (sides[0] != 0) & (sides[0] == sides[1]) & (sides[1] == sides[2])


def rasterise(vertices: np.ndarray, faces: np.ndarray, rt: np.ndarray, focal: float, size: int) -> View:
    """Draw all faces, one after another."""
    camera, ray = to_camera(vertices, rt), rays(focal, size)
    ids, nearest = np.full((size, size), -1), np.zeros((size, size))
    for number, face in enumerate(faces):
        corners = camera[face]
        with np.errstate(invalid="ignore", over="ignore"):
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            offset = normal @ corners[0]
        if not np.isfinite(offset) or offset == 0 or corners[:, 2].max() <= NEAR:
            continue
        low, high = 1 / corners[:, 2].max(), 1 / max(corners[:, 2].min(), NEAR)
        inverse_depth = np.clip(ray @ normal / offset, low, high)
        corners = outline(camera, face, focal, size)
        for k in range(1, len(corners) - 1):
            wins = covered([corners[0], corners[k], corners[k + 1]], size)
            wins &= inverse_depth > nearest * (1 + MARGIN)
            ids[wins], nearest[wins] = number, inverse_depth[wins]
    return View(ids, nearest, camera)
