"""A camera from where it stands and what it looks at, by cross products."""

from __future__ import annotations

import numpy as np


def look_at(eye: np.ndarray, target: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return world to camera [R | t], (3, 4); camera axes are right, up, backward.

    Without meaning where `up` is along the line of sight.
    """
    backward = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross(up, backward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(backward, right), backward])
    return np.column_stack([rotation, -rotation @ eye])


def orbit(azimuth_deg: float, elevation_deg: float, distance: float) -> np.ndarray:
    """Return [R | t] of a camera on a sphere that looks at the origin; between the poles only."""
    a, e = np.radians(azimuth_deg), np.radians(elevation_deg)
    eye = distance * np.array([np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)])
    return look_at(eye, np.zeros(3), np.array([0.0, 1.0, 0.0]))


def focal_length(image_size: int, fov_deg: float) -> float:
    """Return the focal length in pixels of a square image of this field of view."""
    return image_size / (2 * np.tan(np.radians(fov_deg) / 2))
