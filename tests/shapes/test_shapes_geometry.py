"""Normalising, sampling, normals, simplifying."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from mvtn_cli.core.shapes import Shape, cloud, normalise, sample_surface, simplify, validate, vertex_normals
from mvtn_cli.core.shapes.distance import distance_to_mesh
from mvtn_cli.core.shapes.sample import draw_on_faces


def of(body: trimesh.Trimesh) -> Shape:
    return Shape(np.array(body.vertices, np.float64), np.array(body.faces, np.int32))


def bumpy() -> Shape:
    """A closed body without symmetry, with a collinear face and a needle (T6, T7)."""
    body = of(trimesh.creation.icosphere(subdivisions=2))
    wave = 1 + 0.3 * np.sin(3 * body.vertices[:, :1]) + 0.2 * np.cos(5 * body.vertices[:, 1:2])
    extra = np.array([[0, 0, 3], [0.5, 0, 3], [1, 0, 3], [0.5, 1e-5, 3]])
    vertices = np.concatenate([body.vertices * wave, extra])
    first = len(body.vertices)
    faces = np.concatenate([body.faces, np.array([[0, 1, 2], [0, 2, 3]]) + first])
    return Shape(vertices, faces.astype(np.int32))


# --- normalise ---


def test_the_box_centre_goes_to_the_origin_and_the_farthest_vertex_to_one() -> None:
    shape = of(trimesh.creation.cone(radius=2, height=6))
    unit, center, radius = normalise(shape)
    assert np.allclose(unit.vertices.min(axis=0) + unit.vertices.max(axis=0), 0, atol=1e-15)
    assert np.linalg.norm(unit.vertices, axis=1).max() == pytest.approx(1, abs=1e-15)
    assert np.allclose(unit.vertices * radius + center, shape.vertices, atol=1e-14)


def test_points_carried_by_a_mesh_get_the_same_transform() -> None:
    shape = of(trimesh.creation.box(extents=(1, 2, 3)))
    shape = replace(shape, vertices=shape.vertices + 7, points=shape.vertices[:4] + 7)
    unit, _, _ = normalise(shape)
    assert unit.points is not None
    assert np.array_equal(unit.points, unit.vertices[:4])


@pytest.mark.parametrize("scale", [1e-300, 1e-12, 1e-3, 4.6e8, 1e12, 1e290])
@pytest.mark.parametrize("shift", [0.0, 1e6])
def test_scale_and_shift_change_neither_findings_nor_the_normalised_mesh(scale: float, shift: float) -> None:
    plain, plain_findings = validate(bumpy())
    _, _, radius = normalise(plain)
    moved = replace(bumpy(), vertices=(bumpy().vertices + shift * radius * np.array([1, -0.5, 0.25])) * scale)
    mended, findings = validate(moved)
    assert [(f.name, f.count) for f in findings] == [(f.name, f.count) for f in plain_findings]
    assert np.array_equal(mended.faces, plain.faces)
    unit, _, moved_radius = normalise(mended)
    assert np.allclose(unit.vertices, normalise(plain)[0].vertices, atol=2e-9 if shift else 1e-14)
    assert moved_radius == pytest.approx(radius * scale, rel=1e-9)
    normals = vertex_normals(mended.vertices, mended.faces)
    wanted = vertex_normals(plain.vertices, plain.faces)
    assert np.allclose(normals, wanted, atol=1e-3 if shift else 1e-5)
    drawn, _ = sample_surface(unit, 100, seed=5)
    assert np.allclose(drawn, sample_surface(normalise(plain)[0], 100, seed=5)[0], atol=1e-6)


def test_what_has_no_size_is_refused() -> None:
    for shape in (
        cloud(np.zeros((4, 3))),
        cloud(np.zeros((0, 3))),
        Shape(np.zeros((3, 3)), np.zeros((0, 3), np.int32)),
    ):
        with pytest.raises(ValueError, match="validate"):
            normalise(shape)


# --- sample ---


def test_samples_lie_on_their_face_and_follow_area() -> None:
    box = trimesh.creation.box(extents=(1, 2, 4))
    faces = np.array(box.faces, np.int32)
    face, weights = draw_on_faces(np.array(box.vertices), faces, 20_000, np.random.default_rng(0))
    points, _ = sample_surface(of(box), 20_000, seed=0)
    assert np.allclose(np.einsum("nk,nkd->nd", weights, box.triangles[face]), points, atol=1e-12)
    assert weights.min() >= 0
    assert np.allclose(weights.sum(axis=1), 1)
    share = np.bincount(face, minlength=len(faces)) / len(face)
    assert np.abs(share - box.area_faces / box.area).max() < 0.012  # 4 sigma
    # Uniform on the triangle: each weight has mean 1/3 and variance 1/18.
    assert np.allclose(weights.mean(axis=0), 1 / 3, atol=0.007)
    assert np.allclose(weights.var(axis=0), 1 / 18, atol=0.002)


def test_the_seed_decides_the_points_and_nothing_else_does() -> None:
    shape = bumpy()
    assert np.array_equal(sample_surface(shape, 50, 1)[0], sample_surface(shape, 50, 1)[0])
    assert not np.array_equal(sample_surface(shape, 50, 1)[0], sample_surface(shape, 50, 2)[0])


def test_colours_are_interpolated_between_the_corners() -> None:
    triangle = Shape(np.eye(3), np.array([[0, 1, 2]], np.int32), colors=np.eye(3, dtype=np.float32))
    points, colors = sample_surface(triangle, 500, seed=0)
    assert colors is not None and colors.dtype == np.float32
    assert np.allclose(points, colors, atol=1e-6)  # here, a point's coordinates are its weights


def test_faces_without_area_are_never_drawn() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5], [6, 6, 6], [7, 7, 7]], np.float64)
    shape = Shape(vertices, np.array([[3, 4, 5], [0, 1, 2], [3, 3, 4]], np.int32))
    assert (sample_surface(shape, 1000, 0)[0][:, 2] == 0).all()
    with pytest.raises(ValueError, match="no area"):
        sample_surface(replace(shape, faces=shape.faces[:1]), 10, 0)


@pytest.mark.parametrize("count", [10, 64, 150])
def test_a_cloud_is_thinned_without_repeats_and_filled_up_evenly(count: int) -> None:
    points = np.random.default_rng(0).normal(size=(64, 3))
    drawn, colors = sample_surface(cloud(points, points.astype(np.float32)), count, seed=9)
    assert colors is not None
    assert np.allclose(drawn, colors, atol=1e-6)
    _, times = np.unique(drawn, axis=0, return_counts=True)
    assert len(drawn) == count
    assert len(times) == min(count, 64)
    assert times.max() - times.min() <= 1


# --- normals ---


def test_a_cube_corner_looks_along_its_diagonal_however_its_sides_are_cut() -> None:
    box = trimesh.creation.box()
    assert np.allclose(vertex_normals(box.vertices, box.faces), box.vertices * 2 / np.sqrt(3), atol=1e-6)


def test_a_sphere_has_radial_normals() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4)
    normals = vertex_normals(ball.vertices * 1e-5, ball.faces)
    assert normals.dtype == np.float32
    assert (normals * ball.vertices).sum(axis=1).min() > np.cos(np.radians(0.5))


def test_reversed_copies_of_all_faces_change_nothing() -> None:
    shape = bumpy()
    doubled = np.concatenate([shape.faces, shape.faces[:, ::-1], shape.faces])
    assert np.array_equal(vertex_normals(shape.vertices, doubled), vertex_normals(shape.vertices, shape.faces))


def test_where_opposite_faces_cancel_the_first_one_decides() -> None:
    """Two coplanar triangles of opposite winding share an edge: the sum at its ends is zero (T7)."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], np.float64)
    normals = vertex_normals(vertices, np.array([[0, 1, 2], [1, 2, 3]], np.int32))
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)
    assert normals[[0, 1, 2]].tolist() == [[0, 0, 1]] * 3
    assert normals[3].tolist() == [0, 0, -1]


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
def test_normals_are_unit_vectors_whatever_the_mesh(scale: float) -> None:
    needle = [
        [0, 0, 0],
        [1, 0, 0],
        [0.5, 1e-9, 0],
        [2, 2, 2],
        [2, 2, 2],
        [9, 9, 9],
        [np.nan, 0, 0],
        [0, np.inf, 1],
    ]
    faces = [[0, 1, 2], [0, 3, 4], [3, 3, 3], [0, 1, 6], [6, 7, 0], [7, 7, 7]]
    normals = vertex_normals(np.array(needle) * scale, np.array(faces, np.int32))
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    assert np.allclose(normals[:3], [0, 0, 1], atol=1e-6)
    assert normals[3:].tolist() == [[0, 1, 0]] * 5  # no usable face: up
    assert vertex_normals(np.zeros((2, 3)), np.zeros((0, 3), np.int32)).tolist() == [[0, 1, 0]] * 2


