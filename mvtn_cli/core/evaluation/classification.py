"""Accuracy in its usual senses, from labels and logits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def probabilities(logits: ArrayLike) -> NDArray[np.float64]:
    """Turn logits (N, C) into probabilities (N, C) without overflow; a row that is not finite stays NaN."""
    scores = np.asarray(logits, dtype=np.float64)
    if scores.size == 0:
        return scores
    with np.errstate(invalid="ignore"):
        weights = np.exp(scores - scores.max(axis=1, keepdims=True))
        return weights / weights.sum(axis=1, keepdims=True)


def confusion_matrix(labels: ArrayLike, predicted: ArrayLike, num_classes: int) -> NDArray[np.int64]:
    """Count pairs: entry (i, j) is the number of shapes of class i that were taken for class j."""
    cells = np.asarray(labels, dtype=np.int64) * num_classes + np.asarray(predicted, dtype=np.int64)
    return np.bincount(cells, minlength=num_classes * num_classes).reshape(num_classes, num_classes)


def metrics(labels: ArrayLike, logits: ArrayLike, classes: Sequence[str]) -> dict[str, Any]:
    """Judge a classifier.

    Args:
        labels: (N,) class indices; -1 stands for "not known" and is left out.
        logits: (N, C). A row with a value that is not finite counts as wrong, and in `not_finite`.
        classes: The C names, in the order of the columns.

    Returns:
        `count`, `correct`, `not_finite`; `accuracy` (share of all shapes) with its 95 % `accuracy_interval`,
        and `class_accuracy` (mean of the classes' own accuracies, over the classes that occur), in [0, 1] and
        NaN for no shapes;
        `per_class`, one entry a class: `name`, `count`, `correct`, `accuracy`, `confused_with`,
        `confused_count`; `confusion`, C rows of C counts; `top_confusions`, the ten most frequent
        mistakes as `label`, `predicted`, `count`. All of it plain Python numbers.
    """
    labels = np.asarray(labels, dtype=np.int64)
    logits = np.asarray(logits, dtype=np.float64).reshape(len(labels), len(classes))
    known = labels >= 0
    labels, logits = labels[known], logits[known]
    finite = np.isfinite(logits).all(axis=1)
    predicted = np.where(np.isnan(logits), -np.inf, logits).argmax(axis=1) if logits.size else labels
    # The confusion matrix has no column for "no answer": such shapes are in `count` alone.
    confusion = confusion_matrix(labels[finite], predicted[finite], len(classes))
    counts = np.bincount(labels, minlength=len(classes))
    correct = np.diagonal(confusion)
    with np.errstate(invalid="ignore"):
        recalls = np.where(counts > 0, correct / np.maximum(counts, 1), np.nan)
    total = int(counts.sum())
    return {
        "count": total,
        "correct": int(correct.sum()),
        "not_finite": int((~finite).sum()),
        "accuracy": int(correct.sum()) / total if total else float("nan"),
        "accuracy_interval": list(wilson_interval(int(correct.sum()), total)),
        "class_accuracy": float(recalls[counts > 0].mean()) if total else float("nan"),
        "per_class": [_class_row(i, name, counts, confusion, recalls, classes) for i, name in enumerate(classes)],
        "confusion": confusion.tolist(),
        "top_confusions": top_confusions(confusion, classes),
    }


def wilson_interval(correct: int, count: int, z: float = 1.959964) -> tuple[float, float]:
    """Give the interval that a share measured on `count` draws leaves open, 95 % by default.

    References:
        Wilson. Probable inference, the law of succession, and statistical inference. JASA, 1927.
    """
    if count == 0:
        return float("nan"), float("nan")
    share, square = correct / count, z * z / count
    middle = share + square / 2
    half = z * math.sqrt(share * (1 - share) / count + square / (4 * count))
    return max(0.0, (middle - half) / (1 + square)), min(1.0, (middle + half) / (1 + square))


def _class_row(
    index: int,
    name: str,
    counts: NDArray[np.int64],
    confusion: NDArray[np.int64],
    recalls: NDArray[np.float64],
    classes: Sequence[str],
) -> dict[str, Any]:
    wrong = confusion[index].copy()
    wrong[index] = 0
    worst = int(wrong.argmax())
    return {
        "name": name,
        "count": int(counts[index]),
        "correct": int(confusion[index, index]),
        "accuracy": float(recalls[index]),
        "confused_with": classes[worst] if wrong[worst] else None,
        "confused_count": int(wrong[worst]),
    }


def top_confusions(confusion: ArrayLike, classes: Sequence[str], limit: int = 10) -> list[dict[str, Any]]:
    """List the most frequent mistakes, worst first; equal counts keep the order of the classes."""
    wrong = np.array(confusion)
    np.fill_diagonal(wrong, 0)
    order = np.argsort(-wrong, axis=None, kind="stable")[:limit]
    pairs = [divmod(int(cell), len(classes)) for cell in order]
    return [{"label": classes[i], "predicted": classes[j], "count": int(wrong[i, j])} for i, j in pairs if wrong[i, j]]
