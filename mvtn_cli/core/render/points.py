"""Images of point clouds: discs blended by alpha, front to back, with the exact gradient to the cameras.

A point of world radius r (one for all, or each its own) at depth z has the image radius rho = r f / z. Its footprint is
the separable kernel k(u) k(v), k(u) = (1 - u^2)^2 on |u| <= 1, of half width sigma = rho sqrt(7/8), integrated over
each pixel, so that a point far smaller than a pixel still has the right weight and nothing flickers when it moves:

    alpha(pixel) = A I(x) I(y),   I(x) = sigma (F((k + 1 - x) / sigma) - F((k - x) / sigma)),   F' = k

A gives a disc the mass of the radial kernel of the same radius. Blending is C += T alpha s c, T *= 1 - alpha, where the
shade s falls with depth (the depth cue: what lies behind is darker, as points have no normals to be lit by), and the
background is seen through what is left: never normalised weights, which have no gradient where all points share one
colour.
"""

from __future__ import annotations

import math

import numpy as np
import torch

from mvtn_cli.core.render.compiled import njit, njit_inline, parallel_chunksize, prange
from mvtn_cli.core.render.raster import NEAR

AMPLITUDE = math.pi * 225.0 * 8.0 / (3.0 * 256.0 * 7.0)
WIDTH_RATIO = math.sqrt(7.0 / 8.0)
OPAQUE = 0.999


@njit
def kernel(u):
    """The 1-D kernel k."""
    return (1.0 - u * u) ** 2 if -1.0 < u < 1.0 else 0.0


@njit
def kernel_integral(u):
    """F: the integral of k from 0 to u."""
    u = min(max(u, -1.0), 1.0)
    return u - 2.0 * u**3 / 3.0 + u**5 / 5.0


@njit
def pixel_share(centre, sigma, pixel):
    """Return I of one pixel, and its derivatives by centre and by sigma."""
    low, high = (pixel - centre) / sigma, (pixel + 1 - centre) / sigma
    share = sigma * (kernel_integral(high) - kernel_integral(low))
    k_low, k_high = kernel(low), kernel(high)
    return share, k_low - k_high, share / sigma - (high * k_high - low * k_low)


@njit
def fill_shares(centre, sigma, size, shares):
    """Fill `shares` (n,3) for the pixels that the kernel reaches; return the first pixel and their number."""
    first = max(0, int(math.floor(centre - sigma)))
    last = min(size - 1, int(math.floor(centre + sigma)))
    for pixel in range(first, last + 1):
        shares[pixel - first, 0], shares[pixel - first, 1], shares[pixel - first, 2] = pixel_share(centre, sigma, pixel)
    return first, last - first + 1


@njit_inline
def point_to_camera(points, i, rt, camera):
    """Fill row i of `to_camera`."""
    x, y, z = points[i, 0], points[i, 1], points[i, 2]
    camera[i, 0] = rt[0, 0] * x + rt[0, 1] * y + rt[0, 2] * z + rt[0, 3]
    camera[i, 1] = rt[1, 0] * x + rt[1, 1] * y + rt[1, 2] * z + rt[1, 3]
    camera[i, 2] = -(rt[2, 0] * x + rt[2, 1] * y + rt[2, 2] * z + rt[2, 3])


@njit
def to_camera(points, rt, camera):
    """Fill `camera` (P,3) with right, up and the depth ahead of the eye."""
    for i in range(points.shape[0]):
        point_to_camera(points, i, rt, camera)


@njit
def on_screen(right, up, ahead, focal, radius, height, width):
    """Return (visible, x, y, sigma) in pixels; not visible behind the eye, outside the image, or not finite."""
    if not ahead > NEAR:
        return False, 0.0, 0.0, 1.0
    scale = focal / ahead
    x, y, sigma = width * 0.5 + right * scale, height * 0.5 - up * scale, radius * scale * WIDTH_RATIO
    inside = x + sigma > 0.0 and x - sigma < width and y + sigma > 0.0 and y - sigma < height
    return inside and sigma > 1e-6, x, y, sigma


