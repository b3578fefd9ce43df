"""Fixed views are drawn in the first epoch alone, and no number of a training changes by it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import torch

from mvtn_cli.config import EvalConfig
from mvtn_cli.console import Console
from mvtn_cli.core.evaluation.evaluate import evaluate_run
from mvtn_cli.core.render import Look, skips
from mvtn_cli.core.render.tally import tally
from mvtn_cli.core.store import Store, digest, views_file
from mvtn_cli.core.training import fixed_views, loop
from mvtn_cli.core.training.checkpoint import read_weights
from mvtn_cli.core.training.predict import load_model
from mvtn_cli.core.training.run import Run

CPU = torch.device("cpu")
VARIED = {"color": "random", "light": "random"}


@pytest.fixture(autouse=True)
def the_skip() -> Iterator[None]:
    """What a test switches off comes back on."""
    yield
    skips.use_skips(())


@dataclass(frozen=True)
class StoredRecord:
    """A toy record that lies in a store."""

    name: str
    label: int
    split: str
    address: str
    source: str = "toy"
    known_azimuth_deg: float = float("nan")


@pytest.fixture
def stored_boxes(boxes: Any, tmp_path: Path) -> Any:
    """Boxes with addresses, in a store of their own; batches of 3 leave one that is not full."""
    boxes.records = [StoredRecord(r.name, r.label, r.split, digest(r.name)) for r in boxes.records]
    boxes.store = Store(tmp_path / "store")
    return boxes


def numbers(run: Run) -> list[dict[str, Any]]:
    return [{key: value for key, value in line.items() if key != "seconds"} for line in run.metrics()]


def weights_of(run: Run) -> dict[str, torch.Tensor]:
    return read_weights(run.weights_path("last"))


def assert_same_run(one: Run, other: Run) -> None:
    assert numbers(one) == numbers(other)
    a, b = weights_of(one), weights_of(other)
    assert a.keys() == b.keys() and all(torch.equal(a[name], b[name]) for name in a)


def rasterised_by(work: Callable[[], Any]) -> int:
    before = tally().rasterised
    work()
    return tally().rasterised - before


def rasterised_after_each_epoch(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Filled with the counter, where an epoch with its validation has been written down."""
    seen: list[int] = []
    real = Run.append_metrics
    monkeypatch.setattr(Run, "append_metrics", lambda run, line: (seen.append(tally().rasterised), real(run, line))[1])
    return seen


def test_after_the_first_epoch_nothing_is_rasterised(settings, stored_boxes, quiet, monkeypatch):
    seen = rasterised_after_each_epoch(monkeypatch)
    before = tally().rasterised
    loop.train(settings(views="fixed", epochs=3, batch_size=3, val_fraction=0.5, **VARIED), stored_boxes, quiet)
    assert seen[1:] == [seen[0]] * 2
    used = sum(record.split != "test" for record in stored_boxes.records)
    assert seen[0] - before <= 2 * used  # each shape's two views once


def test_weights_and_losses_are_those_of_a_run_that_draws_every_time(settings, stored_boxes, quiet):
    config = settings(views="fixed", epochs=3, batch_size=3, val_fraction=0.5, **VARIED)
    kept = loop.train(config, stored_boxes, quiet, name="kept")
    skips.use_skips(["fixed-views"])
    stored_boxes.store.clear("views")
    drawn = rasterised_by(lambda: loop.train(config, stored_boxes, quiet, name="drawn"))
    assert stored_boxes.store.sizes()["views"].files == 0 and drawn > 3 * 8
    assert_same_run(kept, Run.open(config.runs / "drawn"))


def test_a_second_run_and_its_evaluation_rasterise_nothing(settings, stored_boxes, quiet):
    config = settings(views="fixed", val_fraction=0.5, **VARIED)
    first = loop.train(config, stored_boxes, quiet, name="first")
    assert rasterised_by(lambda: loop.train(config, stored_boxes, quiet, name="second")) == 0
    assert_same_run(first, Run.open(config.runs / "second"))
    # the test split is new, and then no more
    tests = 2 * len(stored_boxes.split("test"))
    assert rasterised_by(lambda: evaluate_run(first, stored_boxes, EvalConfig(), quiet)) >= tests
    shapes = fixed_views.with_kept_views(stored_boxes, config, quiet, CPU)
    batch, kind = fixed_views.load_batch(shapes, stored_boxes.split("test"), "auto")
    model = load_model(first)
    assert rasterised_by(lambda: model(batch, Look.evaluation(config, len(batch), kind))) == 0


