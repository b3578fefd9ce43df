"""Walks over a surface from one sample towards the next: does it arrive, and if not, at which edge does it end?"""

from __future__ import annotations

from mvtn_cli.core.render.compiled import njit
from mvtn_cli.core.render.raster import plane_normal

LONGEST_WALK = 24


@njit
def volume_of(camera, i, j, k):
    """Six times the signed volume of the tetrahedron (eye, i, j, k)."""
    return (
        camera[i, 0] * (camera[j, 1] * camera[k, 2] - camera[j, 2] * camera[k, 1])
        + camera[i, 1] * (camera[j, 2] * camera[k, 0] - camera[j, 0] * camera[k, 2])
        + camera[i, 2] * (camera[j, 0] * camera[k, 1] - camera[j, 1] * camera[k, 0])
    )


@njit
def plane_inverse_depth(camera, faces, face, ray_x, ray_y):
    """1/z of the face's plane along a ray, also outside the face."""
    nx, ny, nz = plane_normal(camera, faces, face)
    a = faces[face, 0]
    offset = nx * camera[a, 0] + ny * camera[a, 1] + nz * camera[a, 2]
    if offset == 0.0:
        return 1.0 / max(camera[a, 2], 1e-9)
    return (nx * ray_x + ny * ray_y + nz) / offset


@njit
def exit_edge(camera, faces, face_edges, face, entered, ray_x, ray_y, step_x, step_y):
    """Return (corner opposite to the edge by which the moving ray leaves the face, share of the step), or (-1, 1)."""
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    sign = 1.0 if volume_of(camera, a, b, c) >= 0 else -1.0
    best, corner = 1e30, -1
    for s in range(3):
        if face_edges[face, s] == entered:
            continue
        p, q = faces[face, (s + 1) % 3], faces[face, (s + 2) % 3]
        cx = camera[p, 1] * camera[q, 2] - camera[p, 2] * camera[q, 1]
        cy = camera[p, 2] * camera[q, 0] - camera[p, 0] * camera[q, 2]
        falling = sign * (cx * step_x + cy * step_y)
        if falling < 0:
            cz = camera[p, 0] * camera[q, 1] - camera[p, 1] * camera[q, 0]
            share = -sign * (cx * ray_x + cy * ray_y + cz) / falling
            if share < best:
                best, corner = share, s
    if corner < 0 or best >= 1.0:
        return -1, 1.0
    return corner, best


@njit
def beyond(camera, faces, face_edges, edge_starts, edge_faces, face, corner, ray_x, ray_y):
    """Return the face that goes on across the edge opposite to `corner`, or -1 where the visible surface ends.

    A face goes on if its third corner lies on the other side of the plane through eye and edge. Of several
    (non-manifold edge) the nearest just beyond is taken; (ray_x, ray_y) is a ray there.
    """
    edge = face_edges[face, corner]
    i, j = faces[face, (corner + 1) % 3], faces[face, (corner + 2) % 3]
    side = volume_of(camera, i, j, faces[face, corner]) > 0
    several = edge_starts[edge + 1] - edge_starts[edge] > 2
    found, nearest = -1, -1e30
    for h in range(edge_starts[edge], edge_starts[edge + 1]):
        other = edge_faces[h]
        if other == face:
            continue
        third = faces[other, 0]
        for s in range(1, 3):
            if face_edges[other, s] == edge:
                third = faces[other, s]
        if (volume_of(camera, i, j, third) > 0) == side:
            continue
        if not several:
            return other
        w = plane_inverse_depth(camera, faces, other, ray_x, ray_y)
        if w > nearest:
            found, nearest = other, w
    return found


@njit
def walk(
    camera, faces, face_edges, edge_starts, edge_faces, creases, first_bit, start, target, ray_x, ray_y, step_x, step_y,
    passed, shares,
):  # fmt: skip
    """Walk on the surface from face `start` along one sample step.

    Creases on the way (bits `first_bit` and up of `creases`) are noted in `passed` (2,2), the edge's two vertices, and
    `shares` (2,), as far as there is room.

    Returns:
        (ended, share, i, j, last face, creases): `ended` says that the surface ends on edge (i, j) at that share.
    """
    face, entered, travelled, number = start, -1, 0.0, 0
    for _ in range(LONGEST_WALK):
        corner, share = exit_edge(camera, faces, face_edges, face, entered, ray_x, ray_y, step_x, step_y)
        if corner < 0:
            return False, 1.0, -1, -1, face, number
        travelled = max(travelled, share)
        i, j = faces[face, (corner + 1) % 3], faces[face, (corner + 2) % 3]
        if (creases[face] >> (first_bit + corner)) & 1:
            if number < shares.shape[0]:
                passed[number, 0], passed[number, 1], shares[number] = i, j, travelled
            number += 1
        entered = face_edges[face, corner]
        after = travelled + 0.02
        following = beyond(
            camera, faces, face_edges, edge_starts, edge_faces, face, corner,
            ray_x + after * step_x, ray_y + after * step_y,
        )  # fmt: skip
        if following < 0:
            return True, travelled, i, j, face, number
        face = following
        if face == target:
            return False, 1.0, -1, -1, face, number
    return False, 1.0, -1, -1, face, number


@njit
def joint(camera, faces, face_edges, first, second):
    """Return the corner of `first` opposite to an edge over which `second` goes on, or -1: no walk is needed then."""
    for s in range(3):
        edge = face_edges[first, s]
        for t in range(3):
            if face_edges[second, t] == edge:
                i, j = faces[first, (s + 1) % 3], faces[first, (s + 2) % 3]
                here, there = volume_of(camera, i, j, faces[first, s]), volume_of(camera, i, j, faces[second, t])
                return s if (here > 0) != (there > 0) else -1
    return -1
