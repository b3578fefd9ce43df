"""The gradient of one view's image to its camera: `edge-flow`.

dL/d[R|t] is summed over three kinds of terms, each of them dL/dX_c for a point X_c that is rigid with the shape:

* interior: the colour between two neighbouring samples of one surface is carried along as the point moves (image
  flow), so it works for any shader and never differentiates a normal. Each colour step is used exactly once, either
  here or as an edge jump;
* edges: a jump that moves across a sample changes it by the jump. The speed is the one of the edge's 3-D point along
  its own normal; rows and columns see a curve |n_x| and |n_y| times per length, so they are weighted by n_x^2, n_y^2;
* shading that follows the camera (headlight, highlight), differentiated at a fixed surface point.

Camera coordinates here are (right, down, ahead), as in `raster.py`.
"""

from __future__ import annotations

import math

import numpy as np

from mvtn_cli.core.render.compiled import njit, njit_inline
from mvtn_cli.core.render.edges import SHARE, SLOPE, X, Y, Z, jump_at
from mvtn_cli.core.render.shade import DIFFUSE, FALLOFF, SHININESS, SPECULAR, power, towards_eye


@njit
def add_point(moments, gx, gy, gz, x, y, z):
    """Add g (X_c, 1)^T to the (3,4) moments that all terms reduce to."""
    moments[0, 0] += gx * x
    moments[0, 1] += gx * y
    moments[0, 2] += gx * z
    moments[0, 3] += gx
    moments[1, 0] += gy * x
    moments[1, 1] += gy * y
    moments[1, 2] += gy * z
    moments[1, 3] += gy
    moments[2, 0] += gz * x
    moments[2, 1] += gz * y
    moments[2, 2] += gz * z
    moments[2, 3] += gz


@njit_inline
def add_sample(
    j, i, depth, normal_image, tint, image, links, box, weights, supersample, focal, rt, follows, shiny, lx, ly, lz,
    albedo, material, moments, by_eye, by_light,
):  # fmt: skip
    """Add one sample's image flow, and how its shading depends on a light that follows the eye.

    A colour step to a neighbour counts half here and half there, each with its own sample's weight.
    """
    height, width = depth.shape
    w = depth[j, i]
    if w == 0.0:
        return
    row, column, link = j // supersample, i // supersample, links[j, i]
    left, above = i > box[2] and links[j, i - 1] & 1, j > box[0] and links[j - 1, i] & 2
    sx = sy = by_albedo = by_white = 0.0
    for channel in range(3):
        weight, here = weights[channel, row, column], image[j, i, channel]
        if link & 1:
            sx += weight * (image[j, i + 1, channel] - here)
        if left:
            sx += weight * (here - image[j, i - 1, channel])
        if link & 2:
            sy += weight * (image[j + 1, i, channel] - here)
        if above:
            sy += weight * (here - image[j - 1, i, channel])
        by_albedo += weight * (albedo[channel] * tint[j, i, channel] if tint.shape[0] > 0 else albedo[channel])
        by_white += weight
    ray_x, ray_y = (i + 0.5 - width * 0.5) / focal, (j + 0.5 - height * 0.5) / focal
    if sx != 0.0 or sy != 0.0:
        z = 1.0 / w
        gx, gy = -0.5 * focal * w * sx, -0.5 * focal * w * sy
        add_point(moments, gx, gy, -(gx * ray_x + gy * ray_y), ray_x * z, ray_y * z, z)
    if not follows:
        return
    nx, ny, nz = normal_image[j, i, 0], normal_image[j, i, 1], normal_image[j, i, 2]
    cosine = nx * lx + ny * ly + nz * lz
    if cosine > 0.0:
        fall = by_albedo * material[DIFFUSE] * material[FALLOFF] * power(cosine, material[FALLOFF] - 1.0)
        by_light[0] += fall * nx
        by_light[1] += fall * ny
        by_light[2] += fall * nz
        if shiny and by_white != 0.0:
            add_highlight(rt, ray_x, ray_y, w, nx, ny, nz, lx, ly, lz, cosine, by_white, material, by_eye, by_light)


@njit
def add_samples(
    depth, normal_image, tint, image, links, first_row, last_row, box, weights, supersample, focal, rt, follows, lx, ly,
    lz, albedo, material, moments, by_eye, by_light,
):  # fmt: skip
    """Add all of some rows' samples."""
    shiny = material[SPECULAR] > 0.0
    for j in range(max(first_row, box[0]), min(last_row, box[1]) + 1):
        for i in range(box[2], box[3] + 1):
            add_sample(
                j, i, depth, normal_image, tint, image, links, box, weights, supersample, focal, rt, follows, shiny, lx,
                ly, lz, albedo, material, moments, by_eye, by_light,
            )  # fmt: skip


