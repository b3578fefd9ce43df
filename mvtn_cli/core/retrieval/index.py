"""Approximate search with FAISS, an extra of the package, and how much of the exact answer it finds."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mvtn_cli.core.retrieval.distances import Gallery, Metric, as_descriptors
from mvtn_cli.errors import DataError

Float64 = NDArray[np.float64]
LINKS, DEPTH = 32, 128  # of the graph: neighbours of a node, and candidates while building and searching
JUDGED = 256  # queries by which the recall is measured


@dataclass(frozen=True)
class Nearest:
    """Answers of a search.

    Attributes:
        indices: (Q, K) shapes, the nearest first.
        distances: (Q, K) Euclidean, or 1 - cosine.
        about: `name`, `seconds`, and for an approximate search `recall` (share of the exact answer that it finds) and
            `judged` (queries by which that was measured).
    """

    indices: NDArray[np.int64]
    distances: Float64
    about: dict[str, Any]


def require(name: str) -> None:
    """Say before any work that an index can't be used.

    Raises:
        DataError: FAISS is wanted and not installed.
    """
    if name == "faiss":
        _faiss()


def search(descriptors: ArrayLike, queries: ArrayLike, count: int, metric: Metric, name: str = "exact") -> Nearest:
    """Find the nearest shapes of each query, exactly or with FAISS.

    Args:
        descriptors: (N, D), what is searched.
        queries: (Q, D).
        count: Hits; at most N.
        metric: How descriptors are compared.
        name: "exact" or "faiss", a graph of near neighbours (HNSW).

    Raises:
        DataError: FAISS is not installed, or a descriptor is not finite.
    """
    begun = time.perf_counter()
    gallery = Gallery.of(descriptors, metric)
    if name == "exact":
        indices, distances = gallery.nearest(queries, count)
        return Nearest(indices, distances, {"name": name, "seconds": time.perf_counter() - begun})
    rows = as_descriptors(queries, metric, "descriptors of the queries")
    indices, distances = _faiss_nearest(gallery.distinct[gallery.place], rows, min(count, len(gallery)))
    seconds = time.perf_counter() - begun
    judged = np.unique(np.linspace(0, len(rows) - 1, JUDGED).astype(int))
    true, _ = gallery.nearest(rows[judged], indices.shape[1])
    about = {"name": name, "seconds": seconds, "recall": recall(indices[judged], true), "judged": len(judged)}
    return Nearest(indices, distances if metric == "euclidean" else distances**2 / 2, about)


def recall(found: NDArray[np.int64], true: NDArray[np.int64]) -> float:
    """Share of the true hits (Q, K) that are among the found ones (Q, K)."""
    return float(np.mean([np.isin(right, mine).mean() for mine, right in zip(found, true, strict=True)]))


def _faiss_nearest(rows: Float64, queries: Float64, count: int) -> tuple[NDArray[np.int64], Float64]:
    faiss = _faiss()
    graph = faiss.IndexHNSWFlat(rows.shape[1], LINKS)
    graph.hnsw.efConstruction = graph.hnsw.efSearch = max(DEPTH, count)
    graph.add(np.ascontiguousarray(rows, dtype=np.float32))
    squares, indices = graph.search(np.ascontiguousarray(queries, dtype=np.float32), count)
    squares = np.where(indices < 0, np.inf, squares)  # a graph may reach fewer than wanted
    return indices.astype(np.int64), np.sqrt(np.maximum(squares.astype(np.float64), 0.0))


def _faiss() -> Any:
    try:
        import faiss
    except ImportError:
        raise DataError(
            "FAISS is not installed",
            hint="pip install mvtn[faiss], or use --index exact",
            code="retrieval.faiss",
        ) from None
    return faiss
