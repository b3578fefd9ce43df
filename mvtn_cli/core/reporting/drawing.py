"""Take all pictures of a shape that a camera gives: colours, silhouette, depth and normals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from mvtn_cli.core.render import Look, ShapeBatch, check_look, render
from mvtn_cli.core.views import Cameras, camera_rotations

PIXELS_AT_ONCE = 1 << 24  # of all views that are in memory as floats; 16 views of 1024²
OPAQUE = 0.5  # where points cover more of a pixel than this, the pixel belongs to the shape


@dataclass(frozen=True)
class Pictures:
    """What M cameras see of one shape.

    Attributes:
        kind: Whether a `mesh` or `points` were drawn.
        rgb: (M, 3, H, W) uint8.
        silhouette: (M, H, W) bool, or None where it was not asked for; so are the next three.
        depth: (M, H, W) float32 along the optical axis, in shape radii; 0 is background. Of points it is the
            mean over those that make up the pixel, weighted by how much of it each of them covers.
        normals: (M, 3, H, W) float32 unit vectors towards the camera, world frame; 0 is background. Meshes only.
        face_ids: (M, H, W) int32, -1 is background. Meshes only.
    """

    kind: str
    rgb: NDArray[np.uint8]
    silhouette: NDArray[np.bool_] | None = None
    depth: NDArray[np.float32] | None = None
    normals: NDArray[np.float32] | None = None
    face_ids: NDArray[np.int32] | None = None


def draw_pictures(
    batch: ShapeBatch,
    kind: str,
    cameras: Cameras,
    settings: Any,
    *,
    geometry: bool = False,
    light: torch.Tensor | None = None,
) -> Pictures:
    """Draw one shape as an evaluation does: white, under a headlight.

    Args:
        batch: One shape.
        kind: `mesh` or `points`.
        cameras: (1, M).
        settings: The picture's: image_size, look, shading, supersample, point_radius, depth_cue.
        geometry: Silhouette and depth are wanted, and of meshes normals and face ids.
        light: (1, M, 3) directions towards the light of each view, instead of the headlight.
    """
    look = Look.evaluation(settings, 1, kind)
    check_look(look)
    whole: dict[str, NDArray[Any]] = {}
    for views in _groups(cameras.num_views, look.image_size):
        own = None if light is None else light[:, views]
        part = draw_with(look, batch, cameras.select(views=views), geometry, own)
        for name in ("rgb", "silhouette", "depth", "normals", "face_ids"):
            if (array := getattr(part, name)) is not None:
                room = whole.setdefault(name, np.empty((cameras.num_views, *array.shape[1:]), array.dtype))
                room[views] = array
    return Pictures(kind, **whole)


def _groups(num_views: int, image_size: int) -> Iterator[slice]:
    """Cut the views into as many as fit into memory at once."""
    size = max(1, PIXELS_AT_ONCE // image_size**2)
    return (slice(begin, begin + size) for begin in range(0, num_views, size))


def draw_with(
    look: Look, batch: ShapeBatch, cameras: Cameras, geometry: bool, light: torch.Tensor | None = None
) -> Pictures:
    """Draw one shape in any look, all views at once; arguments as for `draw_pictures`."""
    mesh = look.kind == "mesh"
    seen = render(batch, cameras, look, gradient="none", outputs=("geometry",) if geometry and mesh else ())
    rgb = _to_bytes(seen.rgb[0])
    if light is not None and mesh:
        rgb = np.concatenate([_draw_lit(batch, look, cameras, light, view) for view in range(cameras.num_views)])
    if not geometry:
        return Pictures(look.kind, rgb)
    if seen.face_ids is None or seen.depth is None or seen.normals is None:
        coverage, depth = point_geometry(batch, look, cameras)
        return Pictures(look.kind, rgb, coverage > OPAQUE, depth)
    return Pictures(look.kind, rgb, seen.face_ids[0] >= 0, seen.depth[0], seen.normals[0], seen.face_ids[0])


def _draw_lit(batch: ShapeBatch, look: Look, cameras: Cameras, light: torch.Tensor, view: int) -> NDArray[np.uint8]:
    lit = replace(look, light_direction=light[:, view].detach().cpu().float().numpy())
    return _to_bytes(render(batch, cameras.select(views=[view]), lit, gradient="none").rgb[0])


def _to_bytes(rgb: torch.Tensor) -> NDArray[np.uint8]:
    return (rgb.clamp(0, 1) * 255).round().to(torch.uint8).cpu().numpy()


def point_geometry(batch: ShapeBatch, look: Look, cameras: Cameras) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Coverage and depth of one point cloud.

    The renderer blends colours, so depth is drawn as one: red says how far away a point is, green that it is there.

    Args:
        batch: One shape.
        look: Of points.
        cameras: (1, M).

    Returns:
        Coverage (M, H, W) in [0, 1], and depth (M, H, W) in shape radii, 0 where the coverage is not above a half.
    """
    views, distance = cameras.num_views, cameras.distance[0].double()
    points = batch.points[0].double()
    reach = points.norm(dim=-1).max()
    near = distance - reach
    backward = camera_rotations(cameras.azimuth_deg[0], cameras.elevation_deg[0])[:, 2]
    red = ((distance[:, None] - backward @ points.T - near[:, None]) / (2 * reach)).clamp(0, 1)  # (M, P)
    colors = torch.stack([red, torch.ones_like(red), torch.zeros_like(red)], dim=-1).float().numpy()
    copies = replace(
        batch,
        points=batch.points.expand(views, -1, -1).contiguous(),
        point_colors=np.ascontiguousarray(colors),
        labels=batch.labels.expand(views),
        names=batch.names * views,
    )
    plain = replace(look, colors=np.ones((views, 3), np.float32), background=(0.0, 0.0, 0.0), depth_cue=0.0)
    each_its_own = Cameras(cameras.azimuth_deg.T, cameras.elevation_deg.T, cameras.distance.T, cameras.fov_deg)
    seen = render(copies, each_its_own, plain, gradient="none").rgb[:, 0].cpu().numpy()
    coverage = seen[:, 1]
    depth = near.numpy()[:, None, None] + 2 * float(reach) * seen[:, 0] / np.maximum(coverage, 1e-6)
    return coverage, np.where(coverage > OPAQUE, depth, 0).astype(np.float32)
