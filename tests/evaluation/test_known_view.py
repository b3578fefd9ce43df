from __future__ import annotations

import numpy as np
import pytest

from mvtn_cli.core.evaluation.known_view import known_view_errors, signed_errors


def test_errors_go_the_short_way_round():
    found = signed_errors([[350.0], [-170.0], [725.0], [90.0]], [10.0, 170.0, 0.0, 100.0])
    assert np.allclose(found, [-20.0, 20.0, 5.0, -10.0])


def test_the_nearest_of_several_views_counts():
    assert np.allclose(signed_errors([[0.0, 120.0, 240.0]], [230.0]), [10.0])


def test_a_view_beyond_the_pole_stands_on_the_other_side():
    assert np.allclose(signed_errors([[0.0]], [180.0], [[100.0]]), [0.0])
    assert np.allclose(np.abs(signed_errors([[0.0]], [180.0], [[80.0]])), [180.0])


def test_views_that_know_nothing_get_the_figures_of_chance():
    random = np.random.default_rng(0)
    found = known_view_errors(random.uniform(-180, 180, (20_000, 1)), random.uniform(0, 360, 20_000))
    assert found["median_deg"] == pytest.approx(90, abs=2)
    assert found["within_30"] == pytest.approx(1 / 6, abs=0.01)
    assert found["over_90"] == pytest.approx(1 / 2, abs=0.015)


def test_shapes_without_a_known_side_are_left_out():
    found = known_view_errors([[10.0], [0.0], [-40.0]], [0.0, np.nan, 0.0])
    assert found == {"count": 2, "median_deg": 25.0, "mean_deg": 25.0, "within_30": 0.5, "over_90": 0.0}
    assert known_view_errors([[1.0]], [np.nan])["count"] == 0
    assert np.isnan(known_view_errors(np.zeros((0, 3)), [])["median_deg"])
