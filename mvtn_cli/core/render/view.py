"""One view from faces to pixels, and one view's gradient: the stages of the other files in their order."""

from __future__ import annotations

import numpy as np

from mvtn_cli.core.render.compiled import njit
from mvtn_cli.core.render.edges import blend, find_edges
from mvtn_cli.core.render.flow import add_edges, add_samples, reduce_to_camera
from mvtn_cli.core.render.raster import project, rasterise
from mvtn_cli.core.render.shade import SPECULAR, average, light_of, paint
from mvtn_cli.core.render.skips import BACKGROUND, EMPTY_SAMPLES, SAMPLES, SEEN
from mvtn_cli.core.render.surface import covered_box, describe


@njit
def see_view(
    vertices, normals, colors, faces, face_edges, edge_starts, edge_faces, creases, solid, rt, focal, smooth, skips,
    ids, depth, normal_image, tint, links, box, records, where, counts,
):  # fmt: skip
    """Fill the G-buffer of one view; return how many jumps there are.

    More jumps than `records` has room for: the rest is missing, and the caller has to see again with more room.
    """
    height, width = ids.shape
    camera, screen = np.empty((vertices.shape[0], 3)), np.empty((vertices.shape[0], 2), np.int32)
    inverse_depth, planes = np.empty((height, width)), np.empty((height, width, 2), np.float32)
    sharp = np.empty((height, width), np.uint8)
    counts[:] = 0
    counts[SEEN], counts[SAMPLES] = faces.shape[0], height * width
    project(vertices, rt, focal, height, width, camera, screen)
    rasterise(faces, solid, camera, screen, focal, 0, height - 1, skips, ids, inverse_depth, counts)
    covered_box(ids, box)
    if skips & BACKGROUND == 0:
        box[0], box[1], box[2], box[3] = 0, height - 1, 0, width - 1
    counts[EMPTY_SAMPLES] = height * width - max(0, box[1] + 1 - box[0]) * max(0, box[3] + 1 - box[2])
    describe(
        normals, colors, faces, creases, rt, focal, smooth, camera, screen, ids, inverse_depth, box, depth,
        normal_image, tint, planes, sharp,
    )  # fmt: skip
    return find_edges(
        camera, faces, face_edges, edge_starts, edge_faces, creases, smooth, ids, inverse_depth, planes, sharp,
        normal_image, box, focal, 0, height - 1, records, where, links,
    )  # fmt: skip


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
def differentiate_view(
    rt, focal, supersample, light, albedo, material, depth, normal_image, tint, links, box, records, where, count,
    image, weights, out,
):  # fmt: skip
    """Fill `out` (3,4) with d<weights, picture>/d[R|t], from what `see_view` and `paint_view` filled."""
    moments, by_eye, by_light = np.zeros((3, 4)), np.zeros(3), np.zeros(3)
    headlight, lx, ly, lz = light_of(rt, light)
    add_samples(
        depth, normal_image, tint, image, links, box, weights, supersample, focal, rt,
        headlight or material[SPECULAR] > 0.0, lx, ly, lz, albedo, material, moments, by_eye, by_light,
    )  # fmt: skip
    add_edges(records, where, count, image, weights, supersample, focal, moments)
    reduce_to_camera(moments, rt, by_eye, by_light, headlight, out)
    for p in range(3):
        for q in range(4):
            out[p, q] /= supersample * supersample
