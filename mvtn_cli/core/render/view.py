"""One view from faces to pixels, and one view's gradient: the stages of the other files in their order."""

from __future__ import annotations

import numpy as np

from mvtn_cli.core.render.compiled import njit
from mvtn_cli.core.render.edges import COLUMNS, blend, find_edges
from mvtn_cli.core.render.flow import add_edges, add_following_light, add_interior, reduce_to_camera
from mvtn_cli.core.render.raster import project
from mvtn_cli.core.render.shade import SPECULAR, average, eye_and_light, shade_samples, visible_faces


@njit(cache=True)
def draw_view(
    vertices, normals, colors, faces, face_edges, edge_starts, edge_faces, rt, focal, supersample, smooth, light,
    headlight, albedo, material, background, ids, inverse_depth, image, breaks, records, where, out,
):  # fmt: skip
    """Fill `out` (3,H,W) and the sample buffers of one view; return how many silhouette crossings there are.

    `focal` is in samples. More crossings than `records` has room for: the image lacks the antialiasing of the rest, and
    the caller has to draw again with more room.
    """
    camera = np.empty((vertices.shape[0], 3))
    eye, towards = np.empty(3), np.empty(3)
    eye_and_light(rt, light, headlight, eye, towards)
    visible_faces(vertices, faces, rt, focal, camera, ids, inverse_depth)
    shade_samples(
        vertices, normals, colors, faces, camera, ids, focal, smooth, eye, towards, albedo, material, background, image
    )
    count = find_edges(
        camera, faces, face_edges, edge_starts, edge_faces, ids, inverse_depth, image, focal, records, where, breaks
    )
    average(image, supersample, out)
    blend(records, where, min(count, records.shape[0]), supersample, image.shape[1], out)
    return count


@njit(cache=True)
def draw_view_alone(
    vertices, normals, colors, faces, face_edges, edge_starts, edge_faces, rt, focal, supersample, smooth, light,
    headlight, albedo, material, background, out,
):  # fmt: skip
    """Fill `out` (3,H,W); nothing else is kept."""
    height, width = out.shape[1] * supersample, out.shape[2] * supersample
    ids, inverse_depth = np.empty((height, width), np.int32), np.empty((height, width))
    image, breaks = np.empty((height, width, 3), np.float32), np.empty((height, width, 2), np.uint8)
    room = 32 * height
    while True:
        records, where = np.empty((room, COLUMNS), np.float32), np.empty(room, np.int32)
        count = draw_view(
            vertices, normals, colors, faces, face_edges, edge_starts, edge_faces, rt, focal, supersample, smooth,
            light, headlight, albedo, material, background, ids, inverse_depth, image, breaks, records, where, out,
        )  # fmt: skip
        if count <= room:
            return
        room = count


@njit(cache=True)
def differentiate_view(
    vertices, normals, colors, faces, rt, focal, supersample, smooth, light, headlight, albedo, material, ids,
    inverse_depth, image, breaks, records, where, count, weights, out,
):  # fmt: skip
    """Fill `out` (3,4) with d<weights, picture>/d[R|t], from the buffers that `draw_view` filled."""
    height, width = ids.shape
    moments, by_eye, by_light = np.zeros((3, 4)), np.zeros(3), np.zeros(3)
    add_interior(ids, inverse_depth, image, breaks, weights, supersample, focal, moments)
    add_edges(records, where, count, weights, supersample, focal, height, width, moments)
    if headlight or material[SPECULAR] > 0.0:
        camera, screen = np.empty((vertices.shape[0], 3)), np.empty((vertices.shape[0], 2), np.int32)
        eye, towards = np.empty(3), np.empty(3)
        project(vertices, rt, focal, height, width, camera, screen)
        eye_and_light(rt, light, headlight, eye, towards)
        add_following_light(
            vertices, normals, colors, faces, camera, ids, weights, supersample, smooth, focal, eye, towards, albedo,
            material, by_eye, by_light,
        )  # fmt: skip
    reduce_to_camera(moments, rt, by_eye, by_light, headlight, out)
    for p in range(3):
        for q in range(4):
            out[p, q] /= supersample * supersample
