"""The gradient to the cameras without any cleverness: differences of finely sampled images."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numba
import numpy as np
import torch
from torch import Tensor

from mvtn_cli.console import Ticker
from mvtn_cli.core.bench.plan import TruthSetting
from mvtn_cli.core.bench.subjects import cameras_at
from mvtn_cli.core.render import Look, ShapeBatch, render

BYTES_A_SAMPLE = 34  # of the renderer's buffers, while a view is drawn
CAREFUL_BYTES = 2_000_000_000  # where the system does not tell what is free


def true_gradient(
    batch: ShapeBatch,
    azimuth_deg: np.ndarray,
    elevation_deg: np.ndarray,
    look: Look,
    weights: Mapping[str, Tensor],
    setting: TruthSetting,
    ticker: Ticker,
) -> dict[str, np.ndarray]:
    """Central differences of <weights, image> over azimuth and elevation.

    The image is that of the same renderer at 16 or more samples a pixel in each direction. It still moves silhouettes
    to where they are between two samples; so far down this changes a pixel by less than the truth's uncertainty.

    Args:
        batch: One shape.
        azimuth_deg: (M,) float64.
        elevation_deg: (M,) float64.
        look: Its `supersample` does not matter.
        weights: Name to (M, 3, H, W).
        setting: Samples and step.
        ticker: Advances by one an image.

    Returns:
        Name to (M, 2) float64, per degree.
    """
    fine = replace(look, supersample=setting.supersample)
    moved = [(m, axis, sign) for m in range(len(azimuth_deg)) for axis in (0, 1) for sign in (1, -1)]
    dots = {name: np.zeros((len(azimuth_deg), 2)) for name in weights}
    for part in _parts(moved, views_at_once(look.image_size * setting.supersample)):
        angles = np.array([[azimuth_deg[m], elevation_deg[m]] for m, _, _ in part])
        for row, (_, axis, sign) in enumerate(part):
            angles[row, axis] += sign * setting.step_deg
        images = render(batch, cameras_at(*angles.T), fine, gradient="none").rgb[0]
        for name, weight in weights.items():
            for row, (m, axis, sign) in enumerate(part):
                dots[name][m, axis] += sign * inner_product(images[row], weight[m]) / (2 * setting.step_deg)
        ticker.advance(len(part))
    return dots


def images_of_truth(num_views: int) -> int:
    """How many images `true_gradient` draws."""
    return 4 * num_views


def views_at_once(side: int) -> int:
    """How many views of `side` samples squared fit into half the free memory; at most one a thread."""
    try:
        free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        free = 2 * CAREFUL_BYTES
    fitting = int(free / 2 / (BYTES_A_SAMPLE * side * side))
    return max(1, min(numba.get_num_threads(), fitting))


def inner_product(a: Tensor, b: Tensor) -> float:
    """Sum of products in float64."""
    return float(torch.dot(a.double().flatten(), b.double().flatten()))


def _parts(items: list, size: int) -> Iterator[list]:
    for start in range(0, len(items), size):
        yield items[start : start + size]
