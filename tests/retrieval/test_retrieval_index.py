"""The approximate search, and its recall."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from mvtn_cli.core.retrieval.index import recall, search
from mvtn_cli.errors import DataError


def test_recall_is_the_share_of_true_hits():
    assert recall(np.array([[3, 1, 2], [0, 1, 9]]), np.array([[1, 2, 3], [5, 6, 9]])) == pytest.approx((1 + 1 / 3) / 2)


def test_without_faiss_the_extra_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "faiss", None)
    with pytest.raises(DataError, match="FAISS is not installed") as refused:
        search(np.eye(3), np.eye(3), 2, "euclidean", "faiss")
    assert "pip install mvtn[faiss]" in refused.value.hint


@pytest.mark.parametrize("metric", ["euclidean", "cosine"])
def test_faiss_finds_nearly_all_and_says_how_many(metric):
    pytest.importorskip("faiss", reason="the extra faiss is not installed")
    random = np.random.default_rng(0)
    rows, queries = random.normal(size=(2000, 16)), random.normal(size=(40, 16))
    exact, near = search(rows, queries, 10, metric), search(rows, queries, 10, metric, "faiss")
    assert exact.about["name"] == "exact" and "recall" not in exact.about
    assert near.about["judged"] == 40
    assert near.about["recall"] == pytest.approx(recall(near.indices, exact.indices)) and near.about["recall"] > 0.9
    same = near.indices == exact.indices
    assert near.distances[same] == pytest.approx(exact.distances[same], rel=1e-4, abs=1e-6)
