"""Which face does each sample see: a fixed-point, watertight visibility buffer for one view.

Frame of this file: camera coordinates with x right, y down, z forward, so that a sample at column `i`, row `j` looks
along the ray ((i + 1/2 - W/2) / f, (j + 1/2 - H/2) / f, 1). Screen coordinates are integers of 1/256 sample, so two
faces that share an edge see the very same edge and every sample centre belongs to exactly one of them (top-left rule).
Small scalar functions, one triangle or one vertex each; drivers live in `mesh.py`.
"""

from __future__ import annotations

import math

import numpy as np

from mvtn_cli.core.render.compiled import njit, njit_inline
from mvtn_cli.core.render.skips import (
    BACKFACE,
    BEHIND_SOLID,
    CLIPPED,
    COVERS_NOTHING,
    DRAWN,
    FRUSTUM,
    HIDDEN,
    NEAR_CLIP,
    NO_SAMPLE,
    OCCLUDED,
    OUTSIDE,
)

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
# Side of an occlusion tile in samples, and after how many faces the tiles are made anew.
TILE, REFRESH = 16, 4096


@njit
def snap(value):
    """Round a screen coordinate (samples) to the 1/256 grid, held within the fixed-point range."""
    scaled = value * SUBPIXEL
    return int(math.floor(min(max(scaled, -LIMIT), LIMIT) + 0.5))


@njit_inline
def project_vertex(vertices, i, rt, focal, height, width, camera, screen):
    """Fill row i of `project`."""
    x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
    right = rt[0, 0] * x + rt[0, 1] * y + rt[0, 2] * z + rt[0, 3]
    down = -(rt[1, 0] * x + rt[1, 1] * y + rt[1, 2] * z + rt[1, 3])
    ahead = -(rt[2, 0] * x + rt[2, 1] * y + rt[2, 2] * z + rt[2, 3])
    camera[i, 0], camera[i, 1], camera[i, 2] = right, down, ahead
    if ahead > NEAR:
        scale = focal / ahead
        screen[i, 0] = snap(right * scale + width * 0.5)
        screen[i, 1] = snap(down * scale + height * 0.5)
    else:
        screen[i, 0] = BEHIND


@njit
def project(vertices, rt, focal, height, width, camera, screen):
    """Fill `camera` (V,3) and `screen` (V,2) int32; x is BEHIND where the vertex is not in front of the near plane.

    A non-finite vertex fails `z > NEAR` and so counts as behind the camera.
    """
    for i in range(vertices.shape[0]):
        project_vertex(vertices, i, rt, focal, height, width, camera, screen)


