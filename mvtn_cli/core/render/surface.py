"""What is seen at each sample: the G-buffer of one view.

Of the surface at a sample centre it holds 1/z, the unit normal towards the eye and, where the shape has colours, the
interpolated one: all that light needs. It does not depend on light, albedo or background, so views that do not move can
keep it (`gbuffer.py`).
"""

from __future__ import annotations

import math

import numpy as np

from mvtn_cli.core.render.compiled import njit
from mvtn_cli.core.render.raster import SUBPIXEL

# Faces below this many square samples have no creases of their own: their steps are image flow.
COARSE = 0.5


@njit
def face_frame(camera, a, b, c, frame):
    """Fill `frame` (3,3): barycentric weight i of a ray r is proportional to frame[i].r; return the signed volume.

    Perspective-correct by construction, and valid for the part of a face that is in front of the near plane.
    """
    for row in range(3):
        p, q = (b, c) if row == 0 else ((c, a) if row == 1 else (a, b))
        frame[row, 0] = camera[p, 1] * camera[q, 2] - camera[p, 2] * camera[q, 1]
        frame[row, 1] = camera[p, 2] * camera[q, 0] - camera[p, 0] * camera[q, 2]
        frame[row, 2] = camera[p, 0] * camera[q, 1] - camera[p, 1] * camera[q, 0]
    return camera[a, 0] * frame[0, 0] + camera[a, 1] * frame[0, 1] + camera[a, 2] * frame[0, 2]


@njit
def barycentric(frame, volume, ray_x, ray_y):
    """Return the three weights of the ray's hit, clamped into the face."""
    sign = 1.0 if volume >= 0 else -1.0
    w0 = max(0.0, sign * (frame[0, 0] * ray_x + frame[0, 1] * ray_y + frame[0, 2]))
    w1 = max(0.0, sign * (frame[1, 0] * ray_x + frame[1, 1] * ray_y + frame[1, 2]))
    w2 = max(0.0, sign * (frame[2, 0] * ray_x + frame[2, 1] * ray_y + frame[2, 2]))
    total = w0 + w1 + w2
    if total <= 0.0:
        return 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0
    scale = 1.0 / total
    return w0 * scale, w1 * scale, w2 * scale


@njit
def corner_normals(normals, rt, a, b, c, frame, volume, smooth, corners):
    """Fill `corners` (4,3): the face's own normal (any length) in row 3, above those of its corners, all to the eye.

    The rows of `frame` sum to the face's normal in camera coordinates; the eye sees its front exactly when `volume` is
    negative. A corner normal that disagrees with its face is turned, so that meshes wound both ways are lit alike.
    """
    sign = -1.0 if volume >= 0 else 1.0
    right = sign * (frame[0, 0] + frame[1, 0] + frame[2, 0])
    up = -sign * (frame[0, 1] + frame[1, 1] + frame[2, 1])
    back = -sign * (frame[0, 2] + frame[1, 2] + frame[2, 2])
    nx = rt[0, 0] * right + rt[1, 0] * up + rt[2, 0] * back
    ny = rt[0, 1] * right + rt[1, 1] * up + rt[2, 1] * back
    nz = rt[0, 2] * right + rt[1, 2] * up + rt[2, 2] * back
    corners[3, 0], corners[3, 1], corners[3, 2] = nx, ny, nz
    if not smooth:
        return
    for row in range(3):
        i = a if row == 0 else (b if row == 1 else c)
        turn = 1.0 if normals[i, 0] * nx + normals[i, 1] * ny + normals[i, 2] * nz >= 0 else -1.0
        for axis in range(3):
            corners[row, axis] = turn * normals[i, axis]


@njit
def normal_at(corners, smooth, w0, w1, w2):
    """Return the unit normal at barycentric weights; the face's own where the corners' cancel."""
    if smooth:
        nx = w0 * corners[0, 0] + w1 * corners[1, 0] + w2 * corners[2, 0]
        ny = w0 * corners[0, 1] + w1 * corners[1, 1] + w2 * corners[2, 1]
        nz = w0 * corners[0, 2] + w1 * corners[1, 2] + w2 * corners[2, 2]
        square = nx * nx + ny * ny + nz * nz
        if square > 1e-8:
            scale = 1.0 / math.sqrt(square)
            return nx * scale, ny * scale, nz * scale
    nx, ny, nz = corners[3, 0], corners[3, 1], corners[3, 2]
    square = nx * nx + ny * ny + nz * nz
    scale = 1.0 / math.sqrt(square) if square > 0.0 else 0.0
    return nx * scale, ny * scale, nz * scale


