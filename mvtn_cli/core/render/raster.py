"""Which face does each sample see: a fixed-point, watertight visibility buffer for one view.

Frame of this file: camera coordinates with x right, y down, z forward, so that a sample at column `i`, row `j` looks
along the ray ((i + 1/2 - W/2) / f, (j + 1/2 - H/2) / f, 1). Screen coordinates are integers of 1/256 sample, so two
faces that share an edge see the very same edge and every sample centre belongs to exactly one of them (top-left rule).
Small scalar functions, one triangle or one vertex each; drivers live in `mesh.py`.
"""

from __future__ import annotations

import math

import numpy as np

from mvtn_cli.core.render.compiled import njit

SUBPIXEL = 256
HALF = SUBPIXEL // 2
# Screen coordinates are held within ±LIMIT, so that products of two differences fit in 64 bits.
LIMIT = 2.0**30
BEHIND = -(2**31)
# A newcomer must be nearer by this relative amount: coplanar faces resolve by face id, without speckle.
DEPTH_MARGIN = 1.0 + 5e-7
NEAR = 0.01
# Up to this many columns each sample is tested; beyond, the span of each row is found by exact division.
SMALL = 5


@njit(cache=True)
def snap(value):
    """Round a screen coordinate (samples) to the 1/256 grid, held within the fixed-point range."""
    scaled = value * SUBPIXEL
    return int(math.floor(min(max(scaled, -LIMIT), LIMIT) + 0.5))


@njit(cache=True)
def project(vertices, rt, focal, height, width, camera, screen):
    """Fill `camera` (V,3) and `screen` (V,2) int32; x is BEHIND where the vertex is not in front of the near plane.

    A non-finite vertex fails `z > NEAR` and so counts as behind the camera.
    """
    for i in range(vertices.shape[0]):
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        right = rt[0, 0] * x + rt[0, 1] * y + rt[0, 2] * z + rt[0, 3]
        down = -(rt[1, 0] * x + rt[1, 1] * y + rt[1, 2] * z + rt[1, 3])
        ahead = -(rt[2, 0] * x + rt[2, 1] * y + rt[2, 2] * z + rt[2, 3])
        camera[i, 0], camera[i, 1], camera[i, 2] = right, down, ahead
        if ahead > NEAR:
            screen[i, 0] = snap(right * focal / ahead + width * 0.5)
            screen[i, 1] = snap(down * focal / ahead + height * 0.5)
        else:
            screen[i, 0] = BEHIND


