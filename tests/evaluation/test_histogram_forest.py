from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mvtn_cli.core.evaluation.baseline import d2_histogram, histogram_forest
from mvtn_cli.errors import DataError


def sphere(count: int, random: np.random.Generator) -> np.ndarray:
    points = random.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def stick(count: int, random: np.random.Generator) -> np.ndarray:
    return np.c_[random.uniform(-1, 1, count), np.zeros(count), np.zeros(count)]


def prepared(builders: dict[str, list]) -> SimpleNamespace:
    """A stand-in with what the baseline reads: records, split, load."""
    random = np.random.default_rng(0)
    made = [(s, label, build(512, random)) for s, shapes in builders.items() for label, build in shapes]
    return SimpleNamespace(
        spec="toy",
        records=[SimpleNamespace(label=label, split=split) for split, label, _ in made],
        split=lambda name: [i for i, (split, _, _) in enumerate(made) if split == name],
        load=lambda i: SimpleNamespace(points=made[i][2]),
    )


def test_distances_between_points_of_a_sphere_follow_their_law():
    # For the unit sphere P(distance < x) = x² / 4.
    found = d2_histogram(sphere(4000, np.random.default_rng(0)), pairs=200_000)
    edges = np.linspace(0, 2, 65)
    assert found.sum() == pytest.approx(1)
    assert np.abs(found - np.diff(edges**2 / 4)).max() < 0.003


def test_the_histogram_does_not_depend_on_how_the_shape_is_turned():
    points = stick(300, np.random.default_rng(1))
    turned = points @ np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    assert np.abs(d2_histogram(points) - d2_histogram(turned)).max() < 1e-3


def test_the_forest_tells_sticks_from_spheres_and_answers_alike_each_time():
    shapes = [(0, sphere), (1, stick)]
    data = prepared({"train": shapes * 6, "test": shapes * 3})
    found = histogram_forest(data, trees=10)
    assert found["accuracy"] == 1.0 and found["accuracy_sd"] == 0.0
    assert (found["train_count"], found["test_count"]) == (12, 6)
    again = histogram_forest(data, trees=10)
    assert {**found, "seconds": 0} == {**again, "seconds": 0}


def test_the_forest_can_only_guess_where_the_labels_mean_nothing():
    data = prepared({"train": [(0, stick), (1, stick)] * 10, "test": [(0, stick), (1, stick)] * 20})
    assert histogram_forest(data, trees=20)["accuracy"] < 0.8


def test_an_empty_split_is_said():
    with pytest.raises(DataError, match=r"split 'train'.*toy has none"):
        histogram_forest(prepared({"test": [(0, stick)]}))
