"""From what is seen to pixels, and from a gradient of pixels to twelve numbers a view: the kernels.

Jumps are not listed but looked for again by the gradient: no room has to be made for a number of them that only the
device knows. Each pixel gathers what moves into it, so that sums have one order and pictures the same bytes each time.
"""

from __future__ import annotations

import numpy as np

from mvtn_cli.core.render.compiled import njit
from mvtn_cli.core.render.edges import COLUMNS, PART, SHARE, SLOPE, between, blends, note
from mvtn_cli.core.render.flow import add_edge, add_sample, reduce_to_camera
from mvtn_cli.core.render.gpu.adding import add_up_block
from mvtn_cli.core.render.gpu.compiled import THREADS, cuda, kernel
from mvtn_cli.core.render.shade import SPECULAR, light_of, paint_sample
from mvtn_cli.core.render.skips import SHADING_TERMS

# Bits of `links` above those of the CPU: a jump to the right, and downward.
JUMPS = 4
# Samples that one thread sums up, and how many numbers: moments (3,4), by eye (3), by light (3).
RUN, TERMS = 8, 18


@kernel
def find_jumps(
    faces, face_edges, edge_starts, edge_faces, creases, offsets, shape_of, starts, camera, focal, smooth, ids, depth,
    planes, sharp, normal_images, links, moves,
):  # fmt: skip
    """Fill `links` (N,S,S), and `moves` (N,S,S,2,2) float32.

    moves[..., down, side] is the share of the step between two samples that moves out of the first (side 0) or the
    second one.
    """
    sample, n = cuda.grid(2)
    side = ids.shape[1]
    if sample >= side * side:
        return
    j, i = sample // side, sample % side
    found, records = cuda.local.array((2, COLUMNS), np.float64), cuda.local.array((2, COLUMNS), np.float32)
    passed, shares = cuda.local.array((2, 2), np.int64), cuda.local.array(2, np.float64)
    where = cuda.local.array(2, np.int32)
    b, link = shape_of[n], 0
    f0, f1 = offsets[1, b], offsets[1, b + 1]
    for down in range(2):
        smoothly, number = between(
            camera[starts[n] : starts[n + 1]], faces[f0:f1], face_edges[f0:f1],
            edge_starts[offsets[2, b] : offsets[2, b + 1]], edge_faces[offsets[3, b] : offsets[3, b + 1]],
            creases[f0:f1], 0 if smooth else 3, ids[n], depth[n], planes[n], sharp[n], normal_images[n], focal, j, i,
            down, passed, shares, found,
        )  # fmt: skip
        count = note(records, where, 0, found, number, 0)
        link |= (1 << down if smoothly else 0) | (JUMPS << down if count > 0 else 0)
        out_of_first, out_of_second = 0.0, 0.0
        for k in range(count):
            move = (0.5 - records[k, SHARE]) * records[k, PART]
            if not blends(records[k, SLOPE], down):
                continue
            if move < 0:
                out_of_second += move
            else:
                out_of_first += move
        moves[n, j, i, down, 0], moves[n, j, i, down, 1] = out_of_first, out_of_second
    links[n, j, i] = link


@kernel
def paint_views(
    rts, shape_of, focal, lights, albedos, material, background, skips, tint_side, depth, normal_images, tints, images
):
    """Fill `images` (N,S,S,3) with the colour at each sample centre."""
    sample, n = cuda.grid(2)
    side = depth.shape[1]
    if sample >= side * side:
        return
    j, i = sample // side, sample % side
    if depth[n, j, i] == 0.0:
        for channel in range(3):
            images[n, j, i, channel] = background[channel]
        return
    b = shape_of[n]
    _, lx, ly, lz = light_of(rts[n], lights[b])
    shiny = material[SPECULAR] > 0.0 or skips & SHADING_TERMS == 0
    paint_sample(
        j, i, rts[n], focal, lx, ly, lz, albedos[b], material, shiny, side, side, normal_images[n],
        tints[n, :tint_side], images[n],
    )  # fmt: skip


@njit
def moved_into(image, moves, channel, j, i):
    """How much of the steps between a sample and its four neighbours moves out of the sample."""
    total, here = 0.0, image[j, i, channel]
    side = image.shape[0]
    if i + 1 < side:
        total += moves[j, i, 0, 0] * (here - image[j, i + 1, channel])
    if j + 1 < side:
        total += moves[j, i, 1, 0] * (here - image[j + 1, i, channel])
    if i > 0:
        total += moves[j, i - 1, 0, 1] * (image[j, i - 1, channel] - here)
    if j > 0:
        total += moves[j - 1, i, 1, 1] * (image[j - 1, i, channel] - here)
    return total


