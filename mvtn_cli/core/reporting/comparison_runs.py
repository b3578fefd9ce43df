"""Read what lies in the folders of several runs: all that a comparison is made of."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.evaluation.files import read_csv
from mvtn_cli.core.reporting.gather import read_json, read_lines, read_toml
from mvtn_cli.core.training.run import Run

NEEDED = (
    "accuracy", "accuracy_interval", "class_accuracy", "checkpoint", "classes", "confusion", "correct", "count",
    "per_class", "split",
)  # fmt: skip


class Answers(NamedTuple):
    """Which of the judged shapes were recognised.

    Attributes:
        shapes: N pairs of a shape's name and class.
        right: (N,) whether its class was answered.
    """

    shapes: tuple[tuple[str, str], ...]
    right: NDArray[np.bool_]


@dataclass(frozen=True)
class RunFiles:
    """One run of a comparison.

    Attributes:
        label: Its name, which no other run of the comparison has.
        path: Its folder.
        info: `run.json`.
        config: The settings of the training.
        epochs: The lines of `metrics.jsonl`.
        result: `result.json`; empty if the run was not evaluated.
        tested: What `train --compare` or `sweep` found out about a run of theirs, as `group_result` gives it.
        best: `best.json`.
        answers: `predictions.csv`.
        retrieval: `retrieval/result.json`; empty if it was not measured.
        robustness: `robustness.json`; empty if it was not measured.
    """

    label: str
    path: Path
    info: Mapping[str, Any]
    config: Mapping[str, Any]
    epochs: tuple[Mapping[str, Any], ...]
    result: Mapping[str, Any]
    tested: Mapping[str, Any]
    best: Mapping[str, Any]
    answers: Answers | None
    retrieval: Mapping[str, Any]
    robustness: Mapping[str, Any]


def read_runs(paths: Sequence[Path]) -> list[RunFiles]:
    """Read the runs in these folders, in this order.

    Raises:
        DataError: A `run.json` can't be read.
    """
    return [_read_run(path, label) for path, label in zip(paths, labels_of(paths), strict=True)]


def labels_of(paths: Sequence[Path]) -> list[str]:
    """The shortest names that tell folders apart: what is left of their paths without what all have in common."""
    if len(paths) < 2:
        return [path.resolve().name for path in paths]
    absolute = [str(path.resolve()) for path in paths]
    common = Path(os.path.commonpath(absolute))
    return [Path(path).relative_to(common).as_posix() if Path(path) != common else common.name for path in absolute]


def _read_run(path: Path, label: str) -> RunFiles:
    result = read_json(path / "result.json")
    judged = all(result.get(key) is not None for key in NEEDED)
    info = Run(path).info
    return RunFiles(
        label=label,
        path=path,
        info=info,
        config=read_toml(path / "config.toml"),
        epochs=tuple(read_lines(path / "metrics.jsonl")),
        result=result if judged else {},
        tested=group_result(path, info),
        best=read_json(path / "best.json"),
        answers=read_answers(path / "predictions.csv") if judged else None,
        retrieval=read_json(path / "retrieval" / "result.json"),
        robustness=read_json(path / "robustness.json"),
    )


def group_result(path: Path, info: Mapping[str, Any]) -> dict[str, Any]:
    """What the comparison or sweep that a run belongs to has measured of it; empty if there is none.

    Returns:
        `accuracy`, `class_accuracy` (None from a comparison), `split` and `source`, the name of the file.
    """
    compared, swept = (read_json(path.resolve().parent / f"{name}.json") for name in ("compare", "sweep"))
    try:
        return _from_comparison(compared, path.resolve().name) or _from_sweep(swept, path.resolve().name, info)
    except (KeyError, TypeError):
        return {}


def _from_comparison(document: Mapping[str, Any], name: str) -> dict[str, Any]:
    for one in document.get("selections", []):
        for run, accuracy in zip(one["runs"], one["accuracies"], strict=False):
            if Path(run).name == name:
                kept = {"accuracy": accuracy, "class_accuracy": None}
                return {**kept, "split": document.get("split"), "source": "compare.json"}
    return {}


def _from_sweep(document: Mapping[str, Any], name: str, info: Mapping[str, Any]) -> dict[str, Any]:
    for run in (run for cell in document.get("cells", []) for run in cell["runs"]):
        if Path(run["run"]).name == name and run["changed"] == info.get("changed"):
            kept = {key: run[key] for key in ("accuracy", "class_accuracy")}
            return {**kept, "split": document.get("split"), "source": "sweep.json"}
    return {}


def read_answers(path: Path) -> Answers | None:
    """Read which shapes were recognised; None if the file is missing or is not one of these."""
    try:
        rows = [row for row in read_csv(path) if row["label"]]
        right = np.array([row["correct"] == "1" for row in rows], dtype=bool)
        return Answers(tuple((row["name"], row["label"]) for row in rows), right)
    except (OSError, ValueError, KeyError, csv.Error):
        return None
