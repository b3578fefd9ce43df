"""The turns that map a layout onto itself: a group, of proper rotations, of the known order."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from mvtn_cli.core.views import LAYOUTS, layout_symmetries, layouts
from mvtn_cli.core.views.symmetry import symmetries, turns_about_y, view_directions


def everyone() -> list[tuple[str, int]]:
    """All kinds of layouts, of several sizes."""
    sizes = {"dodecahedral": [20], "icosahedral": [12], "circular": [1, 2, 3, 7, 12, 40]}
    return [(name, m) for name in LAYOUTS for m in sizes.get(name, [1, 2, 3, 4, 6, 8, 11, 12, 16, 20, 33])]


@pytest.mark.parametrize(("layout", "num_views"), everyone())
def test_each_turn_is_a_rotation_that_takes_every_view_where_it_says(layout, num_views):
    azimuth, elevation = layouts(layout, num_views)
    found, views = layout_symmetries(layout, azimuth, elevation), view_directions(azimuth, elevation)
    assert found.permutations[0].tolist() == list(range(num_views))
    np.testing.assert_allclose(found.rotations @ found.rotations.mT, np.broadcast_to(np.eye(3), found.rotations.shape),
                               atol=1e-12)  # fmt: skip
    np.testing.assert_allclose(np.linalg.det(found.rotations), 1.0)
    for rotation, permutation in zip(*found, strict=True):
        np.testing.assert_allclose(views @ rotation.T, views[permutation], atol=1e-9)


@pytest.mark.parametrize(("layout", "num_views"), everyone())
def test_turns_are_a_group_without_repetitions(layout, num_views):
    found = {tuple(p) for p in layout_symmetries(layout, *layouts(layout, num_views)).permutations.tolist()}
    assert all(tuple(one[k] for k in other) in found for one, other in itertools.product(found, found))
    assert all(tuple(np.argsort(one).tolist()) in found for one in found)


@pytest.mark.parametrize("num_views", [1, 2, 3, 4, 12, 20, 57, 100])
@pytest.mark.parametrize("elevation", [30.0, 0.0, -90.0])
def test_circle_has_its_m_turns_about_the_axis_also_on_the_equator_and_at_a_pole(num_views, elevation):
    found = layout_symmetries("circular", *layouts("circular", num_views, elevation, 17.0))
    shifts = (np.arange(num_views)[:, None] + np.arange(num_views)) % num_views
    assert {tuple(p) for p in found.permutations.tolist()} == {tuple(shift) for shift in shifts.tolist()}
    np.testing.assert_allclose(found.rotations[:, 1, 1], 1.0)


def test_solids_have_their_60_turns():
    for layout, num_views in (("dodecahedral", 20), ("icosahedral", 12)):
        found = layout_symmetries(layout, *layouts(layout, num_views))
        assert found.permutations.shape == (60, num_views)
        # by their angle: the identity, 24 about faces, 20 about corners, 15 about edges (of the dodecahedron)
        angles = np.degrees(np.arccos(np.clip((np.trace(found.rotations, axis1=1, axis2=2) - 1) / 2, -1, 1)))
        kinds, counts = np.unique(angles.round(), return_counts=True)
        assert dict(zip(kinds.tolist(), counts.tolist(), strict=True)) == {0: 1, 72: 12, 120: 20, 144: 12, 180: 15}


@pytest.mark.parametrize(
    ("num_views", "turns"),
    [(1, 1), (2, 2), (4, 8), (5, 1), (6, 6), (8, 12), (12, 6), (16, 4), (20, 2)],
)
def test_rings_have_the_turns_of_their_own(num_views, turns):
    """Worked out on paper: 3 + 6 + 3 views turn by 120° and flip over three axes; 2 + 4 + 2 are a hexagon and two."""
    assert len(layout_symmetries("spherical", *layouts("spherical", num_views)).permutations) == turns


def test_directions_in_a_plane_a_line_and_on_a_cube():
    square = [[1, 0, 0], [0, 0, 1], [-1, 0, 0], [0, 0, -1]]
    assert len(symmetries(square).permutations) == 8
    assert len(symmetries([[1, 0, 0], [-1, 0, 0]]).permutations) == 2
    assert len(symmetries([[0, 1, 0]]).permutations) == 1
    cube = np.array(list(itertools.product((-1, 1), repeat=3))) / 3**0.5
    assert len(symmetries(cube).permutations) == 24


def test_mirror_image_is_no_turn():
    """A set that a mirror maps onto itself, but no rotation does."""
    tripod = np.array([[1.0, 0, 0], [0, 0, 1], [0.2, 0.9, 0.2], [0, 1, 0]])
    tripod /= np.linalg.norm(tripod, axis=1, keepdims=True)
    assert symmetries(tripod).permutations.tolist() == [[0, 1, 2, 3]]


def test_random_or_coinciding_views_have_the_identity_alone():
    assert len(symmetries(view_directions(*layouts("random", 30))).permutations) == 1
    assert symmetries([[1, 0, 0], [1, 0, 0], [0, 1, 0]]).permutations.tolist() == [[0, 1, 2]]
    assert turns_about_y([0.0, 0.0, 90.0], [0.0, 0.0, 0.0]).permutations.tolist() == [[0, 1, 2]]


def test_angles_of_single_precision_and_a_moved_camera_are_told_apart():
    azimuth, elevation = layouts("circular", 12)
    assert len(layout_symmetries("circular", azimuth.astype(np.float32), elevation).permutations) == 12
    azimuth[3] += 0.5
    assert len(layout_symmetries("circular", azimuth, elevation).permutations) == 1
