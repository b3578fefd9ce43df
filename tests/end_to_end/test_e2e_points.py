"""Clouds of points, from a folder with a name that is no identifier to cameras that learn from discs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from processes import Folder

CLASSES = ("Kügelchen & Co", "stick")
SETTINGS = ("--image-size", 16, "--num-views", 2, "--epochs", 2, "--batch-size", 4, "--encoder-points", 64)


@pytest.fixture
def clouds(tmp_path: Path) -> Folder:
    """A folder with `schöne Punkte`: two classes of ten clouds, as text and as arrays."""
    folder = Folder(tmp_path / "work")
    for name in CLASSES:
        for number in range(10):
            random = np.random.default_rng(number)
            points = random.normal(size=(300, 3))
            points /= np.linalg.norm(points, axis=1, keepdims=True)
            points *= random.uniform(0.8, 1.2, 3) * ([0.2, 1, 0.2] if name == "stick" else 1)
            path = folder.path / "schöne Punkte" / name / ("test" if number < 3 else "train") / f"{name} {number}"
            path.parent.mkdir(parents=True, exist_ok=True)
            if number % 2:
                np.save(path.with_suffix(".npy"), points)
            else:
                np.savetxt(path.with_suffix(".xyz"), points)
    return folder


def test_point_clouds_train_cameras_that_learn(clouds: Folder):
    assert clouds.mvtn("preprocess", "schöne Punkte", "--workers", 1).code == 0
    trained = clouds.mvtn("train", *SETTINGS, "--json")  # bare: the set that was preprocessed in this folder
    assert trained.code == 0 and trained.document["test"]["count"] == 6
    run = clouds.path / trained.document["run"]
    lines = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    assert len(lines) == 2 and all(line["view_grad_norm"] > 0 for line in lines)
    # All shapes begin with the same views; what the network sees of a shape now moves them apart.
    assert 0 < lines[0]["view_spread_deg"] < lines[1]["view_spread_deg"]
    info = json.loads((run / "run.json").read_text(encoding="utf-8"))
    assert tuple(info["classes"]) == CLASSES and info["dataset"].endswith("/schöne Punkte")
    assert run.name == "schöne-punkte-learned-spherical-2v-s0"
