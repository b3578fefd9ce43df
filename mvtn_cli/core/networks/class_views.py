"""One set of views for each class: what is left of learned views when they no longer see the shape itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mvtn_cli.core.views import circular_mean


def class_mean_views(
    azimuth_deg: ArrayLike, elevation_deg: ArrayLike, labels: ArrayLike, num_classes: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The circular mean of each view's angles over the shapes of a class.

    Args:
        azimuth_deg: (N, M), need not be wrapped.
        elevation_deg: (N, M), may lie beyond a pole.
        labels: (N,), -1 where unknown: such shapes count for no class.
        num_classes: C.

    Returns:
        Azimuth and elevation, each (C, M) in [-180, 180); a class without shapes has the mean over all shapes.
    """
    angles = np.stack([np.asarray(azimuth_deg, np.float64), np.asarray(elevation_deg, np.float64)])
    known = np.asarray(labels)
    everything = circular_mean(angles, axis=1)
    means = np.repeat(everything[:, None], num_classes, axis=1)
    for label in np.unique(known[known >= 0]):
        means[:, label] = circular_mean(angles[:, known == label], axis=1)
    return means[0], means[1]