@njit
def add_highlight(rt, ray_x, ray_y, w, nx, ny, nz, lx, ly, lz, cosine, by_white, material, by_eye, by_light):
    """Add the highlight's dependence on eye and light at a fixed surface point."""
    vx, vy, vz = towards_eye(rt, ray_x, ray_y)
    facing = nx * vx + ny * vy + nz * vz
    mirrored = 2.0 * cosine * facing - (lx * vx + ly * vy + lz * vz)
    if mirrored <= 0.0:
        return
    g = by_white * material[SPECULAR] * material[SHININESS] * power(mirrored, material[SHININESS] - 1.0)
    by_light[0] += g * (2.0 * facing * nx - vx)
    by_light[1] += g * (2.0 * facing * ny - vy)
    by_light[2] += g * (2.0 * facing * nz - vz)
    gx, gy, gz = g * (2.0 * cosine * nx - lx), g * (2.0 * cosine * ny - ly), g * (2.0 * cosine * nz - lz)
    radial = gx * vx + gy * vy + gz * vz
    nearness = w / math.sqrt(ray_x * ray_x + ray_y * ray_y + 1.0)
    by_eye[0] += (gx - radial * vx) * nearness
    by_eye[1] += (gy - radial * vy) * nearness
    by_eye[2] += (gz - radial * vz) * nearness


@njit
def weight_at(weights, jump, supersample, height, width, j, i):
    """<weight, colour jump> at a sample, held inside the image."""
    row = min(max(j, 0), height - 1) // supersample
    column = min(max(i, 0), width - 1) // supersample
    total = 0.0
    for channel in range(3):
        total += weights[channel, row, column] * jump[channel]
    return total


@njit
def swept_weight(weights, share, slope, jump, supersample, height, width, j, i, down):
    """Mean of <weight, jump> over the interval that the edge sweeps inside this row (or column) of samples."""
    half = 0.5 * min(abs(slope), 1.0)
    if half < 5e-4:
        near = 0 if share < 0.5 else 1
        return weight_at(weights, jump, supersample, height, width, j + near * down, i + near * (1 - down))
    # In these coordinates sample n of the row covers [n, n + 1], p being sample 0.
    low, high = share + 0.5 - half, share + 0.5 + half
    total = 0.0
    for n in range(-1, 3):
        overlap = min(high, n + 1.0) - max(low, n + 0.0)
        if overlap > 0.0:
            at = weight_at(weights, jump, supersample, height, width, j + n * down, i + n * (1 - down))
            total += overlap / (2.0 * half) * at
    return total


@njit_inline
def add_edge(record, at, image, weights, supersample, focal, jump, moments):
    """Add the motion of one silhouette or crease; `jump` (3,) is scratch."""
    height, width = image.shape[0], image.shape[1]
    down, slope = at & 1, record[SLOPE]
    j, i = jump_at(image, record, at, width, jump)
    pull = swept_weight(weights, record[SHARE], slope, jump, supersample, height, width, j, i, down)
    pull *= focal / record[Z] / (1.0 + slope * slope)
    gx, gy = (-slope * pull, pull) if down == 1 else (pull, -slope * pull)
    x, y, z = record[X], record[Y], record[Z]
    add_point(moments, gx, gy, -(gx * x + gy * y) / z, x, y, z)


@njit
def add_edges(records, where, count, image, weights, supersample, focal, moments):
    """Add the motion of every silhouette and crease."""
    jump = np.empty(3)
    for n in range(count):
        add_edge(records[n], where[n], image, weights, supersample, focal, jump, moments)


@njit
def reduce_to_camera(moments, rt, by_eye, by_light, headlight, out):
    """Turn moments and shading terms into `out` (3,4) = dL/d[R|t] of the OpenGL matrix.

    X_w = R^T (X_gl - t) for every term, so dL/dR = (K_gl - k_gl t^T) R with the moments K, k turned to OpenGL axes;
    eye = -R^T t; a headlight is the third row of R.
    """
    for p in range(3):
        sign_p = 1.0 if p == 0 else -1.0
        for q in range(3):
            total = 0.0
            for u in range(3):
                sign_u = 1.0 if u == 0 else -1.0
                total += sign_p * (moments[p, u] * sign_u - moments[p, 3] * rt[u, 3]) * rt[u, q]
            out[p, q] = total - rt[p, 3] * by_eye[q]
        out[p, 3] = sign_p * moments[p, 3]
        for q in range(3):
            out[p, 3] -= rt[p, q] * by_eye[q]
    if headlight:
        for q in range(3):
            out[2, q] += by_light[q]
