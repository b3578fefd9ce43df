"""Cameras in closed form, view layouts and their symmetries, and how far two views are apart."""

from mvtn_cli.core.views.cameras import Cameras, camera_jacobian, camera_positions, camera_rotations
from mvtn_cli.core.views.layout import LAYOUTS, layouts
from mvtn_cli.core.views.statistics import (
    angle_between,
    circular_mean,
    resultant_length,
    view_spread,
    wrap_degrees,
)
from mvtn_cli.core.views.symmetry import Symmetries, layout_symmetries

__all__ = [
    "LAYOUTS",
    "Cameras",
    "Symmetries",
    "angle_between",
    "camera_jacobian",
    "camera_positions",
    "camera_rotations",
    "circular_mean",
    "layout_symmetries",
    "layouts",
    "resultant_length",
    "view_spread",
    "wrap_degrees",
]
