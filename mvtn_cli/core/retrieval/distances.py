"""Exact distances from queries to a gallery, a block of queries at a time."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from mvtn_cli.errors import DataError

Metric = Literal["euclidean", "cosine"]
Float64 = NDArray[np.float64]
BLOCK_BYTES = 16 << 20  # of the distances that one thread has in memory


def as_descriptors(values: ArrayLike, metric: Metric, what: str = "descriptors") -> Float64:
    """Return descriptors (N, D) as float64, for "cosine" with length 1; -0 becomes 0.

    Raises:
        DataError: A value is NaN or infinite, or a descriptor without direction is to be compared by its direction.
    """
    rows = np.array(values, dtype=np.float64, ndmin=2) + 0.0
    if not np.isfinite(rows).all():
        bad = int((~np.isfinite(rows).all(axis=1)).sum())
        raise DataError(
            f"{bad} of {len(rows)} {what} are not finite",
            hint="the weights may be damaged or the training may have diverged",
            code="retrieval.not-finite",
        )
    if metric == "euclidean":
        return rows
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    if not lengths.all():
        raise DataError(
            f"{int((lengths == 0).sum())} of {len(rows)} {what} are zero and have no direction",
            hint="use --metric euclidean",
            code="retrieval.zero",
        )
    return rows / lengths


@dataclass(frozen=True)
class Gallery:
    """What is searched, each distinct descriptor once: so that equal ones have equal distances, bit for bit.

    Attributes:
        distinct: (U, D) float64.
        place: (N,) row of `distinct` of each shape.
        metric: How descriptors are compared.
    """

    distinct: Float64
    place: NDArray[np.int64]
    metric: Metric

    @classmethod
    def of(cls, descriptors: ArrayLike, metric: Metric = "euclidean") -> Gallery:
        """Prepare N descriptors (N, D); raises as `as_descriptors`."""
        rows = np.ascontiguousarray(as_descriptors(descriptors, metric, "descriptors of the gallery"))
        whole_rows = rows.view(np.dtype((np.void, rows.dtype.itemsize * rows.shape[1]))).ravel()
        _, first, place = np.unique(whole_rows, return_index=True, return_inverse=True)
        return cls(rows[first], place.reshape(-1).astype(np.int64), metric)

    def __len__(self) -> int:
        return len(self.place)

    def each_block(self, rows: Float64, work: Callable[[slice, Float64], None]) -> None:
        """Work out the keys of queries to the distinct descriptors, a block at a time, and hand them on.

        A key is the squared Euclidean distance less |query|²: the order is the same. All arithmetic is float64. Blocks
        are independent: each thread takes the next one, so that none waits for another before the end.

        Args:
            rows: (Q, D), of `as_descriptors`.
            work: Gets which queries, and their keys (B, U), which are its own; several calls run at once.
        """
        size = max(1, min(len(rows), BLOCK_BYTES // (8 * len(self.distinct))))
        squares = np.einsum("ij,ij->i", self.distinct, self.distinct)
        turned = self.distinct.T

        def one(begin: int) -> None:
            block = slice(begin, min(begin + size, len(rows)))
            keys = np.matmul(-2.0 * rows[block], turned)
            keys += squares
            work(block, keys)

        with threadpool_limits(1, "blas"), ThreadPoolExecutor(numba.get_num_threads()) as pool:
            list(pool.map(one, range(0, len(rows), size)))

    def nearest(self, queries: ArrayLike, count: int) -> tuple[NDArray[np.int64], Float64]:
        """Find the nearest shapes of each query.

        Args:
            queries: (Q, D).
            count: How many; at most all there are. Shapes at equal distance come in the gallery's order.

        Returns:
            Indices (Q, count) and distances (Q, count): Euclidean, or 1 - cosine.
        """
        rows = as_descriptors(queries, self.metric, "descriptors of the queries")
        count = min(count, len(self))
        found = np.empty((len(rows), count), np.int64)
        away = np.empty((len(rows), count))

        def work(block: slice, keys: Float64) -> None:
            for row, key in zip(range(block.start, block.stop), keys, strict=True):
                found[row] = _first(key[self.place], count)
                apart = self.distinct[self.place[found[row]]] - rows[row]
                away[row] = np.einsum("ij,ij->i", apart, apart)

        self.each_block(rows, work)
        return found, np.sqrt(away) if self.metric == "euclidean" else away / 2


def _first(keys: Float64, count: int) -> NDArray[np.int64]:
    """Indices of the smallest keys in ascending order, equal ones by index."""
    if count < len(keys):
        border = np.partition(keys, count - 1)[count - 1]
        candidates = np.flatnonzero(keys <= border)
    else:
        candidates = np.arange(len(keys))
    return candidates[np.argsort(keys[candidates], kind="stable")][:count]
