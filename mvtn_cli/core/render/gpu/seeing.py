"""Which face does each sample see, and what is the surface there: the kernels, one thread a vertex, face or sample.

The CPU takes faces in their order, and a newcomer has to be nearer by a margin. To end with the same faces, whatever
the order of threads, all faces are gone through twice: first each sample's greatest 1/z is found, then the lowest face
id of those within the margin of it. That differs from the order's answer only where another face lies just beyond the
margin; such samples are marked, and take all faces in their order.
"""

from __future__ import annotations

import numpy as np

from mvtn_cli.core.render.compiled import njit
from mvtn_cli.core.render.gpu.compiled import THREADS, cuda, device_function, kernel
from mvtn_cli.core.render.mesh import outside
from mvtn_cli.core.render.raster import (
    BEHIND,
    DEPTH_MARGIN,
    HALF,
    NEAR,
    box_of,
    clip_at_near,
    edge_at,
    inverse_depth_at,
    plane_of,
    project_vertex,
    seen_from_behind,
)
from mvtn_cli.core.render.surface import barycentric, corner_normals, crease_bits, face_frame, normal_at

NOTHING = 2**31 - 1
# Faces whose box has more samples than this are drawn by a block of threads each.
FEW = 32
DOUBT = DEPTH_MARGIN * DEPTH_MARGIN * (1.0 + 1e-9)


@njit
def outline(face, faces, solid, culling, camera, screen, focal, side, polygon):
    """Fill `polygon` (4,2) with a face on the screen.

    Returns:
        (number of corners, 0 if it is not drawn; its farthest and nearest 1/z; how 1/z changes, as `plane_of`).
    """
    usable, plane_i, plane_j, plane_0 = plane_of(faces, camera, face, focal, side, side)
    if not usable:
        return 0, 0.0, 0.0, 0.0, 0.0, 0.0
    corners, nearest_z, farthest_z = clip_at_near(face, faces, camera, screen, focal, side, side, polygon)
    if corners < 3:
        return 0, 0.0, 0.0, 0.0, 0.0, 0.0
    if culling and solid[face] != 0 and is_whole(face, faces, screen):
        x0, y0, x1, y1 = polygon[0, 0], polygon[0, 1], polygon[1, 0], polygon[1, 1]
        if seen_from_behind(x0, y0, x1, y1, polygon[2, 0], polygon[2, 1]):
            return 0, 0.0, 0.0, 0.0, 0.0, 0.0
    return corners, 1.0 / farthest_z, 1.0 / max(nearest_z, NEAR), plane_i, plane_j, plane_0


@njit
def is_whole(face, faces, screen):
    """Whether all of a face's vertices are in front of the near plane."""
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    return screen[a, 0] != BEHIND and screen[b, 0] != BEHIND and screen[c, 0] != BEHIND


@njit
def polygon_box(polygon, corners, side):
    """`box_of` of up to four corners."""
    low_x, low_y, high_x, high_y = polygon[0, 0], polygon[0, 1], polygon[0, 0], polygon[0, 1]
    for s in range(1, corners):
        low_x, high_x = min(low_x, polygon[s, 0]), max(high_x, polygon[s, 0])
        low_y, high_y = min(low_y, polygon[s, 1]), max(high_y, polygon[s, 1])
    return box_of(low_x, low_y, high_x, high_y, high_x, high_y, side, side)


@njit
def triangle_covers(x0, y0, x1, y1, x2, y2, i, j):
    """Whether the centre of sample (column i, row j) lies in a triangle on the screen, as `fill` has it."""
    area = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
    if area == 0:
        return False
    if area < 0:
        x1, x2, y1, y2 = x2, x1, y2, y1
    x, y = (i << 8) + HALF, (j << 8) + HALF
    a = edge_at(x, y, x0, y0, x1 - x0, y1 - y0)
    b = edge_at(x, y, x1, y1, x2 - x1, y2 - y1)
    return (a | b | edge_at(x, y, x2, y2, x0 - x2, y0 - y2)) >= 0


