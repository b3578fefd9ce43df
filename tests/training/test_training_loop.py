"""The training loop: what it learns, and that nothing which happens on the way spoils it."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from mvtn_cli.console import Console
from mvtn_cli.core.networks import recogniser
from mvtn_cli.core.networks.recogniser import build_recogniser
from mvtn_cli.core.training import learner, loop, ready
from mvtn_cli.core.training.checkpoint import read_weights
from mvtn_cli.core.training.find import begun_batch_size, dataset_word
from mvtn_cli.core.training.loop import train
from mvtn_cli.core.training.run import Run
from mvtn_cli.errors import Interrupted, MvtnError, UsageError


def stop_after(steps: int) -> Callable[[], bool]:
    """A question that says yes the n-th time it is asked."""
    left = iter(range(steps - 1, -1, -1))
    return lambda: next(left) == 0


def weights_of(run: Run, checkpoint: str = "last") -> dict[str, torch.Tensor]:
    return read_weights(run.weights_path(checkpoint))


def same(a: dict[str, torch.Tensor], b: dict[str, torch.Tensor]) -> bool:
    return a.keys() == b.keys() and all(torch.equal(a[name], b[name]) for name in a)


def numbers(run: Run) -> list[dict[str, Any]]:
    """The lines of metrics.jsonl without the time they took."""
    return [{key: value for key, value in line.items() if key != "seconds"} for line in run.metrics()]


def spoil(monkeypatch: pytest.MonkeyPatch, network: str, calls: Iterable[int]) -> None:
    """Make one gradient of the selector or the network NaN in these backward passes, counted from 0."""
    bad = set(calls)

    def build(*args: Any, **kwargs: Any) -> recogniser.Recogniser:
        model = build_recogniser(*args, **kwargs)
        count = iter(range(10**6))
        weight = list(getattr(model, network).parameters())[-1]
        weight.register_hook(lambda gradient: gradient * (math.nan if next(count) in bad else 1.0))
        return model

    monkeypatch.setattr(loop, "build_recogniser", build)


# What it learns


def test_it_learns_eight_shapes_by_heart(settings, boxes, quiet):
    run = train(settings(views="fixed", epochs=25, num_views=3, lr=0.01), boxes, quiet)
    last = run.metrics()[-1]
    assert last["train_accuracy"] == 1.0 and last["train_loss"] < 0.1
    assert run.finished and run.info["state"] == "finished"


@pytest.mark.parametrize("views", ["learned-circular", "learned-spherical", "learned-direct"])
def test_all_weights_of_a_learned_selection_change(views, settings, boxes, quiet):
    config = settings(views=views)
    run = train(config, boxes, quiet)
    before, after = build_recogniser(config, 4).state_dict(), weights_of(run)
    learnt = [name for name in before if name.startswith("selector.")]
    assert learnt and not any(torch.equal(before[name], after[name]) for name in learnt)
    assert all(line["view_grad_norm"] > 0 for line in run.metrics())


def test_fixed_views_have_no_viewpoint_network(settings, boxes, quiet):
    run = train(settings(views="fixed"), boxes, quiet)
    assert not any(name.startswith("selector.") for name in weights_of(run))
    assert {(line["view_grad_norm"], line["view_saturation"]) for line in run.metrics()} == {(None, None)}


def test_a_frozen_backbone_keeps_weights_and_statistics(settings, boxes, quiet):
    config = settings(freeze_backbone=True)
    before, after = build_recogniser(config, 4).state_dict(), weights_of(train(config, boxes, quiet))
    frozen = [name for name in before if name.startswith("network.backbone.")]
    assert all(torch.equal(before[name], after[name]) for name in frozen)
    assert not torch.equal(before["network.head.classifier.weight"], after["network.head.classifier.weight"])


def test_a_batch_size_left_open_is_that_of_the_unfinished_run(settings, boxes, quiet):
    config = settings(batch_size=3)
    assert begun_batch_size(settings(), boxes) is None
    with pytest.raises(Interrupted):
        loop.train(config, boxes, quiet, stop=lambda: True, name="mine")
    assert begun_batch_size(settings(batch_size=32), boxes) == 3
    assert begun_batch_size(settings(batch_size=32, name="mine"), boxes) == 3
    assert begun_batch_size(settings(batch_size=32, name="other"), boxes) is None
    assert begun_batch_size(settings(batch_size=32, seed=1), boxes) is None
    (config.runs / "foreign").mkdir()
    (config.runs / "foreign" / "run.json").write_text("{}")
    assert begun_batch_size(settings(batch_size=32), boxes) == 3
    loop.train(config, boxes, quiet, name="mine")
    assert begun_batch_size(settings(batch_size=32), boxes) is None  # it is finished


def test_a_last_batch_of_one_shape_joins_the_one_before(settings, boxes, quiet, monkeypatch):
    sizes = []
    load = ready.load_batch
    monkeypatch.setattr(ready, "load_batch", lambda s, i, r: (sizes.append(len(i)), load(s, i, r))[1])
    train(settings(batch_size=7, epochs=1), boxes, quiet)
    assert sizes == [8]


# The known view, the numbers and the files


def test_metrics_have_the_error_to_a_known_view(settings, boxes, quiet):
    boxes.known_view = True
    boxes.records = [type(r)(r.name, r.label, r.split, known_azimuth_deg=-170.0) for r in boxes.records]
    run = train(settings(views="fixed", num_views=1, azimuth=150.0, epochs=1), boxes, quiet)
    assert run.metrics()[0]["view_error_deg"] == pytest.approx(40.0, abs=1e-3)


def test_the_run_keeps_what_the_cameras_saw_at_the_start_and_at_the_best(settings, boxes, quiet):
    run = train(settings(epochs=3), boxes, quiet)
    model = build_recogniser(run.config, 4)
    for when in ("start", "best"):
        with np.load(run.path / f"views_{when}.npz") as views:
            assert views["images"].shape == (4, 2, 3, 16, 16) and views["images"].dtype == np.uint8
            assert views["images"].max() > 50 and views["azimuth"].shape == (4, 2)
            assert views["names"].tolist() == [boxes.records[i].name for i in boxes.split("val")]
            if when == "start":
                assert np.allclose(views["azimuth"], model.selector.start_azimuth.numpy())
            else:
                assert not np.allclose(views["azimuth"], model.selector.start_azimuth.numpy())


def test_best_is_the_epoch_with_the_highest_validation_accuracy(settings, boxes, quiet):
    run = train(settings(epochs=6, lr=0.01), boxes, quiet)
    lines = run.metrics()
    winner = max(lines, key=lambda line: (line["val_accuracy"], -line["val_loss"]))
    assert run.best["epoch"] == winner["epoch"] and run.best["val_accuracy"] == winner["val_accuracy"]
    assert same(weights_of(run, "best"), weights_of(run, "last")) == (winner["epoch"] == 6)


def test_choosing_on_the_test_split_is_said(settings, boxes, quiet):
    run = train(settings(select="test", epochs=1), boxes, quiet)
    assert any("test split" in warning for warning in quiet.warnings)
    assert run.info["select"] == "test" and run.info["selected_by"] == "the test split"


# Going on


def test_stopped_at_step_7_and_resumed_equals_unbroken_bit_for_bit(settings, boxes, quiet, tmp_path):
    varied = {"epochs": 5, "color": "random", "light": "random", "explore": 30.0, "clip": 0.5}
    unbroken = train(settings(**varied, runs=tmp_path / "unbroken"), boxes, quiet)
    with pytest.raises(Interrupted, match="epoch 4 after step 1 of 2") as stopped:
        train(settings(**varied), boxes, quiet, stop=stop_after(7))
    (run,) = Run.all(tmp_path / "runs")
    assert run.info["state"] == "interrupted" and len(run.metrics()) == 3
    assert str(run.config_path) in stopped.value.hint
    assert train(settings(**varied), boxes, quiet) == run
    assert same(weights_of(run), weights_of(unbroken)) and same(weights_of(run, "best"), weights_of(unbroken, "best"))
    assert numbers(run) == numbers(unbroken) and run.best == unbroken.best


def test_stopped_after_every_single_step_it_still_equals_the_unbroken_run(settings, boxes, quiet, tmp_path):
    unbroken = train(settings(runs=tmp_path / "unbroken", label_smoothing=0.1), boxes, quiet)
    for _ in range(4):
        with pytest.raises(Interrupted):
            train(settings(label_smoothing=0.1), boxes, quiet, stop=lambda: True)
    run = train(settings(label_smoothing=0.1), boxes, quiet, stop=lambda: True)
    assert same(weights_of(run), weights_of(unbroken)) and numbers(run) == numbers(unbroken)


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import conftest
from mvtn_cli.config import TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.training import loop
loop.SAVE_EVERY_SECONDS = 0.0
left = iter(range(4, -1, -1))
def kill():
    if next(left) == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return False
config = TrainConfig.model_validate_json(sys.argv[2])
loop.train(config, conftest.make_boxes(), Console(quiet=True), stop=kill)
"""


