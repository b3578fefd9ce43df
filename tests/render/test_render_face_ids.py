"""Which face is seen at each sample: against the slow rasteriser, and against what must always hold."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import scenes
from reference.drawing import cameras, matrices
from reference.look_at import focal_length, orbit
from reference.rasteriser import rasterise, to_camera
from scipy.spatial import Delaunay

from mvtn_cli.core.render import render
from mvtn_cli.core.views import Cameras

STIFF = scenes.stiff()
VIEWS = [(0.0, 0.0, 2.2), (90.0, 0.0, 2.2), (33.0, 21.0, 1.0), (200.0, -75.0, 0.3)]


def geometry(shape, views, size):
    return render(scenes.batch_of(shape), views, scenes.look(size), gradient="none", outputs=("geometry",))


def assert_like_the_twin(shape, view, size):
    drawn, rt = geometry(shape, cameras(view), size), matrices(cameras(view))[0, 0]
    twin = rasterise(shape.vertices, shape.faces, rt, scenes.focal(size), size)
    np.testing.assert_array_equal(drawn.face_ids[0, 0], twin.ids)
    hit = twin.ids >= 0
    np.testing.assert_allclose(drawn.depth[0, 0][hit], 1 / twin.inverse_depth[hit], rtol=1e-6)
    assert (drawn.depth[0, 0][~hit] == 0).all()
    return hit


@pytest.mark.parametrize("seed", range(6))
def test_soups_of_triangles_are_seen_like_the_twin_sees_them(seed):
    assert assert_like_the_twin(scenes.soup(30, seed), (61.0 * seed, 25.0 * seed - 60, 2.2), 24).any()


@pytest.mark.parametrize("name", STIFF)
@pytest.mark.parametrize("view", VIEWS, ids=str)
def test_stiff_shapes_are_seen_like_the_twin_sees_them(name, view):
    """T5 to T8, T11, T14."""
    assert_like_the_twin(STIFF[name], view, 25)


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    faces=st.integers(1, 20),
    edge=st.sampled_from([1e-3, 0.1, 0.8, 3.0]),
    azimuth=st.floats(-720, 720, width=32),
    elevation=st.floats(-180, 180, width=32),
    distance=st.floats(0.0625, 4, width=32),
    size=st.integers(1, 20),
)
def test_any_soup_is_seen_like_the_twin_sees_it(seed, faces, edge, azimuth, elevation, distance, size):
    assert_like_the_twin(scenes.soup(faces, seed, edge=edge), (azimuth, elevation, distance), size)


@pytest.mark.parametrize(("azimuth", "elevation", "distance"), [(10, 5, 2.2), (-130, -60, 1.5), (250, 85, 3)])
def test_cameras_stand_where_a_generic_look_at_puts_them(azimuth, elevation, distance):
    """T3, through the renderer."""
    shape, size = scenes.soup(30, 11), 24
    drawn = geometry(shape, cameras((azimuth, elevation, distance)), size).face_ids[0, 0]
    twin = rasterise(shape.vertices, shape.faces, orbit(azimuth, elevation, distance), scenes.focal(size), size)
    np.testing.assert_array_equal(drawn, twin.ids)


@pytest.mark.parametrize("fov", [5.0, 30.0, 120.0, 170.0])
def test_the_field_of_view_is_the_cameras(fov):
    shape, size, view = scenes.soup(30, 12), 24, (10, 5, 2.2)
    views = Cameras.at([10.0], [5.0], 2.2, fov_deg=fov)
    drawn = geometry(shape, views, size).face_ids[0, 0]
    twin = rasterise(shape.vertices, shape.faces, orbit(*view), focal_length(size, fov), size)
    np.testing.assert_array_equal(drawn, twin.ids)


def alone(shape, view, size):
    """Return (F, H, W): the samples that each face covers when it is drawn alone."""
    faces = [scenes.stored(shape.vertices, face, normals=shape.normals) for face in shape.faces]
    views = cameras(view, count=len(faces))
    drawn = render(
        scenes.batch_of(*faces), views, scenes.look(size, len(faces)), gradient="none", outputs=("geometry",)
    )
    return drawn.face_ids[:, 0] >= 0


@pytest.mark.parametrize("seed", range(3))
def test_triangles_with_edges_through_sample_centres_cover_each_sample_of_their_square_once(seed):
    """T9. Corners lie on sample centres; the square's right and lower sides belong to nobody."""
    size, low, high, distance = 20, 2, 17, 2.0
    inner = np.random.default_rng(seed).integers(low, high + 1, (40, 2))
    corners = np.unique([*inner.tolist(), [low, low], [low, high], [high, low], [high, high]], axis=0)
    triangles = Delaunay(corners).simplices
    triangles[::2] = triangles[::2, ::-1]
    across = (corners + 0.5 - size / 2) * distance / scenes.focal(size)
    flat = scenes.stored(np.column_stack([across[:, 0], -across[:, 1], np.zeros(len(corners))]), triangles)
    expected = np.zeros((size, size), int)
    expected[low:high, low:high] = 1
    np.testing.assert_array_equal(alone(flat, (0, 0, distance), size).sum(axis=0), expected)


