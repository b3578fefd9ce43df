"""Whatever stops the work, the same command goes on, and the store ends up byte for byte the same."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from toys import QUIET, SETTINGS, ReadBox, reads, toys, tree_bytes

from mvtn_cli.core.preprocess import mapping, prepare
from mvtn_cli.core.shapes import Shape
from mvtn_cli.core.store import Store
from mvtn_cli.errors import Interrupted

SCRIPT = """
import sys
sys.path.insert(0, {toys!r})
from toys import QUIET, SETTINGS, toys
from mvtn_cli.core.preprocess import mapping, prepare
from mvtn_cli.core.store import Store
from mvtn_cli.errors import Interrupted
mapping.START_UP_S = 0.0
try:
    prepare(toys({count}, {log!r}, delay_s={delay}), SETTINGS, Store({root!r}), QUIET, workers={workers})
except Interrupted as error:
    print(error.message, "|", error.hint)
    sys.exit(130)
"""
COUNT = 24


def unbroken(tmp_path: Path) -> dict[str, bytes]:
    store = Store(tmp_path / "unbroken")
    prepare(toys(COUNT, tmp_path / "unbroken.log"), SETTINGS, store, QUIET, workers=1)
    return tree_bytes(store.root)


def start(tmp_path: Path, *, delay: float = 0.1, workers: int = 1) -> subprocess.Popen[str]:
    script = SCRIPT.format(
        toys=str(Path(__file__).parent),
        count=COUNT,
        log=str(tmp_path / "log"),
        delay=delay,
        root=str(tmp_path / "store"),
        workers=workers,
    )
    return subprocess.Popen(
        [sys.executable, "-c", script],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def wait_for_shapes(root: Path, count: int) -> None:
    deadline = time.monotonic() + 60
    while len(list(root.glob("shapes/*/[!.]*.npz"))) < count:
        assert time.monotonic() < deadline, "the process stored nothing"
        time.sleep(0.01)


def go_on(tmp_path: Path) -> None:
    """Run the same again and see that only the missing shapes are made."""
    store, log = Store(tmp_path / "store"), tmp_path / "log2"
    there = len(tree_bytes(store.root))
    assert 0 < there < COUNT
    _, summary = prepare(toys(COUNT, log), SETTINGS, store, QUIET, workers=1)
    assert (summary.kept, summary.reused, reads(log)) == (COUNT, there, COUNT - there)
    assert tree_bytes(store.root) == unbroken(tmp_path)


def test_a_killed_process_leaves_a_store_that_the_next_run_completes(tmp_path):
    process = start(tmp_path)
    wait_for_shapes(tmp_path / "store", 3)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    go_on(tmp_path)


@pytest.mark.parametrize("workers", [1, 2])
def test_ctrl_c_stops_all_processes_quietly_and_says_how_far_it_came(tmp_path, workers):
    process = start(tmp_path, workers=workers, delay=0.3)
    wait_for_shapes(tmp_path / "store", 3)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to every process of the group
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130, err
    assert f"of {COUNT} shapes are done | the same command goes on" in out
    assert err == ""
    go_on(tmp_path)


class Interrupting(ReadBox):
    """Ctrl-C in the middle of the tenth shape."""

    def __call__(self) -> Shape:
        if self.number == 10:
            raise KeyboardInterrupt
        return super().__call__()


def test_an_interrupted_run_remembers_what_it_did(tmp_path):
    store = Store(tmp_path / "store")
    with pytest.raises(Interrupted, match=f"10 of {COUNT} shapes are done"):
        prepare(toys(COUNT, tmp_path / "log", read=Interrupting), SETTINGS, store, QUIET, workers=1)
    assert len(list((store.root / "datasets").glob("*.json"))) == 1
    go_on(tmp_path)


def test_two_processes_at_once_share_the_work_and_do_nothing_twice(tmp_path):
    processes = [start(tmp_path, delay=0.02) for _ in range(2)]
    for process in processes:
        _, err = process.communicate(timeout=60)
        assert process.returncode == 0, err
    assert tree_bytes(tmp_path / "store") == unbroken(tmp_path)
    assert reads(tmp_path / "log") == COUNT
    assert not list((tmp_path / "store").rglob("*.tmp"))


def test_work_goes_to_other_processes_only_when_it_takes_longer_than_starting_them(tmp_path, monkeypatch):
    monkeypatch.setattr(mapping, "_map_in_processes", _forbidden)
    prepare(toys(5, tmp_path / "log"), SETTINGS, Store(tmp_path / "s"), QUIET, workers=2)
    monkeypatch.setattr(mapping, "START_UP_S", 0.0)
    with pytest.raises(AssertionError, match="other processes"):
        prepare(toys(5, tmp_path / "log"), SETTINGS, Store(tmp_path / "t"), QUIET, workers=2)


def _forbidden(*_arguments):
    raise AssertionError("other processes were started")
