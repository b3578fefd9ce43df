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

from mvtn_cli.core.render.compiled import njit
from mvtn_cli.core.render.edges import JUMP, SHARE, SLOPE, X, Y, Z
from mvtn_cli.core.render.shade import (
    DIFFUSE,
    FALLOFF,
    SHININESS,
    SPECULAR,
    barycentric,
    corner_normals,
    face_frame,
    normal_at,
    power,
)


@njit(cache=True)
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


@njit(cache=True)
def step_product(image, weights, row, column, j, i, j2, i2):
    """<weight of the pixel, colour step from sample (j, i) to (j2, i2)>."""
    total = 0.0
    for channel in range(3):
        total += weights[channel, row, column] * (image[j2, i2, channel] - image[j, i, channel])
    return total


@njit(cache=True)
def image_slope(ids, image, breaks, weights, row, column, j, i):
    """Return <weight, dC/dx> and <weight, dC/dy> at a covered sample: half of each step that crosses no jump."""
    height, width = ids.shape
    along_x = along_y = 0.0
    if i > 0 and ids[j, i - 1] >= 0 and breaks[j, i - 1, 0] == 0:
        along_x += step_product(image, weights, row, column, j, i - 1, j, i)
    if i < width - 1 and ids[j, i + 1] >= 0 and breaks[j, i, 0] == 0:
        along_x += step_product(image, weights, row, column, j, i, j, i + 1)
    if j > 0 and ids[j - 1, i] >= 0 and breaks[j - 1, i, 1] == 0:
        along_y += step_product(image, weights, row, column, j - 1, i, j, i)
    if j < height - 1 and ids[j + 1, i] >= 0 and breaks[j, i, 1] == 0:
        along_y += step_product(image, weights, row, column, j, i, j + 1, i)
    return 0.5 * along_x, 0.5 * along_y