# --- simplify ---


def test_distance_equals_that_to_all_triangles() -> None:
    body = trimesh.creation.annulus(r_min=0.3, r_max=1, height=0.4)
    points = np.random.default_rng(0).normal(size=(300, 3))
    distance = distance_to_mesh(points, np.array(body.vertices), np.array(body.faces, np.int32))
    nearest = [trimesh.triangles.closest_point(body.triangles, np.tile(p, (len(body.faces), 1))) - p for p in points]
    exact = np.linalg.norm(nearest, axis=2).min(axis=1)
    assert (distance >= exact - 1e-12).all()
    assert np.allclose(distance, exact, atol=1e-3)
    assert np.median(distance - exact) < 1e-12


def test_a_mesh_under_the_limit_is_not_touched() -> None:
    shape = bumpy()
    assert simplify(shape, len(shape.vertices)) == (shape, None)
    points = cloud(np.random.default_rng(0).normal(size=(50, 3)))
    assert simplify(points, 10) == (points, None)


@pytest.mark.parametrize("limit", [100, 500, 2000])
def test_simplifying_keeps_under_the_limit_near_the_surface_and_in_file_units(limit: int) -> None:
    ball, center = of(trimesh.creation.icosphere(subdivisions=4, radius=50)), np.array([1e3, 0, -1e3])
    shape = replace(ball, vertices=ball.vertices + center, colors=(ball.vertices > 0).astype(np.float32))
    small, report = simplify(shape, limit)
    assert report is not None
    assert limit * 0.8 <= len(small.vertices) <= limit
    assert (report.vertices_before, report.vertices_after) == (2562, len(small.vertices))
    assert (report.faces_before, report.faces_after) == (5120, len(small.faces))
    assert validate(small)[1] == []
    local = small.vertices - center
    assert np.abs(np.linalg.norm(local, axis=1) / 50 - 1).max() < 4 / limit
    # The best that n vertices can do is a sphere's sagitta over its triangles, about 2 / n of the radius.
    assert 0 < report.error_percent < 100 * 4 / limit
    assert report.error_percent <= report.worst_percent
    assert small.colors is not None
    sure = np.abs(local) > 12  # away from where the colour changes
    assert np.array_equal(small.colors[sure] > 0.5, local[sure] > 0)


