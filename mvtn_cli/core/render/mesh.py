"""Images of batches of meshes, with two gradients to the cameras.

`edge-flow` reduces the incoming gradient straight to the twelve numbers of each view's [R|t] (flow.py); `fd` takes
central differences of the very image that is drawn: four more images a view for azimuth and elevation, two more for
distance where it is asked for. `fd` is the checker of the other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch

from mvtn_cli.core.render.batch import ShapeBatch
from mvtn_cli.core.render.compiled import njit, parallel_chunksize, prange
from mvtn_cli.core.render.edges import COLUMNS
from mvtn_cli.core.render.look import Look
from mvtn_cli.core.render.shade import geometry_view
from mvtn_cli.core.render.view import differentiate_view, draw_view, draw_view_alone
from mvtn_cli.core.views import camera_rotations


@njit(cache=True, parallel=True)
def draw_views(
    vertices, normals, colors, faces, face_edges, edge_starts, edge_faces, offsets, rts, shape_of, focal, supersample,
    smooth, lights, albedos, material, background, weights, images, dots,
):  # fmt: skip
    """Draw view n of shape `shape_of[n]` for all n in parallel, keeping no buffers.

    With `weights` (K,3,H,W) not empty no image is kept either: dots[n] = <weights[n mod K], image n>.
    `offsets` (4, B+1): where each shape's vertices, faces, edges and edge faces begin.
    """
    for n in prange(rts.shape[0]):
        b = shape_of[n]
        v0, v1, f0, f1 = offsets[0, b], offsets[0, b + 1], offsets[1, b], offsets[1, b + 1]
        keep = weights.shape[0] == 0
        image = images[n] if keep else np.empty(weights.shape[1:], np.float32)
        draw_view_alone(
            vertices[v0:v1], normals[v0:v1], colors[v0:v1], faces[f0:f1], face_edges[f0:f1],
            edge_starts[offsets[2, b] : offsets[2, b + 1]], edge_faces[offsets[3, b] : offsets[3, b + 1]],
            rts[n], focal, supersample, smooth, lights[b], no_direction(lights[b]), albedos[b], material, background,
            image,
        )  # fmt: skip
        if not keep:
            dots[n] = inner_product(weights[n % weights.shape[0]], image)


@njit(cache=True)
def no_direction(light):
    """Whether this shape's light is a headlight: its direction is zero."""
    return light[0] == 0.0 and light[1] == 0.0 and light[2] == 0.0


@njit(cache=True)
def inner_product(a, b):
    """Sum of products of two (C,H,W) arrays, in float64."""
    total = 0.0
    for c in range(a.shape[0]):
        for j in range(a.shape[1]):
            for i in range(a.shape[2]):
                total += a[c, j, i] * b[c, j, i]
    return total


@njit(cache=True, parallel=True)
def draw_views_keeping(
    vertices, normals, colors, faces, face_edges, edge_starts, edge_faces, offsets, rts, shape_of, focal, supersample,
    smooth, lights, albedos, material, background, ids, inverse_depth, samples, breaks, records, where,
    counts, images,
):  # fmt: skip
    """Draw every view and keep the sample buffers that the gradient needs."""
    for n in prange(rts.shape[0]):
        b = shape_of[n]
        v0, v1, f0, f1 = offsets[0, b], offsets[0, b + 1], offsets[1, b], offsets[1, b + 1]
        counts[n] = draw_view(
            vertices[v0:v1], normals[v0:v1], colors[v0:v1], faces[f0:f1], face_edges[f0:f1],
            edge_starts[offsets[2, b] : offsets[2, b + 1]], edge_faces[offsets[3, b] : offsets[3, b + 1]],
            rts[n], focal, supersample, smooth, lights[b], no_direction(lights[b]), albedos[b], material, background,
            ids[n], inverse_depth[n], samples[n], breaks[n], records[n], where[n], images[n],
        )  # fmt: skip


@njit(cache=True, parallel=True)
def differentiate_views(
    vertices, normals, colors, faces, offsets, rts, shape_of, focal, supersample, smooth, lights, albedos,
    material, ids, inverse_depth, samples, breaks, records, where, counts, weights, out,
):  # fmt: skip
    """Reduce `weights` (N,3,H,W) to `out` (N,3,4), view by view."""
    for n in prange(rts.shape[0]):
        b = shape_of[n]
        v0, v1, f0, f1 = offsets[0, b], offsets[0, b + 1], offsets[1, b], offsets[1, b + 1]
        differentiate_view(
            vertices[v0:v1], normals[v0:v1], colors[v0:v1], faces[f0:f1], rts[n], focal, supersample, smooth,
            lights[b], no_direction(lights[b]), albedos[b], material, ids[n], inverse_depth[n], samples[n], breaks[n],
            records[n], where[n], counts[n], weights[n], out[n],
        )  # fmt: skip