@njit
def is_touched(links, j, i):
    """Whether a sample is one of those that `blend` holds within [0, 1]."""
    first = links[j, i] >= JUMPS
    return first or (i > 0 and links[j, i - 1] >= JUMPS) or (j > 0 and links[j - 1, i] >= JUMPS)


@kernel
def make_pixels(images, moves, links, background, supersample, out):
    """Fill `out` (N,3,H,W): the mean of each pixel's samples, its jumps moved to where they really are."""
    pixel, n = cuda.grid(2)
    size = out.shape[2]
    if pixel >= size * size:
        return
    row, column = pixel // size, pixel % size
    share = 1.0 / (supersample * supersample)
    for channel in range(3):
        out[n, channel, row, column] = background[channel]
        moved, touched = 0.0, False
        for j in range(row * supersample, (row + 1) * supersample):
            for i in range(column * supersample, (column + 1) * supersample):
                out[n, channel, row, column] += (images[n, j, i, channel] - background[channel]) * share
                moved += moved_into(images[n], moves[n], channel, j, i)
                touched = touched or is_touched(links[n], j, i)
        out[n, channel, row, column] -= moved * share
        if touched:
            out[n, channel, row, column] = min(max(out[n, channel, row, column], 0.0), 1.0)


@kernel
def sum_slopes(
    faces, face_edges, edge_starts, edge_faces, creases, offsets, rts, shape_of, starts, camera, focal, smooth, ids,
    depth, planes, sharp, normal_images, links, tint_side, tints, images, lights, albedos, material, box, supersample,
    edges, weights, sums,
):  # fmt: skip
    """Fill `sums` (N,K,18): what each block of RUN * THREADS samples adds to moments, eye and light."""
    n, side, thread = cuda.blockIdx.y, ids.shape[1], cuda.threadIdx.x
    terms = cuda.shared.array((THREADS, TERMS), np.float64)
    found, records = cuda.local.array((2, COLUMNS), np.float64), cuda.local.array((2, COLUMNS), np.float32)
    passed, shares = cuda.local.array((2, 2), np.int64), cuda.local.array(2, np.float64)
    where, jump = cuda.local.array(2, np.int32), cuda.local.array(3, np.float64)
    moments = cuda.local.array((3, 4), np.float64)
    by_eye, by_light = cuda.local.array(3, np.float64), cuda.local.array(3, np.float64)
    for p in range(3):
        by_eye[p], by_light[p] = 0.0, 0.0
        for q in range(4):
            moments[p, q] = 0.0
    b = shape_of[n]
    f0, f1 = offsets[1, b], offsets[1, b + 1]
    headlight, lx, ly, lz = light_of(rts[n], lights[b])
    shiny = material[SPECULAR] > 0.0
    for k in range(RUN):
        sample = (cuda.blockIdx.x * RUN + k) * THREADS + thread
        if sample >= side * side:
            break
        j, i = sample // side, sample % side
        add_sample(
            j, i, depth[n], normal_images[n], tints[n, :tint_side], images[n], links[n], box, weights[n], supersample,
            focal, rts[n], headlight or shiny, shiny, lx, ly, lz, albedos[b], material, moments, by_eye, by_light,
        )  # fmt: skip
        for down in range(2):
            if not edges or links[n, j, i] & (JUMPS << down) == 0:
                continue
            _, number = between(
                camera[starts[n] : starts[n + 1]], faces[f0:f1], face_edges[f0:f1],
                edge_starts[offsets[2, b] : offsets[2, b + 1]], edge_faces[offsets[3, b] : offsets[3, b + 1]],
                creases[f0:f1], 0 if smooth else 3, ids[n], depth[n], planes[n], sharp[n], normal_images[n], focal, j,
                i, down, passed, shares, found,
            )  # fmt: skip
            at = 2 * sample + down
            for record in range(note(records, where, 0, found, number, at)):
                add_edge(records[record], at, images[n], weights[n], supersample, focal, jump, moments)
    for p in range(3):
        terms[thread, 12 + p], terms[thread, 15 + p] = by_eye[p], by_light[p]
        for q in range(4):
            terms[thread, 4 * p + q] = moments[p, q]
    add_up_block(terms, sums[n, cuda.blockIdx.x])


@kernel
def turn_to_cameras(rts, shape_of, lights, supersample, totals, out):
    """Fill `out` (N,3,4) with d<weights, picture>/d[R|t] from each view's `totals` (N,18)."""
    _, n = cuda.grid(2)
    if cuda.threadIdx.x > 0:
        return
    moments = cuda.local.array((3, 4), np.float64)
    for p in range(3):
        for q in range(4):
            moments[p, q] = totals[n, 4 * p + q]
    headlight = light_of(rts[n], lights[shape_of[n]])[0]
    reduce_to_camera(moments, rts[n], totals[n, 12:15], totals[n, 15:18], headlight, out[n])
    for p in range(3):
        for q in range(4):
            out[n, p, q] /= supersample * supersample
