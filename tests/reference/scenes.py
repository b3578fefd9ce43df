"""Shapes for the renderer's tests: random ones, and the ones that are known to hurt (notes T4..T16)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mvtn_cli.core.render import Look, ShapeBatch, pack
from mvtn_cli.core.store import StoredShape
from reference.look_at import focal_length
from reference.shading import Scene

FOV = 60.0


def stored(vertices, faces, *, normals=None, colors=None, points=None, point_colors=None) -> StoredShape:
    """Wrap arrays up as a preprocessed shape, as they are: nothing is normalised or mended."""
    vertices = np.asarray(vertices, np.float32).reshape(-1, 3)
    faces = np.asarray(faces, np.int32).reshape(-1, 3)
    return StoredShape(
        vertices=vertices,
        faces=faces,
        normals=np.asarray(mean_normals(vertices, faces) if normals is None else normals, np.float32),
        colors=None if colors is None else np.asarray(colors, np.float32),
        points=np.asarray(np.zeros((1, 3)) if points is None else points, np.float32),
        point_colors=None if point_colors is None else np.asarray(point_colors, np.float32),
        center=np.zeros(3),
        radius=1.0,
    )


def cloud(points, point_colors=None) -> StoredShape:
    """Return points without a surface."""
    return stored(np.zeros((0, 3)), np.zeros((0, 3)), points=points, point_colors=point_colors)


def mean_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return (V, 3) area-weighted unit normals; zero where there is none."""
    normals = np.zeros((len(vertices), 3))
    with np.errstate(invalid="ignore", over="ignore"):
        a, b, c = vertices.astype(np.float64)[faces].transpose(1, 0, 2)
        for corner in range(3):
            np.add.at(normals, faces[:, corner], np.cross(b - a, c - a))
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)


def look(size: int, count: int = 1, **changes) -> Look:
    """Return a white shape under a headlight on black, one sample a pixel, with changes."""
    plain = Look(image_size=size, kind="mesh", colors=np.ones((count, 3), np.float32), supersample=1)
    return replace(plain, **changes)


def lit(shape: StoredShape, chosen: Look, b: int = 0) -> Scene:
    """Say the same as (shape, look) to the twin."""
    light = None if chosen.light_direction is None else np.asarray(chosen.light_direction[b], np.float64)
    return Scene(
        vertices=shape.vertices,
        faces=shape.faces,
        normals=shape.normals,
        colors=shape.colors,
        albedo=np.asarray(chosen.colors[b], np.float64),
        light=light,
        background=chosen.background,
        material=tuple(chosen.material),
        smooth=chosen.shading == "smooth",
    )


def focal(size: int) -> float:
    """Return the focal length of the tests' cameras."""
    return focal_length(size, FOV)


def batch_of(*shapes: StoredShape) -> ShapeBatch:
    """Pack shapes that are called 0, 1, 2, ..."""
    return pack(shapes, names=[str(k) for k in range(len(shapes))])


def soup(n_faces: int, seed: int, *, edge: float = 0.6, colored: bool = False) -> StoredShape:
    """Return triangles without any order in the unit ball."""
    random = np.random.default_rng(seed)
    middles = random.uniform(-0.5, 0.5, (n_faces, 1, 3))
    vertices = (middles + random.uniform(-edge, edge, (n_faces, 3, 3))).reshape(-1, 3)
    colors = random.uniform(0, 1, vertices.shape) if colored else None
    return stored(vertices, np.arange(3 * n_faces), colors=colors)