@njit
def covers(polygon, corners, i, j):
    """Whether the centre of a sample lies in the polygon."""
    for s in range(1, corners - 1):
        x0, y0, x1, y1 = polygon[0, 0], polygon[0, 1], polygon[s, 0], polygon[s, 1]
        if triangle_covers(x0, y0, x1, y1, polygon[s + 1, 0], polygon[s + 1, 1], i, j):
            return True
    return False


@kernel
def project_views(vertices, offsets, rts, shape_of, starts, focal, side, camera, screen):
    """Fill `camera` and `screen`, (sum of V_n, ...): view n's vertices begin at `starts[n]`."""
    i, n = cuda.grid(2)
    v0, v1 = offsets[0, shape_of[n]], offsets[0, shape_of[n] + 1]
    if i < v1 - v0:
        first, last = starts[n], starts[n + 1]
        project_vertex(vertices[v0:v1], i, rts[n], focal, side, side, camera[first:last], screen[first:last])


@device_function
def seek(first, step, face, polygon, corners, farthest, nearest, plane_i, plane_j, plane_0, second, best, ids, doubt):
    """Enter a face at every `step`-th sample of its box, in the first or the second round."""
    left, right, top, bottom = polygon_box(polygon, corners, ids.shape[0])
    columns = right - left + 1
    for s in range(first, columns * (bottom - top + 1), step):
        i, j = left + s % columns, top + s // columns
        if not covers(polygon, corners, i, j):
            continue
        w = inverse_depth_at(plane_i, plane_j, plane_0, farthest, nearest, i, j)
        if not second:
            cuda.atomic.max(best, (j, i), w)
        elif not best[j, i] > w * DEPTH_MARGIN:
            cuda.atomic.min(ids, (j, i), face)
        elif not best[j, i] > w * DOUBT:
            doubt[j, i] = 1


@kernel
def seek_small(
    faces, solid, radii, offsets, rts, shape_of, starts, camera, screen, focal, culled, second, best, ids, doubt,
    most_faces, queue, queued,
):  # fmt: skip
    """Enter the faces of few samples, one thread each; queue the others, in the first round."""
    face, n = cuda.grid(2)
    b = shape_of[n]
    f0, f1 = offsets[1, b], offsets[1, b + 1]
    if face >= f1 - f0:
        return
    polygon = cuda.local.array((4, 2), np.int64)
    mine = slice(starts[n], starts[n + 1])
    side = ids.shape[1]
    corners, farthest, nearest, plane_i, plane_j, plane_0 = outline(
        face, faces[f0:f1], solid[f0:f1], culled and outside(rts[n], radii[b]), camera[mine], screen[mine], focal, side,
        polygon,
    )  # fmt: skip
    if corners == 0:
        return
    left, right, top, bottom = polygon_box(polygon, corners, side)
    if left > right or top > bottom:
        return
    if (right - left + 1) * (bottom - top + 1) > FEW:
        if not second:
            queue[cuda.atomic.add(queued, 0, 1)] = n * most_faces + face
        return
    seek(0, 1, face, polygon, corners, farthest, nearest, plane_i, plane_j, plane_0, second, best[n], ids[n], doubt[n])


@kernel
def seek_large(
    faces, solid, radii, offsets, rts, shape_of, starts, camera, screen, focal, culled, second, best, ids, doubt,
    most_faces, queue, queued,
):  # fmt: skip
    """Enter what was queued, one block each."""
    polygon = cuda.local.array((4, 2), np.int64)
    place = cuda.blockIdx.x
    while place < queued[0]:
        n, face = queue[place] // most_faces, queue[place] % most_faces
        b = shape_of[n]
        f0, f1 = offsets[1, b], offsets[1, b + 1]
        mine = slice(starts[n], starts[n + 1])
        corners, farthest, nearest, plane_i, plane_j, plane_0 = outline(
            face, faces[f0:f1], solid[f0:f1], culled and outside(rts[n], radii[b]), camera[mine], screen[mine], focal,
            ids.shape[1], polygon,
        )  # fmt: skip
        seek(
            cuda.threadIdx.x, THREADS, face, polygon, corners, farthest, nearest, plane_i, plane_j, plane_0, second,
            best[n], ids[n], doubt[n],
        )  # fmt: skip
        place += cuda.gridDim.x


