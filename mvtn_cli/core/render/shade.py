"""What colour does a sample have: one directional light, two-sided, smooth or flat; and one view's image.

Radiance = albedo * (ambient + diffuse * max(0, n.l)^falloff) + specular * max(0, r.v)^shininess (no highlight where
n.l <= 0), with v towards the eye and r the mirrored light; albedo = vertex colour * shape colour. A falloff of 1 is
Lambert's law; 2 tells shallow relief apart better.
"""

from __future__ import annotations

import math

import numpy as np

from mvtn_cli.core.render.compiled import njit
from mvtn_cli.core.render.raster import draw_face, project

# Columns of the `material` row that the kernels take.
AMBIENT, DIFFUSE, SPECULAR, SHININESS, FALLOFF = 0, 1, 2, 3, 4


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
def corner_normals(vertices, normals, a, b, c, volume, smooth, corners):
    """Fill `corners` (4,3): the face's own normal (any length) in row 3, above those of its corners, all to the eye.

    The eye sees the front of a face exactly when the signed volume (eye, face) is negative. A corner normal that
    disagrees with its face is turned, so that meshes wound both ways are lit alike.
    """
    ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
    vx, vy, vz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    if volume >= 0:
        nx, ny, nz = -nx, -ny, -nz
    corners[3, 0], corners[3, 1], corners[3, 2] = nx, ny, nz
    if not smooth:
        return
    for row in range(3):
        i = a if row == 0 else (b if row == 1 else c)
        sign = 1.0 if normals[i, 0] * nx + normals[i, 1] * ny + normals[i, 2] * nz >= 0 else -1.0
        for axis in range(3):
            corners[row, axis] = sign * normals[i, axis]


@njit(cache=True)
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


@njit(cache=True)
def power(base, exponent):
    """base^exponent for base > 0; by squaring where the exponent is whole, which it nearly always is."""
    whole = int(exponent)
    if whole != exponent or whole > 1024:
        return base**exponent
    result = 1.0
    while whole > 0:
        if whole & 1:
            result *= base
        base *= base
        whole >>= 1
    return result


@njit(cache=True)
def lambert_and_highlight(nx, ny, nz, vx, vy, vz, lx, ly, lz, material):
    """Return (factor on the albedo, amount added in white) for unit normal, view and light."""
    cosine = nx * lx + ny * ly + nz * lz
    if cosine <= 0.0:
        return material[AMBIENT], 0.0
    highlight = 0.0
    if material[SPECULAR] > 0.0:
        mirrored = 2.0 * cosine * (nx * vx + ny * vy + nz * vz) - (lx * vx + ly * vy + lz * vz)
        if mirrored > 0.0:
            highlight = material[SPECULAR] * power(mirrored, material[SHININESS])
    fallen = power(cosine, material[FALLOFF])
    return material[AMBIENT] + material[DIFFUSE] * fallen, highlight


@njit(cache=True)
def sample_colour(vertices, colors, a, b, c, w0, w1, w2, n, eye, light, albedo, material, out):
    """Fill `out` (3,) with the radiance at one point of face (a, b, c) whose unit normal is `n`."""
    vx = vy = vz = 0.0
    if material[SPECULAR] > 0.0:
        vx = eye[0] - (w0 * vertices[a, 0] + w1 * vertices[b, 0] + w2 * vertices[c, 0])
        vy = eye[1] - (w0 * vertices[a, 1] + w1 * vertices[b, 1] + w2 * vertices[c, 1])
        vz = eye[2] - (w0 * vertices[a, 2] + w1 * vertices[b, 2] + w2 * vertices[c, 2])
        scale = 1.0 / math.sqrt(vx * vx + vy * vy + vz * vz + 1e-30)
        vx, vy, vz = vx * scale, vy * scale, vz * scale
    lambert, highlight = lambert_and_highlight(n[0], n[1], n[2], vx, vy, vz, light[0], light[1], light[2], material)
    for channel in range(3):
        value = albedo[channel]
        if colors.shape[0] > 0:
            value *= w0 * colors[a, channel] + w1 * colors[b, channel] + w2 * colors[c, channel]
        out[channel] = value * lambert + highlight