def test_killed_and_started_again_it_has_the_same_next_epoch(settings, boxes, quiet, tmp_path):
    config = settings(epochs=4, color="random")
    here, environment = (
        Path(__file__).parent,
        {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(map(str, (Path(loop.__file__).parents[3], Path(__file__).parents[1]))),
        },
    )
    command = [sys.executable, "-c", KILLED, str(here), config.model_dump_json()]
    killed = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    (run,) = Run.all(tmp_path / "runs")
    assert run.info["state"] == "running" and len(run.metrics()) == 2
    assert train(config, boxes, quiet) == run
    unbroken = train(settings(epochs=4, color="random", runs=tmp_path / "unbroken"), boxes, quiet)
    assert numbers(run)[2]["train_loss"] == numbers(unbroken)[2]["train_loss"]
    assert numbers(run) == numbers(unbroken) and same(weights_of(run), weights_of(unbroken))


def test_lines_newer_than_the_state_are_cut(settings, boxes, quiet):
    with pytest.raises(Interrupted):
        train(settings(epochs=3), boxes, quiet, stop=stop_after(3))
    run = Run.latest(settings().runs)
    with run.metrics_path.open("a") as file:
        file.write('{"epoch": 2, "train_loss": 99}\n{"epoch": 3, "tr')
    train(settings(epochs=3), boxes, quiet)
    assert [line["epoch"] for line in run.metrics()] == [1, 2, 3]
    assert all(line["train_loss"] < 99 for line in run.metrics())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_finishes_the_step_saves_and_says_how_to_go_on(number, settings, boxes, quiet):
    asked = iter(range(100))

    def interrupt() -> bool:
        if next(asked) == 2:
            os.kill(os.getpid(), number)
        return False

    before = signal.getsignal(number)
    with pytest.raises(Interrupted, match="epoch 2 after step 1 of 2") as stopped:
        train(settings(), boxes, quiet, stop=interrupt)
    assert stopped.value.exit_code == 130
    folder = settings().runs  # is not in config.toml, so that the command has to name it
    command = f"mvtn train --config {folder}/boxes-learned-spherical-2v-s0/config.toml --runs {folder}"
    assert stopped.value.hint == f"go on with the same command, or: {command}"
    assert signal.getsignal(number) is before
    assert len(train(settings(), boxes, quiet).metrics()) == 2