def test_colours_and_lights_vary_from_epoch_to_epoch(settings, stored_boxes, quiet, monkeypatch):
    pictures: list[torch.Tensor] = []
    monkeypatch.setattr(loop.watch, "check_something_is_seen", lambda images, mean: None)
    real = loop.learner.Learner.forward

    def forward(self: Any, *args: Any) -> Any:
        loss, logits, images = real(self, *args)
        pictures.append(images)
        return loss, logits, images

    monkeypatch.setattr(loop.learner.Learner, "forward", forward)
    loop.train(settings(views="fixed", batch_size=8, val_fraction=0, **VARIED), stored_boxes, quiet)
    hues = [images.mean(dim=(1, 3, 4)) for images in pictures]
    assert len(hues) == 2
    distances = torch.cdist(*hues)
    assert (distances > 1e-4).all()  # every shape looks different from all of the other epoch


def test_a_gpu_that_draws_keeps_no_views(settings, stored_boxes, quiet, monkeypatch):
    monkeypatch.setattr(fixed_views, "drawing_device", lambda wanted: torch.device("cuda", 0))
    assert fixed_views.with_kept_views(stored_boxes, settings(views="fixed"), quiet, CPU) is stored_boxes


@pytest.mark.parametrize("views", ["jittered", "random", "learned-circular", "learned-spherical", "learned-direct"])
def test_views_that_move_are_left_alone(views, settings, stored_boxes, quiet):
    config = settings(views=views)
    assert fixed_views.with_kept_views(stored_boxes, config, quiet, CPU) is stored_boxes
    loop.train(config, stored_boxes, quiet)
    assert stored_boxes.store.sizes()["views"].files == 0


def test_points_are_left_alone(settings, stored_boxes, quiet):
    loop.train(settings(views="fixed", render="points"), stored_boxes, quiet)
    assert stored_boxes.store.sizes()["views"].files == 0


def test_damaged_views_are_made_again_and_that_is_said(settings, stored_boxes, capsys):
    config = settings(views="fixed", val_fraction=0.5, **VARIED)
    first = loop.train(config, stored_boxes, Console(quiet=True), name="first")
    files = sorted((stored_boxes.store.root / "views").rglob("*.npz"))
    whole = files[0].read_bytes()
    files[0].write_bytes(whole[: len(whole) // 2])
    files[1].write_bytes(b"no views at all")
    files[2].write_bytes(whole)  # another shape's
    capsys.readouterr()
    drawn = rasterised_by(lambda: loop.train(config, stored_boxes, Console(), name="second"))
    assert drawn == 3 * config.num_views
    assert capsys.readouterr().err.count("damaged; they are made again") == 3
    assert_same_run(first, Run.open(config.runs / "second"))
    assert files[0].read_bytes() == whole
    assert rasterised_by(lambda: loop.train(config, stored_boxes, Console(quiet=True), name="third")) == 0


@pytest.mark.parametrize("trouble", ["not writable", "disk nearly full"])
def test_a_store_that_takes_nothing_is_said_once_and_memory_serves(
    trouble, settings, stored_boxes, capsys, monkeypatch
):
    if trouble == "not writable":
        stored_boxes.store.root.write_bytes(b"a file where the folder should be")
    else:
        monkeypatch.setattr(views_file, "LEAVE_FREE", 1 << 62)
    seen = rasterised_after_each_epoch(monkeypatch)
    config = settings(views="fixed", epochs=3, val_fraction=0.5, **VARIED)
    run = loop.train(config, stored_boxes, Console(), name="unwritten")
    assert run.finished and seen[1:] == [seen[0]] * 2
    assert " ".join(capsys.readouterr().err.split()).count("views are not stored") == 1
