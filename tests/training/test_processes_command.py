"""`torchrun -m mvtn_cli train` and `mvtn train --devices 2`, as a user has them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import Folder, finish

from mvtn_cli.errors import ExitCode

SHAPES = "builtin:shapes?train=13&test=5"
TINY = (
    *("--image-size", 16, "--num-views", 2, "--encoder-points", 64, "--batch-size", 5, "--val-fraction", 0),
    *("--supersample", 1, "--device", "cpu", "--name", "mine"),
)
PATIENCE = 120  # seconds

needs_pgrep = pytest.mark.skipif(sys.platform == "win32", reason="finds processes with pgrep")


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return Folder(tmp_path / "work")


def wait_for_epochs(folder: Folder, count: int, process: subprocess.Popen[bytes]) -> None:
    """Wait until so many epochs are written down."""
    metrics, begun = folder.path / "runs" / "mine" / "metrics.jsonl", time.monotonic()
    while not metrics.exists() or len(metrics.read_text().splitlines()) < count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() - begun < PATIENCE
        time.sleep(0.05)


def test_torchrun_trains_judges_every_shape_once_and_answers_once(folder: Folder):
    """Thirteen shapes to train on and five to test with, none of which two processes can halve."""
    launch = ("python", "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", 2, "-m", "mvtn_cli")
    ended = folder.run(*launch, "train", SHAPES, *TINY, "--batch-size", "auto", "--epochs", 1, "--json")
    assert ended.code == ExitCode.OK, ended.err
    assert ended.document["test"]["count"] == 5 and ended.document["run"] == os.path.join("runs", "mine")
    assert (
        ended.err.count("batch size 32 (auto)") == ended.err.count("epoch 1/1") == 1
        and ended.err.count("trained runs") == 1
    )
    assert [path.name for path in (folder.path / "runs").iterdir()] == ["mine"]
    assert len((folder.path / "runs" / "mine" / "metrics.jsonl").read_text().splitlines()) == 1


@needs_pgrep
def test_killed_and_interrupted_processes_end_together_and_one_process_finishes(folder: Folder):
    train = ("train", SHAPES, *TINY, "--epochs", 20)
    process = folder.start("mvtn", *train, "--devices", 2)
    wait_for_epochs(folder, 2, process)
    second = subprocess.run(["pgrep", "-P", str(process.pid)], capture_output=True, text=True).stdout.split()[1]
    os.kill(int(second), signal.SIGKILL)
    killed = finish(process)
    assert killed.code == ExitCode.FAILED
    message, hint = killed.error
    assert message == "process 2 of 2 was killed by SIGKILL, and the others were stopped"
    assert "same command" in hint

    process = folder.start("mvtn", *train, "--devices", 2)
    wait_for_epochs(folder, 4, process)
    process.send_signal(signal.SIGINT)
    stopped = finish(process)
    assert stopped.code == ExitCode.INTERRUPTED
    message, hint = stopped.error
    assert "saved in runs/mine" in message and "going on with the unfinished run" in stopped.err
    assert subprocess.run(["pgrep", "-P", str(process.pid)], capture_output=True).stdout == b""

    finished = folder.mvtn(*train, "--json")
    assert finished.code == ExitCode.OK, finished.err
    lines = (folder.path / "runs" / "mine" / "metrics.jsonl").read_text().splitlines()
    assert [json.loads(line)["epoch"] for line in lines] == list(range(1, 21))


def test_an_error_is_said_once(folder: Folder):
    ended = folder.mvtn("train", SHAPES, *TINY, "--backbone", "resnet81", "--devices", 2)
    assert ended.code == ExitCode.USAGE and "resnet18" in ended.err
    assert ended.error[0].startswith("unknown backbone")
    assert not (folder.path / "runs").exists()


def test_a_comparison_refuses_several_processes(folder: Folder):
    ended = folder.mvtn("train", SHAPES, "--compare", "fixed,learned", "--devices", 2)
    assert ended.code == ExitCode.USAGE and "--compare" in ended.error[0]


def test_a_device_that_can_not_be_shared_is_said_once_and_before_anything_else(folder: Folder):
    ended = folder.mvtn("train", SHAPES, "--devices", 2, "--device", "cuda:9")
    assert ended.code == ExitCode.USAGE and ended.err.count("error: ") == 1
    assert "preprocess" not in ended.err
