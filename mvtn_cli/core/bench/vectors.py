"""How far one gradient is from another."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike


def cosine(candidate: ArrayLike, truth: ArrayLike) -> float:
    """Cosine of the angle between two vectors of any shape, taken as flat.

    A candidate of length zero has no direction and counts as 0; against a true gradient of zero, or with a number that
    is not finite, there is no answer: NaN.
    """
    a, b = (np.asarray(v, np.float64).ravel() for v in (candidate, truth))
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        return math.nan
    scale_a, scale_b = (float(np.abs(v).max(initial=0.0)) for v in (a, b))
    if scale_b == 0.0:
        return math.nan
    if scale_a == 0.0:
        return 0.0
    a, b = a / scale_a, b / scale_b  # squares of tiny gradients would be zero
    return float(a @ b / math.sqrt((a @ a) * (b @ b)))


def mean_cosine(candidate: ArrayLike, truth: ArrayLike) -> float:
    """Mean over rows of the cosine, rows without true gradient left out.

    Args:
        candidate: (M, K), one gradient a view.
        truth: (M, K).
    """
    pairs = zip(np.asarray(candidate), np.asarray(truth), strict=True)
    return mean_of(cosine(a, b) for a, b in pairs if np.any(b))


def relative_l2(candidate: ArrayLike, truth: ArrayLike) -> float:
    """Length of the difference over the length of the truth; NaN where the truth is zero."""
    a, b = (np.asarray(v, np.float64).ravel() for v in (candidate, truth))
    length = float(np.linalg.norm(b))
    return float(np.linalg.norm(a - b)) / length if length > 0 else math.nan


def rmse(candidate: ArrayLike, truth: ArrayLike) -> float:
    """Root of the mean squared difference."""
    a, b = (np.asarray(v, np.float64) for v in (candidate, truth))
    return math.sqrt(float(np.square(a - b).mean()))


def mean_of(values: Iterable[float]) -> float:
    """Mean; NaN of nothing, and NaN where any is: a failure must not vanish in an average."""
    listed = list(values)
    return float(np.mean(listed)) if listed else math.nan