@njit(cache=True)
def add_interior(ids, inverse_depth, image, breaks, weights, supersample, focal, moments):
    """Add the image flow of every covered sample."""
    height, width = ids.shape
    for j in range(height):
        for i in range(width):
            if ids[j, i] < 0:
                continue
            sx, sy = image_slope(ids, image, breaks, weights, j // supersample, i // supersample, j, i)
            if sx == 0.0 and sy == 0.0:
                continue
            ray_x, ray_y = (i + 0.5 - width * 0.5) / focal, (j + 0.5 - height * 0.5) / focal
            scale = focal * inverse_depth[j, i]
            z = 1.0 / inverse_depth[j, i]
            gx, gy = -scale * sx, -scale * sy
            add_point(moments, gx, gy, -(gx * ray_x + gy * ray_y), ray_x * z, ray_y * z, z)


@njit(cache=True)
def weight_at(weights, record, supersample, height, width, j, i):
    """<weight, colour jump> at a sample, held inside the image."""
    row = min(max(j, 0), height - 1) // supersample
    column = min(max(i, 0), width - 1) // supersample
    total = 0.0
    for channel in range(3):
        total += weights[channel, row, column] * record[JUMP + channel]
    return total


@njit(cache=True)
def swept_weight(weights, record, supersample, height, width, j, i, down):
    """Mean of <weight, jump> over the interval that the edge sweeps inside this row (or column) of samples."""
    share, half = record[SHARE], 0.5 * min(abs(record[SLOPE]), 1.0)
    if half < 5e-4:
        near = 0 if share < 0.5 else 1
        return weight_at(weights, record, supersample, height, width, j + near * down, i + near * (1 - down))
    # In these coordinates sample n of the row covers [n, n + 1], p being sample 0.
    low, high = share + 0.5 - half, share + 0.5 + half
    total = 0.0
    for n in range(-1, 3):
        overlap = min(high, n + 1.0) - max(low, n + 0.0)
        if overlap > 0.0:
            at = weight_at(weights, record, supersample, height, width, j + n * down, i + n * (1 - down))
            total += overlap / (2.0 * half) * at
    return total


@njit(cache=True)
def add_edges(records, where, count, weights, supersample, focal, height, width, moments):
    """Add the motion of every silhouette crossing."""
    for n in range(count):
        record = records[n]
        down, sample = where[n] & 1, where[n] >> 1
        slope = record[SLOPE]
        pull = swept_weight(weights, record, supersample, height, width, sample // width, sample % width, down)
        pull *= focal / record[Z] / (1.0 + slope * slope)
        gx, gy = (-slope * pull, pull) if down == 1 else (pull, -slope * pull)
        gz = -(gx * record[X] + gy * record[Y]) / record[Z]
        add_point(moments, gx, gy, gz, record[X], record[Y], record[Z])


@njit(cache=True)
def add_following_light(
    vertices, normals, colors, faces, camera, ids, weights, supersample, smooth, focal, eye, towards, albedo, material,
    by_eye, by_light,
):  # fmt: skip
    """Add d<weights, image>/d(eye, light) at fixed surface points to `by_eye`, `by_light` (3,)."""
    height, width = ids.shape
    frame, corners, view, g_view = np.empty((3, 3)), np.empty((4, 3)), np.zeros(3), np.empty(3)
    last, volume = -1, 0.0
    a = b = c = 0
    for j in range(height):
        for i in range(width):
            face = ids[j, i]
            if face < 0:
                continue
            if face != last:
                last = face
                a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
                volume = face_frame(camera, a, b, c, frame)
                corner_normals(vertices, normals, a, b, c, volume, smooth, corners)
            w0, w1, w2 = barycentric(frame, volume, (i + 0.5 - width * 0.5) / focal, (j + 0.5 - height * 0.5) / focal)
            nx, ny, nz = normal_at(corners, smooth, w0, w1, w2)
            cosine = nx * towards[0] + ny * towards[1] + nz * towards[2]
            if cosine <= 0.0:
                continue
            by_albedo = by_white = 0.0
            for channel in range(3):
                weight = weights[channel, j // supersample, i // supersample]
                value = albedo[channel]
                if colors.shape[0] > 0:
                    value *= w0 * colors[a, channel] + w1 * colors[b, channel] + w2 * colors[c, channel]
                by_albedo += weight * value
                by_white += weight
            steepness = material[FALLOFF] * power(cosine, material[FALLOFF] - 1.0)
            g_cosine, g_mirror, facing, length = by_albedo * material[DIFFUSE] * steepness, 0.0, 0.0, 1.0
            if material[SPECULAR] > 0.0:
                for axis in range(3):
                    at = w0 * vertices[a, axis] + w1 * vertices[b, axis] + w2 * vertices[c, axis]
                    view[axis] = eye[axis] - at
                length = math.sqrt(view[0] ** 2 + view[1] ** 2 + view[2] ** 2 + 1e-30)
                view /= length
                facing = nx * view[0] + ny * view[1] + nz * view[2]
                mirrored = 2.0 * cosine * facing - (towards[0] * view[0] + towards[1] * view[1] + towards[2] * view[2])
                if mirrored > 0.0:
                    shininess = material[SHININESS]
                    g_mirror = by_white * material[SPECULAR] * shininess * power(mirrored, shininess - 1.0)
            by_light[0] += (g_cosine + 2.0 * facing * g_mirror) * nx - g_mirror * view[0]
            by_light[1] += (g_cosine + 2.0 * facing * g_mirror) * ny - g_mirror * view[1]
            by_light[2] += (g_cosine + 2.0 * facing * g_mirror) * nz - g_mirror * view[2]
            if g_mirror != 0.0:
                g_view[0] = g_mirror * (2.0 * cosine * nx - towards[0])
                g_view[1] = g_mirror * (2.0 * cosine * ny - towards[1])
                g_view[2] = g_mirror * (2.0 * cosine * nz - towards[2])
                radial = g_view[0] * view[0] + g_view[1] * view[1] + g_view[2] * view[2]
                for axis in range(3):
                    by_eye[axis] += (g_view[axis] - radial * view[axis]) / length


@njit(cache=True)
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
