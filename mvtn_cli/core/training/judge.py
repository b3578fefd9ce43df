"""What an epoch was worth, and what is kept of it."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from torch import nn

from mvtn_cli.config import TrainConfig
from mvtn_cli.core.networks.recogniser import Recogniser
from mvtn_cli.core.training import watch
from mvtn_cli.core.training.checkpoint import write_json, write_run_file, write_weights
from mvtn_cli.core.training.predict import Predictions, predict
from mvtn_cli.core.training.run import Run
from mvtn_cli.core.training.shapes import Shapes
from mvtn_cli.core.training.team import Team


def judge_epoch(
    model: Recogniser,
    shapes: Shapes,
    select: list[int],
    shown: list[int],
    config: TrainConfig,
    each_batch: Callable[[], None],
    team: Team | None = None,
) -> dict[str, Any]:
    """Give the evaluation's part of a line of metrics.jsonl.

    Args:
        model: The recogniser as it is now.
        shapes: The data set.
        select: The shapes that choose the best epoch; if there are none, accuracy and loss are None.
        shown: Shapes to look at the views of in that case.
        config: The settings.
        each_batch: Called before each batch; may raise to end early.
        team: Processes that do it together, all of which must call this.
    """
    answers = predict(
        model, shapes, select or shown, config, batch_size=config.batch_size, each_batch=each_batch, team=team
    )
    judged = {
        "val_loss": answers.loss if select else None,
        "val_accuracy": answers.accuracy if select else None,
    }
    if not model.uses_views:
        return judged
    health = watch.view_health(answers.azimuth_deg, answers.elevation_deg, answers.known_azimuth_deg)
    return {
        **judged,
        "view_error_deg": health["view_error_deg"],
        "view_saturation": answers.saturation,
        "view_spread_deg": health["view_spread_deg"],
        "view_apart_deg": health["view_apart_deg"],
    }


def is_better(record: dict[str, Any], best: dict[str, Any] | None) -> bool:
    """Whether an epoch beats the best so far: by accuracy, then by loss. Without validation each one does."""
    if best is None or record["val_accuracy"] is None:
        return True
    return _rank(record) > _rank(best)


def _rank(record: dict[str, Any]) -> tuple[float, float]:
    loss = record["val_loss"]
    return record["val_accuracy"], -loss if math.isfinite(loss) else -math.inf


def keep_best(run: Run, model: nn.Module, best: dict[str, Any], seen: Predictions | None) -> None:
    """Write the weights of the best epoch, which one it was, and what its cameras see, if there are any."""
    write_weights(run.weights_path("best"), model.state_dict(), best)
    write_json(run.path / "best.json", best)
    if seen is not None:
        keep_views(run, "best", seen)


def look_at(
    model: Recogniser,
    shapes: Shapes,
    shown: list[int],
    config: TrainConfig,
    each_batch: Callable[[], None] | None = None,
    team: Team | None = None,
) -> Predictions:
    """Take the pictures of a few shapes as the cameras stand now."""
    return predict(
        model,
        shapes,
        shown,
        config,
        batch_size=config.batch_size,
        keep_images=len(shown),
        each_batch=each_batch,
        team=team,
    )


def keep_views(run: Run, when: str, seen: Predictions) -> None:
    """Write views_start.npz or views_best.npz.

    It holds names and labels (K,), azimuth and elevation (K, M) in degrees, distance (K, M) in shape radii, and
    images (K, M, 3, H, W) as uint8.
    """
    assert seen.images is not None
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        names=np.array(seen.names),
        labels=seen.labels,
        azimuth=seen.azimuth_deg,
        elevation=seen.elevation_deg,
        distance=seen.distance,
        images=seen.images,
    )
    write_run_file(run.path / f"views_{when}.npz", buffer.getvalue())


def epoch_line(record: dict[str, Any], epochs: int, best: bool) -> str:
    """An epoch in one line for people."""
    stage = ", single views" if record["stage"] == "views" else ""
    parts = [f"epoch {record['epoch']}/{epochs}{stage}"]
    if record["train_loss"] is not None:
        parts.append(f"loss {record['train_loss']:.3f}, train {record['train_accuracy']:.1%}")
    if record["val_accuracy"] is not None:
        parts.append(f"val {record['val_accuracy']:.1%}" + (" (best)" if best else ""))
    if record.get("view_error_deg") is not None:
        parts.append(f"views {record['view_error_deg']:.0f}° off")
    if record["skipped_steps"]:
        parts.append(f"{record['skipped_steps']} steps skipped")
    return ", ".join([*parts, f"{record['seconds']:.1f} s"])


def view_warning(record: dict[str, Any], config: TrainConfig) -> str | None:
    """The warning that learned views have collapsed, if they have."""
    if not config.views.startswith("learned"):
        return None
    told = watch.collapse(record["view_saturation"], record["view_spread_deg"], record["view_apart_deg"])
    return f"collapsed views after epoch {record['epoch']}: {told}; try a lower --views-lr" if told else None