def test_loose_pieces_that_cannot_collapse_are_still_brought_under_the_limit() -> None:
    places = np.random.default_rng(0).uniform(-1, 1, (100, 3))
    boxes = [trimesh.creation.box(extents=(0.01, 0.01, 0.01)) for _ in places]
    pieces = [box.apply_translation(place) for box, place in zip(boxes, places, strict=True)]
    small, report = simplify(of(trimesh.util.concatenate(pieces)), 300)
    assert report is not None
    assert len(small.vertices) <= 300
    assert report.worst_percent < 5


def test_a_thin_open_sheet_beside_a_dense_body_is_not_swallowed() -> None:
    """Free collapses eat such a sheet whole; the reported error must see it, and another method keep it."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    bars = [[-1, y, 0.5] for y in np.linspace(-1, 1, 12)] + [[1, y, 0.5] for y in np.linspace(-1, 1, 12)]
    cut = [[i, i + 1, i + 12] for i in range(11)] + [[i + 1, i + 13, i + 12] for i in range(11)]
    shape = of(trimesh.util.concatenate([ball, trimesh.Trimesh(bars, cut, process=False)]))
    small, report = simplify(shape, 300)
    assert report is not None
    assert report.worst_percent < 5
    assert np.allclose(small.vertices.min(axis=0), [-1, -1, -0.3], atol=0.05)
