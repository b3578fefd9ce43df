"""A turn around a shape as an animated GIF."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from mvtn_cli.core.render import ShapeBatch
from mvtn_cli.core.reporting.drawing import draw_pictures
from mvtn_cli.core.views import Cameras

FRAMES, FRAME_MS = 48, 70  # 7.5° a frame, a turn in 3.4 s


def turntable(batch: ShapeBatch, kind: str, settings: Any, elevation_deg: float) -> bytes:
    """Draw one shape from a camera that goes around it once, as a GIF that never ends.

    Args:
        batch: One shape.
        kind: `mesh` or `points`.
        settings: Of the pictures; its distance and fov hold, too.
        elevation_deg: Of the camera.
    """
    azimuth = torch.arange(FRAMES) * (360 / FRAMES)
    cameras = Cameras.at(azimuth, torch.full((FRAMES,), elevation_deg), settings.distance, fov_deg=settings.fov)
    return animation(draw_pictures(batch, kind, cameras, settings).rgb)


def animation(frames: NDArray[np.uint8]) -> bytes:
    """Encode pictures (N, 3, H, W) as a GIF: greys without loss, colours with the 256 that serve each frame best."""
    if (frames == frames[:, :1]).all():
        pictures = [Image.fromarray(frame[0]) for frame in frames]
    else:
        pixels = [Image.fromarray(np.moveaxis(frame, 0, -1).copy()) for frame in frames]
        pictures = [picture.quantize(256, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE) for picture in pixels]
    buffer = io.BytesIO()
    first, *others = pictures
    first.save(buffer, "GIF", save_all=True, append_images=others, duration=FRAME_MS, loop=0, optimize=False)
    return buffer.getvalue()