@kernel
def settle(
    faces, solid, radii, offsets, rts, shape_of, starts, camera, screen, focal, culled, best, ids, doubt,
):  # fmt: skip
    """Take all faces in their order where that is what decides; -1 where nothing is seen."""
    sample, n = cuda.grid(2)
    side = ids.shape[1]
    if sample >= side * side:
        return
    j, i = sample // side, sample % side
    if ids[n, j, i] == NOTHING:
        ids[n, j, i] = -1
    if doubt[n, j, i] == 0:
        return
    polygon = cuda.local.array((4, 2), np.int64)
    b = shape_of[n]
    f0, f1 = offsets[1, b], offsets[1, b + 1]
    mine = slice(starts[n], starts[n + 1])
    culling, seen, found = culled and outside(rts[n], radii[b]), 0.0, -1
    for face in range(f1 - f0):
        corners, farthest, nearest, plane_i, plane_j, plane_0 = outline(
            face, faces[f0:f1], solid[f0:f1], culling, camera[mine], screen[mine], focal, side, polygon
        )
        if corners > 0 and covers(polygon, corners, i, j):
            w = inverse_depth_at(plane_i, plane_j, plane_0, farthest, nearest, i, j)
            if w > seen * DEPTH_MARGIN:
                seen, found = w, face
    ids[n, j, i] = found


@njit
def depth_at(faces, camera, face, focal, side, i, j):
    """1/z of a face at a sample that it covers."""
    z0, z1, z2 = camera[faces[face, 0], 2], camera[faces[face, 1], 2], camera[faces[face, 2], 2]
    _, plane_i, plane_j, plane_0 = plane_of(faces, camera, face, focal, side, side)
    nearest, farthest = 1.0 / max(min(z0, z1, z2), NEAR), 1.0 / max(z0, z1, z2)
    return inverse_depth_at(plane_i, plane_j, plane_0, farthest, nearest, i, j)


@kernel
def describe_views(
    normals, colors, faces, creases, offsets, rts, shape_of, starts, camera, screen, focal, smooth, tinted, ids, depth,
    normal_images, tints, planes, sharp,
):  # fmt: skip
    """Describe the surface at each sample, as `describe`; `depth` (N,S,S) float64 is 1/z."""
    sample, n = cuda.grid(2)
    side = ids.shape[1]
    if sample >= side * side:
        return
    j, i = sample // side, sample % side
    face = ids[n, j, i]
    if face < 0:
        depth[n, j, i], sharp[n, j, i] = 0.0, 0
        return
    frame, corners = cuda.local.array((3, 3), np.float64), cuda.local.array((4, 3), np.float64)
    shape = shape_of[n]
    f0, v0, v1 = offsets[1, shape], offsets[0, shape], offsets[0, shape + 1]
    own, eye = faces[f0 : offsets[1, shape + 1]], camera[starts[n] : starts[n + 1]]
    a, b, c = own[face, 0], own[face, 1], own[face, 2]
    volume = face_frame(eye, a, b, c, frame)
    corner_normals(normals[v0:v1], rts[n], a, b, c, frame, volume, smooth, corners)
    w0, w1, w2 = 1.0, 0.0, 0.0
    if smooth or tinted:
        w0, w1, w2 = barycentric(frame, volume, (i + 0.5 - side * 0.5) / focal, (j + 0.5 - side * 0.5) / focal)
    nx, ny, nz = normal_at(corners, smooth, w0, w1, w2)
    normal_images[n, j, i, 0], normal_images[n, j, i, 1], normal_images[n, j, i, 2] = nx, ny, nz
    if tinted:
        for channel in range(3):
            mixed = w0 * colors[v0 + a, channel] + w1 * colors[v0 + b, channel] + w2 * colors[v0 + c, channel]
            tints[n, j, i, channel] = mixed
    planes[n, j, i, 0] = (frame[0, 0] + frame[1, 0] + frame[2, 0]) / (volume * focal)
    planes[n, j, i, 1] = (frame[0, 1] + frame[1, 1] + frame[2, 1]) / (volume * focal)
    sharp[n, j, i] = crease_bits(creases[f0:], face, a, b, c, screen[starts[n] : starts[n + 1]], smooth)
    depth[n, j, i] = depth_at(own, eye, face, focal, side, i, j)
