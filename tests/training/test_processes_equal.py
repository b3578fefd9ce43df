"""Two processes compute what one does, count each shape once, and end together."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import together
from conftest import make_boxes
from processes import environment, once

from mvtn_cli.console import Console
from mvtn_cli.core.networks.synced import Share
from mvtn_cli.core.training.group import check_one_process
from mvtn_cli.core.training.loop import train
from mvtn_cli.core.training.run import Run
from mvtn_cli.errors import UsageError

PATIENCE = 200  # seconds
SAME = {"rtol": 0.0, "atol": 1e-4}

Reports = tuple[Path, list[dict[str, Any]]]


def run_two(folder: Path) -> Reports:
    """Run `together.py` in two processes; the second one kills itself at the end."""
    folder.mkdir()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    paths = os.pathsep.join(map(str, (Path(together.__file__).parent, Path(__file__).parents[1])))
    common = environment(WORLD_SIZE="2", LOCAL_WORLD_SIZE="2", GROUP_RANK="0", MASTER_ADDR="127.0.0.1")
    common |= {"MASTER_PORT": port, "PYTHONPATH": os.pathsep.join([common["PYTHONPATH"], paths])}
    crew = [
        subprocess.Popen(
            [sys.executable, together.__file__, str(folder)],
            env={**common, "RANK": str(rank), "LOCAL_RANK": str(rank)},
            stdout=subprocess.DEVNULL,
            stderr=(folder / f"rank{rank}.err").open("w"),
        )
        for rank in (0, 1)
    ]
    try:
        codes = [process.wait(PATIENCE) for process in crew]
    finally:
        for process in crew:
            process.kill()
    assert codes == [0, -signal.SIGKILL], "\n".join((folder / f"rank{rank}.err").read_text() for rank in (0, 1))
    return folder, [json.loads((folder / f"rank{rank}.json").read_text()) for rank in (0, 1)]


@pytest.fixture(scope="session")
def two(tmp_path_factory: pytest.TempPathFactory) -> Reports:
    """The folder of two processes, and what each of them reports."""
    return once(tmp_path_factory, "two", run_two)


@pytest.mark.parametrize("name", together.LOSSES)
def test_losses_of_all_steps_are_those_of_one_process(name: str, two: Reports, tmp_path: Path):
    one = together.losses_of(tmp_path, name)
    for report in two[1]:
        both = report["losses"][name]
        assert len(both["steps"]) == len(one["steps"]) and len(one["steps"]) >= (20 if name == "learned" else 4)
        np.testing.assert_allclose([step[0] for step in both["steps"]], [step[0] for step in one["steps"]], **SAME)
        assert [step[1:] for step in both["steps"]] == [list(step[1:]) for step in one["steps"]]
        for line, alone in zip(both["metrics"], one["metrics"], strict=True):
            assert {key for key in line if line[key] is None} == {key for key in alone if alone[key] is None}
            assert line["val_accuracy"] == alone["val_accuracy"]
            assert line["train_loss"] == pytest.approx(alone["train_loss"], abs=1e-4)
            if line["val_loss"] < 2:  # a loss of 7 after a bad start is no measure of rounding
                assert line["val_loss"] == pytest.approx(alone["val_loss"], abs=1e-3)


@pytest.mark.parametrize("name", together.GRADIENTS)
def test_gradients_of_both_networks_are_those_of_one_process(name: str, two: Reports, tmp_path: Path):
    """With every dropout mask, sampled view and statistic drawn or taken over the whole batch."""
    one, (first, second) = together.gradients_of(tmp_path, name), two[1]
    assert first["gradients"][name] == second["gradients"][name] and one.keys() == first["gradients"][name].keys()
    for network, gradient in one.items():
        both = np.array(first["gradients"][name][network])
        assert np.linalg.norm(both - gradient) < 1e-3 * np.linalg.norm(gradient)


@pytest.mark.parametrize("shapes", [5, 1])
@pytest.mark.parametrize("name", together.NORMS)
def test_batch_norm_and_its_gradient_are_those_of_the_whole_batch(name: str, shapes: int, two: Reports):
    """Against torch's own layer; of a single shape the second process has none of its own."""
    one, parts = together.normed(None, name, shapes), [report["normed"][name][str(shapes)] for report in two[1]]
    for key in ("normed", "to_input"):
        both = np.concatenate([part[key] for part in parts if part[key]])
        np.testing.assert_allclose(both, one[key], rtol=1e-4, atol=1e-5)
    for whole, *each in zip(one["to_weights"], *(part["to_weights"] for part in parts), strict=True):
        np.testing.assert_allclose(np.sum(each, 0), whole, rtol=1e-4, atol=1e-5)
    for part in parts:
        for mine, whole in zip(part["statistics"], one["statistics"], strict=True):
            np.testing.assert_allclose(mine, whole, rtol=1e-5)


