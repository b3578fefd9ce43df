"""A cut takes away what is on the other side of the plane, no more and no less."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree
from solids import OCTAHEDRON, TRIANGLES, cloud, solid
from trimesh.intersections import slice_faces_plane

from mvtn_cli.core.robustness.cutting import Plane, cut_mesh, surface_area
from mvtn_cli.core.robustness.occlusion import (
    CROPS,
    DIRECTIONS,
    occlude,
    removed_count,
)
from mvtn_cli.core.shapes import normalise, read_shape
from mvtn_cli.core.store import StoredShape

heights = st.one_of(st.floats(-0.8, 0.8), st.sampled_from([0.0, 1e-30, -1e-30, 1e-7]))  # through vertices, or nearly so
planes = st.builds(Plane.across, st.integers(0, 2), heights, st.sampled_from([1, -1]))
ratios = st.floats(0.01, 0.99)
few = settings(max_examples=30, deadline=None)


def same_bytes(one: StoredShape, other: StoredShape) -> bool:
    names = ("vertices", "faces", "normals", "colors", "points", "point_colors")
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


def octahedron() -> StoredShape:
    """Its equators lie in the planes x, y, z = 0."""
    shape = solid(0)
    vertices = OCTAHEDRON.astype(np.float32)
    return replace(shape, vertices=vertices, faces=TRIANGLES, normals=vertices, colors=None)


def half_edges(shape: StoredShape) -> Counter[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Directed edges between places; 0.0 and -0.0 are one."""
    places = [tuple(row) for row in (shape.vertices + np.float32(0)).tolist()]
    walks = [(face[k], face[(k + 1) % 3]) for face in shape.faces.tolist() for k in range(3)]
    return Counter((places[a], places[b]) for a, b in walks)


@few
@given(st.integers(0, 50), planes)
def test_the_parts_on_both_sides_have_the_area_of_the_whole(seed: int, plane: Plane):
    shape = solid(seed)
    parts = [surface_area(cut_mesh(shape, plane._replace(sign=sign))) for sign in (1, -1)]
    assert sum(parts) == pytest.approx(surface_area(shape), rel=1e-5)


@few
@given(st.integers(0, 50), planes)
def test_no_vertex_lies_on_the_other_side_and_all_of_them_are_used(seed: int, plane: Plane):
    cut = cut_mesh(solid(seed), plane)
    assert (plane.depth(cut.vertices) >= 0).all()
    assert np.array_equal(np.unique(cut.faces), np.arange(len(cut.vertices)))
    assert np.allclose(np.linalg.norm(cut.normals, axis=1), 1, atol=1e-5)
    assert cut.colors.shape == cut.vertices.shape and ((cut.colors >= 0) & (cut.colors <= 1)).all()


@few
@given(st.integers(0, 50), planes, st.booleans())
def test_the_winding_is_kept_and_only_the_cut_is_open(seed: int, plane: Plane, seams: bool):
    cut = cut_mesh(solid(seed, seams=seams), plane)
    corners = cut.vertices[cut.faces].astype(float)
    assert (np.linalg.det(corners) > -1e-9).all()  # seen from the origin all faces of the solid are wound one way
    edges = half_edges(cut)
    assert not edges or max(edges.values()) == 1
    for a, b in edges:
        if (b, a) not in edges:
            assert a[plane.axis] == b[plane.axis] == plane.at


@few
@given(st.integers(0, 50), planes)
def test_what_is_left_lies_on_the_old_surface_with_its_attributes(seed: int, plane: Plane):
    shape = solid(seed)
    # where an attribute is linear in the place, so it is after the cut
    linear = replace(shape, colors=((shape.vertices + 1) / 2).astype(np.float32))
    cut = cut_mesh(linear, plane)
    assert np.allclose(cut.colors, (cut.vertices + 1) / 2, atol=1e-6)


def test_a_cut_is_the_same_each_time_and_leaves_the_original_alone():
    shape, plane = solid(3), Plane.across(1, 0.1, 1)
    before = solid(3)
    assert same_bytes(cut_mesh(shape, plane), cut_mesh(shape, plane)) and same_bytes(shape, before)


def test_a_plane_through_vertices_adds_none():
    cut = cut_mesh(octahedron(), Plane.across(1, 0.0, 1))
    assert len(cut.vertices) == 5 and len(cut.faces) == 4
    assert surface_area(cut) == pytest.approx(surface_area(octahedron()) / 2)


def test_a_plane_that_only_touches_a_corner_leaves_nothing_and_one_beyond_everything():
    assert len(cut_mesh(octahedron(), Plane.across(0, 1.0, 1)).faces) == 0
    assert len(cut_mesh(octahedron(), Plane.across(0, 2.0, 1)).faces) == 0
    assert cut_mesh(octahedron(), Plane.across(0, -1.0, 1)).faces.shape == (8, 3)


def test_a_tip_that_is_cut_off_leaves_the_size_that_geometry_says():
    cut = cut_mesh(octahedron(), Plane.across(2, 0.75, 1))
    assert surface_area(cut) == pytest.approx(surface_area(octahedron()) / 2 / 16)
    assert np.allclose(cut.vertices[:, 2].min(), 0.75) and len(cut.faces) == 4


