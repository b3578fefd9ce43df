from __future__ import annotations

import numpy as np
import pytest

from mvtn_cli.core.evaluation.views import nearest_view_deg, standard_angles, view_statistics
from mvtn_cli.core.views import angle_between, layouts


def test_standard_angles_name_the_same_directions_within_the_usual_bounds():
    random = np.random.default_rng(0)
    azimuth, elevation = random.uniform(-900, 900, (2, 500))
    a, e = standard_angles(azimuth, elevation)
    assert np.abs(a).max() <= 180 and np.abs(e).max() <= 90
    assert (
        angle_between(azimuth, elevation, a, e).max() < 1e-5
    )  # near a pole the two readings differ by the rounding of cosines


def test_nearest_view_finds_the_neighbour_on_the_sphere():
    azimuth, elevation = layouts("icosahedral", 12)
    found = nearest_view_deg(azimuth[None], elevation[None])
    assert np.allclose(found, 63.4349, atol=1e-3)
    assert np.isnan(nearest_view_deg([[5.0]], [[5.0]])).all()


def test_fixed_views_have_no_spread_and_have_not_moved():
    azimuth, elevation = (np.tile(x, (5, 1)) for x in layouts("spherical", 6))
    found = view_statistics([0, 0, 1, 1, 1], azimuth + 360, elevation, ["a", "b", "c"], layouts("spherical", 6))
    assert found["spread_deg"] == pytest.approx(0, abs=1e-5)
    assert found["moved_deg"] == pytest.approx(0, abs=1e-5)
    assert found["coincident_share"] == 0
    assert [row["name"] for row in found["per_class"]] == ["a", "b"]
    assert all(view["azimuth_resultant"] == pytest.approx(1) for view in found["per_view"])


def test_views_that_fell_together_are_seen():
    azimuth = np.array([[0.0, 2.0, 180.0]] * 4)
    found = view_statistics([0] * 4, azimuth, np.zeros_like(azimuth), ["a"])
    assert found["coincident_share"] == pytest.approx(2 / 3)
    assert found["nearest_view_deg"] == pytest.approx((2 + 2 + 178) / 3)
    assert np.isnan(found["moved_deg"])


def test_the_mean_azimuth_of_a_class_does_not_break_at_the_seam():
    azimuth = np.array([[170.0], [-170.0], [350.0], [10.0]])
    found = view_statistics([0, 0, 1, 1], azimuth, np.full((4, 1), 12.0), ["back", "front"])
    back, front = (row["views"][0] for row in found["per_class"])
    assert abs(back["azimuth_deg"]) == pytest.approx(180) and front["azimuth_deg"] == pytest.approx(0, abs=1e-6)
    assert back["azimuth_resultant"] == pytest.approx(np.cos(np.radians(10)))
    assert back["elevation_deg"] == pytest.approx(12)
    assert np.isnan(found["nearest_view_deg"])