@njit(cache=True)
def visible_faces(vertices, faces, rt, focal, camera, ids, inverse_depth):
    """Fill the visibility buffer of one view: face ids (H,W) int32, -1 for background; 1/z (H,W); `camera` (V,3)."""
    screen = np.empty((vertices.shape[0], 2), np.int32)
    polygon = np.empty((4, 2), np.int64)
    height, width = ids.shape
    ids[:] = -1
    inverse_depth[:] = 0.0
    project(vertices, rt, focal, height, width, camera, screen)
    for face in range(faces.shape[0]):
        draw_face(face, faces, camera, screen, focal, ids, inverse_depth, polygon)


@njit(cache=True)
def shade_samples(
    vertices, normals, colors, faces, camera, ids, focal, smooth, eye, towards, albedo, material, background, image
):  # fmt: skip
    """Fill `image` (H,W,3) with the colour at each sample centre."""
    height, width = ids.shape
    frame, corners, normal, colour = np.empty((3, 3)), np.empty((4, 3)), np.empty(3), np.empty(3)
    last, volume = -1, 0.0
    a = b = c = 0
    for j in range(height):
        for i in range(width):
            face = ids[j, i]
            if face < 0:
                for channel in range(3):
                    image[j, i, channel] = background[channel]
                continue
            if face != last:
                last = face
                a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
                volume = face_frame(camera, a, b, c, frame)
                corner_normals(vertices, normals, a, b, c, volume, smooth, corners)
            ray_x, ray_y = (i + 0.5 - width * 0.5) / focal, (j + 0.5 - height * 0.5) / focal
            w0, w1, w2 = barycentric(frame, volume, ray_x, ray_y)
            normal[0], normal[1], normal[2] = normal_at(corners, smooth, w0, w1, w2)
            sample_colour(vertices, colors, a, b, c, w0, w1, w2, normal, eye, towards, albedo, material, colour)
            for channel in range(3):
                image[j, i, channel] = colour[channel]


@njit(cache=True)
def average(image, supersample, out):
    """Fill `out` (3,H,W): each pixel is the mean of its supersample^2 samples."""
    share = 1.0 / (supersample * supersample)
    out[:] = 0.0
    for j in range(image.shape[0]):
        for i in range(image.shape[1]):
            for channel in range(3):
                out[channel, j // supersample, i // supersample] += image[j, i, channel] * share


@njit(cache=True)
def eye_and_light(rt, light, headlight, eye, towards):
    """Fill the eye's world position and the direction towards the light."""
    for axis in range(3):
        eye[axis] = -(rt[0, axis] * rt[0, 3] + rt[1, axis] * rt[1, 3] + rt[2, axis] * rt[2, 3])
        towards[axis] = rt[2, axis] if headlight else light[axis]


@njit(cache=True)
def geometry_view(vertices, normals, faces, rt, focal, smooth, ids, depth, normal_image):
    """Fill `ids` (H,W), `depth` (H,W; 0 where empty) and world `normal_image` (3,H,W) at pixel centres."""
    height, width = ids.shape
    camera = np.empty((vertices.shape[0], 3))
    inverse_depth = np.empty((height, width))
    visible_faces(vertices, faces, rt, focal, camera, ids, inverse_depth)
    frame, corners = np.empty((3, 3)), np.empty((4, 3))
    for j in range(height):
        for i in range(width):
            face = ids[j, i]
            depth[j, i] = 0.0
            normal_image[:, j, i] = 0.0
            if face < 0:
                continue
            depth[j, i] = 1.0 / inverse_depth[j, i]
            a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
            volume = face_frame(camera, a, b, c, frame)
            corner_normals(vertices, normals, a, b, c, volume, smooth, corners)
            w0, w1, w2 = barycentric(frame, volume, (i + 0.5 - width * 0.5) / focal, (j + 0.5 - height * 0.5) / focal)
            normal_image[0, j, i], normal_image[1, j, i], normal_image[2, j, i] = normal_at(corners, smooth, w0, w1, w2)
