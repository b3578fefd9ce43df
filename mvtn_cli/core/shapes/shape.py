"""What a shape is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
ColorArray = npt.NDArray[np.float32]
FaceArray = npt.NDArray[np.int32]
UpAxis = Literal["y", "z"]


@dataclass(frozen=True, eq=False)
class Shape:
    """One object as read, or as repaired: a triangle mesh, or a point cloud.

    Attributes:
        vertices: (V, 3) float64 in file units, y up; empty for a point cloud.
        faces: (F, 3) int32 indices into `vertices`; unchecked until `validate` has seen them.
        colors: (V, 3) float32 in [0, 1], or None. As read, a vertex without a colour is NaN until `validate`.
        points: (P, 3) float64 of a point cloud, else None.
        point_colors: (P, 3) float32 like `colors`, or None.
        name: Short name shown to people.
        source: Where it came from, in printable characters.
        known_azimuth_deg: Azimuth of the one side that tells its class, for made data; None if not known.
    """

    vertices: FloatArray
    faces: FaceArray
    colors: ColorArray | None = None
    points: FloatArray | None = None
    point_colors: ColorArray | None = None
    name: str = ""
    source: str = ""
    known_azimuth_deg: float | None = None

    @property
    def is_cloud(self) -> bool:
        """Whether this is a point cloud: points given, and no face."""
        return self.points is not None and len(self.faces) == 0


def cloud(points: FloatArray, colors: ColorArray | None = None, *, name: str = "", source: str = "") -> Shape:
    """Build the `Shape` of a point cloud from (P, 3) points."""
    return Shape(
        vertices=np.zeros((0, 3)),
        faces=np.zeros((0, 3), np.int32),
        points=np.ascontiguousarray(points, dtype=np.float64),
        point_colors=colors,
        name=name,
        source=source,
    )


def turn_y_up(shape: Shape) -> Shape:
    """Turn a shape whose up axis is z by -90 degrees about x: (x, y, z) becomes (x, z, -y)."""
    points = None if shape.points is None else _turned(shape.points)
    return replace(shape, vertices=_turned(shape.vertices), points=points)


def _turned(xyz: FloatArray) -> FloatArray:
    return np.column_stack([xyz[:, 0], xyz[:, 2], -xyz[:, 1]])
