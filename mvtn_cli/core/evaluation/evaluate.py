"""Judge a trained run on one split and write what was found into its folder."""

from __future__ import annotations

import io
import platform
import time
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mvtn_cli import __version__
from mvtn_cli.core.evaluation.baseline import histogram_forest
from mvtn_cli.core.evaluation.classification import metrics, probabilities
from mvtn_cli.core.evaluation.files import write_csv, write_json
from mvtn_cli.core.evaluation.known_view import known_view_errors
from mvtn_cli.core.evaluation.pictures import draw_shapes
from mvtn_cli.core.evaluation.shown_shapes import save_shapes, shown_names
from mvtn_cli.core.evaluation.view_analysis import check_split, view_analysis
from mvtn_cli.core.evaluation.views import view_statistics
from mvtn_cli.core.training.checkpoint import write_run_file
from mvtn_cli.errors import DataError

if TYPE_CHECKING:
    from mvtn_cli.config import EvalConfig
    from mvtn_cli.console import Console
    from mvtn_cli.core.networks.recogniser import Recogniser
    from mvtn_cli.core.preprocess import Prepared
    from mvtn_cli.core.training.predict import Predictions
    from mvtn_cli.core.training.run import Run

SCHEMA = "mvtn.eval/1"
SHOWN_MISTAKES = 12


def evaluate_run(run: Run, prepared: Prepared, config: EvalConfig, console: Console) -> dict[str, Any]:
    """Predict a split with the weights of a run, measure, and write the files.

    Into `config.out`, else the run's folder (for another split or checkpoint than test and best, a folder of
    that name within it): `result.json`, `predictions.csv`, `views.csv`, `confusion.csv`, `mistakes.npz`,
    and `shapes.npz`, small copies of the shapes that the report shows.

    Args:
        run: A run that has weights.
        prepared: The data set that it is judged on.
        config: Split, checkpoint, baseline, view analysis, batch size, device, out.
        console: For progress.

    Returns:
        What `result.json` holds.

    Raises:
        DataError: The split is empty.
        UsageError: The run knows other classes, or a view analysis is asked for on training shapes.
    """
    begun = time.monotonic()
    from mvtn_cli.core.training.fixed_views import with_kept_views
    from mvtn_cli.core.training.predict import load_model, predict

    settings = run.config
    run.check_classes(prepared)
    if config.view_analysis:
        check_split(config.split)
    indices = split_indices(settings, prepared, config.split)
    model = load_model(run, config.checkpoint, config.device)

    seeded = settings.model_copy(update={"seed": config.seed})  # of random views
    shapes = with_kept_views(prepared, settings, console, model.device)
    batch_size = config.shapes_a_step(settings.batch_size)
    found = predict(model, shapes, indices, seeded, batch_size=batch_size, console=console)
    sources = [prepared.records[i].source for i in indices]
    document = {
        "schema": SCHEMA,
        "run": str(run.path),
        "split": config.split,
        "checkpoint": config.checkpoint,
        **judge(found, run.classes, start_views(model), uses_views=model.uses_views),
        "baseline": None,
        "view_analysis": None,
        "model": model.facts(),
    }
    if config.baseline:
        console.note("random forest on distance histograms …")
        document["baseline"] = histogram_forest(prepared, range(config.seed, config.seed + 3), split=config.split)
    if config.view_analysis:
        train = split_indices(settings, prepared, "train")
        document["view_analysis"] = view_analysis(
            *(model, prepared, train, indices, found, seeded, run.classes),
            batch_size=batch_size, seed=config.seed, console=console,
        )  # fmt: skip
    document |= provenance(run, prepared, config)
    folder = results_folder(run.path, config.split, config.checkpoint, config.out)
    document["mistakes"] = mistakes(found, run.classes, sources)[:SHOWN_MISTAKES]
    write_tables(folder, found, run.classes, sources, uses_views=model.uses_views)
    shown = [mistake["index"] for mistake in document["mistakes"]] if model.uses_views else []
    save_views(folder / "mistakes.npz", found, shown, draw(prepared, indices, found, shown, settings))
    pictured = [*shown_names(run.path / "views_best.npz"), *(found.names[i] for i in shown)]
    save_shapes(folder / "shapes.npz", prepared, pictured if model.uses_views else [], console)
    document |= {"seconds": time.monotonic() - begun, "folder": str(folder)}
    write_json(folder / "result.json", document)
    return document


