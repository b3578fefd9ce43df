"""Pin-hole cameras that look at the origin, in closed form.

World: right-handed, y up. Camera axes: x right, y up, looking along -z (OpenGL).
With azimuth a, elevation e, distance d:

    centre    C = d · ( cos e · sin a,  sin e,   cos e · cos a )
    right     r =     ( cos a,          0,      -sin a         )
    up        u =     (-sin e · sin a,  cos e,  -sin e · cos a )
    backward  b =     ( cos e · sin a,  sin e,   cos e · cos a )
    world to camera:  x_camera = R · x_world + t,   R = [r; u; b],  t = (0, 0, -d)

No cross product and no up vector: the axes are orthonormal and smooth for all angles, at the poles and
beyond them. `docs/cameras.md` tells how to get from here to OpenCV, PyTorch3D and NeRF files.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor


def _radians64(angle_deg: Tensor) -> Tensor:
    """Angles in radians, float64 (on the CPU where the device has no float64)."""
    if angle_deg.device.type == "mps":
        angle_deg = angle_deg.cpu()
    return torch.deg2rad(angle_deg.double())


def camera_rotations(azimuth_deg: Tensor, elevation_deg: Tensor) -> Tensor:
    """World-to-camera rotations R = [right; up; backward].

    Args:
        azimuth_deg: (...) of any float type; not wrapped, so that its gradient has no jump.
        elevation_deg: (...) broadcastable to it; may cross the poles.

    Returns:
        (..., 3, 3) float64, differentiable.
    """
    a, e = torch.broadcast_tensors(_radians64(azimuth_deg), _radians64(elevation_deg))
    sin_a, cos_a, sin_e, cos_e = a.sin(), a.cos(), e.sin(), e.cos()
    right = torch.stack([cos_a, torch.zeros_like(a), -sin_a], dim=-1)
    up = torch.stack([-sin_e * sin_a, cos_e, -sin_e * cos_a], dim=-1)
    backward = torch.stack([cos_e * sin_a, sin_e, cos_e * cos_a], dim=-1)
    return torch.stack([right, up, backward], dim=-2)


def camera_positions(azimuth_deg: Tensor, elevation_deg: Tensor, distance: Tensor | float) -> Tensor:
    """Camera centres in world coordinates, (..., 3) float64: `distance` times the backward axis."""
    backward = camera_rotations(azimuth_deg, elevation_deg)[..., 2, :]
    if isinstance(distance, Tensor):
        return backward * distance.to(backward)[..., None]
    return backward * distance


def camera_jacobian(azimuth_deg: Tensor, elevation_deg: Tensor) -> tuple[Tensor, Tensor]:
    """How the rotation changes with the angles.

    A gradient dL/dR turns into dL/dazimuth = sum(dL/dR · dR/dazimuth), and the same for elevation.

    Args:
        azimuth_deg: (...) degrees.
        elevation_deg: (...) degrees.

    Returns:
        dR/dazimuth and dR/delevation, each (..., 3, 3) float64, per degree.
    """
    a, e = torch.broadcast_tensors(_radians64(azimuth_deg), _radians64(elevation_deg))
    sin_a, cos_a, sin_e, cos_e = a.sin(), a.cos(), e.sin(), e.cos()
    zero = torch.zeros_like(a)
    by_azimuth = torch.stack(
        [
            torch.stack([-sin_a, zero, -cos_a], dim=-1),
            torch.stack([-sin_e * cos_a, zero, sin_e * sin_a], dim=-1),
            torch.stack([cos_e * cos_a, zero, -cos_e * sin_a], dim=-1),
        ],
        dim=-2,
    )
    rotation = camera_rotations(azimuth_deg, elevation_deg)
    up, backward = rotation[..., 1, :], rotation[..., 2, :]
    by_elevation = torch.stack([torch.zeros_like(up), -backward, up], dim=-2)
    per_degree = torch.pi / 180.0
    return by_azimuth * per_degree, by_elevation * per_degree


@dataclass(frozen=True)
class Cameras:
    """B × M cameras that look at the origin.

    Attributes:
        azimuth_deg: (B, M) float32. 0 looks from +z, 90 from +x. Not wrapped.
        elevation_deg: (B, M) float32. 90 looks from +y. Beyond ±90 the picture goes on,
            upside down.
        distance: (B, M) float32, from the origin, in shape radii.
        fov_deg: Vertical field of view in degrees.
    """

    azimuth_deg: Tensor
    elevation_deg: Tensor
    distance: Tensor
    fov_deg: float = 60.0

    def __post_init__(self) -> None:
        shapes = {tuple(field.shape) for field in (self.azimuth_deg, self.elevation_deg, self.distance)}
        if len(shapes) != 1 or self.azimuth_deg.ndim != 2:
            raise ValueError(f"azimuth_deg, elevation_deg and distance must all be (B, M), got {sorted(shapes)}")
        if not 0.0 < self.fov_deg < 180.0:
            raise ValueError(f"fov_deg must lie between 0 and 180, got {self.fov_deg}")

    @classmethod
    def at(
        cls,
        azimuth_deg: Tensor | Sequence[float],
        elevation_deg: Tensor | Sequence[float],
        distance: Tensor | float = 2.2,
        *,
        fov_deg: float = 60.0,
        batch: int = 1,
    ) -> Cameras:
        """Cameras from (M,) or (B, M) angles; (M,) angles, also numpy's, serve all `batch` shapes alike."""
        azimuth = torch.as_tensor(azimuth_deg).float()
        elevation = torch.as_tensor(elevation_deg).float().to(azimuth.device)
        if azimuth.ndim == 1:
            azimuth = azimuth.expand(batch, -1)
        azimuth, elevation = torch.broadcast_tensors(azimuth, elevation)
        far = torch.as_tensor(distance, device=azimuth.device).float().expand_as(azimuth)
        return cls(azimuth, elevation, far, fov_deg)

    def __len__(self) -> int:
        return int(self.azimuth_deg.shape[0])

    @property
    def num_views(self) -> int:
        """M, the number of views of each shape."""
        return int(self.azimuth_deg.shape[1])

    @property
    def rt(self) -> Tensor:
        """(B, M, 3, 4) float32 world-to-camera matrices [R | t], differentiable; float64 inside."""
        rotation = camera_rotations(self.azimuth_deg, self.elevation_deg)
        zero = torch.zeros_like(rotation[..., 0, 0])
        shift = torch.stack([zero, zero, -self.distance.to(rotation)], dim=-1)
        return torch.cat([rotation, shift[..., None]], dim=-1).to(self.azimuth_deg.device, torch.float32)

    @property
    def positions(self) -> Tensor:
        """(B, M, 3) float32 camera centres in world coordinates, differentiable."""
        where = camera_positions(self.azimuth_deg, self.elevation_deg, self.distance)
        return where.to(self.azimuth_deg.device, torch.float32)

    def detach(self) -> Cameras:
        """The same cameras, cut from the graph."""
        return self._map(Tensor.detach)

    def to(self, device: torch.device | str) -> Cameras:
        """The same cameras on another device."""
        return self._map(lambda field: field.to(device))

    def select(
        self,
        shapes: Tensor | slice | list[int] = slice(None),
        views: Tensor | slice | list[int] = slice(None),
    ) -> Cameras:
        """Some of the shapes, then some of their views; both stay (B', M')."""
        return self._map(lambda field: field[shapes][:, views])

    def _map(self, function: Callable[[Tensor], Tensor]) -> Cameras:
        return replace(
            self,
            azimuth_deg=function(self.azimuth_deg),
            elevation_deg=function(self.elevation_deg),
            distance=function(self.distance),
        )
