"""How far the cameras are from the side that is known to tell the classes apart (`builtin:one-sided`)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mvtn_cli.core.evaluation.views import standard_angles
from mvtn_cli.core.views import wrap_degrees

NEAR_DEG = 30.0
FAR_DEG = 90.0


def signed_errors(
    azimuth_deg: ArrayLike, known_azimuth_deg: ArrayLike, elevation_deg: ArrayLike | None = None
) -> NDArray[np.float64]:
    """Turn from the known side to each shape's nearest view.

    Args:
        azimuth_deg: (N, M).
        known_azimuth_deg: (N,); NaN where it is not known.
        elevation_deg: (N, M). Needed only where views may cross a pole, after which they stand on the
            other side of the shape.

    Returns:
        (N,) degrees in [-180, 180), NaN where the side is not known.
    """
    azimuth = np.asarray(azimuth_deg, dtype=np.float64)
    known = np.asarray(known_azimuth_deg, dtype=np.float64)
    if elevation_deg is not None:
        azimuth, _ = standard_angles(azimuth, elevation_deg)
    turns = wrap_degrees(azimuth - known[:, None])
    return turns[np.arange(len(turns)), np.abs(turns).argmin(axis=1)] if turns.size else np.zeros(0)


def known_view_errors(
    azimuth_deg: ArrayLike, known_azimuth_deg: ArrayLike, elevation_deg: ArrayLike | None = None
) -> dict[str, Any]:
    """Summarise the absolute errors of `signed_errors` over the shapes whose side is known.

    Returns:
        `count`; `median_deg`, `mean_deg`; `within_30`, the share not more than 30° off; `over_90`, the
        share more than 90° off. NaN if no side is known. One blind view gives 90°, 90°, 1/6 and 1/2.
    """
    errors = np.abs(signed_errors(azimuth_deg, known_azimuth_deg, elevation_deg))
    errors = errors[np.isfinite(errors)]
    if not errors.size:
        blank = float("nan")
        return {"count": 0, "median_deg": blank, "mean_deg": blank, "within_30": blank, "over_90": blank}
    return {
        "count": int(errors.size),
        "median_deg": float(np.median(errors)),
        "mean_deg": float(errors.mean()),
        "within_30": float((errors <= NEAR_DEG).mean()),
        "over_90": float((errors > FAR_DEG).mean()),
    }
