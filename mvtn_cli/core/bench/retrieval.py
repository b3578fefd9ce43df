"""`mvtn bench retrieval`: how long exact measures of retrieval take, and how much memory."""

from __future__ import annotations

import sys
import time

import numpy as np

from mvtn_cli.console import Console
from mvtn_cli.core.bench.outcome import Outcome, Row
from mvtn_cli.core.retrieval.distances import Gallery
from mvtn_cli.core.retrieval.metrics import score

CLASSES = 55  # as many as ShapeNet Core55 has


def measure_retrieval(console: Console, *, queries: int, gallery: int, dim: int, seed: int = 0) -> Outcome:
    """Rank random descriptors exactly and take all measures of the protocol "paper".

    The classes are of unequal size, as ShapeNet's are: shares are drawn from a Dirichlet distribution. The compilation,
    once a machine, is not counted. Memory is the greatest resident size of the whole process.

    Args:
        console: For notes.
        queries: Q.
        gallery: N.
        dim: D.
        seed: Of descriptors and classes.
    """
    random = np.random.default_rng(seed)
    shares = random.dirichlet(np.full(CLASSES, 0.5))
    labels, theirs = random.choice(CLASSES, queries, p=shares), random.choice(CLASSES, gallery, p=shares)
    rows = random.standard_normal((queries, dim), dtype=np.float32)
    searched = random.standard_normal((gallery, dim), dtype=np.float32)
    console.note(f"{queries} queries, {gallery} shapes, {dim} dimensions")
    score(rows[:2], labels[:2], Gallery.of(searched[:9]), theirs[:9])  # compiles
    before = peak_mib()
    begun = time.perf_counter()
    found = score(rows, labels, Gallery.of(searched), theirs)
    seconds = time.perf_counter() - begun
    row: Row = {
        "what": "exact",
        "queries": queries,
        "gallery": gallery,
        "dim": dim,
        "classes": CLASSES,
        "seconds": seconds,
        "peak_mib": peak_mib(),
        "peak_mib_before": before,
        "map": float(np.nanmean(found.values["ap"])) if (found.relevant > 0).any() else None,
    }
    return Outcome([row], {"exact_seconds": seconds, "peak_mib": row["peak_mib"]})


def peak_mib() -> float | None:
    """The greatest resident size of this process so far, MiB; None where the system does not tell."""
    try:
        import resource
    except ImportError:
        return None
    size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return size / 2**20 if sys.platform == "darwin" else size / 2**10
