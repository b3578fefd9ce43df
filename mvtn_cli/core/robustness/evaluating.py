"""One evaluation after the other, in this process."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mvtn_cli.console import Console, Ticker
from mvtn_cli.core.evaluation.classification import metrics
from mvtn_cli.core.robustness.cells import Cell
from mvtn_cli.core.robustness.corruption import Corruption
from mvtn_cli.core.robustness.served import CorruptedShapes
from mvtn_cli.core.training.predict import load_model, predict
from mvtn_cli.core.training.run import Run
from mvtn_cli.robustness_config import RobustnessConfig

if TYPE_CHECKING:
    from mvtn_cli.core.networks.recogniser import Recogniser


def evaluate_here(
    run: Run,
    prepared: Any,
    indices: Sequence[int],
    missing: Mapping[str, Corruption],
    config: RobustnessConfig,
    _console: Console,
    ticker: Ticker,
) -> Generator[tuple[str, Cell], None, None]:
    """Evaluate a run under each of the missing corruptions; yields keys and what was found.

    Raises:
        DataError: The run has no such weights, or they don't fit.
    """
    model = load_model(run, config.checkpoint, config.device)
    for key, corruption in missing.items():
        ticker.note(words_of(corruption))
        yield key, evaluate(run, model, prepared, indices, corruption, config, ticker)


def words_of(corruption: Corruption) -> str:
    """Say a corruption, as `occlude 0.5 +x`."""
    strength = "" if corruption.kind in ("clean", "so3") else f" {corruption.strength:g}"
    variant = "" if corruption.kind in ("clean", "scale") else f" {corruption.variant}"
    return f"{corruption.kind}{strength}{variant}"


def evaluate(
    run: Run,
    model: Recogniser,
    shapes: Any,
    indices: Sequence[int],
    corruption: Corruption,
    config: RobustnessConfig,
    ticker: Ticker,
) -> Cell:
    """Let a run recognise shapes under one corruption; the answer lacks nothing but its key.

    Args:
        run: Gives settings and classes.
        model: Of the run.
        shapes: A Prepared, or a part of one.
        indices: Which of its records.
        corruption: What is done to them.
        config: Batch size, and seed of random views.
        ticker: Counts shapes.
    """
    begun = time.monotonic()
    batch_size = config.shapes_a_step(run.config.batch_size)
    served = CorruptedShapes(shapes, corruption, capacity=batch_size + 1)
    settings = run.config.model_copy(update={"seed": config.seed})  # of random views
    each_batch, rest = _counting(ticker, batch_size, len(indices))
    found = predict(model, served, indices, settings, batch_size=batch_size, each_batch=each_batch)
    rest()
    judged = metrics(found.labels, found.logits, run.classes)
    finite = np.isfinite(found.logits).all(axis=1)
    return {
        **corruption.as_dict(),
        "variant": corruption.variant,
        **{name: judged[name] for name in ("count", "correct", "not_finite", "accuracy", "class_accuracy")},
        "points_left": _mean(served.points_left),
        "area_left": _mean(served.area_left),
        "predicted": np.where(finite, found.logits.argmax(axis=1), -1).tolist(),
        "seconds": time.monotonic() - begun,
    }


def _counting(ticker: Ticker, batch_size: int, total: int) -> tuple[Callable[[], None], Callable[[], None]]:
    """Count shapes of an evaluation: one function for the begin of each batch, and one for its end."""
    batches = counted = 0

    def each_batch() -> None:
        nonlocal batches, counted
        step = min(batch_size, total - counted) if batches else 0
        batches, counted = batches + 1, counted + step
        ticker.advance(step)

    return each_batch, lambda: ticker.advance(total - counted)


def _mean(shares: dict[int, float]) -> float:
    """Mean over shapes that have the thing at all; NaN for none."""
    known = np.array([share for share in shares.values() if np.isfinite(share)])
    return float(known.mean()) if known.size else float("nan")
