"""Pictures are taken one batch ahead where the networks are not on the CPU, and change nothing."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import pytest
import torch

from mvtn_cli.config import TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.networks import Recogniser, build_recogniser
from mvtn_cli.core.networks.synced import Exchange, Share, SyncedBatchNorm, synchronise_batch_norm
from mvtn_cli.core.render import ShapeBatch
from mvtn_cli.core.training import loop, ready
from mvtn_cli.core.training.draws import WholeBatchDraws
from mvtn_cli.core.training.ready import ReadyMaker, spare_drawer

MPS, CUDA, CPU = torch.device("mps"), torch.device("cuda", 0), torch.device("cpu")
Settings = Callable[..., TrainConfig]


class TwoProcesses:
    """A team of two, seen from one of them."""

    def __init__(self, rank: int, size: int = 2) -> None:
        self.rank, self.size = rank, size

    def share_of(self, batch: list[int]) -> Share:
        return Share(len(batch), self.rank, self.size)

    def drawing(self, share: Share) -> WholeBatchDraws:
        return WholeBatchDraws(share)


@pytest.mark.parametrize(
    "changed",
    [
        {"views": "fixed", "color": "mixed", "light": "mixed"},
        {"views": "jittered", "fuse": True},
        {"views": "random", "network": "viewgcn", "num_views": 4},
        {"views": "jittered", "render": "points"},
    ],
    ids=["fixed", "jittered, points too", "random", "discs"],
)
def test_a_training_whose_pictures_are_taken_ahead_is_the_same(
    changed: dict[str, Any], settings: Settings, boxes: Any, quiet: Console, monkeypatch: pytest.MonkeyPatch
):
    def trained(name: str) -> tuple[list[dict[str, Any]], bytes]:
        run = loop.train(settings(name=name, **changed), boxes, quiet)
        return [{**line, "seconds": 0} for line in run.metrics()], run.require_weights("last").read_bytes()

    threads: set[int] = set()
    take = Recogniser.take_pictures

    def noted(self: Recogniser, *words: Any) -> torch.Tensor:
        threads.add(threading.get_ident())
        return take(self, *words)

    plain = trained("plain")
    monkeypatch.setattr(ready, "spare_drawer", Recogniser.for_drawing)
    monkeypatch.setattr(Recogniser, "take_pictures", noted)
    assert trained("ahead") == plain
    assert len(threads - {threading.get_ident()}) > 0


@pytest.mark.parametrize(
    ("device", "changed", "spare"),
    [
        (MPS, {"views": "fixed"}, True),
        (MPS, {"views": "random"}, True),
        (MPS, {"views": "learned-spherical"}, False),
        (MPS, {"network": "pointnet"}, False),
        (CPU, {"views": "fixed"}, False),
    ],
)
def test_pictures_are_taken_ahead_of_networks_elsewhere_unless_cameras_learn(
    device: torch.device, changed: dict[str, Any], spare: bool, settings: Settings, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(Recogniser, "device", property(lambda self: device))
    assert (spare_drawer(build_recogniser(settings(**changed), 4)) is not None) == spare


@pytest.mark.parametrize(("draws", "spare"), [(CUDA, False), (CPU, True)])
def test_a_gpu_that_draws_for_itself_has_no_spare_drawer(
    draws: torch.device, spare: bool, settings: Settings, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(Recogniser, "device", property(lambda self: CUDA))
    monkeypatch.setattr(ready, "drawing_device", lambda wanted: draws)
    assert (spare_drawer(build_recogniser(settings(views="fixed"), 4)) is not None) == spare


def test_several_processes_take_the_pictures_of_one(settings: Settings, boxes: Any, monkeypatch: pytest.MonkeyPatch):
    config = settings(views="random", color="random", light="random")
    model = build_recogniser(config, 4)
    monkeypatch.setattr(ready, "spare_drawer", Recogniser.for_drawing)

    def images(team: Any) -> torch.Tensor:
        made = ReadyMaker(team, model, boxes, config).make([4, 1, 5, 0, 2], 1, 3)
        assert made.seen is not None
        return made.seen.images

    alone = images(TwoProcesses(0, size=1))
    assert len(alone) == 5 and alone.std() > 0.1
    assert torch.equal(torch.cat([images(TwoProcesses(0)), images(TwoProcesses(1))]), alone)


def test_a_gpu_that_draws_gets_batches_in_pinned_memory_and_nobody_else(
    settings: Settings, boxes: Any, monkeypatch: pytest.MonkeyPatch
):
    config = settings()
    model = build_recogniser(config, 4)

    def made() -> ShapeBatch:
        return ReadyMaker(TwoProcesses(0, size=1), model, boxes, config).make([4, 1], 0, 0).batch  # type: ignore[arg-type]

    plain, pinned = made(), []
    monkeypatch.setattr(torch.Tensor, "pin_memory", lambda self: pinned.append(self.data_ptr()) or self.clone())
    made()
    assert pinned == []
    monkeypatch.setattr(ready, "drawing_device", lambda wanted: CUDA)
    batch = made()
    assert len(set(pinned)) >= 12
    for field in fields(ShapeBatch):
        before, after = getattr(plain, field.name), getattr(batch, field.name)
        same = after == before if isinstance(before, tuple | type(None)) else (after == before).all()
        assert same, field.name


def test_layers_that_exchange_with_other_processes_can_be_copied_for_it(settings: Settings):
    """A process group can't be copied, and neither can a lock."""
    model = build_recogniser(settings(views="learned-spherical"), 4)
    exchange = Exchange(threading.Lock(), Share(4))
    synchronise_batch_norm(model, exchange)
    layers = [layer for layer in model.for_drawing().selector.modules() if isinstance(layer, SyncedBatchNorm)]
    assert layers and all(layer.exchange is exchange for layer in layers)