@njit
def shade_of(ahead, distance, cue):
    """Return the share of its colour that a point keeps at this depth, and its derivative by the depth.

    All of it one shape radius before the centre, `1 - cue` one radius behind, and no change beyond.
    """
    behind = 0.5 * (ahead - distance + 1.0)
    if behind <= 0.0:
        return 1.0, 0.0
    if behind >= 1.0:
        return 1.0 - cue, 0.0
    return 1.0 - cue * behind, -0.5 * cue


@njit
def draw_points(points, colors, radii, rt, focal, cue, background, image):
    """Fill `image` (3,H,W)."""
    height, width = image.shape[1], image.shape[2]
    camera = np.empty(points.shape)
    to_camera(points, rt, camera)
    order = np.argsort(camera[:, 2], kind="mergesort")
    left = np.ones((height, width))
    shares_x, shares_y = np.empty((width, 3)), np.empty((height, 3))
    image[:] = 0.0
    for i in order:
        visible, x, y, sigma = on_screen(camera[i, 0], camera[i, 1], camera[i, 2], focal, radii[i], height, width)
        if not visible:
            continue
        shade, _ = shade_of(camera[i, 2], -rt[2, 3], cue)
        column, columns = fill_shares(x, sigma, width, shares_x)
        row, rows = fill_shares(y, sigma, height, shares_y)
        for j in range(rows):
            for k in range(columns):
                alpha = min(AMPLITUDE * shares_y[j, 0] * shares_x[k, 0], OPAQUE)
                weight = left[row + j, column + k] * alpha
                for channel in range(3):
                    image[channel, row + j, column + k] += weight * shade * colors[i, channel]
                left[row + j, column + k] *= 1.0 - alpha
    for channel in range(3):
        for j in range(height):
            for k in range(width):
                image[channel, j, k] += left[j, k] * background[channel]


@njit_inline
def pixel_gradient(share_x, share_y, wanted, shade, seen, behind):
    """Return d/d(share_x share_y), d/dshade, and what is `seen` and `behind` beyond the point, for one pixel of it."""
    alpha = AMPLITUDE * share_y * share_x
    clamped = alpha > OPAQUE
    alpha = min(alpha, OPAQUE)
    by_shade = seen * alpha * wanted
    wanted *= shade
    behind -= seen * alpha * wanted
    by_alpha = 0.0 if clamped else AMPLITUDE * (seen * wanted - behind / (1.0 - alpha))
    return by_alpha, by_shade, seen * (1.0 - alpha), behind


@njit
def point_gradient(x, y, sigma, column, columns, row, rows, shares_x, shares_y, colour, shade, weights, left, behind):
    """Walk one point's pixels: return dL/dx, dL/dy, dL/dsigma, dL/dshade; take it out of `left` and `behind`.

    `behind` holds, for each pixel, <weight, all colour that is still to come>; alpha moves both this point's share and
    what it hides.
    """
    gx = gy = gs = g_shade = 0.0
    for j in range(rows):
        for k in range(columns):
            wanted = 0.0
            for channel in range(3):
                wanted += weights[channel, row + j, column + k] * colour[channel]
            by_alpha, by_shade, left[row + j, column + k], behind[row + j, column + k] = pixel_gradient(
                shares_x[k, 0], shares_y[j, 0], wanted, shade, left[row + j, column + k], behind[row + j, column + k]
            )
            g_shade += by_shade
            gx += by_alpha * shares_x[k, 1] * shares_y[j, 0]
            gy += by_alpha * shares_x[k, 0] * shares_y[j, 1]
            gs += by_alpha * (shares_x[k, 2] * shares_y[j, 0] + shares_x[k, 0] * shares_y[j, 2])
    return gx, gy, gs, g_shade


@njit_inline
def add_point_motion(point, right, up, ahead, focal, sigma, gx, gy, gs, g_ahead, out):
    """Add to `out` (3,4) what one point's place, width and depth on the screen mean for [R|t].

    x = W/2 + f right / ahead, y = H/2 - f up / ahead, sigma ~ 1 / ahead; the third camera axis points backward.
    """
    scale = focal / ahead
    g_right, g_up = gx * scale, -gy * scale
    g_back = (gx * scale * right - gy * scale * up + gs * sigma) / ahead
    for axis in range(3):
        out[0, axis] += g_right * point[axis]
        out[1, axis] += g_up * point[axis]
        out[2, axis] += (g_back - g_ahead) * point[axis]
    out[0, 3] += g_right
    out[1, 3] += g_up
    out[2, 3] += g_back


