"""Silhouette, depth and normals as PNG files: data that a program reads back, and tiles that a person looks at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from mvtn_cli.core.reporting.images import encode

DEEPEST = 65_535  # what 16 bits hold
NEAR_GREY, FAR_GREY = 255.0, 60.0  # of depth that a person looks at


def silhouette_png(mask: NDArray[np.bool_]) -> bytes:
    """Encode a mask (H, W): 8 bits, 255 is the shape, 0 the background."""
    return encode(Image.fromarray(mask.astype(np.uint8) * 255))


def depth_steps(distance: float) -> int:
    """Steps of a 16-bit depth image in one shape radius: the largest power of ten that holds the far side.

    10,000 for cameras up to 5.5 radii away, 1,000 up to 64.5, else 100.

    Args:
        distance: Of the farthest camera from the origin, shape radii.
    """
    return next(steps for steps in (10_000, 1_000, 100, 10) if (distance + 1) * steps <= DEEPEST or steps == 10)


def depth_png(depth: NDArray[np.float32], steps: int) -> bytes:
    """Encode depth (H, W) in shape radii: 16 bits, `steps` to a radius, rounded; 0 is the background.

    The scale is also written into the file, as the text `depth`.
    """
    words = PngInfo()
    words.add_text("depth", f"{steps} steps to a shape radius along the optical axis; 0 is background")
    values = np.where(depth > 0, np.clip(np.rint(depth.astype(np.float64) * steps), 1, DEEPEST), 0)
    return encode(Image.fromarray(values.astype(np.uint16)), words)


def normals_png(normals: NDArray[np.float32]) -> bytes:
    """Encode world normals (3, H, W): red, green and blue are x, y and z, -1 is 0 and 1 is 255; black is background."""
    return encode(Image.fromarray(np.moveaxis(normals_tile(normals), 0, -1).copy()))


def silhouette_tile(mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Turn a mask (..., H, W) into a picture (..., 3, H, W)."""
    return _grey(mask * 255.0)


def depth_range(depth: NDArray[np.float32]) -> tuple[float, float]:
    """Find the nearest and the farthest point that is seen in any of the views (M, H, W)."""
    seen = depth[depth > 0]
    return (float(seen.min()), float(seen.max())) if seen.size else (0.0, 1.0)


def depth_tile(depth: NDArray[np.float32], near: float, far: float) -> NDArray[np.uint8]:
    """Turn depth (..., H, W) into a picture (..., 3, H, W): what is near is bright."""
    share = (depth - near) / max(far - near, 1e-6)
    return _grey(np.where(depth > 0, NEAR_GREY + (FAR_GREY - NEAR_GREY) * share, 0))


def normals_tile(normals: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Turn normals (..., 3, H, W) into a picture of that shape."""
    there = (normals != 0).any(axis=-3, keepdims=True)
    return np.where(there, np.rint((np.clip(normals, -1, 1) + 1) * 127.5), 0).astype(np.uint8)


def _grey(values: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.repeat(np.rint(values).astype(np.uint8)[..., None, :, :], 3, axis=-3)
