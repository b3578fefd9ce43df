"""Every distribution goes all the way: from its files to stored shapes with labels and splits."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from release_writers import (
    core_v2,
    objects_release,
    off_release,
    put,
    resampled_release,
    scans_release,
    shapenet_rows,
    shrec17,
    write_list,
)

from mvtn_cli.console import Console
from mvtn_cli.core.datasets import open_dataset
from mvtn_cli.core.preprocess import Settings, prepare
from mvtn_cli.core.store import Store

SETTINGS = Settings(max_vertices=100, num_points=32, seed=0)
SHAPES = {"train": ["bed_0001", "sofa_0001"], "test": ["bed_0516"]}


def shapenet_v2(root: Path) -> str:
    rows = shapenet_rows()
    write_list(root / "all.csv", rows)
    put(core_v2(root, rows) / rows[0][1] / rows[0][3] / "models" / "model_normalized.obj", "")
    return f"shapenet55:{root}"


def shapenet_shrec(root: Path) -> str:
    rows = shapenet_rows()
    write_list(root / "all.csv", rows)
    return f"shapenet55:{shrec17(root, rows)}@perturbed"


@pytest.mark.parametrize(
    ("make", "kept", "rejected"),
    [
        (lambda root: f"modelnet40:{off_release(root, {'bed': (3, 2), 'chair': (2, 1)})}", 8, 0),
        (lambda root: f"modelnet10:{resampled_release(root, SHAPES, ['bed', 'sofa'])}", 3, 0),
        (shapenet_v2, 11, 1),  # one of the empty files that the real set has
        (shapenet_shrec, 12, 0),
        (lambda root: f"scanobjectnn:{objects_release(root)}@hardest", 6, 0),
        (lambda root: f"scanobjectnn:{scans_release(root)}@obj_only", 4, 0),
    ],
)
def test_shapes_arrive_in_the_store_with_their_labels(tmp_path, make, kept, rejected):
    dataset = open_dataset(make(tmp_path / "set"))
    store = Store(tmp_path / "store")
    prepared, summary = prepare(dataset, SETTINGS, store, Console(err=io.StringIO(), quiet=True), workers=1)
    assert (summary.kept, summary.rejected) == (kept, rejected)
    labels = {item.name: (item.label, item.split) for item in dataset.items}
    assert all((record.label, record.split) == labels[record.name] for record in prepared.records)
    assert {"train", "test"} <= {record.split for record in prepared.records}
    assert all(prepared.load(index).points.shape == (32, 3) for index in range(len(prepared)))
    again, summary = prepare(open_dataset(dataset.spec), SETTINGS, store, Console(err=io.StringIO(), quiet=True))
    assert summary.made == 0 and again.address == prepared.address