@njit
def differentiate_points(points, colors, radii, rt, focal, cue, image, weights, out):
    """Fill `out` (3,4) with d<weights, image>/d[R|t]; `image` is what `draw_points` made."""
    height, width = image.shape[1], image.shape[2]
    camera = np.empty(points.shape)
    to_camera(points, rt, camera)
    order = np.argsort(camera[:, 2], kind="mergesort")
    left, behind = np.ones((height, width)), np.zeros((height, width))
    for channel in range(3):
        for j in range(height):
            for k in range(width):
                behind[j, k] += weights[channel, j, k] * image[channel, j, k]
    shares_x, shares_y = np.empty((width, 3)), np.empty((height, 3))
    out[:] = 0.0
    for i in order:
        right, up, ahead = camera[i, 0], camera[i, 1], camera[i, 2]
        visible, x, y, sigma = on_screen(right, up, ahead, focal, radii[i], height, width)
        if not visible:
            continue
        column, columns = fill_shares(x, sigma, width, shares_x)
        row, rows = fill_shares(y, sigma, height, shares_y)
        shade, by_ahead = shade_of(ahead, -rt[2, 3], cue)
        gx, gy, gs, g_shade = point_gradient(
            x, y, sigma, column, columns, row, rows, shares_x, shares_y, colors[i], shade, weights, left, behind
        )
        add_point_motion(points[i], right, up, ahead, focal, sigma, gx, gy, gs, g_shade * by_ahead, out)


@njit(parallel=True)
def draw_all(points, colors, radii, rts, shape_of, focal, cue, background, images):
    """Draw view n of cloud `shape_of[n]`, for all n in parallel."""
    for n in prange(rts.shape[0]):
        b = shape_of[n]
        draw_points(points[b], colors[b], radii[b], rts[n], focal, cue, background, images[n])


@njit(parallel=True)
def differentiate_all(points, colors, radii, rts, shape_of, focal, cue, images, weights, out):
    """Gradient of every view, in parallel."""
    for n in prange(rts.shape[0]):
        b = shape_of[n]
        differentiate_points(points[b], colors[b], radii[b], rts[n], focal, cue, images[n], weights[n], out[n])


class RenderPoints(torch.autograd.Function):
    """Images (B,M,3,H,W) of points (B,P,3) with colours (B,P,3) and radii (B,P), from [R|t] (B,M,3,4) float64."""

    @staticmethod
    def forward(
        ctx, rt, points: np.ndarray, colors: np.ndarray, radii: np.ndarray, focal: float, cue: float, background, size
    ):
        """Draw every (cloud, camera) pair."""
        b, m = rt.shape[:2]
        flat = np.ascontiguousarray(rt.detach().numpy().reshape(-1, 3, 4), np.float64)
        images = np.empty((b * m, 3, size, size))  # float64: backward divides what is left of it
        shape_of = np.repeat(np.arange(b), m)
        with parallel_chunksize(1):
            draw_all(points, colors, radii, flat, shape_of, focal, cue, np.array(background), images)
        ctx.scene = (points, colors, radii, flat, shape_of, focal, cue, images)
        return torch.from_numpy(images.astype(np.float32).reshape(b, m, 3, size, size))

    @staticmethod
    def backward(ctx, grad):
        """Reduce straight to the twelve numbers of each view's [R|t]."""
        *scene, images = ctx.scene
        weights = np.ascontiguousarray(grad.detach().float().cpu().numpy().reshape(images.shape))
        out = np.empty((len(images), 3, 4))
        with parallel_chunksize(1):
            differentiate_all(*scene, images, weights, out)
        gradient = torch.from_numpy(out.reshape(*grad.shape[:2], 3, 4))
        return gradient, None, None, None, None, None, None, None
