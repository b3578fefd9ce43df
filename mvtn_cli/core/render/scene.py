"""The one call: `render(batch, cameras, look)`."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
import torch

from mvtn_cli.core.render.batch import ShapeBatch
from mvtn_cli.core.render.devices import drawing_device, is_gpu
from mvtn_cli.core.render.look import Look
from mvtn_cli.core.render.mesh import EdgeFlow, FiniteDifferences, MeshScene, camera_matrices, focal_pixels
from mvtn_cli.core.render.points import RenderPoints
from mvtn_cli.core.render.skips import FIXED_VIEWS, active_skips
from mvtn_cli.core.render.view_keeper import KeptBatch, kept_images
from mvtn_cli.core.views import Cameras
from mvtn_cli.errors import DataError

GRADIENTS = ("edge-flow", "shading", "fd", "none")


@dataclass(frozen=True)
class Images:
    """What `render` gives.

    Attributes:
        rgb: (B, M, 3, H, W) float32 in [0, 1]; carries the gradient to the cameras.
        face_ids: (B, M, H, W) int32, -1 for background, on request ("geometry"); meshes only.
        depth: (B, M, H, W) float32 distance along the optical axis in radii, 0 for background, on request.
        normals: (B, M, 3, H, W) float32 world normals towards the eye, 0 for background, on request.
    """

    rgb: torch.Tensor
    face_ids: np.ndarray | None = None
    depth: np.ndarray | None = None
    normals: np.ndarray | None = None


def render(
    batch: ShapeBatch,
    cameras: Cameras,
    look: Look,
    *,
    gradient: str = "edge-flow",
    fd_step_deg: float = 2.0,
    outputs: Collection[str] = (),
    skips: int | None = None,
) -> Images:
    """Draw every shape of the batch from each of its M cameras.

    Args:
        batch: B shapes; a `KeptBatch` (view_keeper.py) is seen once from cameras that take no gradient, and painted
            ever after, unless `skips` lacks `fixed-views`.
        cameras: (B, M) cameras; those on a CUDA device are drawn there if `numba-cuda` is installed (`docs/gpu.md`),
            those on any other on the CPU and copied.
        look: Light, colour, size; its `kind` says whether faces or points are drawn.
        gradient: Carries a gradient to azimuth, elevation and distance: "edge-flow" analytically, "shading" without
            silhouettes and creases, for comparison, "fd" by central differences of the image itself; points have their
            exact one with all. "none" carries none.
        fd_step_deg: Step of `fd`, degrees.
        outputs: "geometry" asks for face ids, depth and normals (meshes).
        skips: Bits of `skips.py`: what may be left out; None: as `use_skips` said.

    Raises:
        DataError: Faces are asked of a shape that has none.
        ValueError: An unknown gradient mode.
    """
    if gradient not in GRADIENTS:
        raise ValueError(f"gradient must be one of {GRADIENTS}, got {gradient!r}")
    device = drawing_device(cameras.azimuth_deg.device)
    skips = active_skips() if skips is None else skips
    counts = {"cameras": len(cameras), "colours": len(look.colors)}
    if look.light_direction is not None:
        counts["lights"] = len(look.light_direction)
    for what, count in counts.items():
        if count != len(batch):
            raise ValueError(f"{what} are for {count} shapes, the batch has {len(batch)}")
    if gradient == "none":
        cameras = cameras.detach()
    if look.kind == "points":
        return Images(rgb=_points(batch, cameras, look, device))
    on_gpu = is_gpu(device) and gradient != "fd"
    if isinstance(batch, KeptBatch) and on_gpu:
        batch = batch.packed()
    if isinstance(batch, KeptBatch):
        matrices = camera_matrices(cameras.azimuth_deg, cameras.elevation_deg, cameras.distance)
        if skips & FIXED_VIEWS and "geometry" not in outputs and not matrices.requires_grad:
            pictures = torch.from_numpy(kept_images(batch, matrices.numpy(), look, cameras.fov_deg, skips))
            return Images(rgb=pictures.to(cameras.azimuth_deg.device))
        batch = batch.packed()
    if not batch.has_meshes:
        empty = [name for name, n in zip(batch.names, np.diff(batch.offsets[1]), strict=False) if n == 0]
        raise DataError(
            f"no faces to draw in {', '.join(empty[:3]) or 'this batch'}", hint="draw points instead: --render points"
        )
    if on_gpu:
        return _on_gpu(batch, cameras, look, outputs, skips, device, edges=gradient != "shading")
    scene = MeshScene(batch, look, cameras.fov_deg, skips)
    parameters = (cameras.azimuth_deg, cameras.elevation_deg, cameras.distance)
    matrices = camera_matrices(*parameters)
    if gradient == "fd" and matrices.requires_grad:
        rgb = FiniteDifferences.apply(*parameters, scene, fd_step_deg)
    else:
        rgb = EdgeFlow.apply(matrices, scene, gradient != "shading").to(cameras.azimuth_deg.device)
    if "geometry" not in outputs:
        return Images(rgb=rgb)
    return Images(rgb, *geometry(MeshScene(batch, replace(look, supersample=1), cameras.fov_deg, skips), matrices))


def _on_gpu(
    batch: ShapeBatch, cameras: Cameras, look: Look, outputs: Collection[str], skips: int, device: torch.device, *,
    edges: bool,
) -> Images:  # fmt: skip
    from mvtn_cli.core.render.gpu.mesh import GpuEdgeFlow, GpuMeshScene

    matrices = camera_matrices(cameras.azimuth_deg, cameras.elevation_deg, cameras.distance, device)
    rgb = GpuEdgeFlow.apply(matrices, GpuMeshScene(batch, look, cameras.fov_deg, device, skips), edges)
    if "geometry" not in outputs:
        return Images(rgb=rgb)
    scene = GpuMeshScene(batch, replace(look, supersample=1), cameras.fov_deg, device, skips)
    return Images(rgb, *scene.geometry(matrices))


def geometry(scene: MeshScene, matrices: torch.Tensor) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return face ids (B,M,H,W) int32, depth (B,M,H,W) and world normals (B,M,3,H,W) at pixel centres."""
    buffers = scene.see(matrices.detach().numpy())
    covered = buffers.ids >= 0
    depth = np.divide(1.0, buffers.depth, out=np.zeros_like(buffers.depth), where=covered)
    normals = np.where(covered[..., None], buffers.normals, 0.0).transpose(0, 3, 1, 2)
    lead = matrices.shape[:2]
    arrays = (array[buffers.view_of] for array in (buffers.ids, depth, normals))
    ids, depth, normals = (array.reshape(*lead, *array.shape[1:]) for array in arrays)
    return ids, depth, np.ascontiguousarray(normals)


def _points(batch: ShapeBatch, cameras: Cameras, look: Look, device: torch.device) -> torch.Tensor:
    colors = np.repeat(look.colors[:, None], batch.points.shape[1], 1)
    if batch.point_colors is not None:
        colors = colors * batch.point_colors
    focal = focal_pixels(look.image_size, cameras.fov_deg)
    radii = look.point_radii(*batch.points.shape[:2])
    matrices = camera_matrices(cameras.azimuth_deg, cameras.elevation_deg, cameras.distance, device)
    if is_gpu(device):
        from mvtn_cli.core.render.gpu.points import GpuPointScene, GpuRenderPoints

        return GpuRenderPoints.apply(matrices, GpuPointScene(batch.points, colors, radii, focal, look, device))
    cloud = (batch.points.cpu().numpy().astype(np.float64), np.ascontiguousarray(colors, np.float64), radii)
    images = RenderPoints.apply(matrices, *cloud, focal, look.depth_cue, look.background, look.image_size)
    return images.to(cameras.azimuth_deg.device)
