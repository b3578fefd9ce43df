"""Where, between two neighbouring samples, does the picture jump: the silhouettes of one view, found analytically.

For a horizontal or vertical pair of samples that see different faces we walk over the surface from one sample's face
towards the other. Either the walk arrives (one continuous surface, no jump), or it ends at an edge beyond which the
surface turns away or stops: that edge is the silhouette, whatever the winding. Where both surfaces go on, they
intersect each other, and the jump is where their depths are equal. A surface that goes on may still have a crease on
the way, where its shading breaks; that is a jump too.

A record holds the crossing's share of the way from p to q, the edge's slope against the pair's normal direction, the
crossing in camera coordinates (right, down, ahead), and its part of the colour jump C_p - C_q.
"""

from __future__ import annotations

import math

import numpy as np

from mvtn_cli.core.render.compiled import njit, njit_inline
from mvtn_cli.core.render.raster import plane_normal
from mvtn_cli.core.render.walking import joint, plane_inverse_depth, walk

SHARE, SLOPE, X, Y, Z, PART = 0, 1, 2, 3, 4, 5
COLUMNS = 6
# Pairs whose two planes predict each other's 1/z this well, relative to the mean, are one surface.
CONTINUOUS = 0.004
# Cosine between the normals of two samples below which a crease between them is looked for.
BEND = 0.97
STEEP = 1e9


@njit
def set_crossing(record, x, y, z, along_x, along_y, along_z, horizontal):
    """Write a crossing point and the screen slope of the 3-D line through it."""
    screen_x, screen_y = along_x - x / z * along_z, along_y - y / z * along_z
    record[X], record[Y], record[Z] = x, y, z
    if horizontal:
        slope = screen_x / screen_y if screen_y != 0 else STEEP
    else:
        slope = screen_y / screen_x if screen_x != 0 else STEEP
    record[SLOPE] = min(max(slope, -STEEP), STEEP)


@njit
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


@njit
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


@njit
def same_surface(p_here, q_there, p_change, q_change):
    """Whether each plane predicts the 1/z of the other sample: then no walk is needed."""
    bound = CONTINUOUS * (p_here + q_there)
    return abs(p_here + p_change - q_there) < bound and abs(q_there - q_change - p_here) < bound


@njit
def cross_joint(record, camera, i, j, ray_x, ray_y, step_x, step_y, horizontal):
    """Write the crease on edge (i, j) between two samples; return how many that are."""
    cx = camera[i, 1] * camera[j, 2] - camera[i, 2] * camera[j, 1]
    cy = camera[i, 2] * camera[j, 0] - camera[i, 0] * camera[j, 2]
    cz = camera[i, 0] * camera[j, 1] - camera[i, 1] * camera[j, 0]
    change = cx * step_x + cy * step_y
    if change == 0.0 or not cross_edge(record, camera, i, j, ray_x, ray_y, horizontal):
        return 0
    record[SHARE] = min(max(-(cx * ray_x + cy * ray_y + cz) / change, 0.0), 1.0)
    return 1


@njit
def cross_creases(records, camera, passed, shares, number, ray_x, ray_y, backwards, horizontal):
    """Write up to two creases that a walk crossed; more are left to the image flow."""
    if number > shares.shape[0]:
        return 0
    for n in range(number):
        if not cross_edge(records[n], camera, passed[n, 0], passed[n, 1], ray_x, ray_y, horizontal):
            return 0
        records[n, SHARE] = 1.0 - shares[n] if backwards else shares[n]
    return number


