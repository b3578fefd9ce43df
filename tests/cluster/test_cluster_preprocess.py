"""However many machines, and whatever happens to them: the store ends byte for byte as after a serial run."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from threading import Thread

from dask_processes import PATIENCE, wait_until
from toys import QUIET, SETTINGS, reads, toys, tree_bytes

from mvtn_cli.console import Console
from mvtn_cli.core.datasets import open_dataset
from mvtn_cli.core.preprocess import prepare
from mvtn_cli.core.store import Store

COUNT = 60
SCRIPT = """
import sys
from toys import QUIET, SETTINGS, toys
from mvtn_cli.core.preprocess import prepare
from mvtn_cli.core.store import Store
from mvtn_cli.errors import Interrupted
try:
    prepare(toys({count}, {log!r}, delay_s=0.05), SETTINGS, Store({root!r}), QUIET, scheduler={address!r})
except Interrupted as error:
    print(error.message, "|", error.hint)
    sys.exit(130)
"""


def stored(root: Path) -> int:
    return len(list(root.glob("shapes/*/[!.]*.npz")))


def serial(tmp_path: Path) -> tuple[dict[str, bytes], str]:
    store = Store(tmp_path / "serial")
    prepared, _ = prepare(toys(COUNT, tmp_path / "serial.log"), SETTINGS, store, QUIET, workers=1)
    return tree_bytes(store.root), prepared.address


def test_a_worker_is_killed_in_the_middle_and_the_store_is_that_of_a_serial_run(cluster, tmp_path):
    store, log = Store(tmp_path / "store"), tmp_path / "log"

    def kill() -> None:
        wait_until(lambda: stored(store.root) >= 8, "the first shapes")
        cluster.kill_worker()

    killer = Thread(target=kill)
    killer.start()
    dataset = toys(COUNT, log, delay_s=0.05)
    prepared, summary = prepare(dataset, SETTINGS, store, QUIET, scheduler=cluster.address)
    killer.join()
    assert len(cluster.workers) == 1
    assert (tree_bytes(store.root), prepared.address) == serial(tmp_path)
    assert [record.name for record in prepared.records] == [item.name for item in dataset.items]
    assert summary.kept == COUNT and reads(log) >= COUNT
    left = [path.name for path in store.root.rglob("*") if path.name.startswith(".cluster-")]
    assert not left
    # What the index remembers holds on this machine too: nothing is read again, nor is the cluster asked.
    done = reads(log)
    again, summary = prepare(dataset, SETTINGS, store, QUIET, scheduler="tcp://127.0.0.1:9")
    assert (summary.reused, reads(log), again.address) == (COUNT, done, prepared.address)


def test_real_files_and_bad_ones_come_out_as_here(cluster, tmp_path):
    for number in range(6):
        folder = tmp_path / "set" / "thing" / ("train", "test")[number % 2]
        folder.mkdir(parents=True, exist_ok=True)
        text = f"OFF\n4 4 6\n0 0 0\n1 0 0\n0 2 0\n0 0 {number + 3}\n3 0 1 2\n3 0 1 3\n3 0 2 3\n3 1 2 3\n"
        (folder / f"{number}.off").write_text(text if number != 3 else "OFF\nnothing")
    dataset = open_dataset(f"folder:{tmp_path / 'set'}")
    console = Console(quiet=True)
    here, there = Store(tmp_path / "here"), Store(tmp_path / "there")
    one, alone = prepare(dataset, SETTINGS, here, console, workers=1)
    many, spread = prepare(dataset, SETTINGS, there, console, scheduler=cluster.address)
    assert tree_bytes(there.root) == tree_bytes(here.root)
    assert (one.address, alone.findings, alone.rejected) == (many.address, spread.findings, spread.rejected)
    assert spread.rejected == 1


def test_ctrl_c_takes_back_what_was_sent_and_the_same_command_goes_on(cluster, tmp_path):
    root, log = tmp_path / "store", tmp_path / "log"
    script = SCRIPT.format(count=COUNT, log=str(log), root=str(root), address=cluster.address)
    process = subprocess.Popen(
        [sys.executable, "-c", script],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_until(lambda: stored(root) >= 4, "the first shapes")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130, err
    assert f"of {COUNT} shapes are done | the same command goes on" in out
    assert err == ""
    assert 4 <= stored(root) < COUNT
    prepare(toys(COUNT, log), SETTINGS, Store(root), QUIET, scheduler=cluster.address)
    assert tree_bytes(root) == serial(tmp_path)[0]