def test_a_second_signal_ends_at_once(settings, boxes, quiet):
    def interrupt_twice() -> bool:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        return False

    with pytest.raises(KeyboardInterrupt):
        train(settings(), boxes, quiet, stop=interrupt_twice)
    assert not Run.all(settings().runs)[0].state_path.exists()


def test_a_signal_while_an_epoch_is_judged_loses_nothing(settings, boxes, quiet, tmp_path, monkeypatch):
    judge_epoch = loop.judge.judge_epoch

    def interrupted_judge(*args: Any) -> dict[str, Any]:
        monkeypatch.setattr(loop.judge, "judge_epoch", judge_epoch)
        os.kill(os.getpid(), signal.SIGINT)
        return judge_epoch(*args)

    monkeypatch.setattr(loop.judge, "judge_epoch", interrupted_judge)
    with pytest.raises(Interrupted, match="epoch 1 after step 2 of 2"):
        train(settings(), boxes, quiet)
    run = train(settings(), boxes, quiet)
    assert numbers(run) == numbers(train(settings(runs=tmp_path / "unbroken"), boxes, quiet))


# Numbers that are not finite, and clipping


@pytest.mark.parametrize(("network", "name"), [("selector", "viewpoint network"), ("network", "classifier")])
def test_a_step_with_a_bad_gradient_is_left_out_for_both_networks_and_named(
    network, name, settings, boxes, quiet, monkeypatch
):
    with pytest.raises(Interrupted):
        train(settings(), boxes, quiet, stop=stop_after(3))
    run = Run.latest(settings().runs)
    before = weights_of(run)
    spoil(monkeypatch, network, [0])  # the second step of epoch 2: no judging settles statistics in between
    with pytest.raises(Interrupted):
        train(settings(), boxes, quiet, stop=stop_after(1))
    assert same(weights_of(run), before)
    spoil(monkeypatch, network, [])
    run = train(settings(), boxes, quiet)
    assert [line["skipped_steps"] for line in run.metrics()] == [0, 1]
    (warning,) = quiet.warnings
    assert f"gradient of the {name}" in warning and "epoch 2, batch 2 (" in warning and "/train" in warning
    assert all(torch.isfinite(w).all() for w in weights_of(run).values())