def test_each_shape_is_judged_once_and_as_by_one_process(two: Reports):
    """Seven shapes in batches of two: three whole batches and one of a single shape for two processes."""
    one = json.loads(json.dumps(together.answers(None)))
    assert one["names"] == [record.name for record in make_boxes().records[:7]] and one["images"][0] == 5
    for report in two[1]:
        assert report["answers"] == one


def test_statistics_settle_as_in_one_process(two: Reports):
    one = together.settled(None)
    for report in two[1]:
        for network, statistics in one.items():
            np.testing.assert_allclose(report["settled"][network], statistics, rtol=1e-3, atol=1e-4)


def test_one_that_is_asked_to_stop_stops_both_after_the_same_step_and_one_process_goes_on(two: Reports, tmp_path: Path):
    folder, reports = two
    for report in reports:
        assert (
            report["stopped"]["kind"] == "Interrupted" and "epoch 2 after step 1 of 2" in report["stopped"]["message"]
        )
    run = Run(folder / "runs" / "stopped")
    assert run.info["state"] == "interrupted" and len(run.metrics()) == 1
    config = together.settings(folder / "runs", name="stopped", epochs=4)
    assert train(config, make_boxes(), Console(quiet=True)) == run
    whole = train(config.model_copy(update={"runs": tmp_path}), make_boxes(), Console(quiet=True))
    for line, alone in zip(run.metrics(), whole.metrics(), strict=True):
        assert line["train_loss"] == pytest.approx(alone["train_loss"], abs=1e-3)


def test_a_bad_gradient_of_one_makes_both_leave_the_step_out(two: Reports):
    first, second = (report["spoilt"] for report in two[1])
    assert [line["skipped_steps"] for line in first] == [1, 0] and first == second
    assert all(np.isfinite(line["train_loss"]) for line in first)


def test_an_error_of_one_is_raised_by_both_before_anything_is_written(two: Reports):
    folder, reports = two
    assert [report["wrong"]["kind"] for report in reports] == ["UsageError"] * 2
    assert not (folder / "runs" / "wrong").exists()


def test_the_first_alone_writes(two: Reports):
    first, second = two[1]
    assert {"state.pt", "metrics.jsonl", "best.safetensors", "run.json"} <= set(first["writes"])
    assert second["writes"] == []


def test_when_one_is_killed_the_other_says_so_and_what_was_saved_goes_on(two: Reports):
    folder, (first, _) = two
    assert first["lost"]["code"] == "train.process-lost" and first["lost"]["state"] == "interrupted"
    assert "another of the 2 processes" in first["lost"]["message"]
    config = together.settings(folder / "runs", name="killed", epochs=4)
    run = train(config, make_boxes(), Console(quiet=True))
    assert run.finished and [line["epoch"] for line in run.metrics()] == [1, 2, 3, 4]


def test_a_group_of_trainings_refuses_several_processes(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("RANK", "0")
    monkeypatch.setenv("WORLD_SIZE", "2")
    with pytest.raises(UsageError, match="a sweep trains with one process"):
        check_one_process("a sweep")
    monkeypatch.setenv("WORLD_SIZE", "1")  # as torchrun says to a single one
    check_one_process("a sweep")


@pytest.mark.parametrize(("total", "size"), [(5, 2), (1, 3), (6, 3), (7, 8)])
def test_shares_of_a_batch_make_it_up(total: int, size: int):
    shares = [Share(total, rank, size) for rank in range(size)]
    owned = [row for share in shares if share.own for row in range(total)[share.rows]]
    assert owned == list(range(total)) and sum(share.weight for share in shares) == pytest.approx(1.0)
    assert max(share.own for share in shares) - min(share.own for share in shares) <= 1
    assert all(share.present == 1 and share.weight == 0 for share in shares if not share.own)
