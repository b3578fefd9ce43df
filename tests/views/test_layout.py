"""View layouts for every number of views."""

from __future__ import annotations

import numpy as np
import pytest

from mvtn_cli.core.views import LAYOUTS, angle_between, layouts
from mvtn_cli.errors import UsageError


def closest_pair(azimuth: np.ndarray, elevation: np.ndarray) -> float:
    between = angle_between(azimuth[:, None], elevation[:, None], azimuth, elevation)
    return float(between[np.triu_indices(len(azimuth), 1)].min())


def densest(num_views: int) -> float:
    """Closest distance of a hexagonal packing of the whole sphere, degrees: no layout is better for M > 2."""
    return float(np.rad2deg(np.sqrt(8 * np.pi / (np.sqrt(3) * num_views))))


@pytest.mark.parametrize("name", ["circular", "spherical", "random"])
def test_every_number_of_views_gives_so_many_different_views(name):
    for num_views in range(1, 101):
        azimuth, elevation = layouts(name, num_views)
        assert azimuth.shape == elevation.shape == (num_views,)
        assert azimuth.dtype == np.float64 and np.abs(elevation).max() <= 90
        assert num_views == 1 or closest_pair(azimuth, elevation) > (0.01 if name == "random" else 3.0)


def test_spherical_views_are_spread_out_for_every_number():
    for num_views in range(2, 101):
        assert closest_pair(*layouts("spherical", num_views)) > 0.67 * densest(num_views), num_views


def test_spherical_layout_is_balanced_above_and_below():
    """A grid that is cut to M loses its upper ring; here no two mirror rings differ by more than one view."""
    for num_views in range(2, 101):
        _, elevation = layouts("spherical", num_views)
        rings, sizes = np.unique(elevation.round(6), return_counts=True)
        assert (np.diff(elevation) >= 0).all()
        assert np.abs(sizes - sizes[::-1]).max() <= 1
        np.testing.assert_allclose(rings, -rings[::-1])


@pytest.mark.parametrize(
    ("num_views", "rings"),
    [
        (4, {-45: 2, 45: 2}),
        (6, {-45: 3, 45: 3}),
        (8, {-60: 2, 0: 4, 60: 2}),
        (12, {-60: 3, 0: 6, 60: 3}),
        (16, {-67.5: 2, -22.5: 6, 22.5: 6, 67.5: 2}),
        (20, {-67.5: 3, -22.5: 7, 22.5: 7, 67.5: 3}),
    ],
)
def test_spherical_is_the_papers_grid_where_that_has_exactly_m_points(num_views, rings):
    azimuth, elevation = layouts("spherical", num_views)
    expected = [(360 * k / size, height) for height, size in rings.items() for k in range(size)]
    np.testing.assert_allclose(np.stack([azimuth, elevation], 1), expected)


def test_circle_starts_at_the_given_azimuth_and_a_single_view_stands_there():
    azimuth, elevation = layouts("circular", 4, elevation_deg=15, azimuth_deg=10)
    assert azimuth.tolist() == [10, 100, 190, 280] and set(elevation) == {15}
    for name in ("circular", "spherical"):
        azimuth, elevation = layouts(name, 1, elevation_deg=5, azimuth_deg=20)
        assert (azimuth.tolist(), elevation.tolist()) == ([20], [5])


@pytest.mark.parametrize(("name", "count", "closest"), [("dodecahedral", 20, 41.8103), ("icosahedral", 12, 63.4349)])
def test_solids_are_regular(name, count, closest):
    azimuth, elevation = layouts(name, count)
    between = angle_between(azimuth[:, None], elevation[:, None], azimuth, elevation)
    neighbours = (np.abs(between - closest) < 1e-3).sum(axis=1)
    assert closest_pair(azimuth, elevation) == pytest.approx(closest, abs=1e-3)
    assert set(neighbours) == {3 if count == 20 else 5}
    with pytest.raises(UsageError, match=f"{name} layout has {count} views, got 6"):
        layouts(name, 6)


def test_random_views_are_uniform_on_the_sphere_and_repeat_with_their_seed():
    heights = np.concatenate([np.sin(np.deg2rad(layouts("random", 100, seed=s)[1])) for s in range(40)])
    azimuths = np.concatenate([layouts("random", 100, seed=s)[0] for s in range(40)])
    for values, low, high in ((heights, -1, 1), (azimuths, -180, 180)):
        share, _ = np.histogram(values, bins=8, range=(low, high))
        assert np.abs(share / len(values) - 1 / 8).max() < 4 * np.sqrt(7 / 64 / len(values))
    assert np.array_equal(layouts("random", 5, seed=3), layouts("random", 5, seed=3))
    assert not np.array_equal(layouts("random", 5, seed=3), layouts("random", 5, seed=4))


def test_wrong_names_and_numbers_are_told_with_the_right_ones():
    with pytest.raises(UsageError, match="did you mean 'spherical'"):
        layouts("sperical", 6)
    for num_views in (0, 101):
        with pytest.raises(UsageError, match=rf"1\.\.100, got {num_views}"):
            layouts(LAYOUTS[0], num_views)
