"""Local Fisher discriminant analysis (Sugiyama, JMLR 8, 2007): a linear map that draws near shapes of a class together.

The scatter matrices are defined over all pairs of shapes. Only pairs within a class have weights of their own, so that
they are worked out class by class, and all others from the scatter around the mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigh

from mvtn_cli.errors import DataError

Float64 = NDArray[np.float64]
NEIGHBOUR = 7  # whose distance is the local scale, as in the paper
RIDGE = 1e-2  # of the mean within-class variance, added to each direction (measured: docs/retrieval.md)
RANK = 1e-10  # directions in which the shapes vary less than this share of the largest variance don't count
ROWS = 1024  # of a class's pairs that are in memory at once


@dataclass(frozen=True)
class LFDA:
    """A fitted map.

    Attributes:
        components: (D, d) float64; each column is of unit length in terms of the within-class scatter, times the
            square root of its eigenvalue (the weighted form, which the paper of MVTN uses).
        eigenvalues: (d,) float64, between-class over within-class scatter, falling.
    """

    components: Float64
    eigenvalues: Float64

    def transform(self, descriptors: ArrayLike) -> Float64:
        """Map descriptors (N, D) to (N, d), without centring."""
        return np.asarray(descriptors, dtype=np.float64) @ self.components


def fit_lfda(descriptors: ArrayLike, labels: ArrayLike, dim: int, neighbour: int = NEIGHBOUR) -> LFDA:
    """Find the directions that separate classes most while near shapes of a class stay near.

    Directions in which nothing varies are left out before, so that there may be more dimensions than shapes. Mapped
    descriptors are the same in any unit.

    Args:
        descriptors: (N, D).
        labels: (N,), any integers.
        dim: Directions wanted; fewer come back where the shapes vary in fewer.
        neighbour: Which neighbour within the class tells the local scale; a smaller class takes its farthest.

    Raises:
        DataError: There are fewer than two classes, all descriptors are equal, or one is not finite.
    """
    rows, classes = np.array(descriptors, dtype=np.float64, ndmin=2), np.asarray(labels)
    _check(rows, classes)
    rows = rows - rows.mean(axis=0)
    unit = np.abs(rows).max()
    if unit == 0:
        raise DataError(
            f"all {len(rows)} descriptors are equal, so that nothing tells the classes apart",
            hint="use other weights: these have learned nothing, or the training diverged",
            code="retrieval.equal",
        )
    span = _span(rows / unit)
    between, within = scatters(rows / unit @ span, classes, neighbour)
    scale = np.trace(within) or np.trace(between + within)
    within[np.diag_indices_from(within)] += RIDGE * scale / len(within)
    kept = min(dim, len(within))
    values, vectors = eigh(between, within, subset_by_index=[len(within) - kept, len(within) - 1])
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    components = span @ (vectors * np.sqrt(values)) / unit
    largest = np.take_along_axis(components, np.abs(components).argmax(axis=0)[None], axis=0)
    return LFDA(components * np.where(largest < 0, -1.0, 1.0), values)


def scatters(descriptors: ArrayLike, labels: ArrayLike, neighbour: int = NEIGHBOUR) -> tuple[Float64, Float64]:
    """Scatter matrices between classes and within them, (D, D) each.

    They are ½ Σ w_ij (x_i - x_j)(x_i - x_j)ᵀ over all pairs. With the affinity a_ij = exp(-|x_i - x_j|² / (σ_i σ_j)),
    where σ is the distance to the neighbour, n shapes and n_c in the class: within, w = a/n_c in a class and 0 else;
    between, w = a(1/n - 1/n_c) in a class and 1/n else. Where a scale is 0 (duplicates), a is 0.

    Args:
        descriptors: (N, D).
        labels: (N,).
        neighbour: As for `fit_lfda`.
    """
    rows, classes = np.asarray(descriptors, dtype=np.float64), np.asarray(labels)
    centred = rows - rows.mean(axis=0)
    within = np.zeros((rows.shape[1],) * 2)
    between = centred.T @ centred
    for label in np.unique(classes):
        mine = centred[classes == label]
        own = mine - mine.mean(axis=0)
        local = _local_scatter(own, neighbour)
        within += local / len(mine)
        between += local * (1 / len(rows) - 1 / len(mine)) - own.T @ own * (len(mine) / len(rows))
    return (between + between.T) / 2, (within + within.T) / 2


def _local_scatter(rows: Float64, neighbour: int) -> Float64:
    """½ Σ a_ij (x_i - x_j)(x_i - x_j)ᵀ over the pairs of one class."""
    blocks = [slice(begin, begin + ROWS) for begin in range(0, len(rows), ROWS)]
    last = min(neighbour, len(rows) - 1)
    squares = [np.partition(_squared_distances(rows[block], rows), last, axis=1)[:, last] for block in blocks]
    scale = np.sqrt(np.concatenate(squares))
    total = np.zeros((rows.shape[1],) * 2)
    for block in blocks:
        scales = scale[block, None] * scale
        apart = _squared_distances(rows[block], rows)
        affinity = np.exp(-np.divide(apart, scales, where=scales > 0, out=np.full_like(apart, np.inf)))
        total += (rows[block] * affinity.sum(axis=1, keepdims=True)).T @ rows[block]
        total -= rows[block].T @ (affinity @ rows)
    return total


def _squared_distances(some: Float64, others: Float64) -> Float64:
    """(A, B), by products of matrices. Of duplicates they may be a rounding error, which weighs a difference of 0."""
    lengths, theirs = np.einsum("ij,ij->i", some, some), np.einsum("ij,ij->i", others, others)
    return np.maximum(lengths[:, None] + theirs - 2.0 * some @ others.T, 0.0)


def _span(centred: Float64) -> Float64:
    """Orthonormal columns (D, r) of the directions in which the shapes vary."""
    variances, directions = eigh(centred.T @ centred)
    return directions[:, variances > RANK * variances[-1]]


def _check(rows: Float64, classes: NDArray[np.int64]) -> None:
    if len(rows) != len(classes):
        raise ValueError(f"{len(rows)} descriptors with {len(classes)} labels")
    if not np.isfinite(rows).all():
        raise DataError(
            "some descriptors of the training shapes are not finite",
            hint="the weights may be damaged or the training may have diverged",
            code="retrieval.not-finite",
        )
    if len(np.unique(classes)) < 2:
        raise DataError(
            "LFDA separates classes, and there are fewer than two",
            hint="use --no-lfda",
            code="retrieval.classes",
        )