@njit(cache=True)
def narrow(edge, slope, low, high):
    """Shrink the integer range [low, high] to the i with edge + slope * i >= 0, by exact division."""
    if slope > 0:
        low = max(low, -(edge // slope))
    elif slope < 0:
        high = min(high, edge // (-slope))
    elif edge < 0:
        high = low - 1
    return low, high


@njit(cache=True)
def fill_small(
    edge_a, edge_b, edge_c, right_a, right_b, right_c, down_a, down_b, down_c, left, right, top, bottom, plane_i,
    plane_j, plane_0, nearest, farthest, face, ids, inverse_depth,
):  # fmt: skip
    """Test every sample of a small box; the edge functions are given at column 0 of row `top`, with their steps."""
    edge_a += right_a * left
    edge_b += right_b * left
    edge_c += right_c * left
    for j in range(top, bottom + 1):
        a, b, c = edge_a, edge_b, edge_c
        for i in range(left, right + 1):
            if (a | b | c) >= 0:
                w = min(max(plane_i * i + plane_j * j + plane_0, farthest), nearest)
                if w > inverse_depth[j, i] * DEPTH_MARGIN:
                    inverse_depth[j, i] = w
                    ids[j, i] = face
            a += right_a
            b += right_b
            c += right_c
        edge_a += down_a
        edge_b += down_b
        edge_c += down_c


@njit(cache=True)
def fill(x0, y0, x1, y1, x2, y2, plane_i, plane_j, plane_0, nearest, farthest, face, ids, inverse_depth):
    """Write `face` into every sample whose centre lies in the triangle and that it is the nearest for.

    1/z = plane_i * i + plane_j * j + plane_0, held between the face's own `farthest` and `nearest` 1/z, which keeps
    edge-on faces from spilling depth.
    """
    area = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
    if area == 0:
        return
    if area < 0:
        x1, x2, y1, y2 = x2, x1, y2, y1
    height, width = ids.shape
    left = max(0, (min(x0, x1, x2) + HALF - 1) >> 8)
    right = min(width - 1, (max(x0, x1, x2) - HALF) >> 8)
    top = max(0, (min(y0, y1, y2) + HALF - 1) >> 8)
    bottom = min(height - 1, (max(y0, y1, y2) - HALF) >> 8)
    if left > right or top > bottom:
        return
    ax, ay, bx, by, cx, cy = x1 - x0, y1 - y0, x2 - x1, y2 - y1, x0 - x2, y0 - y2
    # Top-left rule: a sample exactly on an edge belongs to the face for which the edge is a left or a top one.
    bias_a = 0 if (ay < 0 or (ay == 0 and ax > 0)) else -1
    bias_b = 0 if (by < 0 or (by == 0 and bx > 0)) else -1
    bias_c = 0 if (cy < 0 or (cy == 0 and cx > 0)) else -1
    row_y = (top << 8) + HALF
    edge_a = ax * (row_y - y0) - ay * (HALF - x0) + bias_a
    edge_b = bx * (row_y - y1) - by * (HALF - x1) + bias_b
    edge_c = cx * (row_y - y2) - cy * (HALF - x2) + bias_c
    if right - left < SMALL:
        fill_small(
            edge_a, edge_b, edge_c, -ay * SUBPIXEL, -by * SUBPIXEL, -cy * SUBPIXEL, ax * SUBPIXEL, bx * SUBPIXEL,
            cx * SUBPIXEL, left, right, top, bottom, plane_i, plane_j, plane_0, nearest, farthest, face, ids,
            inverse_depth,
        )  # fmt: skip
        return
    for j in range(top, bottom + 1):
        first, last = narrow(edge_a, -ay * SUBPIXEL, left, right)
        first, last = narrow(edge_b, -by * SUBPIXEL, first, last)
        first, last = narrow(edge_c, -cy * SUBPIXEL, first, last)
        for i in range(first, last + 1):
            w = min(max(plane_i * i + plane_j * j + plane_0, farthest), nearest)
            if w > inverse_depth[j, i] * DEPTH_MARGIN:
                inverse_depth[j, i] = w
                ids[j, i] = face
        edge_a += ax * SUBPIXEL
        edge_b += bx * SUBPIXEL
        edge_c += cx * SUBPIXEL


@njit(cache=True)
def cut_at_near(camera, i, j, focal, height, width):
    """Return the screen point where edge (i, j) crosses the near plane.

    The lower index comes first, so that both faces of the edge get the same fixed-point point.
    """
    if j < i:
        i, j = j, i
    share = (NEAR - camera[i, 2]) / (camera[j, 2] - camera[i, 2])
    x = camera[i, 0] + share * (camera[j, 0] - camera[i, 0])
    y = camera[i, 1] + share * (camera[j, 1] - camera[i, 1])
    return snap(x * focal / NEAR + width * 0.5), snap(y * focal / NEAR + height * 0.5)


@njit(cache=True)
def draw_face(face, faces, camera, screen, focal, ids, inverse_depth, polygon):
    """Draw one face; `polygon` (4,2) int64 is scratch for a face that straddles the near plane."""
    height, width = ids.shape
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    xa, xb, xc = np.int64(screen[a, 0]), np.int64(screen[b, 0]), np.int64(screen[c, 0])
    ya, yb, yc = np.int64(screen[a, 1]), np.int64(screen[b, 1]), np.int64(screen[c, 1])
    low = min(xa, xb, xc)
    all_in_front = low != BEHIND
    if all_in_front:
        # Most faces of a dense mesh cover no sample centre: leave before any plane is computed.
        if max(0, (low + HALF - 1) >> 8) > min(width - 1, (max(xa, xb, xc) - HALF) >> 8):
            return
        if max(0, (min(ya, yb, yc) + HALF - 1) >> 8) > min(height - 1, (max(ya, yb, yc) - HALF) >> 8):
            return
    elif xa == BEHIND and xb == BEHIND and xc == BEHIND:
        return
    za, zb, zc = camera[a, 2], camera[b, 2], camera[c, 2]
    ux, uy, uz = camera[b, 0] - camera[a, 0], camera[b, 1] - camera[a, 1], zb - za
    vx, vy, vz = camera[c, 0] - camera[a, 0], camera[c, 1] - camera[a, 1], zc - za
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    offset = nx * camera[a, 0] + ny * camera[a, 1] + nz * za
    if offset == 0.0 or not math.isfinite(offset):
        return
    plane_i, plane_j = nx / (offset * focal), ny / (offset * focal)
    plane_0 = nz / offset + plane_i * (0.5 - width * 0.5) + plane_j * (0.5 - height * 0.5)
    farthest = 1.0 / max(za, zb, zc)
    if all_in_front:
        nearest = 1.0 / min(za, zb, zc)
        fill(xa, ya, xb, yb, xc, yc, plane_i, plane_j, plane_0, nearest, farthest, face, ids, inverse_depth)
        return
    corners = 0
    for s in range(3):
        i, j = faces[face, s], faces[face, (s + 1) % 3]
        if camera[i, 2] > NEAR:
            polygon[corners, 0], polygon[corners, 1] = screen[i, 0], screen[i, 1]
            corners += 1
        if (camera[i, 2] > NEAR) != (camera[j, 2] > NEAR):
            polygon[corners, 0], polygon[corners, 1] = cut_at_near(camera, i, j, focal, height, width)
            corners += 1
    for s in range(1, corners - 1):
        fill(
            polygon[0, 0], polygon[0, 1], polygon[s, 0], polygon[s, 1], polygon[s + 1, 0], polygon[s + 1, 1],
            plane_i, plane_j, plane_0, 1.0 / NEAR, farthest, face, ids, inverse_depth,
        )  # fmt: skip
