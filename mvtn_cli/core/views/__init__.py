"""Cameras in closed form, view layouts, and how far two views are apart."""

from mvtn_cli.core.views.cameras import Cameras, camera_jacobian, camera_positions, camera_rotations
from mvtn_cli.core.views.layout import LAYOUTS, layouts
from mvtn_cli.core.views.statistics import (
    angle_between,
    circular_mean,
    resultant_length,
    view_spread,
    wrap_degrees,
)

__all__ = [
    "LAYOUTS",
    "Cameras",
    "angle_between",
    "camera_jacobian",
    "camera_positions",
    "camera_rotations",
    "circular_mean",
    "layouts",
    "resultant_length",
    "view_spread",
    "wrap_degrees",
]
