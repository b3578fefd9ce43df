"""Measures of rankings against scikit-learn, and against sorting in float64, on rankings full of ties."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from sklearn.metrics import average_precision_score, ndcg_score, precision_recall_curve

from mvtn_cli.core.retrieval import distances
from mvtn_cli.core.retrieval.curves import RECALL, curves_of
from mvtn_cli.core.retrieval.distances import Gallery
from mvtn_cli.core.retrieval.metrics import score, summary
from mvtn_cli.errors import DataError


def scattered(seed: int, queries: int = 9, shapes: int = 60, grid: int | None = 3, classes: int = 4):
    """Descriptors on a coarse grid: many are equal, and many more equally far."""
    random = np.random.default_rng(seed)

    def draw(count: int) -> np.ndarray:
        return random.integers(0, grid, (count, 3)).astype(float) if grid else random.normal(size=(count, 3))

    labels = random.integers(0, classes, queries + shapes)
    return draw(queries), labels[:queries], draw(shapes), labels[queries:]


def far(queries: np.ndarray, gallery: np.ndarray) -> np.ndarray:
    return ((queries[:, None] - gallery[None]) ** 2).sum(axis=2)


def by_sorting(key: np.ndarray, relevant: np.ndarray, cuts: tuple[int, ...]) -> dict[str, float]:
    """The plain float64 twin: mean over random orders of what is equally far, ties of AP as one group."""
    order = np.argsort(key, kind="stable")
    key, relevant, total = key[order], relevant[order].astype(float), int(relevant.sum())
    position = np.arange(1, len(key) + 1)
    shared = relevant.copy()
    ap = 0.0
    for value in np.unique(key):
        group = key == value
        shared[group] = relevant[group].mean()
        last = np.flatnonzero(group)[-1] + 1
        ap += relevant[group].sum() * relevant[:last].sum() / last / total
    found = {
        "ap": ap,
        "ap_printed": (shared / position).sum() / total,
        "ndcg": (shared / np.log2(position + 1)).sum() / (1 / np.log2(position[:total] + 1)).sum(),
    }
    for cut in cuts:
        precision, recall = shared[:cut].sum() / min(cut, len(key)), shared[:cut].sum() / total
        both = precision + recall
        found |= {f"p@{cut}": precision, f"r@{cut}": recall, f"f1@{cut}": 2 * precision * recall / both if both else 0}
    return found


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("grid", [2, 5, None])
def test_interpolated_precision_is_the_highest_at_this_recall_or_a_greater_one(seed: int, grid: int | None):
    queries, labels, gallery, theirs = scattered(seed, grid=grid)
    curves = score(queries, labels, Gallery.of(gallery), theirs).curves
    for curve, away, label in zip(curves, far(queries, gallery), labels, strict=True):
        precision, recall, _ = precision_recall_curve(theirs == label, -away)
        precision, recall = precision[:-1], recall[:-1]  # the last point is made up: precision 1 at recall 0
        expected = [precision[recall >= level - 1e-9].max() for level in RECALL]
        assert np.allclose(curve, expected, rtol=0, atol=1e-12)


def test_curves_are_averaged_over_queries_and_over_classes():
    values = np.array([[1.0] * 21, [0.5] * 21, [0.0] * 21, [np.nan] * 21])
    found = curves_of(values, np.array(["chair", "chair", "mug", "none"]))
    assert found["recall"] == RECALL.tolist() and found["recall"][1] == 0.05
    assert found["micro"] == [0.5] * 21 and found["macro"] == [0.375] * 21
    assert found["classes"] == {"chair": [0.75] * 21, "mug": [0.0] * 21}
    nothing = curves_of(values[3:], np.array(["none"]))
    assert np.isnan(nothing["micro"]).all() and nothing["classes"] == {}


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("grid", [2, 5, None])
def test_every_measure_equals_its_plain_twin_and_scikit_learn(seed: int, grid: int | None):
    queries, labels, gallery, theirs = scattered(seed, grid=grid)
    cuts = (1, 7, 60, 1000)
    found = score(queries, labels, Gallery.of(gallery), theirs, cuts)
    keys = far(queries, gallery)
    for q, label in enumerate(labels):
        relevant = theirs == label
        for name, value in by_sorting(keys[q], relevant, cuts).items():
            assert found.values[name][q] == pytest.approx(value, abs=1e-12), name
        assert found.values["ap"][q] == pytest.approx(average_precision_score(relevant, -keys[q]), abs=1e-12)
        assert found.values["ndcg"][q] == pytest.approx(ndcg_score([relevant], [-keys[q]]), abs=1e-12)


@given(seed=some.integers(0, 10**6), grid=some.sampled_from([1, 2, 4]), block=some.sampled_from([1, 700, 1 << 20]))
@settings(max_examples=40, deadline=None)
def test_neither_the_order_of_the_files_nor_the_blocks_matter(seed: int, grid: int, block: int):
    queries, labels, gallery, theirs = scattered(seed, grid=grid)
    before = score(queries, labels, Gallery.of(gallery), theirs)
    order = np.random.default_rng(seed + 1).permutation(len(gallery))
    kept = distances.BLOCK_BYTES
    distances.BLOCK_BYTES = block
    try:
        after = score(queries[::-1], labels[::-1], Gallery.of(gallery[order]), theirs[order])
    finally:
        distances.BLOCK_BYTES = kept
    for name, values in before.values.items():
        assert np.allclose(values[::-1], after.values[name], atol=1e-13, equal_nan=True), name


def test_threads_change_no_bit(monkeypatch: pytest.MonkeyPatch):
    queries, labels, gallery, theirs = scattered(2, queries=50, shapes=300, grid=None)
    found = []
    for threads in (1, 4):
        monkeypatch.setattr(distances, "BLOCK_BYTES", 8 * 300 * 7)
        monkeypatch.setattr(distances.numba, "get_num_threads", lambda threads=threads: threads)
        measured = score(queries, labels, Gallery.of(gallery), theirs)
        found.append((measured.values, Gallery.of(gallery).nearest(queries, 9)))
    (one, near), (four, near_too) = found
    assert all(np.array_equal(one[name], four[name]) for name in one)
    assert all(np.array_equal(a, b) for a, b in zip(near, near_too, strict=True))


def test_duplicates_are_equally_far_whatever_numbers_they_are_made_of():
    random = np.random.default_rng(0)
    base = random.normal(size=(40, 33))
    gallery, theirs = np.concatenate([base, base, base]), np.repeat([0, 1, 0], 40)
    queries = random.normal(size=(6, 33))
    found = score(queries, np.zeros(6, int), Gallery.of(gallery), theirs, (3,)).values
    assert found["ap"] == pytest.approx(2 / 3, abs=1e-12) and found["p@3"] == pytest.approx(2 / 3, abs=1e-12)


@given(seed=some.integers(0, 10**6), shapes=some.integers(1, 80))
@settings(max_examples=40, deadline=None)
def test_measures_lie_between_0_and_1_and_are_1_for_perfect_rankings_alone(seed: int, shapes: int):
    queries, labels, gallery, theirs = scattered(seed, shapes=shapes)
    for values in score(queries, labels, Gallery.of(gallery), theirs).values.values():
        kept = values[~np.isnan(values)]
        assert ((kept >= 0) & (kept <= 1 + 1e-12)).all()
    perfect = score(np.eye(4)[labels], labels, Gallery.of(np.eye(4)[theirs]), theirs).values
    assert np.nanmin(perfect["ap"], initial=1) == np.nanmin(perfect["ndcg"], initial=1) == 1
    there = np.isin(labels, theirs)
    assert (np.isnan(perfect["ap"]) == ~there).all()


def test_the_printed_formula_is_far_below_1_for_a_perfect_ranking():
    """10 relevant shapes at the first 10 positions: 0.293, by hand."""
    theirs = np.repeat([0, 1], 10)
    found = score([[0.0]], [0], Gallery.of(theirs[:, None] * 5.0 + np.arange(20)[:, None] / 100), theirs, (5,))
    assert found.values["ap_printed"][0] == pytest.approx((1 / np.arange(1, 11)).sum() / 10)
    assert found.values["ap"][0] == 1 and found.values["p@5"][0] == 1 and found.values["r@5"][0] == 0.5


def test_cosine_compares_directions():
    random = np.random.default_rng(3)
    gallery, queries = random.normal(size=(30, 5)), random.normal(size=(4, 5))
    scaled = gallery * random.uniform(0.1, 9, (30, 1))
    near, away = Gallery.of(scaled, "cosine").nearest(queries, 30)
    norms = np.linalg.norm(queries, axis=1)[:, None] * np.linalg.norm(gallery, axis=1)
    cosine = 1 - queries @ gallery.T / norms
    assert np.array_equal(near, np.argsort(cosine, axis=1))
    assert away == pytest.approx(np.sort(cosine, axis=1), abs=1e-12)
    with pytest.raises(DataError, match="1 of 2 descriptors of the gallery are zero"):
        Gallery.of([[0.0, 0.0], [1, 0]], "cosine")


def test_nearest_is_sorting_and_equal_ones_come_in_order():
    queries, _, gallery, _ = scattered(5, shapes=40)
    keys = far(queries, gallery)
    for count in (1, 7, 40, 100):
        near, away = Gallery.of(gallery).nearest(queries, count)
        assert np.array_equal(near, np.argsort(keys, axis=1, kind="stable")[:, :count])
        assert away == pytest.approx(np.sqrt(np.sort(keys, axis=1)[:, :count]))
    _, self_distance = Gallery.of(gallery * np.pi).nearest(gallery * np.pi, 1)
    assert (self_distance == 0).all()


def test_not_finite_descriptors_are_named():
    with pytest.raises(DataError, match="1 of 2 descriptors of the gallery are not finite"):
        Gallery.of([[0.0], [np.nan]])
    with pytest.raises(DataError, match="1 of 1 descriptors of the queries are not finite"):
        score([[np.inf]], [0], Gallery.of([[0.0]]), [0])


def test_micro_and_macro_and_classes_without_a_relevant_shape():
    queries, labels = [[0.0], [0.0], [0.0], [9.0]], [0, 0, 0, 1]
    found = summary(score([*queries, [4.0]], [*labels, 2], Gallery.of([[1.0], [2.0]]), [0, 1], (1,)), ["a", "b", "c"])
    assert found["queries"] == 4 and found["left_out"] == 1
    assert found["micro"]["ap"] == 1 and found["macro"]["ap"] == 1 and found["micro"]["p@1"] == 1
    worse = summary(score(queries, labels, Gallery.of([[1.0], [10.0]]), [1, 0], (1,)), ["a", "b"])
    assert worse["micro"]["ap"] == pytest.approx(0.5)
    half = summary(score([[0.0], [0.0], [0.0], [0.0]], labels, Gallery.of([[1.0], [2.0]]), [0, 1], (1,)), ["a", "b"])
    assert half["micro"]["ap"] == pytest.approx((3 * 1 + 0.5) / 4) and half["macro"]["ap"] == pytest.approx(0.75)
    assert [(row["name"], row["queries"], row["relevant"]) for row in half["per_class"]] == [("a", 3, 1), ("b", 1, 1)]
