"""The floor: how far one gets without a picture, from the distances inside a shape alone."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mvtn_cli.errors import DataError

if TYPE_CHECKING:
    from mvtn_cli.core.preprocess import Prepared

BINS = 64
PAIRS = 20_000
TREES = 500


def d2_histogram(points: ArrayLike, *, pairs: int = PAIRS, bins: int = BINS, seed: int = 0) -> NDArray[np.float32]:
    """Histogram of the distances between random pairs of points (P, 3) in the unit ball: (bins,), sum 1.

    Distances run from 0 to 2. The descriptor doesn't change when the shape turns.

    References:
        Osada, Funkhouser, Chazelle, Dobkin. Shape Distributions. ACM Transactions on Graphics, 2002 ("D2").
    """
    points = np.asarray(points, dtype=np.float64)
    if len(points) < 2:
        raise ValueError(f"points must have at least two rows, got {len(points)}")
    random = np.random.default_rng(seed)
    first = random.integers(len(points), size=pairs)
    second = (first + random.integers(1, len(points), size=pairs)) % len(points)  # never the same point twice
    distances = np.linalg.norm(points[first] - points[second], axis=1)
    counts, _ = np.histogram(np.clip(distances, 0.0, 2.0), bins=bins, range=(0.0, 2.0))
    return (counts / pairs).astype(np.float32)


def forest_accuracy(
    train: tuple[ArrayLike, ArrayLike],
    test: tuple[ArrayLike, ArrayLike],
    seeds: Sequence[int] = (0, 1, 2),
    trees: int = TREES,
) -> list[float]:
    """Fit a random forest a seed on (features (N, F), labels (N,)) and score it on the other pair."""
    from sklearn.ensemble import RandomForestClassifier  # a second to import

    scores = []
    for seed in seeds:
        forest = RandomForestClassifier(n_estimators=trees, random_state=seed, n_jobs=-1)
        scores.append(float(forest.fit(*train).score(*test)))
    return scores


def histogram_forest(
    prepared: Prepared, seeds: Sequence[int] = (0, 1, 2), *, trees: int = TREES, split: str = "test"
) -> dict[str, Any]:
    """Classify `split` from D2 histograms of the stored points with a random forest fitted on `train`.

    Returns:
        `accuracy` (mean over the seeds), `accuracy_sd` (sample deviation; NaN for one seed), `accuracies`,
        `seeds`, `bins`, `pairs`, `trees`, `train_count`, `test_count`, `split`, `seconds`.

    Raises:
        DataError: If one of the two splits has no labelled shapes.
    """
    begun = time.monotonic()
    train, test = _features(prepared, "train"), _features(prepared, split)
    scores = forest_accuracy(train, test, seeds, trees)
    return {
        "accuracy": float(np.mean(scores)),
        "accuracy_sd": float(np.std(scores, ddof=1)) if len(scores) > 1 else float("nan"),
        "accuracies": scores,
        "seeds": list(seeds),
        "bins": BINS,
        "pairs": PAIRS,
        "trees": trees,
        "train_count": len(train[1]),
        "test_count": len(test[1]),
        "split": split,
        "seconds": time.monotonic() - begun,
    }


def _features(prepared: Prepared, split: str) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    chosen = [i for i in prepared.split(split) if prepared.records[i].label >= 0]
    if not chosen:
        raise DataError(
            f"the histogram baseline needs labelled shapes in split '{split}', and {prepared.spec} has none",
            hint="use a data set with a train and a test split",
            code="dataset.empty-split",
        )
    features = np.stack([d2_histogram(prepared.load(i).points) for i in chosen])
    return features, np.array([prepared.records[i].label for i in chosen], dtype=np.int64)
