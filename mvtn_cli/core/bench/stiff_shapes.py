"""Shapes that break renderers. None is normalised or mended: the renderer gets them as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from mvtn_cli.core.shapes import Shape, normalise, vertex_normals
from mvtn_cli.core.store import StoredShape

LEVEL = ((-0.8, -0.5, 0.0), (0.9, -0.4, 0.0), (0.1, 0.8, 0.0))
TILTED = ((-0.8, -0.5, 0.3), (0.9, -0.4, -0.2), (0.1, 0.8, 0.1))


def raw(vertices: ArrayLike, faces: ArrayLike, normals: np.ndarray | None = None) -> StoredShape:
    """Arrays as a preprocessed shape."""
    vertices = np.asarray(vertices, np.float32).reshape(-1, 3)
    faces = np.asarray(faces, np.int32).reshape(-1, 3)
    if normals is None:
        with np.errstate(all="ignore"):
            normals = vertex_normals(vertices.astype(np.float64), faces)
    return StoredShape(
        vertices=vertices,
        faces=faces,
        normals=np.asarray(normals, np.float32),
        colors=None,
        points=np.zeros((1, 3), np.float32),
        point_colors=None,
        center=np.zeros(3),
        radius=1.0,
    )


def cloud(points: ArrayLike) -> StoredShape:
    """Points without a surface."""
    return replace(raw(np.zeros((0, 3)), np.zeros((0, 3))), points=np.asarray(points, np.float32).reshape(-1, 3))


def soup(count: int, seed: int, edge: float = 0.6) -> StoredShape:
    """Triangles without any order, in the unit ball."""
    random = np.random.default_rng(seed)
    middles = random.uniform(-0.5, 0.5, (count, 1, 3))
    return raw(middles + random.uniform(-edge, edge, (count, 3, 3)), np.arange(3 * count))


def box(size: Sequence[float] = (1.0, 1.0, 1.0), center: Sequence[float] = (0.0, 0.0, 0.0)) -> StoredShape:
    """A closed box of 8 shared vertices, wound outward."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return raw(corners * size + center, [corner for a, b, c, d in quads for corner in ((a, b, c), (a, c, d))])


def chair() -> StoredShape:
    """Boxes that run into each other."""
    legs = [box((0.1, 0.6, 0.1), (x, -0.3, z)) for x in (-0.4, 0.4) for z in (-0.4, 0.4)]
    return joined(box((0.9, 0.12, 0.9)), box((0.9, 0.8, 0.1), (0, 0.4, -0.4)), *legs)


def joined(*shapes: StoredShape) -> StoredShape:
    """Several shapes as one, normals as they were."""
    starts = np.cumsum([0, *(len(shape.vertices) for shape in shapes[:-1])])
    return raw(
        np.concatenate([shape.vertices for shape in shapes]),
        np.concatenate([shape.faces + start for shape, start in zip(shapes, starts, strict=True)]),
        np.concatenate([shape.normals for shape in shapes]),
    )


def with_faces(shape: StoredShape, faces: ArrayLike) -> StoredShape:
    """The same vertices and normals under other faces."""
    return replace(shape, faces=np.ascontiguousarray(faces, np.int32).reshape(-1, 3))


def every_face_twice(shape: StoredShape, *, reverse: bool) -> StoredShape:
    """Each face again, in the same order of corners or in the opposite one."""
    again = shape.faces[:, ::-1] if reverse else shape.faces
    return with_faces(shape, np.concatenate([shape.faces, again]))


def slivers(count: int, width: float) -> StoredShape:
    """Triangles of length 1 and this width."""
    random = np.random.default_rng(3)
    start, along, aside = random.uniform(-0.5, 0.5, (3, count, 1, 3))
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    aside -= (aside * along).sum(-1, keepdims=True) * along
    aside *= width / np.linalg.norm(aside, axis=-1, keepdims=True)
    corners = np.concatenate([start, start + along, start + along / 3 + aside], axis=1)
    return raw(corners, np.arange(3 * count))


def not_finite(shape: StoredShape) -> StoredShape:
    """The shape with three vertices that are NaN or infinite."""
    vertices = shape.vertices.copy()
    vertices[[4, 17, 25], [1, 0, 2]] = np.nan, np.inf, -np.inf
    return replace(shape, vertices=vertices)


def rescaled(shape: StoredShape, scale: float, shift: ArrayLike = 0.0) -> StoredShape:
    """The shape after a journey through other units, normalised again."""
    moved = shape.vertices.astype(np.float64) * scale + np.asarray(shift, np.float64)
    back, _, _ = normalise(Shape(vertices=moved, faces=shape.faces, name="", source=""))
    return raw(back.vertices, shape.faces)


def bumpy(steps: int) -> StoredShape:
    """A closed, bumpy surface of 4 steps² faces, wound outward: 500 steps make a million."""
    around = 2 * steps
    u, v = np.meshgrid(np.arange(around) * np.pi / steps, (np.arange(steps) + 0.5) * np.pi / steps)
    radius = 0.7 + 0.15 * np.sin(3 * u) * np.sin(v) + 0.1 * np.cos(2 * v + u)
    xyz = np.stack([np.sin(v) * np.sin(u), 0.7 * np.cos(v), np.sin(v) * np.cos(u)], -1) * radius[..., None]
    a = np.arange(around * steps).reshape(steps, around)
    b = np.roll(a, -1, axis=1)
    top, bottom = around * steps, around * steps + 1
    parts = [
        np.stack([a[:-1], a[1:], b[:-1]], -1),
        np.stack([b[:-1], a[1:], b[1:]], -1),
        np.stack([np.full(around, top), a[0], b[0]], -1),
        np.stack([np.full(around, bottom), b[-1], a[-1]], -1),
    ]
    faces = np.concatenate([part.reshape(-1, 3) for part in parts])
    return raw(np.concatenate([xyz.reshape(-1, 3), [[0, 0.5, 0.02], [0, -0.55, 0]]]), faces)