@njit
def find_jump(
    camera, faces, face_edges, edge_starts, edge_faces, creases, first_bit, first, second, ray_x, ray_y, step_x, step_y,
    horizontal, passed, shares, records,
):  # fmt: skip
    """Write what breaks the picture between two samples into `records` (2, COLUMNS).

    Returns:
        (whether one surface goes on, how many of its creases, or of silhouettes, are written).
    """
    ended_p, share_p, ip, jp, last_p = False, -1.0, -1, -1, first
    ended_q, share_q, iq, jq, last_q = False, 2.0, -1, -1, second
    if first >= 0 and second >= 0:
        corner = joint(camera, faces, face_edges, first, second)
        if corner >= 0:
            if (creases[first] >> (first_bit + corner)) & 1 == 0:
                return True, 0
            i, j = faces[first, (corner + 1) % 3], faces[first, (corner + 2) % 3]
            return True, cross_joint(records[0], camera, i, j, ray_x, ray_y, step_x, step_y, horizontal)
    if first >= 0:
        ended_p, share_p, ip, jp, last_p, bends = walk(
            camera, faces, face_edges, edge_starts, edge_faces, creases, first_bit, first, second, ray_x, ray_y,
            step_x, step_y, passed, shares,
        )  # fmt: skip
        if not ended_p and last_p == second:
            return True, cross_creases(records, camera, passed, shares, bends, ray_x, ray_y, False, horizontal)
    if second >= 0:
        ended_q, share_q, iq, jq, last_q, bends = walk(
            camera, faces, face_edges, edge_starts, edge_faces, creases, first_bit, second, first, ray_x + step_x,
            ray_y + step_y, -step_x, -step_y, passed, shares,
        )  # fmt: skip
        if not ended_q and last_q == first:
            return True, cross_creases(records, camera, passed, shares, bends, ray_x, ray_y, True, horizontal)
        share_q = 1.0 - share_q
    if ended_p and ended_q and share_p < share_q:
        good_p = cross_edge(records[0], camera, ip, jp, ray_x, ray_y, horizontal)
        good_q = cross_edge(records[1], camera, iq, jq, ray_x, ray_y, horizontal)
        records[0, SHARE], records[1, SHARE] = share_p, share_q
        return False, 2 if good_p and good_q else 0
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
            return False, int(good)
    if owner_is_p:
        records[0, SHARE] = share_p
        return False, int(cross_edge(records[0], camera, ip, jp, ray_x, ray_y, horizontal))
    if ended_q:
        records[0, SHARE] = share_q
        return False, int(cross_edge(records[0], camera, iq, jq, ray_x, ray_y, horizontal))
    if first < 0 or second < 0:
        # The walk left the image of the surface without an edge: it was longer than LONGEST_WALK.
        return True, 0
    good = cross_planes(records[0], camera, faces, last_p, last_q, ray_x, ray_y, step_x, step_y, horizontal)
    return False, int(good)


@njit
def bends(here, there):
    """Whether two unit normals are so far apart that it matters where between the samples the crease is."""
    return here[0] * there[0] + here[1] * there[1] + here[2] * there[2] < BEND


@njit
def note(records, where, count, found, number, at):
    """Append what was found between two samples; beyond the room it is only counted."""
    for n in range(number):
        if not (math.isfinite(found[n, SLOPE]) and found[n, Z] > 0):
            continue
        if count < records.shape[0]:
            for column in range(PART):
                records[count, column] = found[n, column]
            records[count, PART] = 1.0 / number
            where[count] = at
        count += 1
    return count


@njit_inline
def between(
    camera, faces, face_edges, edge_starts, edge_faces, creases, first_bit, ids, inverse_depth, planes, sharp, normals,
    focal, j, i, down, passed, shares, found,
):  # fmt: skip
    """Look between sample (j, i) and the one to its right, or below it.

    Returns:
        (whether the surface goes on smoothly, how many jumps are written to `found` (2, COLUMNS)).
    """
    height, width = ids.shape
    i2, j2 = i + 1 - down, j + down
    if i2 >= width or j2 >= height:
        return False, 0
    first, second = ids[j, i], ids[j2, i2]
    if second == first:
        return first >= 0, 0
    both, alike, bent = first >= 0 and second >= 0, False, False
    if both:
        bent = sharp[j, i] != 0 and sharp[j2, i2] != 0 and bends(normals[j, i], normals[j2, i2])
        alike = same_surface(inverse_depth[j, i], inverse_depth[j2, i2], planes[j, i, down], planes[j2, i2, down])
        if alike and not bent:
            return True, 0
    ray_x, ray_y = (i + 0.5 - width * 0.5) / focal, (j + 0.5 - height * 0.5) / focal
    goes_on, number = find_jump(
        camera, faces, face_edges, edge_starts, edge_faces, creases, first_bit, first, second, ray_x, ray_y,
        (1 - down) / focal, down / focal, down == 0, passed, shares, found,
    )  # fmt: skip
    if both and (goes_on or alike):
        number = number if goes_on and bent else 0
        return number == 0, number
    return False, number