@njit
def crease_bits(creases, face, a, b, c, screen, smooth):
    """Which edges of a face break the shading: split normals if smooth, bent edges if flat; none if it is tiny."""
    area = (np.int64(screen[b, 0]) - screen[a, 0]) * (np.int64(screen[c, 1]) - screen[a, 1])
    area -= (np.int64(screen[b, 1]) - screen[a, 1]) * (np.int64(screen[c, 0]) - screen[a, 0])
    if abs(area) < 2.0 * COARSE * SUBPIXEL * SUBPIXEL:
        return 0
    return creases[face] & 7 if smooth else creases[face] >> 3


@njit
def covered_box(ids, first_row, last_row, box):
    """Fill `box` (4,) with first and last row (of some) and column that see anything; empty: first > last."""
    height, width = ids.shape
    box[0], box[1], box[2], box[3] = height, -1, width, -1
    for j in range(first_row, last_row + 1):
        first = 0
        while first < width and ids[j, first] < 0:
            first += 1
        if first == width:
            continue
        last = width - 1
        while ids[j, last] < 0:
            last -= 1
        box[0], box[1] = min(box[0], j), j
        box[2], box[3] = min(box[2], first), max(box[3], last)


@njit
def describe(
    normals, colors, faces, creases, rt, focal, smooth, camera, screen, ids, inverse_depth, box, depth, normal_image,
    tint, planes, sharp,
):  # fmt: skip
    """Describe the surface at each sample of the covered box.

    Args:
        normals, colors, faces, creases: Of the shape.
        rt, focal, smooth: Of the view, in samples.
        camera, screen, ids, inverse_depth: Of `rasterise`.
        box: (4,) of `covered_box`.
        depth: (H, W) float32, filled with 1/z.
        normal_image: (H, W, 3) float32, filled.
        tint: (H, W, 3) float32, filled with the interpolated colour; empty for shapes without colours.
        planes: (H, W, 2) float32, filled with how 1/z of the face's plane changes by column and by row.
        sharp: (H, W) uint8, filled with the face's edges that are creases.
    """
    height, width = ids.shape
    frame, corners = np.empty((3, 3)), np.empty((4, 3))
    last, volume, by_column, by_row, bits = -1, 0.0, 0.0, 0.0, 0
    nx, ny, nz = 0.0, 0.0, 0.0
    a = b = c = 0
    for j in range(box[0], box[1] + 1):
        for i in range(box[2], box[3] + 1):
            face = ids[j, i]
            if face < 0:
                depth[j, i] = 0.0
                continue
            fresh = face != last
            if fresh:
                last = face
                a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
                volume = face_frame(camera, a, b, c, frame)
                corner_normals(normals, rt, a, b, c, frame, volume, smooth, corners)
                by_column = (frame[0, 0] + frame[1, 0] + frame[2, 0]) / (volume * focal)
                by_row = (frame[0, 1] + frame[1, 1] + frame[2, 1]) / (volume * focal)
                bits = crease_bits(creases, face, a, b, c, screen, smooth)
            if smooth or tint.shape[0] > 0:
                ray_x, ray_y = (i + 0.5 - width * 0.5) / focal, (j + 0.5 - height * 0.5) / focal
                w0, w1, w2 = barycentric(frame, volume, ray_x, ray_y)
                nx, ny, nz = normal_at(corners, smooth, w0, w1, w2)
                if tint.shape[0] > 0:
                    for channel in range(3):
                        mixed = w0 * colors[a, channel] + w1 * colors[b, channel] + w2 * colors[c, channel]
                        tint[j, i, channel] = mixed
            elif fresh:
                nx, ny, nz = normal_at(corners, smooth, 1.0, 0.0, 0.0)
            depth[j, i] = inverse_depth[j, i]
            normal_image[j, i, 0], normal_image[j, i, 1], normal_image[j, i, 2] = nx, ny, nz
            planes[j, i, 0], planes[j, i, 1] = by_column, by_row
            sharp[j, i] = bits
