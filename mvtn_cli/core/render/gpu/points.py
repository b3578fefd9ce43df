"""Images of point clouds on a CUDA device, and their gradient: a block draws a tile of pixels, a thread each.

The points of a view are sorted by depth; all threads of a block load some of them, and each pixel takes those that
reach it in their order, as on the CPU.
"""

from __future__ import annotations

import math

import numpy as np
import torch

from mvtn_cli.core.render.compiled import njit
from mvtn_cli.core.render.gpu.adding import add_up_block
from mvtn_cli.core.render.gpu.compiled import SIMULATED, THREADS, cuda, device_function, kernel, launch
from mvtn_cli.core.render.look import Look
from mvtn_cli.core.render.points import (
    AMPLITUDE,
    OPAQUE,
    add_point_motion,
    on_screen,
    pixel_gradient,
    pixel_share,
    point_to_camera,
    shade_of,
)

# Columns and rows of pixels that a block draws.
WIDE = 2 if SIMULATED else 16
HIGH = THREADS // WIDE
# Bytes of buffers that are held at once, at least one view's, and most views of a launch.
HELD, MOST_VIEWS = 1 << 30, 65_535
TERMS = 12


@kernel
def place_points(points, rts, shape_of, camera):
    """Fill `camera` (N,P,3)."""
    i, n = cuda.grid(2)
    if i < camera.shape[1]:
        point_to_camera(points[shape_of[n]], i, rts[n], camera[n])


@njit
def is_reached(centre, sigma, pixel):
    """Whether a kernel reaches a pixel, as `fill_shares` has it."""
    return math.floor(centre - sigma) <= pixel <= math.floor(centre + sigma)


@njit
def tile_of(block, size):
    """First column and first row of the pixels that a block draws."""
    tiles = (size + WIDE - 1) // WIDE
    return block % tiles * WIDE, block // tiles * HIGH


@device_function
def load(first, order, camera, radii, focal, size, column, row, numbers, places):
    """Each thread loads one point: its number, -1 where it does not reach the tile, and (x, y, sigma)."""
    thread = cuda.threadIdx.x
    numbers[thread] = -1
    if first + thread >= order.shape[0]:
        return
    i = order[first + thread]
    visible, x, y, sigma = on_screen(camera[i, 0], camera[i, 1], camera[i, 2], focal, radii[i], size, size)
    if not visible or math.floor(x + sigma) < column or math.floor(x - sigma) >= column + WIDE:
        return
    if math.floor(y + sigma) < row or math.floor(y - sigma) >= row + HIGH:
        return
    numbers[thread] = i
    places[thread, 0], places[thread, 1], places[thread, 2] = x, y, sigma


@kernel
def draw_views(order, camera, colors, radii, rts, shape_of, focal, cue, background, images):
    """Fill `images` (N,3,H,W) float64."""
    n, size, points = cuda.blockIdx.y, images.shape[2], order.shape[1]
    numbers = cuda.shared.array(THREADS, np.int32)
    places = cuda.shared.array((THREADS, 3), np.float64)
    left_column, top = tile_of(cuda.blockIdx.x, size)
    column, row = left_column + cuda.threadIdx.x % WIDE, top + cuda.threadIdx.x // WIDE
    b, left = shape_of[n], 1.0
    red = green = blue = 0.0
    for first in range(0, points, THREADS):
        cuda.syncthreads()
        load(first, order[n], camera[n], radii[b], focal, size, left_column, top, numbers, places)
        cuda.syncthreads()
        for k in range(min(THREADS, points - first)):
            i, x, y, sigma = numbers[k], places[k, 0], places[k, 1], places[k, 2]
            if i < 0 or not (is_reached(x, sigma, column) and is_reached(y, sigma, row)):
                continue
            shade = shade_of(camera[n, i, 2], -rts[n, 2, 3], cue)[0]
            share_x, share_y = pixel_share(x, sigma, column)[0], pixel_share(y, sigma, row)[0]
            alpha = min(AMPLITUDE * share_y * share_x, OPAQUE)
            weight = left * alpha
            red += weight * shade * colors[b, i, 0]
            green += weight * shade * colors[b, i, 1]
            blue += weight * shade * colors[b, i, 2]
            left *= 1.0 - alpha
    if column < size and row < size:
        images[n, 0, row, column] = red + left * background[0]
        images[n, 1, row, column] = green + left * background[1]
        images[n, 2, row, column] = blue + left * background[2]