@njit
def find_edges(
    camera, faces, face_edges, edge_starts, edge_faces, creases, smooth, ids, inverse_depth, planes, sharp, normals,
    box, focal, first_row, last_row, records, where, links,
):  # fmt: skip
    """Find every jump between neighbouring samples in some rows of one view.

    Args:
        camera, faces, face_edges, edge_starts, edge_faces, creases, smooth: The shape, and how it is shaded.
        ids, inverse_depth, planes, sharp, normals, box: Of `rasterise` and `describe`.
        focal: In samples.
        first_row, last_row: Rows whose samples are the first of a pair.
        records: (cap, COLUMNS) float32, filled.
        where: (cap,) int32, filled with 2 * sample + direction (0 right, 1 down).
        links: (H, W) uint8, filled in the box: bit 0 where the surface goes on smoothly to the right, bit 1 downward.

    Returns:
        How many records there are; more than `cap` means that the rest was not written.
    """
    height, width = ids.shape
    found, passed, shares = np.empty((2, COLUMNS)), np.empty((2, 2), np.int64), np.empty(2)
    first_bit = 0 if smooth else 3
    count = 0
    for j in range(max(first_row, box[0] - 1, 0), min(last_row, box[1]) + 1):
        for i in range(max(box[2] - 1, 0), box[3] + 1):
            first = ids[j, i]
            links[j, i] = 0
            for down in range(2):
                i2, j2 = i + 1 - down, j + down
                # Nearly all pairs see one face, or nothing.
                if i2 < width and j2 < height and ids[j2, i2] == first:
                    links[j, i] |= (1 << down) if first >= 0 else 0
                    continue
                smoothly, number = between(
                    camera, faces, face_edges, edge_starts, edge_faces, creases, first_bit, ids, inverse_depth, planes,
                    sharp, normals, focal, j, i, down, passed, shares, found,
                )  # fmt: skip
                if smoothly:
                    links[j, i] |= 1 << down
                count = note(records, where, count, found, number, 2 * (j * width + i) + down)
    return count


@njit
def jump_at(image, record, at, width, jump):
    """Fill `jump` (3,) with C_p - C_q of a record's pair; return the row and column of p."""
    down, sample = at & 1, at >> 1
    j, i = sample // width, sample % width
    for channel in range(3):
        step = image[j, i, channel] - image[j + down, i + 1 - down, channel]
        jump[channel] = step * record[PART]
    return j, i


@njit_inline
def blends(slope, down):
    """Whether a jump blends this pair: an edge nearer to the vertical does along rows, others along columns."""
    slope = abs(slope)
    return slope < 1.0 or (slope == 1.0 and down == 0)


@njit
def blend(records, where, count, image, supersample, out):
    """Antialias: move each jump from the sample boundary to where it really is; `out` (3,H,W) is in pixels."""
    share_of_pixel = 1.0 / (supersample * supersample)
    jump = np.empty(3)
    for n in range(count):
        down = where[n] & 1
        if not blends(records[n, SLOPE], down):
            continue
        j, i = jump_at(image, records[n], where[n], image.shape[1], jump)
        move = 0.5 - records[n, SHARE]
        if move < 0:
            j, i = j + down, i + 1 - down
        for channel in range(3):
            out[channel, j // supersample, i // supersample] -= move * jump[channel] * share_of_pixel
    # A speck smaller than a sample has a jump on each side, and each takes its share: keep what is left a colour.
    for n in range(count):
        sample = where[n] >> 1
        j, i = sample // image.shape[1], sample % image.shape[1]
        for channel in range(3):
            for down in range(2):
                v, u = min(j + down, image.shape[0] - 1) // supersample, i // supersample
                out[channel, v, u] = min(max(out[channel, v, u], 0.0), 1.0)
            u = min(i + 1, image.shape[1] - 1) // supersample
            out[channel, j // supersample, u] = min(max(out[channel, j // supersample, u], 0.0), 1.0)
