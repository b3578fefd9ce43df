"""Real files: meshes neither aligned nor to one scale, files that break loaders, and scanned points."""

from __future__ import annotations

import csv
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
from toys import QUIET, SETTINGS

from mvtn_cli.core.datasets import open_dataset, unlabelled
from mvtn_cli.core.preprocess import Prepared, Settings, prepare
from mvtn_cli.core.store import Store

FEW = 24


def assert_sound(prepared: Prepared, points: int) -> None:
    for index, record in enumerate(prepared.records):
        shape = prepared.load(index)
        everything = np.concatenate([shape.vertices, shape.points])
        assert np.isfinite(everything).all(), record.source
        assert np.isfinite(shape.normals).all(), record.source
        reach = np.linalg.norm(everything, axis=1).max()
        assert (0.9 if shape.has_mesh else 0) < reach < 1.1, record.source
        assert shape.points.shape == (points, 3), record.source
        assert not shape.has_mesh or shape.faces.max() < len(shape.vertices), record.source


def test_real_meshes_are_all_kept(tmp_path, real_data):
    paths = sorted((real_data / "meshes24").rglob("*.off"), key=lambda path: path.stat().st_size)[:: 576 // FEW]
    paths.append(real_data / "meshes24" / "Quadruped" / "train" / "m94.off")  # an extent of 4.6e8
    dataset = unlabelled(paths)
    settings = Settings(max_vertices=3000, num_points=256, seed=0)
    prepared, summary = prepare(dataset, settings, Store(tmp_path), QUIET, workers=1)
    assert (summary.kept, summary.rejected) == (len(paths), 0)
    assert_sound(prepared, 256)
    assert all(row["vertices_after"] <= 3000 < row["vertices_before"] for row in summary.simplifications)


def test_awkward_files_come_out_as_their_manifest_expects(tmp_path, real_data):
    with (real_data / "awkward" / "MANIFEST.tsv").open(encoding="utf-8") as file:
        expected = {row["file"]: row["expected"] for row in csv.DictReader(file, delimiter="\t")}
    dataset = unlabelled([real_data / "awkward" / name for name in expected])
    prepared, summary = prepare(dataset, SETTINGS, Store(tmp_path), QUIET, workers=1)
    assert summary.kept + summary.rejected == len(expected) == 71
    assert_sound(prepared, SETTINGS.num_points)
    rejected = {Path(found["file"]).name for found in summary.findings if found["fatal"]}
    must_go = {name for name, word in expected.items() if word == "rejected"}
    must_stay = {name for name, word in expected.items() if word == "valid"}
    assert rejected.isdisjoint(must_stay)
    assert must_go <= rejected


def test_rows_of_the_point_release_are_kept_as_points(tmp_path, real_data):
    root = tmp_path / "release"
    root.mkdir()
    for split in ("train", "test"):
        (root / f"{split}_files.txt").write_text(f"data/x/ply_data_{split}0.h5\n")
        source = real_data / "modelnet40_points" / f"ply_data_{split}0.h5"
        with h5py.File(source) as whole, h5py.File(root / f"ply_data_{split}0.h5", "w") as few:
            few["data"], few["label"] = whole["data"][:FEW], whole["label"][:FEW]
    shutil.copy(real_data / "modelnet40_points" / "shape_names.txt", root)
    dataset = open_dataset(f"modelnet40:{root}")
    for count in (512, 1024, 1500):  # fewer than there are, as many, more
        settings = replace(SETTINGS, num_points=count)
        prepared, summary = prepare(dataset, settings, Store(tmp_path / "s"), QUIET, workers=1)
        assert (summary.kept, summary.rejected) == (2 * FEW, 0)
        assert_sound(prepared, count)
        original = dataset.items[0].read().points
        shape = prepared.load(0)
        back = Counter(map(tuple, np.round((shape.points * shape.radius + shape.center) * 2048).astype(int)))
        assert set(back) <= set(map(tuple, np.round(original * 2048).astype(int)))  # its own points, none made up
        assert len(back) >= min(count, 1000)
        assert not shape.has_mesh
