"""What learned views are worth, and what they know: a run seen again from the mean views of each class."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mvtn_cli.console import Console
from mvtn_cli.core.evaluation.classification import metrics
from mvtn_cli.core.evaluation.given_views import cameras_of, recognise_from
from mvtn_cli.core.evaluation.view_leak import class_leak, class_spread
from mvtn_cli.core.networks.class_views import class_mean_views
from mvtn_cli.core.views import circular_mean, resultant_length, view_spread
from mvtn_cli.errors import UsageError

if TYPE_CHECKING:
    from mvtn_cli.config import TrainConfig
    from mvtn_cli.core.networks.recogniser import Recogniser
    from mvtn_cli.core.training.predict import Predictions
    from mvtn_cli.core.training.shapes import Shapes

OWN, CLASS_MEAN, OVERALL_MEAN = "per-instance", "per-class-mean", "overall-mean"


def check_split(split: str) -> None:
    """Refuse to measure the views on the shapes that their means are taken from.

    Raises:
        UsageError: They are the training shapes.
    """
    if split == "train":
        raise UsageError(
            "a view analysis learns from the cameras of training shapes, so it can't be measured on them",
            hint="leave out --view-analysis, or use --split test",
            code="eval.view-analysis",
        )


def why_not(model: Recogniser) -> str | None:
    """Say why there is nothing to analyse in the views of a run; None where there is."""
    kind = model.config.views
    if not model.uses_views:
        return f"{model.config.network} looks at points alone: it has no views to analyse."
    if kind == "random":
        return "The views of this run are drawn at random, without looking at the shape: they can't know its class."
    if not (kind.startswith("learned") or kind == "transferred"):
        return (
            f"The views of this run are {kind}: it judges every shape from the same ones, which can't know its class."
        )
    return None


def view_analysis(
    model: Recogniser,
    shapes: Shapes,
    train: Sequence[int],
    tested: Sequence[int],
    found: Predictions,
    settings: TrainConfig,
    classes: Sequence[str],
    *,
    batch_size: int,
    seed: int,
    console: Console,
) -> dict[str, Any]:
    """Compare the views of single shapes with mean views, and look for the class in them.

    The mean views of each class, and of all shapes, are those that the viewpoint network chooses for the
    training shapes. A measured shape gets those of its *true* class: this uses its label, which a recogniser
    doesn't have, and so favours the class means.

    Args:
        model: In evaluation mode.
        shapes: The data set.
        train: The training shapes' records, M_train of them.
        tested: The N records that were measured.
        found: What the run said about these from its own views.
        settings: Of the training; the seed is that of random points.
        classes: C names.
        batch_size: Shapes at a time.
        seed: Of the classifier that reads the angles.
        console: For progress.

    Returns:
        `skipped`: None, or a sentence that says why there is nothing else here. `train_count`, `test_count`;
        `views`: for per-instance, per-class-mean and overall-mean views `accuracy`, `accuracy_interval`,
        `class_accuracy`, `gained` and `lost` (shapes that are right with these views only, and with their own
        views only), and `uses_label`; `spread` as from `class_spread`; `leak` as from `class_leak`;
        `per_class` as from `class_distribution`, with `correct` under each of the three names.
    """
    if reason := why_not(model):
        return {"skipped": reason}
    labels = np.asarray(found.labels)
    train_labels = np.array([shapes.records[i].label for i in train])
    seen = cameras_of(model, shapes, train, settings, batch_size=batch_size, console=console)
    by_class = class_mean_views(*seen, train_labels, len(classes))
    overall = class_mean_views(*seen, np.zeros_like(train_labels), 1)
    others = {
        CLASS_MEAN: (by_class[0][labels], by_class[1][labels]),
        OVERALL_MEAN: (overall[0][np.zeros_like(labels)], overall[1][np.zeros_like(labels)]),
    }
    logits = recognise_from(model, shapes, tested, others, settings, batch_size=batch_size, console=console)
    answers = {OWN: np.asarray(found.logits), **logits}
    console.note("reading the class from the angles of the cameras …")
    azimuth, elevation = np.asarray(found.azimuth_deg), np.asarray(found.elevation_deg)
    return {
        "skipped": None,
        "train_count": len(train),
        "test_count": len(labels),
        "views": compare_answers(labels, answers, classes),
        "spread": class_spread(azimuth, elevation, labels),
        "leak": class_leak((*seen, train_labels), (azimuth, elevation, labels), len(classes), seed=seed),
        "per_class": class_distribution(labels, azimuth, elevation, answers, classes),
    }


def compare_answers(
    labels: NDArray[np.int64], answers: dict[str, NDArray[np.float32]], classes: Sequence[str]
) -> list[dict[str, Any]]:
    """Judge the logits (N, C) from each kind of views, shape by shape against those from their own views."""
    right = {name: _right(labels, logits) for name, logits in answers.items()}
    rows = []
    for name, logits in answers.items():
        judged = metrics(labels, logits, classes)
        rows.append(
            {
                "views": name,
                **{key: judged[key] for key in ("accuracy", "accuracy_interval", "class_accuracy")},
                "gained": int((right[name] & ~right[OWN]).sum()),
                "lost": int((right[OWN] & ~right[name]).sum()),
                "uses_label": name == CLASS_MEAN,
            }
        )
    return rows


def class_distribution(
    labels: NDArray[np.int64],
    azimuth_deg: ArrayLike,
    elevation_deg: ArrayLike,
    answers: dict[str, NDArray[np.float32]],
    classes: Sequence[str],
) -> list[dict[str, Any]]:
    """Where the cameras (N, M) of each class stand that occurs.

    Returns:
        `name`, `count`; `correct`, by the names of the answers; `spread_deg`, `view_spread` within the class
        (mean over the views); `views`: for each, the circular mean and resultant length of the azimuth, the mean
        and the standard deviation of the elevation, degrees.
    """
    azimuth, elevation = np.asarray(azimuth_deg, np.float64), np.asarray(elevation_deg, np.float64)
    right = {name: _right(labels, logits) for name, logits in answers.items()}
    rows = []
    for label, name in enumerate(classes):
        mine = labels == label
        if not mine.any():
            continue
        a, e = azimuth[mine], elevation[mine]
        columns = circular_mean(a, axis=0), resultant_length(a, axis=0), e.mean(axis=0), e.std(axis=0)
        rows.append(
            {
                "name": name,
                "count": int(mine.sum()),
                "correct": {kind: int(of[mine].sum()) for kind, of in right.items()},
                "spread_deg": float(view_spread(a, e, axis=0).mean()),
                "views": [
                    dict(
                        zip(
                            ("azimuth_deg", "azimuth_resultant", "elevation_deg", "elevation_sd_deg"), view, strict=True
                        )
                    )
                    for view in np.stack(columns, axis=1).tolist()
                ],
            }
        )
    return rows


def _right(labels: NDArray[np.int64], logits: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which answers are right; one that is not finite is wrong."""
    return (logits.argmax(axis=1) == labels) & np.isfinite(logits).all(axis=1)
