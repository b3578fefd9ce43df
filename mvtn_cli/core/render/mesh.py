"""Images of batches of meshes, with two gradients to the cameras.

`edge-flow` reduces the incoming gradient straight to the twelve numbers of each view's [R|t] (flow.py); `shading` is
the part of it that silhouettes and creases have no share in; `fd` takes central differences of the very image that is
drawn: four more images a view for azimuth and elevation, two more for distance where it is asked for. `fd` is the
checker of the others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch

from mvtn_cli.core.render.bands import BLOCK, band_rows, bands_for, join_bands
from mvtn_cli.core.render.batch import ShapeBatch
from mvtn_cli.core.render.compiled import njit, parallel_chunksize, prange
from mvtn_cli.core.render.gbuffer import GBuffers, empty_buffers, with_room
from mvtn_cli.core.render.kept_views import KeptViews, paint_kept_views, put_together
from mvtn_cli.core.render.look import Look
from mvtn_cli.core.render.raster import NEAR
from mvtn_cli.core.render.skips import COUNTERS, EVERYTHING, NO_GRADIENT, SAME_VIEW
from mvtn_cli.core.render.tally import tally
from mvtn_cli.core.render.view import add_up, paint_view, see_rows, sum_part
from mvtn_cli.core.views import camera_rotations

# Samples whose buffers are held at once where no gradient is asked for.
SAMPLES_AT_ONCE = 4_000_000


@njit(parallel=True)
def see_views(
    vertices, normals, colors, faces, face_edges, edge_starts, edge_faces, creases, solid, radii, offsets, rts,
    shape_of, focal, smooth, skips, ids, depth, normal_images, tints, links, records, where, boxes, jumps, counts,
):  # fmt: skip
    """Fill the G-buffer of view n of shape `shape_of[n]`, for all n, and all of their bands, in parallel.

    `offsets` (4, B+1): where each shape's vertices, faces, edges and edge faces begin. `boxes` (N,K,4), `jumps` (N,K)
    and `counts` (N,K,COUNTERS) are those of each view's K bands; each band has one K-th of `records` and `where`.
    """
    bands = jumps.shape[1]
    room = records.shape[1] // bands
    for task in prange(jumps.size):
        n, k = task // bands, task % bands
        b = shape_of[n]
        v0, v1, f0, f1 = offsets[0, b], offsets[0, b + 1], offsets[1, b], offsets[1, b + 1]
        first_row, last_row = band_rows(k, bands, ids.shape[1])
        jumps[n, k] = see_rows(
            vertices[v0:v1], normals[v0:v1], colors[v0:v1], faces[f0:f1], face_edges[f0:f1],
            edge_starts[offsets[2, b] : offsets[2, b + 1]], edge_faces[offsets[3, b] : offsets[3, b + 1]],
            creases[f0:f1], solid[f0:f1] if outside(rts[n], radii[b]) else solid[:0], rts[n], focal, smooth, skips,
            first_row, last_row, ids[n], depth[n], normal_images[n], tints[n], links[n], boxes[n, k],
            records[n, k * room : (k + 1) * room], where[n, k * room : (k + 1) * room], counts[n, k],
        )  # fmt: skip


@njit
def outside(rt, radius):
    """Whether eye and near plane are outside of everything; the length of t is the eye's distance from the origin."""
    return rt[0, 3] ** 2 + rt[1, 3] ** 2 + rt[2, 3] ** 2 > (radius + NEAR) ** 2


@njit(parallel=True)
def paint_views(
    rts, shape_of, focal, supersample, lights, albedos, material, background, skips, depth, normal_images, tints, boxes,
    records, where, jumps, images, out,
):  # fmt: skip
    """Fill `out` (N,3,H,W) and the samples' colours `images` from G-buffers."""
    for n in prange(rts.shape[0]):
        b = shape_of[n]
        paint_view(
            rts[n], focal, supersample, lights[b], albedos[b], material, background, skips, depth[n], normal_images[n],
            tints[n], boxes[n], records[n], where[n], jumps[n], images[n], out[n],
        )  # fmt: skip


