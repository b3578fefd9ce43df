"""Where the cameras went: means, spread, and whether they fell together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mvtn_cli.core.views import angle_between, circular_mean, resultant_length, view_spread, wrap_degrees

Array = NDArray[np.float64]
COINCIDENT_DEG = 5.0


def standard_angles(azimuth_deg: ArrayLike, elevation_deg: ArrayLike) -> tuple[Array, Array]:
    """Name the same directions with azimuth in [-180, 180) and elevation in [-90, 90].

    A learned camera may be said to stand at elevation 100°: that is 80°, on the other side.
    """
    azimuth, elevation = np.broadcast_arrays(wrap_degrees(azimuth_deg), wrap_degrees(elevation_deg))
    beyond = np.abs(elevation) > 90.0
    over = np.where(elevation >= 0, 180.0 - elevation, -180.0 - elevation)
    return wrap_degrees(np.where(beyond, azimuth + 180.0, azimuth)), np.where(beyond, over, elevation)


def nearest_view_deg(azimuth_deg: ArrayLike, elevation_deg: ArrayLike) -> Array:
    """Angle from each view (N, M) to the nearest other view of the same shape: (N, M); NaN for M = 1."""
    azimuth, elevation = np.asarray(azimuth_deg), np.asarray(elevation_deg)
    count, views = azimuth.shape
    if views < 2:
        return np.full((count, views), np.nan)
    nearest = np.full((count, views), np.inf)
    for other in range(1, views):  # each pairing once around, so that memory stays at N × M
        angle = angle_between(azimuth, elevation, np.roll(azimuth, other, axis=1), np.roll(elevation, other, axis=1))
        nearest = np.minimum(nearest, angle)
    return nearest


def view_statistics(
    labels: ArrayLike,
    azimuth_deg: ArrayLike,
    elevation_deg: ArrayLike,
    classes: Sequence[str],
    start: tuple[ArrayLike, ArrayLike] | None = None,
) -> dict[str, Any]:
    """Describe the cameras of N shapes.

    Args:
        labels: (N,) class indices.
        azimuth_deg: (N, M), not necessarily wrapped.
        elevation_deg: (N, M), may cross a pole.
        classes: Names of the classes.
        start: Azimuth and elevation before learning, each (M,) or (N, M).

    Returns:
        `num_views`; `spread_deg`, how much the cameras differ between shapes (mean over the views of
        `view_spread`: 0 says that every shape gets the same cameras); `nearest_view_deg`, the mean angle to
        the nearest other view of the same shape, and `coincident_share`, the share of views within 5° of
        another one: these say whether the views have collapsed onto one another, and are NaN for a single
        view; `moved_deg`, the mean angle from the start, or NaN; `per_view` and `per_class`, each with
        circular mean and resultant of the azimuth (1 all alike, 0 evenly spread) and the mean elevation.
    """
    azimuth, elevation = standard_angles(azimuth_deg, elevation_deg)
    labels = np.asarray(labels, dtype=np.int64)
    if azimuth.size == 0:
        return {"num_views": 0, "per_view": [], "per_class": []}
    gaps = nearest_view_deg(azimuth, elevation)
    single = azimuth.shape[1] < 2
    moved = np.nan if start is None else angle_between(azimuth, elevation, *start).mean()
    return {
        "num_views": int(azimuth.shape[1]),
        "spread_deg": float(view_spread(azimuth, elevation, axis=0).mean()),
        "nearest_view_deg": float("nan") if single else float(gaps.mean()),
        "coincident_share": float("nan") if single else float((gaps < COINCIDENT_DEG).mean()),
        "moved_deg": float(moved),
        "per_view": _each_view(azimuth, elevation),
        "per_class": [
            {"name": name, "count": int(mine.sum()), "views": _each_view(azimuth[mine], elevation[mine])}
            for c, name in enumerate(classes)
            if (mine := labels == c).any()
        ],
    }


def _each_view(azimuth: Array, elevation: Array) -> list[dict[str, float]]:
    means = circular_mean(azimuth, axis=0), resultant_length(azimuth, axis=0), elevation.mean(axis=0)
    return [
        {"azimuth_deg": float(a), "azimuth_resultant": float(r), "elevation_deg": float(e)}
        for a, r, e in zip(*means, strict=True)
    ]
