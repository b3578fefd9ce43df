"""Made-up runs of a comparison: what training and evaluation leave behind, as far as a comparison reads it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from made_up import predictions

from mvtn_cli.core.evaluation.evaluate import judge, write_tables
from mvtn_cli.core.evaluation.files import write_json

CLASSES = ["chair", "sofa", "table", "lamp", "class <5> & more"]


def small_run(
    folder: Path,
    *,
    seed: int = 0,
    skill: float = 3.0,
    views: str = "fixed",
    address: str = "9f2c51d0",
    spec: str = "builtin:shapes",
    evaluated: bool = True,
    split: str = "test",
    seconds: float = 2.0,
    epochs: int = 8,
    state: str = "finished",
    **settings: Any,
) -> Path:
    """Write a run whose answers come from its seed and skill; the judged shapes are always the same."""
    folder.mkdir(parents=True)
    config = {
        "views": views, "num_views": 3, "image_size": 32, "network": "mvcnn", "backbone": "tiny", "seed": seed,
        "dataset": spec, "name": folder.name, **settings,
    }  # fmt: skip
    (folder / "config.toml").write_text(tomli_w.dumps(config))
    info = {
        "name": folder.name, "state": state, "classes": CLASSES, "dataset": spec, "title": f"made-up set; /data/{spec}",
        "data_address": address, "seed": seed, "changed": 5.0,
        "model": {"parameters": {"classifier": 1000, "viewpoint network": 234}},
    }  # fmt: skip
    write_json(folder / "run.json", info)
    lines = [
        {"epoch": i + 1, "seconds": seconds, "val_accuracy": 0.9 - 0.6 * np.exp(-skill * (i + 1) / 8)}
        for i in range(epochs)
    ]
    (folder / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    write_json(folder / "best.json", {"epoch": epochs, "selected_by": "48 shapes held out of train"})
    if evaluated:
        evaluate(folder, seed, skill, split, epochs)
    return folder


def evaluate(folder: Path, seed: int, skill: float, split: str = "test", best: int = 8, per_class: int = 30) -> None:
    """Write result.json and predictions.csv."""
    found = predictions(CLASSES, per_class, 3, known=False, learned=False, skill=skill)
    found.logits = found.logits + np.random.default_rng(seed).normal(size=found.logits.shape)
    result = {"schema": "mvtn.eval/1", "split": split, "checkpoint": "best", "best": {"epoch": best}}
    write_json(folder / "result.json", {**result, **judge(found, CLASSES, None)})
    write_tables(folder, found, CLASSES, [f"/data/{name}.off" for name in found.names])