def judge(
    found: Predictions,
    classes: Sequence[str],
    start: tuple[ArrayLike, ArrayLike] | None = None,
    *,
    uses_views: bool = True,
) -> dict[str, Any]:
    """Measure predictions: `classification.metrics`, `views`, and `known_view` (None if no side is known).

    The last two are None for a network that looks at points alone.
    """
    if not uses_views:
        return {
            **metrics(found.labels, found.logits, classes),
            "classes": list(classes),
            "views": None,
            "known_view": None,
        }
    labels, known = np.asarray(found.labels), np.asarray(found.known_azimuth_deg, dtype=np.float64)
    azimuth, elevation = np.asarray(found.azimuth_deg), np.asarray(found.elevation_deg)
    side_is_known = bool(np.isfinite(known).any())
    return {
        **metrics(labels, found.logits, classes),
        "classes": list(classes),
        "views": view_statistics(labels, azimuth, elevation, classes, start),
        "known_view": known_view_errors(azimuth, known, elevation) if side_is_known else None,
    }


def mistakes(found: Predictions, classes: Sequence[str], sources: Sequence[str]) -> list[dict[str, Any]]:
    """List the shapes that were taken for something else, the surest mistakes first.

    Returns:
        One dictionary a mistake: `index` (row of the predictions), `name`, `source`, `label`, `predicted`,
        `probability` (of the class given) and `label_probability` (of the right one).
    """
    labels, chances = np.asarray(found.labels), probabilities(found.logits)
    given = np.where(np.isnan(chances), -1.0, chances).argmax(axis=1) if len(labels) else labels
    wrong = np.flatnonzero((labels >= 0) & (given != labels) & np.isfinite(chances).all(axis=1))
    wrong = wrong[np.argsort(-chances[wrong, given[wrong]], kind="stable")]
    return [
        {
            "index": i,
            "name": found.names[i],
            "source": sources[i],
            "label": classes[int(labels[i])],
            "predicted": classes[int(given[i])],
            "probability": float(chances[i, given[i]]),
            "label_probability": float(chances[i, labels[i]]),
        }
        for i in wrong.tolist()
    ]


def write_tables(
    folder: Path, found: Predictions, classes: Sequence[str], sources: Sequence[str], *, uses_views: bool = True
) -> list[Path]:
    """Write `predictions.csv`, `confusion.csv`, and `views.csv` where there are views.

    Rows are in the order of the predictions.
    """
    labels, chances = np.asarray(found.labels), probabilities(found.logits)
    given = np.where(np.isnan(chances), -1.0, chances).argmax(axis=1) if len(labels) else labels
    words = [classes[label] if label >= 0 else "" for label in labels]
    shapes = range(len(labels))
    predictions = [
        (
            found.names[i],
            words[i],
            classes[int(given[i])],
            float(chances[i, given[i]]),
            "" if labels[i] < 0 else int(given[i] == labels[i]),
            sources[i],
        )
        for i in shapes
    ]
    azimuth, elevation = np.asarray(found.azimuth_deg), np.asarray(found.elevation_deg)
    views = [
        (
            *(found.names[i], words[i], v, azimuth[i, v], elevation[i, v], found.distance[i, v]),
            found.known_azimuth_deg[i],
        )
        for i in shapes
        for v in range(azimuth.shape[1])
    ]
    confusion = metrics(labels, found.logits, classes)["confusion"]
    angles = ("azimuth_deg", "elevation_deg", "distance", "known_azimuth_deg")
    written = []
    if uses_views:
        written.append(write_csv(folder / "views.csv", ("name", "label", "view", *angles), views))
    else:
        (folder / "views.csv").unlink(missing_ok=True)
    return [
        *written,
        write_csv(
            folder / "predictions.csv",
            ("name", "label", "predicted", "probability", "correct", "source"),
            predictions,
        ),
        write_csv(
            folder / "confusion.csv",
            ("label", *classes),
            [(name, *row) for name, row in zip(classes, confusion, strict=True)],
        ),
    ]


