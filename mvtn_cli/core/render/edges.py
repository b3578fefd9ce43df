"""Where, between two neighbouring samples, does the picture jump: the silhouettes of one view, found analytically.

For a horizontal or vertical pair of samples that see different faces we walk over the surface from one sample's face
towards the other. Either the walk arrives (one continuous surface, no jump), or it ends at an edge beyond which the
surface turns away or stops: that edge is the silhouette, whatever the winding. Where both surfaces go on, they
intersect each other, and the jump is where their depths are equal.

A record holds the crossing's share of the way from p to q, the edge's slope against the pair's normal direction, the
crossing in camera coordinates (right, down, ahead), and the colour jump C_p - C_q.
"""

from __future__ import annotations

import math

import numpy as np

from mvtn_cli.core.render.compiled import njit

SHARE, SLOPE, X, Y, Z, JUMP = 0, 1, 2, 3, 4, 5
COLUMNS = 8
LONGEST_WALK = 64
# Pairs whose two planes predict each other's 1/z this well, relative to the mean, are one surface.
CONTINUOUS = 0.004
NO_JUMP, FIRST, SECOND, THIN_GAP, INTERSECTION = 0, 1, 2, 3, 4
STEEP = 1e9


@njit(cache=True)
def volume_of(camera, i, j, k):
    """Six times the signed volume of the tetrahedron (eye, i, j, k)."""
    return (
        camera[i, 0] * (camera[j, 1] * camera[k, 2] - camera[j, 2] * camera[k, 1])
        + camera[i, 1] * (camera[j, 2] * camera[k, 0] - camera[j, 0] * camera[k, 2])
        + camera[i, 2] * (camera[j, 0] * camera[k, 1] - camera[j, 1] * camera[k, 0])
    )


