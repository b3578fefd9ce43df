"""Take pictures of stored shapes from given cameras, as an evaluation does: white, under a headlight."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from mvtn_cli.core.render import Look, check_look, render
from mvtn_cli.core.training.shapes import Shapes, alike_batches, load_batch
from mvtn_cli.core.views import Cameras

BATCH_VIEWS = 96


def draw_shapes(
    shapes: Shapes,
    indices: Sequence[int],
    azimuth_deg: ArrayLike,
    elevation_deg: ArrayLike,
    settings: Any,
    *,
    distance: ArrayLike | None = None,
) -> NDArray[np.uint8]:
    """Draw each shape from its own M cameras.

    Args:
        shapes: A Prepared.
        indices: N of its records.
        azimuth_deg: (N, M) or (M,), degrees.
        elevation_deg: (N, M) or (M,), degrees.
        settings: The picture's: image_size, distance, fov, look, render, shading, supersample, point_radius,
            depth_cue.
        distance: (N, M) or (M,), shape radii; None is the settings'.

    Returns:
        (N, M, 3, H, W).
    """
    far = settings.distance if distance is None else distance
    angles = np.broadcast_arrays(*(np.atleast_2d(x) for x in (azimuth_deg, elevation_deg, far)))
    azimuth, elevation, radii = (np.broadcast_to(x, (len(indices), x.shape[1])) for x in angles)
    size = settings.image_size
    pictures = np.zeros((len(indices), azimuth.shape[1], 3, size, size), np.uint8)
    done = 0
    for chunk in alike_batches(shapes, indices, max(1, BATCH_VIEWS // max(1, azimuth.shape[1])), settings.render):
        batch, kind = load_batch(shapes, chunk, settings.render)
        rows = slice(done, done + len(chunk))
        cameras = Cameras.at(
            torch.tensor(azimuth[rows]),
            torch.tensor(elevation[rows]),
            torch.tensor(radii[rows], dtype=torch.float32),
            fov_deg=settings.fov,
        )
        look = Look.evaluation(settings, len(chunk), kind)
        check_look(look)
        rgb = render(batch, cameras, look, gradient="none").rgb
        pictures[rows] = (rgb.clamp(0, 1) * 255).round().to(torch.uint8).cpu().numpy()
        done += len(chunk)
    return pictures
