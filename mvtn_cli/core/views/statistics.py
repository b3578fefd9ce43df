"""How far two views are apart, and means of angles.

Azimuths are free to leave ±180° while a network learns; only what is counted or shown is wrapped.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def wrap_degrees(angle_deg: ArrayLike) -> NDArray[np.float64]:
    """Angles brought to [-180, 180)."""
    wrapped = np.mod(np.asarray(angle_deg, dtype=np.float64) + 180.0, 360.0) - 180.0
    # mod(-tiny, 360) rounds to 360 itself
    return np.where(wrapped >= 180.0, -180.0, wrapped)


def angle_between(
    azimuth1_deg: ArrayLike, elevation1_deg: ArrayLike, azimuth2_deg: ArrayLike, elevation2_deg: ArrayLike
) -> NDArray[np.float64]:
    """Angle at the origin between two camera directions, in degrees, 0..180.

    The haversine of the angle and that of its supplement are each a sum of squares of sines, so that neither
    angles near 0 nor angles near 180 lose digits, as they do with the arc cosine of a dot product.

    Args:
        azimuth1_deg, elevation1_deg, azimuth2_deg, elevation2_deg: broadcastable; neither needs wrapping, and
            elevations may lie beyond the poles.
    """
    a1, e1, a2, e2 = (
        np.deg2rad(np.asarray(x, dtype=np.float64))
        for x in (azimuth1_deg, elevation1_deg, azimuth2_deg, elevation2_deg)
    )
    half_azimuth = (a2 - a1) / 2
    cosines = np.cos(e1) * np.cos(e2)
    near = np.sin((e2 - e1) / 2) ** 2 + cosines * np.sin(half_azimuth) ** 2
    far = np.sin((e2 + e1) / 2) ** 2 + cosines * np.cos(half_azimuth) ** 2
    # beyond the poles `cosines` may be negative, and a sum that is zero may come out as -1e-17
    return np.rad2deg(2 * np.arctan2(np.sqrt(np.maximum(near, 0.0)), np.sqrt(np.maximum(far, 0.0))))


def circular_mean(angle_deg: ArrayLike, axis: int | None = None) -> NDArray[np.float64]:
    """Mean direction of angles on a circle, in [-180, 180); without meaning where they cancel out."""
    angle = np.deg2rad(np.asarray(angle_deg, dtype=np.float64))
    mean = np.arctan2(np.sin(angle).mean(axis=axis), np.cos(angle).mean(axis=axis))
    return wrap_degrees(np.rad2deg(mean))


def resultant_length(angle_deg: ArrayLike, axis: int | None = None) -> NDArray[np.float64]:
    """Length of the mean of the unit vectors of angles on a circle: 1 all alike, 0 evenly spread."""
    angle = np.deg2rad(np.asarray(angle_deg, dtype=np.float64))
    return np.hypot(np.sin(angle).mean(axis=axis), np.cos(angle).mean(axis=axis))


def view_spread(azimuth_deg: ArrayLike, elevation_deg: ArrayLike, axis: int | None = None) -> NDArray[np.float64]:
    """Angular deviation of camera directions on the sphere along `axis`, in degrees.

    sqrt(2 · (1 - |mean direction|)), in degrees: 0 where all cameras look from one side, 81.03 where they
    are spread evenly. Over the shapes of a batch (axis 0) a value near 0 says that the views do not depend on
    the shape.
    For small spreads it is the root mean square angle to the mean direction.
    """
    a, e = (np.deg2rad(np.asarray(x, dtype=np.float64)) for x in (azimuth_deg, elevation_deg))
    components = (np.cos(e) * np.sin(a), np.sin(e) * np.ones_like(a), np.cos(e) * np.cos(a))
    mean = [component.mean(axis=axis, keepdims=True) for component in components]
    length = np.sqrt(sum(m**2 for m in mean))
    # 1 - length, without the loss of digits of that difference: the variance over (1 + length)
    variance = sum(((c - m) ** 2).mean(axis=axis) for c, m in zip(components, mean, strict=True))
    result: NDArray[np.float64] = np.rad2deg(np.sqrt(2 * variance / (1 + length.reshape(np.shape(variance)))))
    return result