def box(size=(1.0, 1.0, 1.0), center=(0.0, 0.0, 0.0)) -> StoredShape:
    """Return a closed box of 8 vertices and 12 faces, wound outward."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [corner for a, b, c, d in quads for corner in ((a, b, c), (a, c, d))]
    return stored(corners * size + center, faces)


def joined(*shapes: StoredShape) -> StoredShape:
    """Return several shapes as one."""
    starts = np.cumsum([0] + [len(shape.vertices) for shape in shapes])
    return stored(
        np.concatenate([shape.vertices for shape in shapes]),
        np.concatenate([shape.faces + start for shape, start in zip(shapes, starts, strict=False)]),
        normals=np.concatenate([shape.normals for shape in shapes]),
    )


def chair() -> StoredShape:
    """Return boxes that run into each other; no symmetry but left and right."""
    seat, back = box((0.9, 0.12, 0.9)), box((0.9, 0.8, 0.1), (0, 0.4, -0.4))
    legs = [box((0.1, 0.6, 0.1), (x, -0.3, z)) for x in (-0.4, 0.4) for z in (-0.4, 0.4)]
    return joined(seat, back, *legs)


def icosahedron() -> StoredShape:
    """Return 12 vertices on the unit sphere, 20 faces, wound outward."""
    g = (1 + 5**0.5) / 2
    corners = np.array([p for s in (-1, 1) for t in (-g, g) for p in ((0, s, t), (s, t, 0), (t, 0, s))])
    faces = []
    for a in range(12):
        for b in range(a + 1, 12):
            for c in range(b + 1, 12):
                sides = [np.linalg.norm(corners[p] - corners[q]) for p, q in ((a, b), (b, c), (c, a))]
                if max(sides) < 2.1:
                    outward = np.linalg.det(corners[[a, b, c]]) > 0
                    faces.append((a, b, c) if outward else (a, c, b))
    return stored(corners / np.linalg.norm(corners[0]), faces)


def bumpy(steps: int) -> StoredShape:
    """Return a closed, bumpy, lopsided surface of 4 * steps^2 faces, wound outward."""
    around = 2 * steps
    u, v = np.meshgrid(np.arange(around) * np.pi / steps, (np.arange(steps) + 0.5) * np.pi / steps)
    radius = 0.7 + 0.15 * np.sin(3 * u) * np.sin(v) + 0.1 * np.cos(2 * v + u)
    xyz = np.stack([np.sin(v) * np.sin(u), 0.7 * np.cos(v), np.sin(v) * np.cos(u)], -1) * radius[..., None]
    a = np.arange(around * steps).reshape(steps, around)
    b = np.roll(a, -1, axis=1)
    top, bottom = around * steps, around * steps + 1
    walls = [np.stack([a[:-1], a[1:], b[:-1]], -1), np.stack([b[:-1], a[1:], b[1:]], -1)]
    caps = [
        np.stack([np.full(around, top), a[0], b[0]], -1),
        np.stack([np.full(around, bottom), b[-1], a[-1]], -1),
    ]
    faces = np.concatenate([part.reshape(-1, 3) for part in (*walls, *caps)])
    return stored([*xyz.reshape(-1, 3), [0, 0.5, 0.02], [0, -0.55, 0]], faces)


def without_normals(shape: StoredShape) -> StoredShape:
    """Return the shape with normals of length zero."""
    return replace(shape, normals=np.zeros_like(shape.normals))


def stiff() -> dict[str, StoredShape]:
    """Return shapes that broke renderers before, by what is wrong with them."""
    random = np.random.default_rng(7)
    plain, level = soup(12, 5), [[-0.8, -0.5, 0], [0.9, -0.4, 0], [0.1, 0.8, 0]]
    tilted = [[-0.8, -0.5, 0.3], [0.9, -0.4, -0.2], [0.1, 0.8, 0.1]]
    beside = np.array(tilted) + 0.3 * (np.array(tilted)[1] - tilted[0])
    nan = soup(12, 6).vertices.copy()
    nan[4, 1], nan[17, 0], nan[25] = np.nan, np.inf, -np.inf
    return {
        "across the near plane": stored(random.uniform(-4, 4, (36, 3)), np.arange(36)),
        "behind the camera": stored(np.add(random.uniform(-1, 1, (18, 3)), [0, 0, 5]), np.arange(18)),
        "slivers": stored(slivers(30, 1e-6), np.arange(90)),
        "slivers that are lines": stored(slivers(30, 0), np.arange(90)),
        "needles": stored(slivers(30, 0.01), np.arange(90)),
        "zero area": joined(plain, stored(plain.vertices, [[0, 0, 1], [3, 4, 4], [6, 6, 6]])),
        "zero normals": without_normals(plain),
        "one vertex, two opposite faces": stored([*level, [0.2, -0.7, 0.8]], [[0, 1, 2], [1, 0, 3]]),
        "every face twice": joined(plain, plain),
        "every face twice, reversed": joined(plain, flipped(plain)),
        "coplanar": stored([*tilted, *beside], [[0, 1, 2], [3, 4, 5]]),
        "through each other": joined(box(), box((0.5, 1.4, 0.5)), box((1.3, 0.3, 0.2), (0.1, 0.1, 0.1))),
        "sheets a millionth apart": joined(box(), box(np.full(3, 1 + 1e-6))),
        "NaN and infinite vertices": stored(nan, np.arange(36)),
        "one face": stored(tilted, [[0, 1, 2]]),
        "one face edge-on": stored([[0, 0.5, 0.3], [0, -0.7, 0.1], [0, 0.1, -0.6]], [[0, 1, 2]]),
        "far away vertex": stored([*tilted, [1e9, 3e8, -2e9]], [[0, 1, 2], [0, 1, 3]]),
        "tiny": stored(soup(20, 9).vertices * 1e-6, np.arange(60)),
        "all vertices alike": stored(np.full((3, 3), 0.1), [[0, 1, 2]]),
    }


def slivers(count: int, width: float) -> np.ndarray:
    """Return (3 * count, 3) vertices of triangles of length 1 and the given width."""
    random = np.random.default_rng(3)
    start, along, aside = random.uniform(-0.5, 0.5, (3, count, 1, 3))
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    aside -= (aside * along).sum(-1, keepdims=True) * along
    aside *= width / np.linalg.norm(aside, axis=-1, keepdims=True)
    return np.concatenate([start, start + along, start + along / 3 + aside], axis=1).reshape(-1, 3)


def flipped(shape: StoredShape) -> StoredShape:
    """Return the shape with every face wound the other way; normals as they were."""
    return replace(shape, faces=np.ascontiguousarray(shape.faces[:, ::-1]))