@njit(cache=True)
def plane_normal(camera, faces, face):
    """Normal of a face in camera coordinates, not normalised."""
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    ux, uy, uz = camera[b, 0] - camera[a, 0], camera[b, 1] - camera[a, 1], camera[b, 2] - camera[a, 2]
    vx, vy, vz = camera[c, 0] - camera[a, 0], camera[c, 1] - camera[a, 1], camera[c, 2] - camera[a, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@njit(cache=True)
def plane_inverse_depth(camera, faces, face, ray_x, ray_y):
    """1/z of the face's plane along a ray, also outside the face."""
    nx, ny, nz = plane_normal(camera, faces, face)
    a = faces[face, 0]
    offset = nx * camera[a, 0] + ny * camera[a, 1] + nz * camera[a, 2]
    if offset == 0.0:
        return 1.0 / max(camera[a, 2], 1e-9)
    return (nx * ray_x + ny * ray_y + nz) / offset


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
def walk(camera, faces, face_edges, edge_starts, edge_faces, start, target, ray_x, ray_y, step_x, step_y):
    """Walk on the surface from face `start` along one sample step.

    Returns (ended, share, i, j, last face): `ended` says that the surface ends on edge (i, j) at that share.
    """
    face, entered, travelled = start, -1, 0.0
    for _ in range(LONGEST_WALK):
        corner, share = exit_edge(camera, faces, face_edges, face, entered, ray_x, ray_y, step_x, step_y)
        if corner < 0:
            return False, 1.0, -1, -1, face
        travelled = max(travelled, share)
        entered = face_edges[face, corner]
        after = travelled + 0.02
        following = beyond(
            camera, faces, face_edges, edge_starts, edge_faces, face, corner,
            ray_x + after * step_x, ray_y + after * step_y,
        )  # fmt: skip
        if following < 0:
            return True, travelled, faces[face, (corner + 1) % 3], faces[face, (corner + 2) % 3], face
        face = following
        if face == target:
            return False, 1.0, -1, -1, face
    return False, 1.0, -1, -1, face


@njit(cache=True)
def set_crossing(record, x, y, z, along_x, along_y, along_z, horizontal):
    """Write a crossing point and the screen slope of the 3-D line through it."""
    screen_x, screen_y = along_x - x / z * along_z, along_y - y / z * along_z
    record[X], record[Y], record[Z] = x, y, z
    if horizontal:
        slope = screen_x / screen_y if screen_y != 0 else STEEP
    else:
        slope = screen_y / screen_x if screen_x != 0 else STEEP
    record[SLOPE] = min(max(slope, -STEEP), STEEP)


@njit(cache=True)
def cross_edge(record, camera, i, j, ray_x, ray_y, horizontal):
    """Write where edge (i, j) crosses the row (or column) of the ray."""
    if horizontal:
        low, high = camera[i, 1] - ray_y * camera[i, 2], camera[j, 1] - ray_y * camera[j, 2]
    else:
        low, high = camera[i, 0] - ray_x * camera[i, 2], camera[j, 0] - ray_x * camera[j, 2]
    u = 0.5 if low == high else min(max(low / (low - high), 0.0), 1.0)
    dx, dy, dz = camera[j, 0] - camera[i, 0], camera[j, 1] - camera[i, 1], camera[j, 2] - camera[i, 2]
    z = camera[i, 2] + u * dz
    set_crossing(record, camera[i, 0] + u * dx, camera[i, 1] + u * dy, z, dx, dy, dz, horizontal)
    return z > 0


@njit(cache=True)
def cross_planes(record, camera, faces, first, second, ray_x, ray_y, step_x, step_y, horizontal):
    """Write where the planes of two faces have equal depth between the samples: surfaces that intersect."""
    start = plane_inverse_depth(camera, faces, first, ray_x, ray_y)
    start -= plane_inverse_depth(camera, faces, second, ray_x, ray_y)
    end = plane_inverse_depth(camera, faces, first, ray_x + step_x, ray_y + step_y)
    end -= plane_inverse_depth(camera, faces, second, ray_x + step_x, ray_y + step_y)
    share = 0.5 if start == end else min(max(start / (start - end), 0.0), 1.0)
    x, y = ray_x + share * step_x, ray_y + share * step_y
    w = 0.5 * (plane_inverse_depth(camera, faces, first, x, y) + plane_inverse_depth(camera, faces, second, x, y))
    z = 1.0 / max(w, 1e-6)
    ax, ay, az = plane_normal(camera, faces, first)
    bx, by, bz = plane_normal(camera, faces, second)
    set_crossing(record, x * z, y * z, z, ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx, horizontal)
    record[SHARE] = share
    return w > 1e-6


@njit(cache=True)
def same_surface(camera, faces, first, second, p_here, q_there, ray_x, ray_y, step_x, step_y):
    """Whether each plane predicts the 1/z of the other sample: then no walk is needed."""
    bound = CONTINUOUS * (p_here + q_there)
    p_there = plane_inverse_depth(camera, faces, first, ray_x + step_x, ray_y + step_y)
    if not abs(p_there - q_there) < bound:
        return False
    return abs(p_here - plane_inverse_depth(camera, faces, second, ray_x, ray_y)) < bound


@njit(cache=True)
def find_jump(
    camera, faces, face_edges, edge_starts, edge_faces, first, second, ray_x, ray_y, step_x, step_y, horizontal, records
):  # fmt: skip
    """Write the silhouette between two samples into `records` (2, COLUMNS); return (kind, number written)."""
    ended_p, share_p, ip, jp, last_p = False, -1.0, -1, -1, first
    ended_q, share_q, iq, jq, last_q = False, 2.0, -1, -1, second
    if first >= 0:
        ended_p, share_p, ip, jp, last_p = walk(
            camera, faces, face_edges, edge_starts, edge_faces, first, second, ray_x, ray_y, step_x, step_y
        )
        if not ended_p and last_p == second:
            return NO_JUMP, 0
    if second >= 0:
        ended_q, share_q, iq, jq, last_q = walk(
            camera, faces, face_edges, edge_starts, edge_faces, second, first, ray_x + step_x, ray_y + step_y,
            -step_x, -step_y,
        )  # fmt: skip
        if not ended_q and last_q == first:
            return NO_JUMP, 0
        share_q = 1.0 - share_q
    if ended_p and ended_q and share_p < share_q:
        good_p = cross_edge(records[0], camera, ip, jp, ray_x, ray_y, horizontal)
        good_q = cross_edge(records[1], camera, iq, jq, ray_x, ray_y, horizontal)
        records[0, SHARE], records[1, SHARE] = share_p, share_q
        return THIN_GAP, 2 if good_p and good_q else 0
    owner_is_p = ended_p
    if ended_p and ended_q:
        middle = 0.5 * (share_p + share_q)
        x, y = ray_x + middle * step_x, ray_y + middle * step_y
        w_p = plane_inverse_depth(camera, faces, last_p, x, y)
        owner_is_p = w_p >= plane_inverse_depth(camera, faces, last_q, x, y)
    if first >= 0 and second >= 0 and ended_p != ended_q:
        # An end that is hidden behind the other surface is not seen: the jump is where the two meet before it.
        share = share_p if ended_p else share_q
        x, y = ray_x + share * step_x, ray_y + share * step_y
        w_p = plane_inverse_depth(camera, faces, last_p, x, y)
        w_q = plane_inverse_depth(camera, faces, last_q, x, y)
        if (w_p < w_q) == ended_p:
            good = cross_planes(records[0], camera, faces, last_p, last_q, ray_x, ray_y, step_x, step_y, horizontal)
            return INTERSECTION, int(good)
    if owner_is_p:
        records[0, SHARE] = share_p
        return FIRST, int(cross_edge(records[0], camera, ip, jp, ray_x, ray_y, horizontal))
    if ended_q:
        records[0, SHARE] = share_q
        return SECOND, int(cross_edge(records[0], camera, iq, jq, ray_x, ray_y, horizontal))
    if first < 0 or second < 0:
        # The walk left the image of the surface without an edge: it was longer than LONGEST_WALK.
        return NO_JUMP, 0
    good = cross_planes(records[0], camera, faces, last_p, last_q, ray_x, ray_y, step_x, step_y, horizontal)
    return INTERSECTION, int(good)


@njit(cache=True)
def find_edges(
    camera, faces, face_edges, edge_starts, edge_faces, ids, inverse_depth, image, focal, records, where, breaks
):
    """Find every jump between neighbouring samples of one view.

    Args:
        ids: (H, W) face ids.
        inverse_depth: (H, W) 1/z.
        image: (H, W, 3) colours at the sample centres.
        records: (cap, COLUMNS) float32, filled.
        where: (cap,) int32, filled with 2 * sample + direction (0 right, 1 down).
        breaks: (H, W, 2) uint8, filled: whether the step to the right and the step down cross a jump.

    Returns:
        How many records there are; more than `cap` means that the rest was not written.
    """
    height, width = ids.shape
    found = np.empty((2, COLUMNS))
    count = 0
    breaks[:] = 0
    for j in range(height):
        for i in range(width):
            first = ids[j, i]
            for down in range(2):
                i2, j2 = i + 1 - down, j + down
                if i2 >= width or j2 >= height or ids[j2, i2] == first:
                    continue
                second = ids[j2, i2]
                ray_x, ray_y = (i + 0.5 - width * 0.5) / focal, (j + 0.5 - height * 0.5) / focal
                step_x, step_y = (1 - down) / focal, down / focal
                if (
                    first >= 0
                    and second >= 0
                    and same_surface(
                        camera, faces, first, second, inverse_depth[j, i], inverse_depth[j2, i2], ray_x, ray_y,
                        step_x, step_y,
                    )
                ):  # fmt: skip
                    continue
                kind, number = find_jump(
                    camera, faces, face_edges, edge_starts, edge_faces, first, second, ray_x, ray_y, step_x, step_y,
                    down == 0, found,
                )  # fmt: skip
                if kind == NO_JUMP:
                    continue
                breaks[j, i, down] = kind
                for n in range(number):
                    if not (math.isfinite(found[n, SLOPE]) and found[n, Z] > 0):
                        continue
                    if count < records.shape[0]:
                        for column in range(JUMP):
                            records[count, column] = found[n, column]
                        for channel in range(3):
                            jump = image[j, i, channel] - image[j2, i2, channel]
                            records[count, JUMP + channel] = jump / number
                        where[count] = 2 * (j * width + i) + down
                    count += 1
    return count


@njit(cache=True)
def blend(records, where, count, supersample, width, out):
    """Antialias: move each jump from the sample boundary to where it really is; `out` (3,H,W) is in pixels."""
    share_of_pixel = 1.0 / (supersample * supersample)
    for n in range(count):
        down = where[n] & 1
        slope = abs(records[n, SLOPE])
        # An edge nearer to the vertical is blended along rows, one nearer to the horizontal along columns.
        if slope > 1.0 or (slope == 1.0 and down == 1):
            continue
        sample = where[n] >> 1
        j, i = sample // width, sample % width
        move = 0.5 - records[n, SHARE]
        if move < 0:
            j, i = j + down, i + 1 - down
        for channel in range(3):
            out[channel, j // supersample, i // supersample] -= move * records[n, JUMP + channel] * share_of_pixel
    # A speck smaller than a sample has a jump on each side, and each takes its share: keep what is left a colour.
    for channel in range(3):
        for j in range(out.shape[1]):
            for i in range(out.shape[2]):
                out[channel, j, i] = min(max(out[channel, j, i], 0.0), 1.0)
