"""Measure how well a run's descriptors find shapes of the same class, and write what was found."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvtn_cli.core.evaluation.evaluate import provenance
from mvtn_cli.core.evaluation.files import write_csv, write_json
from mvtn_cli.core.retrieval.curves import curves_of, draw_curves, write_curves
from mvtn_cli.core.retrieval.descriptors import labelled
from mvtn_cli.core.retrieval.distances import Gallery
from mvtn_cli.core.retrieval.figure import write_figure
from mvtn_cli.core.retrieval.index import search
from mvtn_cli.core.retrieval.metrics import score, summary
from mvtn_cli.core.retrieval.searchable import Searchable, labels_of, limited, open_searchable
from mvtn_cli.core.retrieval.shrec17_run import measure_shrec17

if TYPE_CHECKING:
    from mvtn_cli.console import Console
    from mvtn_cli.core.preprocess import Prepared
    from mvtn_cli.core.training.run import Run
    from mvtn_cli.retrieve_config import RetrieveConfig

SCHEMA = "mvtn.retrieve/1"


def retrieve_run(run: Run, prepared: Prepared, config: RetrieveConfig, console: Console) -> dict[str, Any]:
    """Measure retrieval by one of the protocols.

    Writes into `config.out`, else into the run's folder `retrieval` (`retrieval-shrec17`): `result.json`,
    `per_class.csv`, `precision_recall.csv`, `.svg` and `.png`, `queries.csv` (protocol "paper") and `figure.png`; with
    `config.out` also the contest's files.

    Args:
        run: A run that has weights.
        prepared: The data set that it was trained on.
        config: Protocol, distances, limits, files.
        console: For progress.

    Returns:
        What `result.json` holds.

    Raises:
        MvtnError: As `open_searchable`; or there are no queries.
    """
    begun = time.monotonic()
    searchable = open_searchable(run, prepared, config, console)
    folder = results_folder(run.path, config)
    measured = measure_paper if config.protocol == "paper" else measure_shrec17
    found = measured(searchable, config, folder)
    document = {
        "schema": SCHEMA,
        "run": str(run.path),
        "protocol": config.protocol,
        "checkpoint": config.checkpoint,
        "metric": config.metric,
        "lfda": _about_lfda(searchable),
        "dimensions": int(searchable.described.descriptors.shape[1]),
        **found,
        "described": searchable.describer.computed,
        **provenance(run, prepared, config),  # type: ignore[arg-type]
        "seed": config.seed,
        "training_seed": run.config.seed,
        "seconds": time.monotonic() - begun,
        "folder": str(folder),
    }
    write_json(folder / "result.json", document)
    return document


def measure_paper(searchable: Searchable, config: RetrieveConfig, folder: Path) -> dict[str, Any]:
    """Test shapes search all training shapes; see `retrieve_run`."""
    prepared = searchable.prepared
    indices = limited(prepared, labelled(prepared, "test"), config.limit, config.seed)
    rows, labels = searchable.map(searchable.describer.describe(prepared, indices)), labels_of(prepared, indices)
    begun = time.monotonic()
    scores = score(rows, labels, Gallery.of(searchable.rows, config.metric), searchable.labels, config.at)
    found = summary(scores, prepared.classes)
    found["seconds_scoring"] = time.monotonic() - begun
    names = list(scores.values)
    columns = ("name", "queries", "relevant", *names)
    write_csv(folder / "per_class.csv", columns, [[row[key] for key in columns] for row in found["per_class"]])
    words = [prepared.classes[label] for label in labels]
    values = zip(*scores.values.values(), strict=True)
    shown = zip([prepared.records[i].name for i in indices], words, scores.relevant, values, strict=True)
    lines = [(name, word, relevant, *measures) for name, word, relevant, measures in shown]
    write_csv(folder / "queries.csv", ("name", "label", "relevant", *names), lines)
    curves = curves_of(scores.curves, np.array(words))
    write_curves(folder / "precision_recall.csv", curves)
    draw_curves(folder, curves, f"{searchable.describer.run.name}: test shapes search the training shapes")
    nearest = search(searchable.rows, rows, max(config.at), config.metric, config.index) if _is_extra(config) else None
    return {
        "gallery": {"split": "train", "count": len(searchable.indices)},
        "split": "test",
        "cuts": list(config.at),
        **found,
        "precision_recall": curves,
        "index": nearest.about if nearest else {"name": "exact"},
        "figure": write_figure(folder, searchable, indices, rows, config),
    }


def results_folder(run: Path, config: RetrieveConfig) -> Path:
    """Where the results go."""
    return config.out or run / ("retrieval" if config.protocol == "paper" else "retrieval-shrec17")


def _is_extra(config: RetrieveConfig) -> bool:
    """Whether another index than the exact one is to be judged."""
    return config.index != "exact"


def _about_lfda(searchable: Searchable) -> dict[str, Any] | None:
    if searchable.lfda is None:
        return None
    return {"dim": int(searchable.lfda.components.shape[1]), "fitted_on": len(searchable.indices)}
