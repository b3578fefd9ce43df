"""How good rankings are: average precision, NDCG, precision and recall, by query, class and overall."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mvtn_cli.core.retrieval.distances import Gallery, as_descriptors
from mvtn_cli.core.retrieval.ranks import LEVELS, rank_block

Float64 = NDArray[np.float64]
CUTS = (1, 10, 100)


@dataclass(frozen=True)
class Scores:
    """Measures of Q queries.

    Attributes:
        labels: (Q,) class of each query.
        relevant: (Q,) how many shapes of the gallery have its class.
        values: By name, (Q,) each: `ap`, `ap_printed`, `ndcg`, and `p@N`, `r@N`, `f1@N` for each cut N; NaN where
            nothing is relevant.
        curves: (Q, 21) interpolated precision, the highest at this recall or a greater one, at recall 0, 0.05, …, 1;
            NaN where nothing is relevant.
    """

    labels: NDArray[np.int64]
    relevant: NDArray[np.int64]
    values: Mapping[str, Float64]
    curves: Float64


def score(
    queries: ArrayLike,
    query_labels: ArrayLike,
    gallery: Gallery,
    gallery_labels: ArrayLike,
    cuts: Sequence[int] = CUTS,
) -> Scores:
    """Rank the whole gallery for each query by float64 distances, and measure the rankings.

    A shape is relevant if it has the query's class. The order in which shapes are listed has no influence: shapes at
    equal distance share their positions (see `rank_block`).

    Args:
        queries: (Q, D).
        query_labels: (Q,) classes from 0.
        gallery: N descriptors; no query is taken out of it.
        gallery_labels: (N,) classes from 0.
        cuts: Lengths of lists for precision, recall and F1; one longer than the gallery means all of it.
    """
    labels, theirs = _labels(query_labels), _labels(gallery_labels)
    rows = np.array(queries, dtype=np.float64, ndmin=2)
    if (len(rows), len(gallery)) != (len(labels), len(theirs)):
        raise ValueError(f"{len(rows)} queries with {len(labels)} labels, {len(gallery)} shapes with {len(theirs)}")
    classes = int(max(labels.max(initial=-1), theirs.max(initial=-1))) + 1
    counts = np.bincount(theirs, minlength=classes)
    lengths = np.minimum(np.array(cuts, np.int64), len(theirs))
    found = _rank(rows, labels, gallery, theirs, counts, lengths)
    relevant = counts[labels]
    values = {"ap": found[:, 0], "ap_printed": found[:, 1], "ndcg": found[:, 2]}
    for number, (cut, length) in enumerate(zip(cuts, lengths, strict=True)):
        hits = found[:, 3 + number]
        precision, recall = hits / length, np.divide(hits, relevant, out=hits * np.nan, where=relevant > 0)
        values |= {f"p@{cut}": precision, f"r@{cut}": recall, f"f1@{cut}": f1(precision, recall)}
    return Scores(labels, relevant, values, found[:, -LEVELS:])


def _labels(given: ArrayLike) -> NDArray[np.int64]:
    labels = np.asarray(given, dtype=np.int64).reshape(-1)
    if (labels < 0).any():
        raise ValueError("labels must not be negative")
    return labels


def _rank(
    rows: Float64,
    labels: NDArray[np.int64],
    gallery: Gallery,
    theirs: NDArray[np.int64],
    counts: NDArray[np.int64],
    lengths: NDArray[np.int64],
) -> Float64:
    members = np.argsort(theirs, kind="stable")
    offsets = np.concatenate([[0], np.cumsum(counts)])
    many = np.bincount(gallery.place, minlength=len(gallery.distinct))
    position = np.arange(1, len(theirs) + 1)
    sums = np.zeros((2, len(theirs) + 1))
    sums[:, 1:] = np.cumsum([1 / position, 1 / np.log2(position + 1)], axis=1)
    found = np.empty((len(rows), 3 + len(lengths) + LEVELS))

    def work(block: slice, keys: Float64) -> None:
        rank_block(keys, many, gallery.place, members, offsets, labels[block], sums, lengths, found[block])

    gallery.each_block(as_descriptors(rows, gallery.metric, "descriptors of the queries"), work)
    return found


def f1(precision: Float64, recall: Float64) -> Float64:
    """Harmonic mean of precision and recall, 0 where both are."""
    both = np.asarray(precision + recall)
    return np.divide(2 * precision * recall, both, out=np.where(np.isnan(both), np.nan, 0.0), where=both > 0)


def summary(scores: Scores, classes: Sequence[str]) -> dict[str, Any]:
    """Average measures: `micro` over queries, `macro` over the means of classes, and `per_class`.

    Queries for which nothing is relevant have no part in it; `left_out` counts them.
    """
    counted = scores.relevant > 0
    rows = []
    for label in np.unique(scores.labels):
        mine = counted & (scores.labels == label)
        row = {"name": classes[label], "queries": int(mine.sum())}
        row["relevant"] = int(scores.relevant[scores.labels == label][0])
        rows.append(row | _means(scores.values, mine))
    answered = [row for row in rows if row["queries"]]
    return {
        "queries": int(counted.sum()),
        "left_out": int((~counted).sum()),
        "micro": _means(scores.values, counted),
        "macro": {name: _mean([row[name] for row in answered]) for name in scores.values},
        "per_class": rows,
    }


def _means(values: Mapping[str, Float64], chosen: NDArray[np.bool_]) -> dict[str, float]:
    return {name: _mean(value[chosen]) for name, value in values.items()}


def _mean(values: ArrayLike) -> float:
    array = np.asarray(values, dtype=np.float64)
    return float(array.mean()) if array.size else float("nan")
