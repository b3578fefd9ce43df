"""LFDA against its definition over all pairs, and what it must bear."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from scipy.linalg import eigh

from mvtn_cli.core.retrieval import lfda
from mvtn_cli.core.retrieval.lfda import fit_lfda, scatters
from mvtn_cli.errors import DataError


def by_definition(rows: np.ndarray, labels: np.ndarray, neighbour: int) -> tuple[np.ndarray, np.ndarray]:
    """Both scatter matrices, pair by pair."""
    count, dim = rows.shape
    sizes = {label: int((labels == label).sum()) for label in labels}
    scale = np.zeros(count)
    for i in range(count):
        mine = np.sort(np.linalg.norm(rows[labels == labels[i]] - rows[i], axis=1))
        scale[i] = mine[min(neighbour, len(mine) - 1)]
    between, within = np.zeros((dim, dim)), np.zeros((dim, dim))
    for i in range(count):
        for j in range(count):
            apart = rows[i] - rows[j]
            pair = 0.5 * np.outer(apart, apart)
            if labels[i] != labels[j]:
                between += pair / count
                continue
            product = scale[i] * scale[j]
            affinity = np.exp(-(apart @ apart) / product) if product > 0 else 0.0
            within += affinity / sizes[labels[i]] * pair
            between += affinity * (1 / count - 1 / sizes[labels[i]]) * pair
    return between, within


def clouds(seed: int, dim: int = 5, sizes: tuple[int, ...] = (14, 9, 3, 1)) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    labels = np.repeat(np.arange(len(sizes)), sizes)
    return random.normal(size=(len(labels), dim)) + random.normal(size=(len(sizes), dim))[labels] * 2, labels


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("neighbour", [1, 7])
def test_the_short_form_equals_the_definition_over_all_pairs(seed: int, neighbour: int, monkeypatch):
    monkeypatch.setattr(lfda, "ROWS", 4)
    rows, labels = clouds(seed)
    rows = np.concatenate([rows, rows[:3], rows[:1].repeat(9, axis=0)])  # duplicates, so many that a scale is 0
    labels = np.concatenate([labels, labels[:3], labels[:1].repeat(9)])
    found, true = scatters(rows + 100, labels, neighbour), by_definition(rows + 100, labels, neighbour)
    size = max(np.abs(matrix).max() for matrix in true)
    for mine, theirs in zip(found, true, strict=True):
        assert np.abs(mine - theirs).max() <= 1e-10 * size


@pytest.mark.parametrize("seed", range(3))
def test_the_directions_solve_the_generalised_eigenproblem(seed: int):
    rows, labels = clouds(seed)
    model = fit_lfda(rows, labels, 3)
    between, within = by_definition(rows, labels, 7)
    within += lfda.RIDGE * np.trace(within) / 5 * np.eye(5)
    values = eigh(between, within, eigvals_only=True)[::-1][:3]
    assert model.eigenvalues == pytest.approx(values, rel=1e-9)
    assert model.components.shape == (5, 3)
    scaled = model.components / np.sqrt(model.eigenvalues)
    assert scaled.T @ within @ scaled == pytest.approx(np.eye(3), abs=1e-9)


@given(seed=some.integers(0, 10**6), power=some.floats(-30, 30), shift=some.floats(-10, 10))
@settings(max_examples=30, deadline=None)
def test_neither_unit_nor_origin_nor_order_change_distances(seed: int, power: float, shift: float):
    rows, labels = clouds(seed, sizes=(8, 7, 5))
    order = np.random.default_rng(seed).permutation(len(rows))
    plain = fit_lfda(rows, labels, 2).transform(rows)
    other = fit_lfda((rows[order] + shift) * 10.0**power, labels[order], 2).transform(rows * 10.0**power)

    def apart(mapped: np.ndarray) -> np.ndarray:
        return np.linalg.norm(mapped[:, None] - mapped[None], axis=2)

    assert apart(other) == pytest.approx(apart(plain), rel=1e-5, abs=1e-6)


def test_more_dimensions_than_shapes_and_constant_ones():
    random = np.random.default_rng(0)
    rows, labels = random.normal(size=(12, 40)), np.repeat([0, 1, 2], 4)
    rows[:, 5:9] = 7.0
    model = fit_lfda(rows, labels, 128)
    assert model.components.shape[0] == 40 and model.components.shape[1] <= 11
    assert np.abs(model.components[5:9]).max() < 1e-6 * np.abs(model.components).max()
    mapped = model.transform(rows)
    assert np.isfinite(mapped).all()
    centres = np.array([mapped[labels == c].mean(axis=0) for c in range(3)])
    nearest = np.linalg.norm(mapped[:, None] - centres, axis=2).argmin(axis=1)
    assert np.array_equal(nearest, labels)


def test_classes_of_one_shape_and_of_duplicates_alone():
    """No within-class scatter at all: the map still separates."""
    for rows, labels in (
        (np.eye(4), np.arange(4)),
        (np.eye(3).repeat(5, axis=0), np.arange(3).repeat(5)),
    ):
        mapped = fit_lfda(rows, labels, 3).transform(rows)
        assert np.isfinite(mapped).all()
        apart = np.linalg.norm(mapped[:, None] - mapped[None], axis=2)
        same = labels[:, None] == labels
        assert apart[same].max() < 1e-6 * apart[~same].min()


def test_it_finds_the_class_that_noise_in_many_directions_hides():
    """Nearest neighbours are right only after the map."""
    random = np.random.default_rng(1)
    labels = np.arange(400) % 2
    rows = random.normal(size=(400, 21)) * 4
    rows[:, 7] = labels + 0.1 * random.normal(size=400)
    mapped = fit_lfda(rows[:200], labels[:200], 1).transform(rows)
    nearest = np.abs(mapped[200:] - mapped[:200].T).argmin(axis=1)
    before = np.linalg.norm(rows[200:, None] - rows[:200], axis=2).argmin(axis=1)
    right, right_before = ((labels[near] == labels[200:]).mean() for near in (nearest, before))
    assert right > 0.95 > 0.7 > right_before


def test_what_cannot_be_separated_is_named():
    with pytest.raises(DataError, match="all 4 descriptors are equal"):
        fit_lfda(np.full((4, 3), 2.5), [0, 0, 1, 1], 2)
    with pytest.raises(DataError, match="fewer than two") as refused:
        fit_lfda(np.eye(3), [1, 1, 1], 2)
    assert refused.value.hint == "use --no-lfda"
    with pytest.raises(DataError, match="not finite"):
        fit_lfda([[np.nan], [1.0]], [0, 1], 1)