def compare_with_trimesh(shape: StoredShape, plane: Plane) -> None:
    """Another implementation, in float64, finds the same area, bounds and section."""
    normal = np.zeros(3)
    normal[plane.axis] = plane.sign
    origin = normal * plane.at * plane.sign
    vertices, faces, *_ = slice_faces_plane(shape.vertices.astype(float), shape.faces, normal, origin)
    cut = cut_mesh(shape, plane)
    whole = replace(shape, vertices=vertices, faces=faces)
    assert surface_area(cut) == pytest.approx(surface_area(whole), rel=1e-5, abs=1e-7)
    if len(cut.faces):
        assert np.allclose(cut.vertices.min(0), vertices[faces].min((0, 1)), atol=1e-6)
        assert np.allclose(cut.vertices.max(0), vertices[faces].max((0, 1)), atol=1e-6)
        on = cut.vertices[cut.vertices[:, plane.axis] == plane.at].astype(float)
        theirs = vertices[np.abs(vertices[:, plane.axis] - plane.at) < 1e-9]
        assert len(on) == 0 or KDTree(theirs).query(on)[0].max() < 1e-6


@few
@given(st.integers(0, 50), planes)
def test_another_library_cuts_the_same(seed: int, plane: Plane):
    compare_with_trimesh(solid(seed), plane)


def test_real_meshes_are_cut_the_same_by_another_library(real_data: Path):
    files = sorted((real_data / "modelnet_off").glob("*.off"))[:4]
    for number, path in enumerate(files):
        mesh, _, _ = normalise(read_shape(path))
        shape = replace(solid(0), vertices=mesh.vertices.astype(np.float32), faces=mesh.faces, colors=None)
        shape = replace(shape, normals=np.tile(np.float32([0, 1, 0]), (len(shape.vertices), 1)))
        compare_with_trimesh(shape, Plane.across(number % 3, 0.0371, 1 - 2 * (number % 2)))


# Occlusion


@few
@given(st.integers(0, 50), ratios, st.sampled_from(DIRECTIONS), st.booleans())
def test_a_quantile_removes_its_share_of_the_points_from_the_side_that_was_named(
    seed: int, ratio: float, direction: str, bare: bool
):
    shape = cloud(seed) if bare else solid(seed)
    left = occlude(shape, ratio, direction, "quantile")
    stay = np.unique(left.shape.points, axis=0)
    assert abs(len(shape.points) - len(stay) - ratio * len(shape.points)) <= 1
    assert left.points_left == len(stay) / len(shape.points)
    axis, side = "xyz".index(direction[1]), 1 if direction[0] == "+" else -1
    gone = np.array([row for row in shape.points if not (stay == row).all(axis=1).any()]).reshape(-1, 3)
    assert not len(gone) or (side * gone[:, axis]).min() >= (side * stay[:, axis]).max()


@few
@given(st.integers(0, 50), ratios, st.sampled_from(DIRECTIONS), st.sampled_from(CROPS))
def test_points_and_mesh_are_cut_by_one_plane_and_stay_what_they_were(
    seed: int, ratio: float, direction: str, crop: str
):
    shape = solid(seed)
    left = occlude(shape, ratio, direction, crop)
    assert left.shape.has_mesh and left.shape.points.shape == shape.points.shape
    assert left.shape.point_colors.shape == shape.point_colors.shape
    axis, side = "xyz".index(direction[1]), 1 if direction[0] == "+" else -1
    if left.points_left > 0 and left.area_left > 0:
        assert (side * left.shape.points[:, axis]).max() <= (side * left.shape.vertices[:, axis]).max() + 1e-6
    assert 0 <= left.area_left <= 1 + 1e-6 and 0 <= left.points_left <= 1


@few
@given(st.integers(0, 50), st.floats(0.01, 0.98), st.sampled_from(DIRECTIONS))
def test_an_extent_is_a_share_of_the_box_along_the_axis(seed: int, ratio: float, direction: str):
    shape = solid(seed)
    axis = "xyz".index(direction[1])
    whole = shape.vertices[:, axis].astype(float)
    left = occlude(shape, ratio, direction, "extent").shape.vertices[:, axis].astype(float)
    assert np.ptp(left) == pytest.approx((1 - ratio) * np.ptp(whole), abs=1e-6)
    assert (left.min() == whole.min()) if direction[0] == "+" else (left.max() == whole.max())


def test_the_cube_is_the_one_of_the_released_code():
    shape = cloud(1)
    for ratio in (0.1, 0.5, 0.75):
        left = occlude(shape, ratio, "-y", "cube")
        assert left.points_left == (shape.points[:, 1] >= 2 * ratio - 1).mean()
    assert occlude(shape, 0.99, "-y", "cube").points_left == 0


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("crop", CROPS)
def test_no_occlusion_is_the_very_same_shape(direction: str, crop: str):
    for shape in (solid(1), cloud(1)):
        assert occlude(shape, 0.0, direction, crop).shape is shape


def test_a_shape_that_vanishes_is_still_drawn_as_what_it_was():
    left = occlude(solid(1), 0.99, "-x", "cube")
    assert left.points_left == 0 and left.area_left == 0
    assert left.shape.has_mesh and surface_area(left.shape) == 0 and not left.shape.points.any()
    assert not occlude(cloud(1), 0.99, "-x", "cube").shape.has_mesh


@few
@given(st.floats(0, 0.9999), st.integers(1, 3000))
def test_one_point_at_least_stays(ratio: float, count: int):
    assert 0 <= removed_count(ratio, count) < count
    assert abs(removed_count(ratio, count) - ratio * count) <= 1
