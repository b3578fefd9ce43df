"""Evaluations and descriptors of a run: on a cluster they are those of this machine, bit for bit."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from mvtn_cli.config import TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.cluster import connect
from mvtn_cli.core.datasets import open_dataset
from mvtn_cli.core.networks.recogniser import build_recogniser
from mvtn_cli.core.preprocess import Part, Prepared, Settings, prepare
from mvtn_cli.core.retrieval import descriptors
from mvtn_cli.core.retrieval.descriptors import Describer
from mvtn_cli.core.robustness import measure
from mvtn_cli.core.robustness.cells import FILE, read_cells
from mvtn_cli.core.robustness.many_machines import Errand, run_errand
from mvtn_cli.core.robustness.plan import plan_of
from mvtn_cli.core.store import Store
from mvtn_cli.core.training.checkpoint import write_weights
from mvtn_cli.core.training.run import Run
from mvtn_cli.errors import DataError
from mvtn_cli.robustness_config import RobustnessConfig

QUIET = Console(quiet=True)


@pytest.fixture
def prepared(tmp_path: Path) -> Prepared:
    dataset = open_dataset("builtin:shapes?train=20&test=12")
    settings = Settings(max_vertices=20_000, num_points=64, seed=0)
    return prepare(dataset, settings, Store(tmp_path / "store"), QUIET, workers=1)[0]


@pytest.fixture
def run(tmp_path: Path, prepared: Prepared) -> Run:
    """A run that was never trained, with weights all the same."""
    config = TrainConfig(dataset=prepared.spec, views="fixed", num_views=2, image_size=16, encoder_points=32)
    run = Run.create(tmp_path / "runs" / "a", config, prepared)
    model = build_recogniser(config, len(prepared.classes), read_weights=False)
    random = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for weight in model.parameters():
            if weight.ndim == 2:  # answers that differ from shape to shape
                weight += torch.empty_like(weight).normal_(0, 0.5, generator=random)
    write_weights(run.weights_path("best"), model.state_dict(), {"epoch": 1})
    return run


def test_evaluations_are_those_of_this_machine_and_are_kept_by_it(cluster, prepared, run, tmp_path):
    wanted = {"rotate": [90], "noise": [0.05], "repeats": 2, "device": "cpu", "batch_size": 5}
    here, there = RobustnessConfig(**wanted), RobustnessConfig(**wanted, scheduler=cluster.address)
    indices, plan = measure.chosen_indices(prepared, 7, 0), plan_of(here)
    (alone,) = measure.measure([run], prepared, indices, plan, here, QUIET)
    (run.path / FILE).unlink()
    (spread,) = measure.measure([run], prepared, indices, plan, there, QUIET)
    assert len(spread.cells) == len(plan) == 5
    timeless = [repr([{**cell, "seconds": 0} for cell in one.cells]) for one in (alone, spread)]  # NaN is no NaN
    assert timeless[0] == timeless[1]
    assert len({tuple(cell["predicted"]) for cell in alone.cells}) > 1
    assert set(read_cells(run.path)) == {cell["key"] for cell in spread.cells}
    # What is finished is not asked for again, nor is the cluster.
    finished = RobustnessConfig(**wanted, scheduler="tcp://127.0.0.1:9")
    (again,) = measure.measure([run], prepared, indices, plan, finished, QUIET)
    assert repr(again.cells) == repr([read_cells(run.path)[cell["key"]] for cell in spread.cells])


def test_descriptors_are_those_of_this_machine_and_are_stored(cluster, prepared, run, monkeypatch):
    monkeypatch.setattr(descriptors, "CHUNK", 6)
    store, indices = prepared.store, prepared.split("train")

    def describer(scheduler: str | None) -> Describer:
        return Describer(run, "best", "cpu", 4, 0, store, QUIET, scheduler)

    alone = describer(None).describe(prepared, indices)
    kept = files_of(store)
    shutil.rmtree(store.root / "descriptors")
    shutil.rmtree(store.root / "views")
    many = describer(cluster.address)
    spread = many.describe(prepared, indices)
    assert many.computed == len(indices) == 20
    assert np.array_equal(spread.descriptors, alone.descriptors) and np.array_equal(spread.predicted, alone.predicted)
    assert files_of(store) == kept and len(kept) == 4
    again = describer("tcp://127.0.0.1:9")
    assert np.array_equal(again.describe(prepared, indices).descriptors, alone.descriptors) and again.computed == 0


def files_of(store: Store) -> dict[str, bytes]:
    return {str(path.relative_to(store.root)): path.read_bytes() for path in store.root.glob("descriptors/*/*")}


def test_a_worker_needs_the_weights_too(cluster, prepared, run, tmp_path):
    weights = run.weights_path("best")
    with connect(cluster.address, prepared.store.root, QUIET, needs=[weights, tmp_path / "gone"]) as workers:
        assert str(weights) in [path for path, _ in workers._badge.files]


def test_a_shape_that_is_gone_is_said_by_name(prepared, run):
    part = Part.of(prepared, [3, 5])
    assert np.array_equal(part.load(1).points, prepared.load(5).points)
    prepared.store.shape_path(prepared.records[3].address).unlink()
    with pytest.raises(DataError, match=f"stored shape of {prepared.records[3].name} is missing") as caught:
        run_errand(Errand("key", run, plan_of(RobustnessConfig())[0], part, RobustnessConfig(device="cpu")))
    assert prepared.spec in caught.value.hint