def draw(
    prepared: Prepared, indices: Sequence[int], found: Predictions, shown: Sequence[int], settings: Any
) -> NDArray[np.uint8] | None:
    """Take the pictures again that some of the predictions were made from; None for no shapes."""
    if not shown:
        return None
    rows = list(shown)
    return draw_shapes(
        prepared,
        [indices[i] for i in rows],
        found.azimuth_deg[rows],
        found.elevation_deg[rows],
        settings,
        distance=found.distance[rows],
    )


def save_views(path: Path, found: Predictions, shown: Sequence[int], images: NDArray[np.uint8] | None) -> None:
    """Keep pictures with their cameras, as `views_best.npz` of a run does; without any, an old file goes."""
    if images is None:
        path.unlink(missing_ok=True)
        return
    rows = list(shown)
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        names=np.array([found.names[i] for i in rows], dtype=str),
        labels=np.asarray(found.labels)[rows],
        azimuth=np.asarray(found.azimuth_deg)[rows],
        elevation=np.asarray(found.elevation_deg)[rows],
        distance=np.asarray(found.distance)[rows],
        images=images,
    )
    write_run_file(path, buffer.getvalue())


def split_indices(settings: Any, prepared: Prepared, split: str) -> list[int]:
    """Find the labelled shapes of a split; `val` and `train` are what the training made of them.

    Raises:
        DataError: There are none.
    """
    from mvtn_cli.core.training.split import training_indices

    if split == "test":
        indices = prepared.split("test")
    else:
        chosen = training_indices(settings, prepared)
        indices = chosen.train if split == "train" else chosen.select
    indices = [i for i in indices if prepared.records[i].label >= 0]
    if not indices:
        raise DataError(
            f"no labelled shapes for split '{split}' in {prepared.spec}",
            hint="try another --split, or mvtn predict for files without labels",
            code="dataset.empty-split",
        )
    return indices


def results_folder(run: Path, split: str, checkpoint: str, out: Path | None = None) -> Path:
    """Where an evaluation goes: the run itself for the usual one, so that no other overwrites it."""
    if out is not None:
        return Path(out)
    return run if (split, checkpoint) == ("test", "best") else run / f"{split}-{checkpoint}"


def start_views(model: Recogniser) -> tuple[NDArray[Any], NDArray[Any]] | None:
    """Azimuth and elevation (M,) before learning, for the selections that start at a layout exactly."""
    if model.config.views not in ("learned-circular", "learned-spherical"):
        return None
    azimuth, elevation = (angle.cpu().numpy().astype(np.float64) for angle in model.selector.start)
    return azimuth, elevation


def provenance(run: Run, prepared: Prepared, config: EvalConfig) -> dict[str, Any]:
    """What is needed to get the same numbers again."""
    import torch

    return {
        "selection": run.config.views,
        "seed": run.config.seed,
        "data": {"spec": prepared.spec, "title": prepared.title, "address": prepared.address},
        "best": run.best,
        "versions": {
            "mvtn": __version__,
            "python": platform.python_version(),
            "torch": torch.__version__,
            "torchvision": metadata.version("torchvision"),
            "numpy": np.__version__,
        },
        "batch_size": config.shapes_a_step(run.config.batch_size),
    }
