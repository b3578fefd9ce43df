"""However a training is stopped, it ends as if it had not been."""

from __future__ import annotations

import json
import re
import shlex
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
from demonstration import Demo
from processes import PATIENCE, Ended, Folder, finish


def metrics(runs: Path) -> list[dict[str, Any]]:
    """The lines of the only run's metrics.jsonl, without the time they took."""
    lines = [json.loads(line) for path in runs.glob("*/metrics.jsonl") for line in path.read_text().splitlines()]
    return [{key: value for key, value in line.items() if key != "seconds"} for line in lines]


def stop(folder: Folder, number: signal.Signals, *words: str) -> Ended:
    """Start a training and send it a signal once its first epoch is written down."""
    process = folder.start("mvtn", *words)
    try:
        _wait_for_first_epoch(folder, process)
    finally:
        process.send_signal(number)
    return finish(process)


def _wait_for_first_epoch(folder: Folder, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not any(path.read_text().endswith("\n") for path in folder.path.glob("*/*/metrics.jsonl")):
        assert process.poll() is None, "the training ended before its first epoch"
        assert time.monotonic() < deadline, "the training never came to its first epoch"
        time.sleep(0.005)


def test_ctrl_c_saves_in_the_middle_of_an_epoch_and_the_command_it_names_goes_on(folder: Folder, demo: Demo):
    stopped = stop(folder, signal.SIGINT, "train", "--runs", "my runs")
    assert stopped.code == 130 and stopped.out == ""
    message, hint = stopped.error
    told = re.search(r"stopped in epoch (\d+) after step (\d+) of 6; saved in my runs/(\S+)", message)
    assert told and int(told[1]) == len(metrics(folder.path / "my runs")) + 1
    named = shlex.split(hint[hint.index("mvtn train") :])
    gone_on = folder.run(*named)
    assert gone_on.code == 0 and f"going on with the unfinished run my runs/{told[3]}" in gone_on.err
    assert len(re.findall(r"^epoch ", gone_on.err, re.M)) == 8 - int(told[1]) + 1  # none is done twice
    assert metrics(folder.path / "my runs") == metrics(demo.run.parent)
    assert not (folder.path / "runs").exists()


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL on this system")
def test_after_a_kill_the_same_command_goes_on_to_the_same_end(folder: Folder, demo: Demo):
    assert stop(folder, signal.SIGKILL, "train").code == -signal.SIGKILL
    gone_on = folder.mvtn("train", "--json")
    assert gone_on.code == 0 and "going on with the unfinished run" in gone_on.err
    assert metrics(folder.path / "runs") == metrics(demo.run.parent)
    assert gone_on.document["test"] == demo.train.document["test"]
    weights = [next(runs.glob("*/last.safetensors")).read_bytes() for runs in (folder.path / "runs", demo.run.parent)]
    assert weights[0] == weights[1]
