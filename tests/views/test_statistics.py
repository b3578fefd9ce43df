"""Angles between views, and circular means."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mvtn_cli.core.views import angle_between, circular_mean, resultant_length, view_spread, wrap_degrees

angles = st.floats(-400, 400, allow_nan=False)


def direction(azimuth: float, elevation: float) -> np.ndarray:
    a, e = np.deg2rad(azimuth), np.deg2rad(elevation)
    return np.array([np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)])


@given(angles, angles, angles, angles)
def test_angle_is_that_of_the_directions(a1, e1, a2, e2):
    one, other = direction(a1, e1), direction(a2, e2)
    expected = np.rad2deg(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))
    assert angle_between(a1, e1, a2, e2) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("tiny", [1e-3, 1e-7, 1e-12])
def test_angles_keep_their_digits_near_0_and_180(tiny):
    """The arc cosine of a dot product gives 0 for everything below 1e-6 degrees."""
    assert angle_between(10, 0, 10 + tiny, 0) == pytest.approx(10 + tiny - 10, rel=1e-9)
    assert angle_between(0, 0, 0, tiny) == pytest.approx(tiny, rel=1e-9)
    assert 180 - angle_between(0, 20, 180, -20 + tiny) == pytest.approx(tiny, rel=1e-6, abs=3e-14)
    assert angle_between(5, 30, 365, 30) == pytest.approx(0, abs=1e-12)


@given(angles)
def test_wrapping_changes_no_direction_and_stays_in_range(angle):
    wrapped = wrap_degrees(angle)
    assert -180 <= wrapped < 180
    assert angle_between(angle, 0, wrapped, 0) == pytest.approx(0, abs=1e-6)


def test_wrapping_at_its_edges():
    assert wrap_degrees([180, -180, 540, 0, -1e-17]).tolist() == [-180, -180, -180, 0, 0]


@given(st.lists(st.floats(-40, 40), min_size=1, max_size=8), angles)
def test_circular_mean_turns_with_the_angles_and_sees_no_seam(offsets, turn):
    base = circular_mean(offsets)
    assert angle_between(circular_mean(np.array(offsets) + turn), 0, base + turn, 0) == pytest.approx(0, abs=1e-6)
    assert circular_mean([179, -179]) == pytest.approx(-180)


def test_resultant_length_is_one_for_equal_and_zero_for_opposite_angles():
    assert resultant_length([30, 390, -330]) == pytest.approx(1)
    assert resultant_length([0, 90, 180, 270]) == pytest.approx(0, abs=1e-15)
    assert resultant_length([[0, 180], [10, 10]], axis=1).tolist() == pytest.approx([0, 1])


def test_view_spread_is_zero_for_equal_views_and_largest_for_even_ones():
    assert view_spread([10, 370, -350], 20) == pytest.approx(0, abs=1e-6)
    assert view_spread([0, 180], [0, 0]) == pytest.approx(np.rad2deg(np.sqrt(2)))
    assert view_spread([-1e-5, 1e-5], [0, 0]) == pytest.approx(1e-5, rel=1e-6)
    assert view_spread([[0, 10], [180, 10]], [[0, 0], [0, 0]], axis=0).shape == (2,)
    assert view_spread(73.0, 90 + np.zeros(5)) == pytest.approx(0, abs=1e-6)
