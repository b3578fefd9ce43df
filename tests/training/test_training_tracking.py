"""TensorBoard's event files say what metrics.jsonl says, also after an interruption."""

from __future__ import annotations

import sys

import pytest

from mvtn_cli.core.training.loop import train
from mvtn_cli.core.training.tracking import open_log
from mvtn_cli.errors import Interrupted, MvtnError


@pytest.fixture
def tensorboard():
    """The reader of event files."""
    pytest.importorskip("tensorboard", reason="the extra tensorboard is not installed")


def read_events(run) -> dict[str, list[tuple[int, float]]]:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(run.path / "tensorboard")).Reload()
    return {tag: [(event.step, event.value) for event in events.Scalars(tag)] for tag in events.Tags()["scalars"]}


def numbers(run) -> dict[str, list[tuple[int, float]]]:
    """The same from metrics.jsonl."""
    told: dict[str, list[tuple[int, float]]] = {}
    for record in run.metrics():
        for name, value in record.items():
            if name != "epoch" and isinstance(value, int | float):
                told.setdefault(name, []).append((record["epoch"], pytest.approx(value, rel=1e-6)))
    return told


@pytest.mark.usefixtures("tensorboard")
def test_an_interrupted_training_has_each_epoch_once(settings, boxes, quiet):
    config = settings(views="fixed", epochs=3, log="tensorboard", name="logged")
    steps = iter([False] * 2 + [True])  # two steps an epoch: in the middle of the second
    with pytest.raises(Interrupted):
        train(config, boxes, quiet, stop=lambda: next(steps))
    run = train(config, boxes, quiet)
    events = read_events(run)
    assert len(list((run.path / "tensorboard").iterdir())) == 2
    assert [step for step, _ in events["train_loss"]] == [1, 2, 3]
    assert events == numbers(run)


@pytest.mark.usefixtures("tensorboard")
def test_an_epoch_that_comes_again_takes_the_place_of_the_first(settings, boxes, quiet):
    run = train(settings(views="fixed", epochs=2, log="tensorboard"), boxes, quiet)
    run.cut_metrics(1)
    again = {"epoch": 2, "train_loss": 0.125, "val_loss": None, "stage": "shapes"}
    run.append_metrics(again)
    with open_log("tensorboard", run) as track:
        track(again)
    assert read_events(run)["train_loss"][1:] == [(2, 0.125)]
    assert [step for step, _ in read_events(run)["val_loss"]] == [1]


@pytest.mark.usefixtures("tensorboard")
def test_a_log_that_is_asked_for_later_begins_with_the_epochs_that_are_done(settings, boxes, quiet):
    config = settings(views="fixed", epochs=2, name="late")
    steps = iter([False] * 2 + [True])
    with pytest.raises(Interrupted):
        train(config, boxes, quiet, stop=lambda: next(steps))
    run = train(config.model_copy(update={"log": "tensorboard"}), boxes, quiet)  # no other training for that
    assert [step for step, _ in read_events(run)["val_accuracy"]] == [1, 2]


def test_without_the_extra_nothing_is_begun(settings, boxes, quiet, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    config = settings(views="fixed", log="tensorboard")
    with pytest.raises(MvtnError, match="needs the package tensorboard") as refused:
        train(config, boxes, quiet)
    assert "pip install mvtn[tensorboard]" in refused.value.hint and not config.runs.exists()


def test_without_a_log_there_is_no_folder_for_it(settings, boxes, quiet):
    run = train(settings(views="fixed", epochs=1), boxes, quiet)
    assert not (run.path / "tensorboard").exists()
