"""Trainings that differ in a few settings, with several seeds, in one table."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mvtn_cli.config import TrainConfig
from mvtn_cli.console import Console, duration
from mvtn_cli.core.training.checkpoint import write_json, write_run_file
from mvtn_cli.core.training.compare import summarise
from mvtn_cli.core.training.find import dataset_word
from mvtn_cli.core.training.group import check_can_be_tested, check_one_process, free_group, predict_test, train_one
from mvtn_cli.core.training.predict import Predictions
from mvtn_cli.core.training.run import Run
from mvtn_cli.core.training.sweep_plot import draw_plots

SCHEMA = "mvtn.sweep/1"
MEASURES = ("accuracy", "class_accuracy", "seconds")


@dataclass(frozen=True)
class Cell:
    """One combination.

    Attributes:
        word: Of its runs' names, unique in a sweep.
        config: The settings of its trainings, but for the seed.
    """

    word: str
    config: TrainConfig


def sweep(
    config: TrainConfig,
    cells: Sequence[Cell],
    fields: Sequence[str],
    seeds: int,
    prepared: Any,
    console: Console,
    *,
    judge: Callable[[Run], Predictions] | None = None,
) -> dict[str, Any]:
    """Train each combination with each seed, one after another, and put the results into one table.

    Each training is an ordinary run `NAME/WORD-sSEED`. The same command again, or one with more values, goes on where
    it was: finished runs are taken as they are, and what was measured of them too. The tables are written after every
    run, the plots at the end.

    Args:
        config: What all have in common: name, folder of runs, device, first seed.
        cells: The combinations.
        fields: The settings that are varied.
        seeds: Trainings of each; seeds count up from the common one.
        prepared: The data set.
        console: Where progress is shown.
        judge: Gives a finished run's answers on the test split; None takes its best weights.

    Returns:
        The document that is also written to sweep.json: `name`, `path`, `split`, `seeds`, `fields`, and of each of
        `cells` its `settings`, mean and sd of its `runs`.

    Raises:
        Interrupted: As `train`.
        DataError: There is nothing to test on.
    """
    check_one_process("a sweep")
    plan = {
        f"{cell.word}-s{seed}": (cell, cell.config.model_copy(update={"seed": seed, "name": None}))
        for seed in range(config.seed, config.seed + seeds)  # by seed first: an early stop leaves whole tables
        for cell in cells
    }
    check_can_be_tested(prepared)
    word = f"sweep-{dataset_word(prepared.spec)}-{'+'.join(field.replace('_', '-') for field in fields)}"
    trainings = {name: one for name, (_, one) in plan.items()}
    group = config.name or free_group(config.runs, word, trainings, prepared)
    folder = Path(config.runs) / group
    known, found = _known(folder), dict[str, list[dict[str, Any]]]()
    judged = judge or (lambda run: predict_test(run, prepared, config.device, console))
    document: dict[str, Any] = {}
    for number, (name, (cell, one)) in enumerate(plan.items(), 1):
        run = train_one(one, f"{group}/{name}", prepared, console)
        result = known.get((str(run.path), run.info["changed"])) or _measure(run, judged(run))
        found.setdefault(cell.word, []).append(result)
        told = f"{result['accuracy']:.1%} in {duration(result['seconds'])}"
        console.note(f"{number}/{len(plan)}: {cell.word}, seed {one.seed}: test accuracy {told}")
        done = [other for other in cells if other.word in found]
        document = _document(group, folder, config, done, fields, seeds, found)
        write_tables(folder, document)
    draw_plots(folder, document["cells"], fields, f"{prepared.title}: test accuracy, mean ± sd")
    return document


def write_tables(folder: Path, document: Mapping[str, Any]) -> None:
    """Write sweep.json, and sweep.csv with a row a run."""
    write_json(folder / "sweep.json", dict(document))
    buffer = io.StringIO(newline="")
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([*document["fields"], "seed", *MEASURES, "run"])
    for cell in document["cells"]:
        shown = [_text(cell["settings"][field]) for field in document["fields"]]
        writer.writerows([*shown, run["seed"], *(run[key] for key in MEASURES), run["run"]] for run in cell["runs"])
    write_run_file(folder / "sweep.csv", buffer.getvalue().encode())


def class_accuracy(answers: Predictions) -> float:
    """Mean of the classes' own accuracies, over the classes that occur."""
    right = answers.logits.argmax(axis=1) == answers.labels
    return float(np.mean([right[answers.labels == label].mean() for label in np.unique(answers.labels)]))


def _measure(run: Run, answers: Predictions) -> dict[str, Any]:
    return {
        "run": str(run.path),
        "seed": run.config.seed,
        "accuracy": answers.accuracy,
        "class_accuracy": class_accuracy(answers),
        "seconds": float(run.info["seconds"]),
        "changed": run.info["changed"],
    }


def _known(folder: Path) -> dict[tuple[str, float], dict[str, Any]]:
    """What was measured before, by run and the time of its last change; a file that can't be read knows nothing."""
    try:
        document = json.loads((folder / "sweep.json").read_text(encoding="utf-8"))
        results = [run for cell in document["cells"] for run in cell["runs"]]
        return {(run["run"], run["changed"]): run for run in results if set(MEASURES) <= set(run)}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _document(
    group: str,
    folder: Path,
    config: TrainConfig,
    cells: Sequence[Cell],
    fields: Sequence[str],
    seeds: int,
    found: Mapping[str, list[dict[str, Any]]],
) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "name": group,
        "path": str(folder),
        "split": "test",
        "seeds": list(range(config.seed, config.seed + seeds)),
        "fields": list(fields),
        "cells": [_entry(cell, fields, found[cell.word]) for cell in cells],
    }


def _entry(cell: Cell, fields: Sequence[str], runs: list[dict[str, Any]]) -> dict[str, Any]:
    settings = cell.config.model_dump(mode="json", include=set(fields))
    entry: dict[str, Any] = {"word": cell.word, "settings": settings}
    for measure in MEASURES:
        summary = summarise([run[measure] for run in runs])
        entry[measure] = {"mean": summary["mean"], "sd": summary["sd"]}
    return {**entry, "runs": runs}


def _text(value: Any) -> str:
    return "auto" if value is None else str(value)
