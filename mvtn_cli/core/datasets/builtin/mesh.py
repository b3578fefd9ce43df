"""Triangle meshes from a handful of primitives: boxes, lofts, lathes, tubes, slabs, posts.

Axes: y is up, a thing's front looks along +z, its length or width lies along x. Every primitive is welded,
wound outwards and centred as its docstring says. Sharp edges stay welded: preprocessing splits them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

_AXES = {"x": 0, "y": 1, "z": 2}
_BOX_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2.0
_BOX_QUADS = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])


@dataclass(frozen=True, eq=False)
class Mesh:
    """Plain triangles: vertices (V, 3) float64, faces (F, 3) int32, counter-clockwise seen from outside."""

    vertices: np.ndarray
    faces: np.ndarray

    def at(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Mesh:
        """Move by (x, y, z)."""
        return Mesh(self.vertices + np.array([x, y, z]), self.faces)

    def scaled(self, x: float = 1.0, y: float = 1.0, z: float = 1.0) -> Mesh:
        """Stretch about the origin; a mirroring keeps its faces outward."""
        faces = self.faces if x * y * z > 0 else self.faces[:, ::-1]
        return Mesh(self.vertices * np.array([x, y, z]), faces)

    def turned(self, axis: str, degrees: float) -> Mesh:
        """Turn about a coordinate axis through the origin, right-handed (about y: +z moves towards +x)."""
        return Mesh(self.vertices @ _turn(axis, degrees).T, self.faces)


def _turn(axis: str, degrees: float) -> np.ndarray:
    k = _AXES[axis]
    i, j = (k + 1) % 3, (k + 2) % 3
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.eye(3)
    matrix[i, i], matrix[i, j], matrix[j, i], matrix[j, j] = c, -s, s, c
    return matrix


def join(parts: Iterable[Mesh]) -> Mesh:
    """Put meshes side by side into one; nothing is welded or cut."""
    parts = list(parts)
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=True)]
    return Mesh(np.concatenate([part.vertices for part in parts]), np.concatenate(faces).astype(np.int32))


def mirrored_pair(part: Mesh) -> list[Mesh]:
    """Return the part and its mirror image in the plane x = 0."""
    return [part, part.scaled(x=-1)]


# ---------------------------------------------------------------- primitives


def box(width: float, height: float, depth: float) -> Mesh:
    """Cuboid (x, y, z) centred on the origin."""
    faces = _BOX_QUADS[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    return Mesh(_BOX_CORNERS * np.array([width, height, depth]), faces.astype(np.int32))


def board(width: float, height: float, depth: float) -> Mesh:
    """Cuboid that stands on y = 0, centred in x and z."""
    return box(width, height, depth).at(y=height / 2)


def loft(rings: np.ndarray, start: ArrayLike | None = None, end: ArrayLike | None = None) -> Mesh:
    """Skin through closed rings, with a fan to a point at either end if one is given.

    Args:
        rings: (K, N, 3), all with N points, counter-clockwise when the next ring lies towards the eye.
        start, end: Apex (3,) of the cap; None leaves that end open.
    """
    count, around, _ = rings.shape
    k, i = np.meshgrid(np.arange(count - 1) * around, np.arange(around), indexing="ij")
    n = (i + 1) % around
    quads = np.stack([k + i, k + n, k + around + n, k + around + i], axis=-1).reshape(-1, 4)
    faces, vertices = [quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)], [rings.reshape(-1, 3)]
    first, last = np.arange(around), np.arange(around) + (count - 1) * around
    apex = count * around
    for point, ring in ((start, first[::-1]), (end, last)):
        if point is not None:
            faces.append(np.stack([np.full(around, apex), ring, np.roll(ring, -1)], axis=-1))
            vertices.append(np.asarray(point, dtype=float)[None])
            apex += 1
    return Mesh(np.concatenate(vertices), np.concatenate(faces).astype(np.int32))


def lathe(profile: ArrayLike, segments: int = 24) -> Mesh:
    """Surface of revolution about y.

    Args:
        profile: (K, 2) of (radius, height), walked so that the outside lies to the right when height points
            up: up the outside, then down the inside of a hollow thing. A first or last radius of 0 closes
            that end.
        segments: Around the axis.
    """
    points = np.asarray(profile, dtype=float)
    tips = [np.array([0.0, points[e, 1], 0.0]) if points[e, 0] == 0 else None for e in (0, -1)]
    points = points[points[:, 0] > 0]
    angle = np.arange(segments) * (2 * np.pi / segments)
    circle = np.stack([np.sin(angle), np.zeros(segments), np.cos(angle)], axis=-1)
    rings = points[:, None, :1] * circle + points[:, None, 1:] * np.array([0.0, 1.0, 0.0])
    return loft(rings, *tips)


def disc(radius: float, height: float, segments: int = 24) -> Mesh:
    """Upright cylinder standing on y = 0."""
    return lathe([(0, 0), (radius, 0), (radius, height), (0, height)], segments)


def ball(width: float, height: float, depth: float, segments: int = 12) -> Mesh:
    """Ellipsoid (x, y, z) centred on the origin."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, segments // 2 + 1)
    profile = np.stack([np.cos(angle), np.sin(angle)], axis=-1) / 2
    profile[[0, -1], 0] = 0
    return lathe(profile, segments).scaled(width, height, depth)