def test_a_picture_of_nan_leaves_no_trace_in_the_statistics_of_batchnorm(settings, boxes, quiet, monkeypatch):
    render, count = recogniser.render, iter(range(10**6))

    def spoilt(*args: Any, **kwargs: Any) -> Any:
        images = render(*args, **kwargs)
        if torch.is_grad_enabled() and next(count) == 1:
            images.rgb.data[0, 0, 0, 0, 0] = math.nan
        return images

    monkeypatch.setattr(recogniser, "render", spoilt)
    run = train(settings(), boxes, quiet)
    assert [line["skipped_steps"] for line in run.metrics()] == [1, 0]
    assert "the loss is not finite in epoch 1, batch 2" in quiet.warnings[0]
    assert all(torch.isfinite(w).all() for w in weights_of(run).values())


def test_many_bad_steps_in_a_row_stop_the_run_with_a_good_checkpoint(settings, boxes, quiet, monkeypatch):
    config = settings(epochs=4, max_bad_steps=3)
    spoil(monkeypatch, "selector", [1, 3, 4, 5])
    with pytest.raises(MvtnError, match="3 steps in a row") as stopped:
        train(config, boxes, quiet)
    assert stopped.value.code == "train.not-finite"
    run = Run.latest(config.runs)
    assert run.info["state"] == "interrupted" and len(quiet.warnings) == 4
    assert all(torch.isfinite(w).all() for w in weights_of(run).values())
    monkeypatch.setattr(loop, "build_recogniser", build_recogniser)
    assert [line["skipped_steps"] for line in train(config, boxes, quiet).metrics()] == [1, 1, 2, 0]


class PlainDescent(torch.optim.SGD):
    """Moves by lr times the gradient, so that a change of weights shows the gradient that the step took."""

    moved: list[float]

    def __init__(self, groups: list[dict[str, Any]], weight_decay: float) -> None:
        super().__init__(groups, lr=1.0)

    def step(self, closure: Any = None) -> None:
        parameters = [p for group in self.param_groups for p in group["params"]]
        before = [p.detach().clone() for p in parameters]
        super().step()
        change = torch.stack([(p.detach() - b).norm() for p, b in zip(parameters, before, strict=True)]).norm()
        self.moved = [*getattr(self, "moved", []), float(change) / self.param_groups[0]["lr"]]


def test_the_gradient_is_clipped_before_the_step_and_of_the_viewpoint_network_alone(
    settings, boxes, quiet, monkeypatch
):
    """Fails for a clip after the step (the step would take the whole gradient), and for none."""
    built: list[PlainDescent] = []
    monkeypatch.setattr(
        learner, "AdamW", lambda *args, **kwargs: built.append(PlainDescent(*args, **kwargs)) or built[-1]
    )
    run = train(settings(clip=0.01, epochs=2, lr=1e-3, views_lr=1e-3), boxes, quiet)
    classifier, viewpoints = (optimiser.moved for optimiser in built)
    assert len(viewpoints) == 4 and viewpoints == pytest.approx([0.01] * 4, rel=0.02)
    assert min(classifier) > 0.05
    assert all(line["view_grad_norm"] > 0.02 for line in run.metrics())  # as it was before clipping