@njit(parallel=True)
def differentiate_views(
    rts, shape_of, view_of, focal, supersample, lights, albedos, material, depth, normal_images, tints, links, boxes,
    records, where, jumps, images, weights, out,
):  # fmt: skip
    """Reduce `weights` (N,3,H,W) to `out` (N,3,4); number n was drawn as view `view_of[n]`."""
    side = depth.shape[1]
    blocks = -(-side // BLOCK)
    # One sum for each block of rows, and after the last row one for the edges.
    sums = np.empty((weights.shape[0], blocks + 1, 5, 4))
    for task in prange(weights.shape[0] * (blocks + 1)):
        n, block = task // (blocks + 1), task % (blocks + 1)
        k = view_of[n]
        b = shape_of[k]
        sum_part(
            rts[k], focal, supersample, lights[b], albedos[b], material, block * BLOCK,
            min(side, (block + 1) * BLOCK) - 1, depth[k], normal_images[k], tints[k], links[k], boxes[k], records[k],
            where[k], jumps[k], images[k], weights[n], sums[n, block],
        )  # fmt: skip
    for n in range(weights.shape[0]):
        add_up(rts[view_of[n]], supersample, lights[shape_of[view_of[n]]], sums[n], out[n])


def focal_pixels(image_size: int, fov_deg: float) -> float:
    """Focal length in pixels of a square image whose vertical field of view is `fov_deg`."""
    return image_size / 2 / math.tan(math.radians(fov_deg) / 2)


class MeshScene:
    """A batch and a look, ready to be drawn from any cameras."""

    def __init__(self, batch: ShapeBatch, look: Look, fov_deg: float, skips: int = EVERYTHING) -> None:
        self.batch, self.look, self.skips = batch, look, skips
        self.size, self.side = look.image_size, look.image_size * look.supersample
        self.focal = focal_pixels(look.image_size, fov_deg)
        self.fine_focal = self.focal * look.supersample
        self.smooth = look.shading == "smooth"
        light = look.light_direction
        self.lights = np.zeros((len(batch), 3)) if light is None else light.astype(np.float64)
        mesh = (batch.vertices, batch.normals, batch.colors, batch.faces, batch.face_edges)
        self.mesh = (*mesh, batch.edge_starts, batch.edge_faces, batch.creases, batch.solid, batch.radii, batch.offsets)
        self.albedos = np.ascontiguousarray(look.colors, np.float64)
        self.background = np.array(look.background)

    def see(self, rts: np.ndarray) -> GBuffers:
        """Fill the G-buffers of (B, M, 3, 4) cameras; a (shape, camera) pair that occurs twice is seen once."""
        flat, shape_of = np.ascontiguousarray(rts.reshape(-1, 3, 4)), np.repeat(np.arange(len(rts)), rts.shape[1])
        view_of = np.arange(len(flat))
        if self.skips & SAME_VIEW:
            rows = np.column_stack([shape_of.view(np.uint64), flat.reshape(-1, 12).view(np.uint64)])
            _, first, sames = np.unique(rows, axis=0, return_index=True, return_inverse=True)
            if len(first) < len(flat):
                flat, shape_of, view_of = flat[first], shape_of[first], sames.reshape(-1)
        buffers = empty_buffers(flat, shape_of, view_of, self.side, tinted=len(self.batch.colors) > 0)
        bands = bands_for(len(flat), self.side)
        boxes, jumps = np.empty((len(flat), bands, 4), np.int64), np.empty((len(flat), bands), np.int64)
        counts = np.empty((len(flat), bands, COUNTERS), np.int64)
        while True:
            with parallel_chunksize(1):
                see_views(
                    *self.mesh, flat, shape_of, self.fine_focal, self.smooth, self.skips, buffers.ids, *buffers.seen,
                    buffers.links, buffers.records, buffers.where, boxes, jumps, counts,
                )  # fmt: skip
            most = int(jumps.max(initial=0))
            if most <= buffers.records.shape[1] // bands:
                break
            buffers = with_room(buffers, most * bands)
        join_bands(buffers, boxes, jumps, counts)
        tally().add_views(buffers.counts, len(view_of))
        return buffers

    def paint(self, buffers: GBuffers) -> tuple[np.ndarray, np.ndarray]:
        """Return the images of all views, (N, 3, H, W) float32, and the colours of their samples."""
        count = len(buffers.rts)
        samples = np.empty((count, self.side, self.side, 3), np.float32)
        out = np.empty((count, 3, self.size, self.size), np.float32)
        with parallel_chunksize(1):
            paint_views(
                buffers.rts, buffers.shape_of, self.fine_focal, self.look.supersample, self.lights, self.albedos,
                self.look.material, self.background, self.skips, *buffers.seen, buffers.boxes, *buffers.edges, samples,
                out,
            )  # fmt: skip
        return (out if len(buffers.view_of) == count else out[buffers.view_of]), samples

    def paint_kept(self, kept: Sequence[KeptViews]) -> np.ndarray:
        """Return the images (N, 3, H, W) float32 of kept views of each shape of the batch, bit for bit as `paint`."""
        packed = put_together(kept)
        out = np.empty((len(packed.rts), 3, self.size, self.size), np.float32)
        with parallel_chunksize(1):
            paint_kept_views(
                packed.rts, packed.shape_of, self.side, self.fine_focal, self.look.supersample, self.lights,
                self.albedos, self.look.material, self.background, self.skips, packed.boxes, packed.covered,
                packed.normals, packed.tints, packed.records, packed.where, packed.starts, out,
            )  # fmt: skip
        return out

    def images(self, rts: np.ndarray) -> np.ndarray:
        """Draw (B, M, 3, 4) cameras: (B, M, 3, H, W) float32; buffers are kept for a few views at a time only."""
        views = max(1, SAMPLES_AT_ONCE // (self.side * self.side * max(1, len(rts))))
        parts = [self.paint(self.see(rts[:, start : start + views]))[0] for start in range(0, rts.shape[1], views)]
        return np.concatenate([part.reshape(len(rts), -1, 3, self.size, self.size) for part in parts], axis=1)

    def gradient(
        self, buffers: GBuffers, samples: np.ndarray, weights: np.ndarray, *, edges: bool = True
    ) -> np.ndarray:
        """Return d<weights, images>/d[R|t], (N, 3, 4), for the views whose buffers these are."""
        rows = np.ascontiguousarray(weights.reshape(-1, 3, self.size, self.size), np.float32)
        out = np.zeros((len(rows), 3, 4))
        wanted = np.arange(len(rows))
        if self.skips & NO_GRADIENT:
            wanted = np.flatnonzero(rows.reshape(len(rows), -1).any(axis=1))
            tally().count("no-gradient", len(rows) - len(wanted), len(rows))
        if not len(wanted):
            return out
        records, where, jumps = buffers.edges
        found = np.empty((len(wanted), 3, 4))
        with parallel_chunksize(1):
            differentiate_views(
                buffers.rts, buffers.shape_of, buffers.view_of[wanted], self.fine_focal, self.look.supersample,
                self.lights, self.albedos, self.look.material, *buffers.seen, buffers.links, buffers.boxes, records,
                where, jumps if edges else np.zeros_like(jumps), samples,
                rows if len(wanted) == len(rows) else rows[wanted], found,
            )  # fmt: skip
        out[wanted] = found
        return out


def camera_matrices(
    azimuth_deg: torch.Tensor, elevation_deg: torch.Tensor, distance: torch.Tensor, device: torch.device | str = "cpu"
) -> torch.Tensor:
    """[R|t] of cameras, (..., 3, 4) float64 on the device that draws, differentiable.

    The kernels take float64: a float32 matrix would blur differences over small steps.
    """
    rotation = camera_rotations(azimuth_deg.to(device), elevation_deg.to(device))
    zero = torch.zeros_like(rotation[..., 0, 0])
    shift = torch.stack([zero, zero, -distance.to(rotation)], dim=-1)
    return torch.cat([rotation, shift[..., None]], dim=-1)


class EdgeFlow(torch.autograd.Function):
    """Images (B,M,3,H,W) from matrices (B,M,3,4) float64; backward by `flow.py`, with or without its edges."""

    @staticmethod
    def forward(ctx, matrices, scene: MeshScene, edges: bool):
        """Draw every (shape, camera) pair."""
        ctx.scene, ctx.edges = scene, edges
        rts = matrices.detach().numpy()
        if not ctx.needs_input_grad[0]:
            return torch.from_numpy(scene.images(rts))
        ctx.buffers = scene.see(rts)
        images, ctx.samples = scene.paint(ctx.buffers)
        return torch.from_numpy(images.reshape(*rts.shape[:2], *images.shape[1:]))

    @staticmethod
    def backward(ctx, grad):
        """Reduce straight to each view's [R|t]."""
        found = ctx.scene.gradient(ctx.buffers, ctx.samples, grad.detach().numpy(), edges=ctx.edges)
        return torch.from_numpy(found.reshape(*grad.shape[:2], 3, 4)), None, None


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
        grads: list[torch.Tensor | None] = [None] * 5
        weights = grad.detach().double().cpu().numpy()
        for k in wanted:
            difference = np.zeros(weights.shape[:2])
            for sign in (1.0, -1.0):
                moved = [p.double() + sign * steps[k] if q == k else p for q, p in enumerate(parameters)]
                images = ctx.scene.images(camera_matrices(*moved).numpy())
                difference += sign * np.einsum("bmchw,bmchw->bm", weights, images)
            grads[k] = torch.from_numpy(difference / (2 * steps[k])).to(parameters[k])
        return tuple(grads)
