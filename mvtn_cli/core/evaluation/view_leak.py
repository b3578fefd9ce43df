"""How much of the class stands in the cameras: what they differ by, and what a classifier reads from them alone."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mvtn_cli.core.evaluation.classification import wilson_interval
from mvtn_cli.core.views import view_spread

TREES = 300
BLUR_DEG = 1.0  # about the width of a pixel: in a spread of 0.01° a forest finds a class that no picture shows
ALIKE_DEG = 0.1  # cameras with a smaller spread between shapes are the same ones

Array = NDArray[np.float64]


def angle_features(azimuth_deg: ArrayLike, elevation_deg: ArrayLike) -> Array:
    """Sine and cosine of the angles (N, M): (N, 4M), so that -180° and 180° are one place."""
    angles = np.deg2rad(np.concatenate([np.asarray(azimuth_deg), np.asarray(elevation_deg)], axis=1), dtype=np.float64)
    return np.concatenate([np.sin(angles), np.cos(angles)], axis=1)


def class_leak(
    train: tuple[ArrayLike, ArrayLike, ArrayLike],
    test: tuple[ArrayLike, ArrayLike, ArrayLike],
    num_classes: int,
    *,
    seed: int = 0,
    trees: int = TREES,
    blur_deg: float = BLUR_DEG,
) -> dict[str, Any]:
    """Classify shapes by the angles of their cameras, without any picture.

    Args:
        train: Azimuth (N, M), elevation (N, M) and labels (N,) to learn from.
        test: The same, of other shapes, to be judged on.
        num_classes: C.
        seed: Of the forest and the blur.
        trees: Of the forest.
        blur_deg: Standard deviation of the noise that is put on all angles, so that differences too small to be
            seen in a picture don't count.

    Returns:
        `train_count`, `test_count`, `blur_deg`; `chance` (1 / C) and `majority` (always saying the class that is most
        frequent in training), which know nothing; `logistic` (regression on `angle_features`, which finds what
        lies apart in a straight line) and `forest` (random, which finds islands), each with `accuracy`,
        `accuracy_interval` (95 %) and `class_accuracy`.
    """
    from sklearn.ensemble import RandomForestClassifier  # a second to import
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    random = np.random.default_rng(seed)
    features, labels = angle_features(*_blurred(train[:2], blur_deg, random)), np.asarray(train[2])
    asked, truth = angle_features(*_blurred(test[:2], blur_deg, random)), np.asarray(test[2])
    majority = int(np.bincount(labels, minlength=num_classes).argmax())
    found: dict[str, Any] = {
        "train_count": len(labels),
        "test_count": len(truth),
        "blur_deg": blur_deg,
        "chance": 1.0 / num_classes,
        "majority": float((truth == majority).mean()),
    }
    readers = {
        "logistic": make_pipeline(StandardScaler(), LogisticRegression(max_iter=2000)),
        "forest": RandomForestClassifier(n_estimators=trees, random_state=seed, n_jobs=-1),
    }
    for name, reader in readers.items():
        if len(np.unique(labels)) < 2:  # there is nothing to tell apart
            said = np.full(len(truth), majority)
        else:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ConvergenceWarning)
                said = reader.fit(features, labels).predict(asked)
        found[name] = _judged(said == truth, truth)
    return found


def _blurred(angles: tuple[ArrayLike, ArrayLike], blur_deg: float, random: np.random.Generator) -> tuple[Array, Array]:
    azimuth, elevation = (np.asarray(angle) + random.normal(0.0, blur_deg, np.shape(angle)) for angle in angles)
    return azimuth, elevation


def _judged(right: NDArray[np.bool_], truth: NDArray[np.int64]) -> dict[str, Any]:
    return {
        "accuracy": float(right.mean()),
        "accuracy_interval": list(wilson_interval(int(right.sum()), len(right))),
        "class_accuracy": float(np.mean([right[truth == label].mean() for label in np.unique(truth)])),
    }


def class_spread(azimuth_deg: ArrayLike, elevation_deg: ArrayLike, labels: ArrayLike) -> dict[str, float]:
    """Split the spread of the cameras between shapes into what the class explains and what it doesn't.

    It is the analysis of variance of the directions as unit vectors, summed over the views: the squared
    distances to the mean direction of all shapes are those to the mean of the own class, and those between these
    means.

    Args:
        azimuth_deg: (N, M).
        elevation_deg: (N, M).
        labels: (N,).

    Returns:
        `total_deg`, `within_deg`: `view_spread` over all shapes, and over those of one class (mean over shapes
        and views). `explained`: the share in [0, 1] of the variance that is between classes: 1 says that each
        class has one set of cameras, NaN that all shapes have the same. `by_chance`: what labels dealt out at
        random would explain on average, (classes - 1) / (N - 1).
    """
    azimuth, elevation = np.asarray(azimuth_deg, np.float64), np.asarray(elevation_deg, np.float64)
    label = np.asarray(labels)
    a, e = np.deg2rad(azimuth), np.deg2rad(elevation)
    directions = np.stack([np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)], axis=-1)
    groups = [label == c for c in np.unique(label)]
    total = _scatter(directions)
    spread = float(view_spread(azimuth, elevation, axis=0).mean())
    within = [view_spread(azimuth[g], elevation[g], axis=0).mean() * g.sum() for g in groups]
    alike = spread < ALIKE_DEG
    return {
        "total_deg": spread,
        "within_deg": float(sum(within) / len(label)),
        "explained": float("nan") if alike else float(1 - sum(_scatter(directions[g]) for g in groups) / total),
        "by_chance": float("nan") if len(label) < 2 else (len(groups) - 1) / (len(label) - 1),
    }


def _scatter(directions: Array) -> float:
    """Sum of squared distances (N, M, 3) to the mean over the shapes."""
    return float(((directions - directions.mean(axis=0)) ** 2).sum())
