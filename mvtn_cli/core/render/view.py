"""One view from faces to pixels, and one view's gradient: the stages of the other files in their order."""

from __future__ import annotations

import numpy as np

from mvtn_cli.core.render.compiled import njit
from mvtn_cli.core.render.edges import blend, find_edges
from mvtn_cli.core.render.flow import add_edges, add_samples, reduce_to_camera
from mvtn_cli.core.render.raster import project, rasterise
from mvtn_cli.core.render.shade import SPECULAR, average, light_of, paint
from mvtn_cli.core.render.skips import BACKGROUND, SAMPLES, SEEN
from mvtn_cli.core.render.surface import covered_box, describe


@njit
def see_rows(
    vertices, normals, colors, faces, face_edges, edge_starts, edge_faces, creases, solid, rt, focal, smooth, skips,
    first_row, last_row, view_ids, view_depth, view_normals, view_tint, links, box, records, where, counts,
):  # fmt: skip
    """Fill some rows of one view's G-buffer, which may be none; return how many jumps begin in them.

    More jumps than `records` has room for: the rest is missing, and the caller has to see again with more room.
    """
    height, width = view_ids.shape
    box[0], box[1], box[2], box[3] = height, -1, width, -1
    counts[:] = 0
    if first_row > last_row:
        return 0
    if first_row == 0:
        counts[SEEN], counts[SAMPLES] = faces.shape[0], height * width
    camera, screen = np.empty((vertices.shape[0], 3)), np.empty((vertices.shape[0], 2), np.int32)
    inverse_depth, planes = np.empty((height, width)), np.empty((height, width, 2), np.float32)
    sharp = np.empty((height, width), np.uint8)
    ids, depth, normal_image, tint = view_ids, view_depth, view_normals, view_tint
    # A jump is found with its upper sample: a band looks at one row of the next one, too, and must not write there.
    below = min(last_row + 1, height - 1)
    whole = first_row == 0 and last_row == below
    if not whole:
        ids, depth = np.empty((height, width), np.int32), np.empty((height, width), np.float32)
        normal_image, tint = np.empty((height, width, 3), np.float32), np.empty(tint.shape, np.float32)
    project(vertices, rt, focal, height, width, camera, screen)
    rasterise(faces, solid, camera, screen, focal, first_row, below, skips, ids, inverse_depth, counts)
    covered_box(ids, first_row, below, box)
    if skips & BACKGROUND == 0:
        box[0], box[1], box[2], box[3] = first_row, below, 0, width - 1
    describe(
        normals, colors, faces, creases, rt, focal, smooth, camera, screen, ids, inverse_depth, box, depth,
        normal_image, tint, planes, sharp,
    )  # fmt: skip
    if not whole:
        copy_rows(ids, depth, normal_image, tint, first_row, last_row, view_ids, view_depth, view_normals, view_tint)
    return find_edges(
        camera, faces, face_edges, edge_starts, edge_faces, creases, smooth, ids, inverse_depth, planes, sharp,
        normal_image, box, focal, first_row, last_row, records, where, links,
    )  # fmt: skip


@njit
def copy_rows(ids, depth, normal_image, tint, first_row, last_row, view_ids, view_depth, view_normals, view_tint):
    """Write what a band has seen into its view; what is not in the band's box may be in the view's."""
    for j in range(first_row, last_row + 1):
        for i in range(ids.shape[1]):
            view_ids[j, i], view_depth[j, i] = ids[j, i], 0.0
            if ids[j, i] < 0:
                continue
            view_depth[j, i] = depth[j, i]
            for axis in range(3):
                view_normals[j, i, axis] = normal_image[j, i, axis]
                if tint.shape[0] > 0:
                    view_tint[j, i, axis] = tint[j, i, axis]


@njit
def paint_view(
    rt, focal, supersample, light, albedo, material, background, skips, depth, normal_image, tint, box, records, where,
    count, image, out,
):  # fmt: skip
    """Fill `out` (3,H,W) and the samples' colours `image` from a G-buffer."""
    _, lx, ly, lz = light_of(rt, light)
    paint(rt, focal, lx, ly, lz, albedo, material, background, skips, box, depth, normal_image, tint, image)
    average(image, box, background, supersample, out)
    blend(records, where, count, image, supersample, out)


@njit
def sum_part(
    rt, focal, supersample, light, albedo, material, first_row, last_row, depth, normal_image, tint, links, box,
    records, where, count, image, weights, out,
):  # fmt: skip
    """Fill `out` (5,4) with what the samples of some rows add to the moments, and to eye and light in rows 3 and 4.

    No row at all: what silhouettes and creases add.
    """
    # A sum of its own: threads that add to neighbouring memory wait for each other.
    moments, by_eye, by_light = np.zeros((3, 4)), np.zeros(3), np.zeros(3)
    if first_row > last_row:
        add_edges(records, where, count, image, weights, supersample, focal, moments)
    else:
        headlight, lx, ly, lz = light_of(rt, light)
        add_samples(
            depth, normal_image, tint, image, links, first_row, last_row, box, weights, supersample, focal, rt,
            headlight or material[SPECULAR] > 0.0, lx, ly, lz, albedo, material, moments, by_eye, by_light,
        )  # fmt: skip
    for p in range(3):
        out[3, p], out[4, p] = by_eye[p], by_light[p]
        for q in range(4):
            out[p, q] = moments[p, q]


@njit
def add_up(rt, supersample, light, sums, out):
    """Fill `out` (3,4) with d<weights, picture>/d[R|t] from a view's `sums` (K,5,4), added in their order."""
    moments, by_eye, by_light = np.zeros((3, 4)), np.zeros(3), np.zeros(3)
    for k in range(sums.shape[0]):
        for p in range(3):
            by_eye[p] += sums[k, 3, p]
            by_light[p] += sums[k, 4, p]
            for q in range(4):
                moments[p, q] += sums[k, p, q]
    reduce_to_camera(moments, rt, by_eye, by_light, light_of(rt, light)[0], out)
    for p in range(3):
        for q in range(4):
            out[p, q] /= supersample * supersample