def tube(path: ArrayLike, radius: float | ArrayLike, segments: int = 8) -> Mesh:
    """Round pipe along a polyline, closed at both ends.

    Args:
        path: (K, 3), no two successive points alike.
        radius: One for all, or (K,).
    """
    points = np.asarray(path, dtype=float)
    tangents = _unit(np.gradient(points, axis=0))
    radii = np.broadcast_to(np.asarray(radius, dtype=float), len(points))
    side = _unit(np.cross(tangents[0], np.eye(3)[np.abs(tangents[0]).argmin()]))
    angle = np.arange(segments) * (2 * np.pi / segments)
    rings = []
    for point, tangent, size in zip(points, tangents, radii, strict=True):
        side = _unit(side - tangent * (side @ tangent))  # carried along without twist
        other = np.cross(tangent, side)
        rings.append(point + size * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * other))
    return loft(np.array(rings), points[0], points[-1])


def rod(start: ArrayLike, end: ArrayLike, radius: float, end_radius: float | None = None, segments: int = 10) -> Mesh:
    """Straight cylinder or cone between two points."""
    return tube(np.array([start, end], dtype=float), [radius, radius if end_radius is None else end_radius], segments)


def post(foot: ArrayLike, top: ArrayLike, foot_size: float, top_size: float, sides: int = 4) -> Mesh:
    """Leg between two points with horizontal ends: square (4 sides, along x and z) or round."""
    angle = np.arange(sides) * (2 * np.pi / sides) + np.pi / sides
    reach = 0.5 / np.cos(np.pi / sides)  # so that the size is the width over the flats
    ring = reach * np.stack([np.sin(angle), np.zeros(sides), np.cos(angle)], axis=-1)
    foot, top = np.asarray(foot, dtype=float), np.asarray(top, dtype=float)
    return loft(np.stack([foot + foot_size * ring, top + top_size * ring]), foot, top)


def slab(outline: ArrayLike, thickness: float) -> Mesh:
    """Flat plate, thick along z: an outline (N, 2) in x, y, counter-clockwise, star-shaped from its mean."""
    points = np.asarray(outline, dtype=float)
    back = np.column_stack([points, np.full(len(points), -thickness / 2)])
    front = back + np.array([0.0, 0.0, thickness])
    return loft(np.stack([back, front]), back.mean(0), front.mean(0))


def top_plate(width: float, depth: float, thickness: float, exponent: float, segments: int = 32) -> Mesh:
    """Horizontal plate standing on y = 0, a superellipse: exponent 2 is an ellipse, 10 nearly a rectangle."""
    outline = superellipse(width, depth, exponent, segments)
    return slab(outline, thickness).turned("x", -90).at(y=thickness / 2)


def superellipse(width: float, height: float, exponent: float, segments: int = 32) -> np.ndarray:
    """Closed outline (N, 2), counter-clockwise: |2x/width|^e + |2y/height|^e = 1.

    Points crowd at the corners where the exponent is large; a multiple of 8 segments puts one right on them.
    """
    angle = np.arange(segments) * (2 * np.pi / segments)
    corner = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    corner[np.abs(corner) < 1e-12] = 0  # else a tiny number to a small power is a notch
    return np.sign(corner) * np.abs(corner) ** (2 / exponent) * np.array([width, height]) / 2


def rounded_box(width: float, height: float, depth: float, radius: float, steps: int = 2) -> Mesh:
    """Cuboid centred on the origin with round edges: a sphere whose eight octants are moved apart."""
    half = np.array([width, height, depth]) / 2
    radius = min(radius, 0.98 * float(half.min()))
    quarter = np.linspace(0, np.pi / 2, steps + 1)
    around = np.concatenate([q * np.pi / 2 + quarter for q in range(4)])
    sign_x, sign_z = np.repeat([1, 1, -1, -1], steps + 1), np.repeat([1, -1, -1, 1], steps + 1)
    rise = np.concatenate([quarter - np.pi / 2, quarter])
    sign_y = np.repeat([-1, 1], steps + 1)
    inner = half - radius
    flat = np.cos(rise)[:, None] * np.stack([np.sin(around), np.cos(around)])[:, None]
    x = radius * flat[0] + sign_x * inner[0]
    z = radius * flat[1] + sign_z * inner[2]
    y = np.broadcast_to((radius * np.sin(rise) + sign_y * inner[1])[:, None], x.shape)
    return welded(loft(np.stack([x, y, z], axis=-1), (0, -half[1], 0), (0, half[1], 0)))


def curve(points: ArrayLike, count: int) -> np.ndarray:
    """Smooth path (count, D) through control points (K, D): Catmull-Rom, mirrored past the ends."""
    p = np.asarray(points, dtype=float)
    p = np.concatenate([2 * p[:1] - p[1:2], p, 2 * p[-1:] - p[-2:-1]])
    place = np.linspace(0, len(p) - 3, count)
    k = np.minimum(place.astype(int), len(p) - 4)
    t = (place - k)[:, None]
    a, b, c, d = p[k], p[k + 1], p[k + 2], p[k + 3]
    return b + t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a))) / 2


def welded(mesh: Mesh) -> Mesh:
    """Merge vertices at one place and drop the faces that thereby lose their area."""
    grid = np.round(mesh.vertices / np.ptp(mesh.vertices, axis=0).max(), 9)
    _, first, group = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    faces = group.reshape(-1)[mesh.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    return Mesh(mesh.vertices[first], faces.astype(np.int32))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