@kernel
def sum_slopes(order, camera, points, colors, radii, rts, shape_of, focal, cue, images, weights, sums):
    """Fill `sums` (N,K,12): what each tile adds to d<weights, images>/d[R|t]."""
    n, size, number, thread = cuda.blockIdx.y, images.shape[2], order.shape[1], cuda.threadIdx.x
    numbers = cuda.shared.array(THREADS, np.int32)
    places = cuda.shared.array((THREADS, 3), np.float64)
    terms = cuda.shared.array((THREADS, TERMS), np.float64)
    out = cuda.local.array((3, 4), np.float64)
    left_column, top = tile_of(cuda.blockIdx.x, size)
    column, row = left_column + thread % WIDE, top + thread // WIDE
    inside = column < size and row < size
    b, left, behind = shape_of[n], 1.0, 0.0
    for p in range(3):
        for q in range(4):
            out[p, q] = 0.0
        if inside:
            behind += weights[n, p, row, column] * images[n, p, row, column]
    for first in range(0, number, THREADS):
        cuda.syncthreads()
        load(first, order[n], camera[n], radii[b], focal, size, left_column, top, numbers, places)
        cuda.syncthreads()
        for k in range(min(THREADS, number - first)):
            i, x, y, sigma = numbers[k], places[k, 0], places[k, 1], places[k, 2]
            if not inside or i < 0 or not (is_reached(x, sigma, column) and is_reached(y, sigma, row)):
                continue
            right, up, ahead = camera[n, i, 0], camera[n, i, 1], camera[n, i, 2]
            shade, by_ahead = shade_of(ahead, -rts[n, 2, 3], cue)
            in_x, in_x_by_x, in_x_by_sigma = pixel_share(x, sigma, column)
            in_y, in_y_by_y, in_y_by_sigma = pixel_share(y, sigma, row)
            wanted = 0.0
            for channel in range(3):
                wanted += weights[n, channel, row, column] * colors[b, i, channel]
            by_alpha, by_shade, left, behind = pixel_gradient(in_x, in_y, wanted, shade, left, behind)
            by_sigma = by_alpha * (in_x_by_sigma * in_y + in_x * in_y_by_sigma)
            add_point_motion(
                points[b, i], right, up, ahead, focal, sigma, by_alpha * in_x_by_x * in_y, by_alpha * in_x * in_y_by_y,
                by_sigma, by_shade * by_ahead, out,
            )  # fmt: skip
    for p in range(3):
        for q in range(4):
            terms[thread, 4 * p + q] = out[p, q]
    add_up_block(terms, sums[n, cuda.blockIdx.x])


class GpuPointScene:
    """Clouds (B,P,3) with colours (B,P,3) and radii (B,P) on a device, ready to be drawn from any cameras."""

    def __init__(
        self,
        points: torch.Tensor,
        colors: np.ndarray,
        radii: np.ndarray,
        focal: float,
        look: Look,
        device: torch.device,
    ) -> None:
        self.focal, self.cue, self.size = focal, look.depth_cue, look.image_size
        given = (points, torch.from_numpy(colors), torch.from_numpy(radii), torch.tensor(look.background))
        # A copy that waits would wait for all that the device has still to do.
        self.points, self.colors, self.radii, self.background = (
            tensor.detach().contiguous().to(device, torch.float64, non_blocking=True) for tensor in given
        )

    def _place(self, rts: torch.Tensor, shape_of: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return each view's points in its camera's coordinates, (N,P,3), and their numbers from near to far."""
        camera = torch.empty((len(rts), *self.points.shape[1:]), dtype=torch.float64, device=rts.device)
        launch(place_points, len(rts), camera.shape[1], self.points, rts, shape_of, camera)
        return camera, torch.argsort(camera[..., 2], dim=1, stable=True)

    @property
    def tiles(self) -> int:
        """Blocks that an image takes."""
        return -(-self.size // WIDE) * -(-self.size // HIGH)

    @property
    def at_once(self) -> int:
        """Views whose buffers are held at once."""
        need = 24 * self.size**2 + 64 * self.points.shape[1] + 96 * self.tiles
        return max(1, min(MOST_VIEWS, HELD // need))

    def _draw(self, rts: torch.Tensor, shape_of: torch.Tensor, camera: torch.Tensor, order: torch.Tensor):
        images = torch.empty((len(rts), 3, self.size, self.size), dtype=torch.float64, device=rts.device)
        launch(
            draw_views, len(rts), self.tiles * THREADS, order, camera, self.colors, self.radii, rts, shape_of,
            self.focal, self.cue, self.background, images,
        )  # fmt: skip
        return images

    def draw(self, matrices: torch.Tensor) -> torch.Tensor:
        """Return the images (B, M, 3, H, W) float32 of (B, M, 3, 4) cameras."""
        rts, shape_of = _flat(matrices)
        parts = zip(rts.split(self.at_once), shape_of.split(self.at_once), strict=True)
        images = torch.cat([self._draw(part, of, *self._place(part, of)).float() for part, of in parts])
        return images.reshape(*matrices.shape[:2], *images.shape[1:])

    def gradient(self, matrices: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
        """Return d<weights, images>/d[R|t], (B, M, 3, 4) float64; what is drawn is drawn again."""
        rts, shape_of = _flat(matrices)
        rows = weights.detach().float().reshape(-1, 3, self.size, self.size).contiguous()
        found = []
        for part, of, row in zip(*(array.split(self.at_once) for array in (rts, shape_of, rows)), strict=True):
            camera, order = self._place(part, of)
            images = self._draw(part, of, camera, order)
            sums = torch.empty((len(part), self.tiles, TERMS), dtype=torch.float64, device=part.device)
            launch(
                sum_slopes, len(part), self.tiles * THREADS, order, camera, self.points, self.colors, self.radii, part,
                of, self.focal, self.cue, images, row, sums,
            )  # fmt: skip
            found.append(sums.sum(dim=1))
        return torch.cat(found).reshape(matrices.shape)


def _flat(matrices: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return (B * M, 3, 4) cameras and the cloud of each."""
    shapes, views = matrices.shape[:2]
    shape_of = torch.arange(shapes, device=matrices.device)[:, None].expand(shapes, views)
    return matrices.detach().reshape(-1, 3, 4).contiguous(), shape_of.reshape(-1).contiguous()


class GpuRenderPoints(torch.autograd.Function):
    """Images (B,M,3,H,W) from matrices (B,M,3,4) float64, both on the device; as `points.RenderPoints`."""

    @staticmethod
    def forward(ctx, matrices, scene: GpuPointScene):
        """Draw every (cloud, camera) pair."""
        ctx.scene = scene
        ctx.save_for_backward(matrices)
        return scene.draw(matrices)

    @staticmethod
    def backward(ctx, grad):
        """Reduce straight to the twelve numbers of each view's [R|t]."""
        (matrices,) = ctx.saved_tensors
        return ctx.scene.gradient(matrices, grad), None