@njit
def narrow(edge, slope, low, high):
    """Shrink the integer range [low, high] to the i with edge + slope * i >= 0, by exact division."""
    if slope > 0:
        low = max(low, -(edge // slope))
    elif slope < 0:
        high = min(high, edge // (-slope))
    elif edge < 0:
        high = low - 1
    return low, high


@njit_inline
def edge_at(x, y, start_x, start_y, along_x, along_y):
    """Return the edge function at a screen point: at least 0 on the face's side.

    Top-left rule: a sample exactly on an edge belongs to the face for which the edge is a left or a top one.
    """
    bias = 0 if (along_y < 0 or (along_y == 0 and along_x > 0)) else -1
    return along_x * (y - start_y) - along_y * (x - start_x) + bias


@njit_inline
def inverse_depth_at(plane_i, plane_j, plane_0, farthest, nearest, i, j):
    """1/z of a face at a sample, held between the face's own `farthest` and `nearest`."""
    return min(max(plane_i * i + plane_j * j + plane_0, farthest), nearest)


@njit
def fill(
    x0, y0, x1, y1, x2, y2, left, right, top, bottom, face, faces, camera, focal, nearest, farthest, ids,
    inverse_depth,
):  # fmt: skip
    """Write `face` into every sample of the box whose centre lies in the triangle and that it is the nearest for.

    1/z is affine in the sample; it is held between the face's own `farthest` and `nearest`, which keeps edge-on faces
    from spilling depth. The plane is found at the first sample that is covered: most faces of a dense mesh cover none.
    """
    area = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
    if area == 0:
        return
    if area < 0:
        x1, x2, y1, y2 = x2, x1, y2, y1
    height, width = ids.shape
    ax, ay, bx, by, cx, cy = x1 - x0, y1 - y0, x2 - x1, y2 - y1, x0 - x2, y0 - y2
    row_y, column_x = (top << 8) + HALF, (left << 8) + HALF
    edge_a = edge_at(column_x, row_y, x0, y0, ax, ay)
    edge_b = edge_at(column_x, row_y, x1, y1, bx, by)
    edge_c = edge_at(column_x, row_y, x2, y2, cx, cy)
    right_a, right_b, right_c = -ay * SUBPIXEL, -by * SUBPIXEL, -cy * SUBPIXEL
    small = right - left < SMALL
    known, usable, plane_i, plane_j, plane_0 = False, True, 0.0, 0.0, 0.0
    for j in range(top, bottom + 1):
        first, last = left, right
        if not small:
            first, last = narrow(edge_a, right_a, 0, right - left)
            first, last = narrow(edge_b, right_b, first, last)
            first, last = narrow(edge_c, right_c, first, last)
            first, last = first + left, last + left
        a, b, c = edge_a, edge_b, edge_c
        for i in range(first, last + 1):
            if not small or (a | b | c) >= 0:
                if not known:
                    known = True
                    usable, plane_i, plane_j, plane_0 = plane_of(faces, camera, face, focal, height, width)
                    if not usable:
                        return
                w = inverse_depth_at(plane_i, plane_j, plane_0, farthest, nearest, i, j)
                if w > inverse_depth[j, i] * DEPTH_MARGIN:
                    inverse_depth[j, i] = w
                    ids[j, i] = face
            a += right_a
            b += right_b
            c += right_c
        edge_a += ax * SUBPIXEL
        edge_b += bx * SUBPIXEL
        edge_c += cx * SUBPIXEL


@njit
def plane_normal(camera, faces, face):
    """Normal of a face in camera coordinates, not normalised."""
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    ux, uy, uz = camera[b, 0] - camera[a, 0], camera[b, 1] - camera[a, 1], camera[b, 2] - camera[a, 2]
    vx, vy, vz = camera[c, 0] - camera[a, 0], camera[c, 1] - camera[a, 1], camera[c, 2] - camera[a, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@njit
def plane_of(faces, camera, face, focal, height, width):
    """Return (usable, by column, by row, at sample (0, 0)): 1/z of the face's plane as it changes over the image."""
    a = faces[face, 0]
    nx, ny, nz = plane_normal(camera, faces, face)
    offset = nx * camera[a, 0] + ny * camera[a, 1] + nz * camera[a, 2]
    if offset == 0.0 or not math.isfinite(offset):
        return False, 0.0, 0.0, 0.0
    plane_i, plane_j = nx / (offset * focal), ny / (offset * focal)
    return True, plane_i, plane_j, nz / offset + plane_i * (0.5 - width * 0.5) + plane_j * (0.5 - height * 0.5)


@njit
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


@njit
def box_of(x0, y0, x1, y1, x2, y2, height, width):
    """Return first and last column, first and last row of the sample centres in a box; empty: first > last."""
    left = max(0, (min(x0, x1, x2) + HALF - 1) >> 8)
    right = min(width - 1, (max(x0, x1, x2) - HALF) >> 8)
    top = max(0, (min(y0, y1, y2) + HALF - 1) >> 8)
    bottom = min(height - 1, (max(y0, y1, y2) - HALF) >> 8)
    return left, right, top, bottom


@njit_inline
def clip_at_near(face, faces, camera, screen, focal, height, width, polygon):
    """Fill `polygon` (4,2) int64 with what the near plane leaves of a face, on the screen.

    Returns:
        (number of corners, z of the nearest vertex, of the farthest one).
    """
    corners, nearest_z, farthest_z = 0, 1e300, 0.0
    for s in range(3):
        i, j = faces[face, s], faces[face, (s + 1) % 3]
        nearest_z, farthest_z = min(nearest_z, camera[i, 2]), max(farthest_z, camera[i, 2])
        if camera[i, 2] > NEAR:
            polygon[corners, 0], polygon[corners, 1] = screen[i, 0], screen[i, 1]
            corners += 1
        if (camera[i, 2] > NEAR) != (camera[j, 2] > NEAR):
            polygon[corners, 0], polygon[corners, 1] = cut_at_near(camera, i, j, focal, height, width)
            corners += 1
    return corners, nearest_z, farthest_z


@njit
def draw_clipped(face, faces, camera, screen, focal, first_row, last_row, ids, inverse_depth, polygon):
    """Cut one face at the near plane and draw what is left; `polygon` (4,2) int64 is scratch."""
    height, width = ids.shape
    if not plane_of(faces, camera, face, focal, height, width)[0]:
        return
    corners, nearest_z, farthest_z = clip_at_near(face, faces, camera, screen, focal, height, width, polygon)
    for s in range(1, corners - 1):
        x0, y0, x1, y1 = polygon[0, 0], polygon[0, 1], polygon[s, 0], polygon[s, 1]
        x2, y2 = polygon[s + 1, 0], polygon[s + 1, 1]
        left, right, top, bottom = box_of(x0, y0, x1, y1, x2, y2, height, width)
        fill(
            x0, y0, x1, y1, x2, y2, left, right, max(top, first_row), min(bottom, last_row), face, faces, camera,
            focal, 1.0 / max(nearest_z, NEAR), 1.0 / farthest_z, ids, inverse_depth,
        )  # fmt: skip


@njit
def refresh_tiles(inverse_depth, first_row, last_row, tiles):
    """Set each tile to the 1/z of its farthest sample, 0 where any sample is still empty."""
    tiles[:] = 0.0
    width = inverse_depth.shape[1]
    for tile_j in range(first_row // TILE, last_row // TILE + 1):
        for tile_i in range(tiles.shape[1]):
            farthest = 1e300
            for j in range(max(first_row, tile_j * TILE), min(last_row + 1, (tile_j + 1) * TILE)):
                for i in range(tile_i * TILE, min(width, (tile_i + 1) * TILE)):
                    farthest = min(farthest, inverse_depth[j, i])
            tiles[tile_j, tile_i] = farthest if farthest < 1e300 else 0.0


@njit
def hidden(tiles, left, right, top, bottom, nearest):
    """Whether everything in the box is already covered by what is nearer than 1/z = `nearest`."""
    for tile_j in range(top // TILE, bottom // TILE + 1):
        for tile_i in range(left // TILE, right // TILE + 1):
            if nearest > tiles[tile_j, tile_i]:
                return False
    return True


@njit
def seen_from_behind(x0, y0, x1, y1, x2, y2):
    """Whether the corners, counter-clockwise from outside, appear clockwise; rows grow downward."""
    return (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0) > 0


@njit
def rasterise(faces, solid, camera, screen, focal, first_row, last_row, skips, ids, inverse_depth, counts):
    """Draw all faces into some rows of one view, and count what was left out.

    Args:
        faces: (F, 3).
        solid: (F,) uint8, 1 where the face seen from behind is hidden for certain (`solids.py`); may be empty.
        camera, screen: Of `project`.
        focal: In samples.
        first_row, last_row: Which rows.
        skips: Bits of `skips.py`: what may be left out.
        ids, inverse_depth: (H, W), these rows are filled; -1 and 0 where nothing is seen.
        counts: (COUNTERS,) int64, added to. Of a view drawn in bands, each of which ends with the first row of the
            next, a face counts in the first that it reaches; in the top one if it reaches no row.
    """
    height, width = ids.shape
    polygon = np.empty((4, 2), np.int64)
    ids[first_row : last_row + 1] = -1
    inverse_depth[first_row : last_row + 1] = 0.0
    number = faces.shape[0]
    culling = skips & BACKFACE != 0 and solid.shape[0] == number
    # Tiles pay where many faces lie behind each other; `due` is when they are next made.
    due = REFRESH if skips & OCCLUDED != 0 and number > 2 * REFRESH else number
    tiles = np.zeros((height // TILE + 1, width // TILE + 1)) if due < number else np.zeros((1, 1))
    tiled, top_rows = False, first_row == 0
    for face in range(number):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        x0, x1, x2 = np.int64(screen[a, 0]), np.int64(screen[b, 0]), np.int64(screen[c, 0])
        y0, y1, y2 = np.int64(screen[a, 1]), np.int64(screen[b, 1]), np.int64(screen[c, 1])
        reaches = min(x0, x1, x2) == BEHIND
        clipping = reaches or skips & NEAR_CLIP == 0
        counts[CLIPPED] += clipping and top_rows
        if max(x0, x1, x2) == BEHIND and skips & FRUSTUM != 0:
            counts[OUTSIDE] += top_rows
            continue
        if reaches:
            counts[DRAWN] += top_rows
            draw_clipped(face, faces, camera, screen, focal, first_row, last_row, ids, inverse_depth, polygon)
            continue
        left, right, top, bottom = box_of(x0, y0, x1, y1, x2, y2, height, width)
        empty = left > right or top > bottom
        counted = top_rows or (not empty and top > first_row)
        top, bottom = max(top, first_row), min(bottom, last_row)
        if not empty and top > bottom:
            continue
        if empty:
            outside = max(x0, x1, x2) < HALF or min(x0, x1, x2) > width * SUBPIXEL - HALF
            outside = outside or max(y0, y1, y2) < HALF or min(y0, y1, y2) > height * SUBPIXEL - HALF
            if skips & (FRUSTUM if outside else NO_SAMPLE) != 0:
                counts[OUTSIDE if outside else COVERS_NOTHING] += counted
                continue
        if culling and solid[face] != 0 and seen_from_behind(x0, y0, x1, y1, x2, y2):
            counts[BEHIND_SOLID] += counted
            continue
        nearest = 1.0 / min(camera[a, 2], camera[b, 2], camera[c, 2])
        if face >= due:
            refresh_tiles(inverse_depth, first_row, last_row, tiles)
            due, tiled = due + REFRESH, True
        if tiled and not empty and hidden(tiles, left, right, top, bottom, nearest):
            counts[HIDDEN] += counted
            continue
        counts[DRAWN] += counted
        if clipping:
            draw_clipped(face, faces, camera, screen, focal, first_row, last_row, ids, inverse_depth, polygon)
            continue
        farthest = 1.0 / max(camera[a, 2], camera[b, 2], camera[c, 2])
        fill(
            x0, y0, x1, y1, x2, y2, left, right, top, bottom, face, faces, camera, focal, nearest, farthest, ids,
            inverse_depth,
        )  # fmt: skip
