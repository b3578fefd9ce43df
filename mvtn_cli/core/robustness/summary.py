"""From single evaluations to means, deviations and differences to clean shapes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.robustness.cells import Cell
from mvtn_cli.core.training.compare import paired_interval


def summarise_cells(cells: Sequence[Cell], labels: Sequence[int]) -> dict[str, Any]:
    """Summarise the evaluations of one run.

    Args:
        cells: The clean one first; those of one kind and strength make one entry.
        labels: (N,) true classes, in the order of the cells' answers.

    Returns:
        `clean`: count, correct, accuracy and class_accuracy; `corruptions`, one entry a kind and strength:
        `kind`, `strength`, `crop`, `evaluations`, `mean`, `sd` (n - 1, None for one), `low` and `high` of the
        accuracies, mean `class_accuracy`, `by` (accuracy of each direction or repeat), `points_left`, `area_left`,
        and `difference`: mean change to clean, with its 95 % interval over shapes (`low`, `high`), and the shares of
        shapes that got `lost` and `found`.
    """
    clean = cells[0]
    groups: dict[tuple[str, float], list[Cell]] = {}
    for cell in cells[1:]:
        groups.setdefault((cell["kind"], cell["strength"]), []).append(cell)
    truth = np.asarray(labels)
    return {
        "clean": {name: clean[name] for name in ("count", "correct", "accuracy", "class_accuracy")},
        "corruptions": [_entry(group, _hits([clean], truth)[0], truth) for group in groups.values()],
    }


def _entry(cells: Sequence[Cell], clean: NDArray[np.float64], labels: NDArray[np.int64]) -> dict[str, Any]:
    accuracies = np.array([cell["correct"] / cell["count"] for cell in cells])
    first = cells[0]
    return {
        "kind": first["kind"],
        "strength": first["strength"],
        "crop": first["crop"] or None,
        "evaluations": len(cells),
        "mean": float(accuracies.mean()),
        "sd": float(accuracies.std(ddof=1)) if len(cells) > 1 else None,
        "low": float(accuracies.min()),
        "high": float(accuracies.max()),
        "class_accuracy": float(np.mean([cell["class_accuracy"] for cell in cells])),
        "by": {cell["variant"]: float(value) for cell, value in zip(cells, accuracies, strict=True)},
        "points_left": _mean([cell["points_left"] for cell in cells]),
        "area_left": _mean([cell["area_left"] for cell in cells]),
        "difference": _difference(clean, _hits(cells, labels)),
    }


def _hits(cells: Sequence[Cell], labels: NDArray[np.int64]) -> NDArray[np.float64]:
    """(K, N): 1 where an evaluation has a shape right."""
    return np.array([np.asarray(cell["predicted"]) == labels for cell in cells], np.float64)


def _difference(clean: NDArray[np.float64], hits: NDArray[np.float64]) -> dict[str, Any]:
    """Each shape is its own control: its hits over all evaluations, less its clean hit."""
    mean, low, high = paired_interval(clean.tolist(), hits.mean(axis=0).tolist())
    return {
        "mean": mean,
        "low": low,
        "high": high,
        "lost": float((clean * (1 - hits)).mean()),
        "found": float(((1 - clean) * hits).mean()),
    }


def _mean(shares: Sequence[float | None]) -> float | None:
    known = [share for share in shares if share is not None and np.isfinite(share)]
    return float(np.mean(known)) if known else None