@njit(cache=True, parallel=True)
def draw_geometry(vertices, normals, faces, offsets, rts, shape_of, focal, smooth, ids, depth, normal_images):
    """Fill face ids, depth and world normals at pixel centres, view by view."""
    for n in prange(rts.shape[0]):
        b = shape_of[n]
        v0, v1, f0, f1 = offsets[0, b], offsets[0, b + 1], offsets[1, b], offsets[1, b + 1]
        geometry_view(
            vertices[v0:v1], normals[v0:v1], faces[f0:f1], rts[n], focal, smooth, ids[n], depth[n], normal_images[n]
        )


def focal_pixels(image_size: int, fov_deg: float) -> float:
    """Focal length in pixels of a square image whose vertical field of view is `fov_deg`."""
    return image_size / 2 / math.tan(math.radians(fov_deg) / 2)


# Silhouette crossings that there is room for, per row of samples; a view with more is drawn again with enough.
ROOM = 32


@dataclass(frozen=True)
class Buffers:
    """What the forward pass keeps for `edge-flow`: about 30 bytes a sample, and 36 a silhouette crossing."""

    rts: np.ndarray
    arrays: tuple[np.ndarray, ...]


class MeshScene:
    """A batch and a look, ready to be drawn from any cameras."""

    def __init__(self, batch: ShapeBatch, look: Look, fov_deg: float) -> None:
        self.batch, self.look = batch, look
        self.size = look.image_size
        self.focal = focal_pixels(look.image_size, fov_deg)
        light = look.light_direction
        lights = np.zeros((len(batch), 3)) if light is None else light.astype(np.float64)
        mesh = (batch.vertices, batch.normals, batch.colors, batch.faces)
        self.mesh = (*mesh, batch.face_edges, batch.edge_starts, batch.edge_faces, batch.offsets)
        self.plain_mesh = (*mesh, batch.offsets)
        albedos = np.ascontiguousarray(look.colors, np.float64)
        samples = (self.focal * look.supersample, look.supersample, look.shading == "smooth")
        self.shading = (*samples, lights, albedos, look.material)
        self.background = np.array(look.background)

    def _views(self, rts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Flatten (..., B, M, 3, 4) matrices; say which shape each belongs to."""
        shape_of = np.repeat(np.arange(len(self.batch)), rts.shape[-3])
        flat = np.ascontiguousarray(rts.reshape(-1, 3, 4))
        return flat, np.tile(shape_of, len(flat) // len(shape_of))

    def images(self, rts: np.ndarray) -> np.ndarray:
        """Draw (B, M, 3, 4) cameras: (B, M, 3, H, W) float32."""
        flat, shape_of = self._views(rts)
        images = np.empty((len(flat), 3, self.size, self.size), np.float32)
        with parallel_chunksize(1):
            draw_views(
                *self.mesh, flat, shape_of, *self.shading, self.background, np.empty_like(images[:0]), images,
                np.empty(0),
            )  # fmt: skip
        return images.reshape(*rts.shape[:2], 3, self.size, self.size)

    def products(self, rts: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Return <weights[b, m], image of rts[k, b, m]>, (K, B, M), for K camera sets; no image is kept."""
        flat, shape_of = self._views(rts)
        dots = np.empty(len(flat))
        rows = np.ascontiguousarray(weights.reshape(-1, 3, self.size, self.size), np.float32)
        with parallel_chunksize(1):
            draw_views(*self.mesh, flat, shape_of, *self.shading, self.background, rows, rows[:0], dots)
        return dots.reshape(rts.shape[:3])

    def images_and_buffers(self, rts: np.ndarray) -> tuple[np.ndarray, Buffers]:
        """Draw (B, M, 3, 4) cameras and keep what `gradient` needs."""
        flat, shape_of = self._views(rts)
        count, side = len(flat), self.size * self.look.supersample
        images = np.empty((count, 3, self.size, self.size), np.float32)
        samples = (
            np.empty((count, side, side), np.int32),
            np.empty((count, side, side)),
            np.empty((count, side, side, 3), np.float32),
            np.empty((count, side, side, 2), np.uint8),
        )
        room = ROOM * side
        while True:
            records = np.empty((count, room, COLUMNS), np.float32)
            where, counts = np.empty((count, room), np.int32), np.empty(count, np.int64)
            with parallel_chunksize(1):
                draw_views_keeping(
                    *self.mesh, flat, shape_of, *self.shading, self.background, *samples, records, where, counts, images
                )
            if counts.max() <= room:
                break
            room = int(counts.max())
        buffers = Buffers(flat, (*samples, records, where, counts))
        return images.reshape(*rts.shape[:2], 3, self.size, self.size), buffers

    def gradient(self, buffers: Buffers, weights: np.ndarray) -> np.ndarray:
        """Return d<weights, images>/d[R|t], (B, M, 3, 4), for the views whose buffers these are."""
        b = len(self.batch)
        shape_of = np.repeat(np.arange(b), len(buffers.rts) // b)
        out = np.empty_like(buffers.rts)
        rows = np.ascontiguousarray(weights.reshape(-1, 3, self.size, self.size), np.float32)
        arguments: tuple = (*self.plain_mesh, buffers.rts, shape_of, *self.shading, *buffers.arrays, rows, out)
        with parallel_chunksize(1):
            differentiate_views(*arguments)
        return out.reshape(b, -1, 3, 4)

    def geometry(self, rts: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return face ids (B,M,H,W) int32, depth (B,M,H,W) and world normals (B,M,3,H,W) at pixel centres."""
        flat, shape_of = self._views(rts)
        lead, size = rts.shape[:2], self.size
        ids = np.empty((len(flat), size, size), np.int32)
        depth = np.empty((len(flat), size, size), np.float32)
        normals = np.empty((len(flat), 3, size, size), np.float32)
        vertices, own_normals, _, faces, offsets = self.plain_mesh
        smooth = self.look.shading == "smooth"
        draw_geometry(vertices, own_normals, faces, offsets, flat, shape_of, self.focal, smooth, ids, depth, normals)
        return ids.reshape(*lead, size, size), depth.reshape(*lead, size, size), normals.reshape(*lead, 3, size, size)


def camera_matrices(azimuth_deg: torch.Tensor, elevation_deg: torch.Tensor, distance: torch.Tensor) -> torch.Tensor:
    """[R|t] of cameras, (..., 3, 4) float64 on the CPU, differentiable.

    The kernels take float64: a float32 matrix would blur differences over small steps.
    """
    rotation = camera_rotations(azimuth_deg.cpu(), elevation_deg.cpu())
    zero = torch.zeros_like(rotation[..., 0, 0])
    shift = torch.stack([zero, zero, -distance.cpu().to(rotation)], dim=-1)
    return torch.cat([rotation, shift[..., None]], dim=-1)


class EdgeFlow(torch.autograd.Function):
    """Images (B,M,3,H,W) from matrices (B,M,3,4) float64; backward by `flow.py`."""

    @staticmethod
    def forward(ctx, matrices, scene: MeshScene):
        """Draw every (shape, camera) pair."""
        ctx.scene = scene
        if not ctx.needs_input_grad[0]:
            return torch.from_numpy(scene.images(matrices.detach().numpy()))
        images, ctx.buffers = scene.images_and_buffers(matrices.detach().numpy())
        return torch.from_numpy(images)

    @staticmethod
    def backward(ctx, grad):
        """Reduce straight to each view's [R|t]."""
        return torch.from_numpy(ctx.scene.gradient(ctx.buffers, grad.detach().numpy())), None


class FiniteDifferences(torch.autograd.Function):
    """Images (B,M,3,H,W) of a scene; backward by central differences over `step` degrees."""

    @staticmethod
    def forward(ctx, azimuth, elevation, distance, scene: MeshScene, step: float):
        """Draw every (shape, camera) pair."""
        ctx.scene, ctx.step = scene, step
        ctx.save_for_backward(azimuth, elevation, distance)
        return torch.from_numpy(scene.images(camera_matrices(azimuth, elevation, distance).numpy())).to(azimuth.device)

    @staticmethod
    def backward(ctx, grad):
        """Differences of <grad, image> in each camera parameter that wants a gradient."""
        parameters = list(ctx.saved_tensors)
        wanted = [k for k in range(3) if ctx.needs_input_grad[k]]
        # Distance is in shape radii: a step of as many radii as the angular step has radians moves pixels alike.
        steps = [ctx.step, ctx.step, math.radians(ctx.step)]
        sets = []
        for k in wanted:
            for sign in (1.0, -1.0):
                moved = [p.double() + sign * steps[k] if q == k else p for q, p in enumerate(parameters)]
                sets.append(camera_matrices(*moved).numpy())
        grads: list[torch.Tensor | None] = [None] * 5
        dots = ctx.scene.products(np.stack(sets), grad.detach().float().cpu().numpy())
        for position, k in enumerate(wanted):
            difference = (dots[2 * position] - dots[2 * position + 1]) / (2 * steps[k])
            grads[k] = torch.from_numpy(difference).to(parameters[k])
        return tuple(grads)