# Which run is meant


def test_a_finished_run_is_left_alone_and_a_new_one_begun(settings, boxes, quiet):
    first = train(settings(epochs=1), boxes, quiet)
    before = {path: path.stat().st_mtime_ns for path in first.path.iterdir()}
    second = train(settings(epochs=1), boxes, quiet)
    assert (first.name, second.name) == ("boxes-learned-spherical-2v-s0", "boxes-learned-spherical-2v-s0-2")
    assert {path: path.stat().st_mtime_ns for path in first.path.iterdir()} == before
    assert same(weights_of(first), weights_of(second))


@pytest.mark.parametrize(
    ("spec", "word"),
    [
        ("builtin:shapes?train=9", "shapes"),
        ("folder:/data/Größere Möbel", "grössere-möbel"),
        ("/data/o\u0308l_lampen", "öl-lampen"),  # as macOS spells it
        ("/data/части", "части"),
        ("/data/...", "data"),
    ],
)
def test_a_run_is_named_after_its_data_set_in_any_language(spec: str, word: str):
    assert dataset_word(spec) == word


def test_other_settings_begin_another_run_beside_an_unfinished_one(settings, boxes, quiet):
    with pytest.raises(Interrupted):
        train(settings(), boxes, quiet, stop=stop_after(1))
    train(settings(lr=0.01, epochs=1), boxes, quiet)
    assert [run.finished for run in Run.all(settings().runs)] == [False, True]
    train(settings(threads=None, workers=2, device="auto"), boxes, quiet)  # what computes the same goes on
    assert [run.finished for run in Run.all(settings().runs)] == [True, True]


def test_a_named_run_refuses_changed_settings_and_names_each(settings, boxes, quiet):
    with pytest.raises(Interrupted):
        train(settings(name="mine"), boxes, quiet, stop=stop_after(1))
    boxes.address, changed = "another", settings(name="mine", lr=0.5, explore=10, epochs=9)
    with pytest.raises(UsageError) as refused:
        train(changed, boxes, quiet)
    for told in (
        "lr: 0.003 → 0.5",
        "explore: auto → 10.0",
        "epochs: 2 → 9",
        "dataset: builtin:boxes as it was",
    ):
        assert told in refused.value.message
    assert "batch_size" not in refused.value.message


def test_a_run_that_is_being_trained_is_not_trained_twice(settings, boxes, quiet):
    with pytest.raises(Interrupted):
        train(settings(), boxes, quiet, stop=stop_after(1))
    with Run.latest(settings().runs).lock(), pytest.raises(MvtnError, match="another process"):
        train(settings(), boxes, quiet)


def test_going_on_is_said(settings, boxes, quiet, capsys):
    with pytest.raises(Interrupted):
        train(settings(), boxes, quiet, stop=stop_after(3))
    train(settings(), boxes, Console())
    told = capsys.readouterr().err
    assert "going on with the unfinished run" in told and "(1 epochs done)" in told and "epoch 2/2" in told


def test_the_settings_file_of_a_run_opens_as_the_settings_it_was_begun_with(settings, boxes, quiet):
    config = settings(epochs=1, name="mine", train_limit=6)
    run = train(config, boxes, quiet)
    assert run.config == config.model_copy(update={"dataset": "builtin:boxes", "runs": Path("runs")})
    assert Run.open("mine", config.runs) == run and run.classes == boxes.classes
    with pytest.raises(UsageError, match="did you mean 'mine'"):
        Run.open("mini", config.runs)


def test_a_wrong_backbone_leaves_no_run_behind(settings, boxes, quiet):
    config = settings(backbone="resnet81")
    with pytest.raises(UsageError, match="resnet18"):
        train(config, boxes, quiet)
    assert not list(config.runs.glob("*"))