@pytest.mark.parametrize("view", [(0.0, 0.0, 2.2), (45.0, 0.0, 2.2), (17.0, 40.0, 1.8), (90.0, 90.0, 2.2)], ids=str)
@pytest.mark.parametrize("make", [scenes.icosahedron, scenes.box, lambda: scenes.bumpy(5)])
def test_a_closed_surface_has_as_many_fronts_as_backs_over_each_sample(make, view):
    """T9 in perspective: a sample that two neighbours both take, or both leave, breaks the balance."""
    shape = make()
    covered = alone(shape, view, 25)
    camera = to_camera(shape.vertices, matrices(cameras(view))[0, 0])
    fronts = np.linalg.det(camera[shape.faces]) < 0
    np.testing.assert_array_equal(covered[fronts].sum(axis=0), covered[~fronts].sum(axis=0))
    assert covered.any()


def test_of_two_equal_faces_the_first_is_seen():
    """T8, whatever the winding of the second, and wherever the two begin."""
    first = scenes.soup(12, 5)
    for second in (
        first,
        scenes.flipped(first),
        scenes.stored(first.vertices, np.roll(first.faces, 1, axis=1)),
    ):
        for view in VIEWS:
            assert geometry(scenes.joined(first, second), cameras(view), 24).face_ids.max() < 12


def test_of_coplanar_faces_the_first_is_seen_wherever_it_is():
    """T8: no speckle, in either order."""
    shape = STIFF["coplanar"]
    swapped = scenes.stored(shape.vertices, shape.faces[::-1])
    for view in VIEWS[:2]:
        for which in (shape, swapped):
            own, both = alone(which, view, 48)[0], geometry(which, cameras(view), 48).face_ids[0, 0]
            np.testing.assert_array_equal(both == 0, own)
            assert (both == 1).any()


def test_twenty_thousand_faces_smaller_than_a_sample_are_seen_like_the_twin_sees_them():
    """T10."""
    shape = scenes.soup(20_000, 3, edge=0.02)
    assert assert_like_the_twin(shape, (20.0, 30.0, 2.2), 12).any()


@pytest.mark.parametrize("size", [1, 2, 3, 7])
def test_images_of_a_few_pixels_are_seen_like_the_twin_sees_them(size):
    """T11."""
    assert assert_like_the_twin(scenes.box(), (20.0, 30.0, 1.5), size).any()


def test_a_face_seen_edge_on_covers_nothing():
    """T11."""
    assert (geometry(STIFF["one face edge-on"], cameras((0, 0, 2.2)), 25).face_ids == -1).all()


@pytest.mark.parametrize("scale", [1e-12, 1e-6, 1e6, 1e12])
@pytest.mark.parametrize("shift", [0.0, 1e6])
def test_units_and_place_do_not_matter_once_a_shape_is_normalised(scale, shift):
    """T12: moved by a million radii and scaled, then brought back in float64."""
    shape = scenes.bumpy(6)
    moved = (shape.vertices.astype(np.float64) + shift) * scale
    middle = (moved.max(axis=0) + moved.min(axis=0)) / 2
    shapes = []
    for vertices in (moved, shape.vertices.astype(np.float64)):
        centred = vertices - (middle if vertices is moved else (vertices.max(axis=0) + vertices.min(axis=0)) / 2)
        shapes.append(scenes.stored(centred / np.linalg.norm(centred, axis=1).max(), shape.faces))
    there, here = (geometry(s, cameras((31, 17, 2.2)), 48) for s in shapes)
    assert (there.face_ids == here.face_ids).mean() > 0.999  # a corner may round to another 1/256 of a sample
    difference = (there.rgb - here.rgb).abs()
    assert difference.max() < 2e-2 and difference.mean() < 1e-5


def test_a_vertex_that_is_not_a_number_takes_only_its_own_faces_away():
    """T15, T17."""
    whole, broken = scenes.bumpy(5), scenes.bumpy(5)
    broken.vertices[7] = np.nan
    view = cameras((20, 10, 2.2), (200, -30, 2.2))
    left = scenes.stored(whole.vertices, whole.faces[~(whole.faces == 7).any(axis=1)], normals=whole.normals)
    numbers = np.flatnonzero(~(whole.faces == 7).any(axis=1))
    expected = geometry(left, view, 24).face_ids
    np.testing.assert_array_equal(geometry(broken, view, 24).face_ids, np.where(expected < 0, -1, numbers[expected]))
