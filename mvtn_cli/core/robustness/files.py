"""The documents, tables and plots of a measurement of robustness."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from mvtn_cli import __version__
from mvtn_cli.core.evaluation.files import write_csv, write_json
from mvtn_cli.core.robustness.measure import Measured
from mvtn_cli.core.robustness.plot import draw_plots
from mvtn_cli.core.robustness.summary import summarise_cells
from mvtn_cli.robustness_config import RobustnessConfig

SCHEMA = "mvtn.robustness/1"
COLUMNS = (
    *("run", "kind", "strength", "crop", "direction", "repeat", "seed", "count", "correct"),
    *("accuracy", "class_accuracy", "points_left", "area_left"),
)


def document_of(
    measured: Sequence[Measured], prepared: Any, indices: Sequence[int], config: RobustnessConfig
) -> dict[str, Any]:
    """The answer of a measurement, for programs; runs are in the order in which they were named."""
    labels = [prepared.records[index].label for index in indices]
    sizes = {config.shapes_a_step(one.run.config.batch_size) for one in measured}
    return {
        "schema": SCHEMA,
        "data": {"spec": prepared.spec, "title": prepared.title, "address": prepared.address},
        "split": "test",
        "count": len(indices),
        "limit": config.limit,
        "checkpoint": config.checkpoint,
        "seed": config.seed,
        "repeats": config.repeats,
        "batch_size": sizes.pop() if len(sizes) == 1 else None,
        "runs": [_run_entry(one, labels) for one in measured],
        "versions": {
            "mvtn": __version__,
            "python": platform.python_version(),
            "torch": metadata.version("torch"),
            "numpy": np.__version__,
        },
    }


def write_files(folder: Path, document: dict[str, Any], measured: Sequence[Measured]) -> dict[str, Any]:
    """Write `robustness.json`, `.csv` (a row an evaluation), `.svg` and `.png`; return the document with `folder`."""
    document = {**document, "folder": str(folder)}
    rows = [
        [one.run.name if column == "run" else cell[column] for column in COLUMNS]
        for one in measured
        for cell in one.cells
    ]
    write_csv(folder / "robustness.csv", COLUMNS, rows)
    data = document["data"]["spec"]
    draw_plots(folder, document["runs"], f"{data}, {document['count']} test shapes: mean ± sd")
    write_json(folder / "robustness.json", document)
    return document


def _run_entry(one: Measured, labels: Sequence[int]) -> dict[str, Any]:
    settings = one.run.config
    return {
        "name": one.run.name,
        "run": str(one.run.path),
        "selection": settings.views,
        "best": one.run.best,
        **summarise_cells(one.cells, labels),
    }
