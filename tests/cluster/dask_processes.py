"""A real Dask cluster on this machine: one scheduler, two workers, each a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from processes import environment

ROOMS = (Path(__file__).parent, Path(__file__).parent.parent / "preprocess")  # whose functions are sent by name
PATIENCE = 60.0  # seconds


@dataclass
class Processes:
    """What was started.

    Attributes:
        folder: For the scheduler's address and for logs.
        address: Of the scheduler.
        workers: Those that were started and not killed.
    """

    folder: Path
    address: str = ""
    started: list[subprocess.Popen[bytes]] = field(default_factory=list)
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def start_scheduler(self) -> None:
        """Start it at a free port, and wait until it says which."""
        file = self.folder / "scheduler.json"
        self._start("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", file, "--no-dashboard")
        wait_until(lambda: file.exists() and bool(file.read_text().strip()), "the scheduler to listen")
        self.address = json.loads(file.read_text())["address"]

    def start_worker(self) -> None:
        """Start a worker with one thread and no nanny: killed, it stays dead."""
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", self.folder)
        self.workers.append(self._start("dask_worker", self.address, *options))

    def kill_worker(self) -> None:
        """End one at once, without a word."""
        worker = self.workers.pop()
        worker.kill()
        worker.wait()

    def end(self) -> None:
        """End all of them."""
        for process in self.started:
            process.kill()
            process.wait()

    def _start(self, module: str, *options: object) -> subprocess.Popen[bytes]:
        own = environment()
        own["PYTHONPATH"] = ":".join([own["PYTHONPATH"], *map(str, ROOMS)])
        with (self.folder / f"{module}-{len(self.started)}.log").open("wb") as log:
            command = [sys.executable, "-m", f"distributed.cli.{module}", *map(str, options)]
            process = subprocess.Popen(command, env=own, cwd=self.folder, stdout=log, stderr=log)
        self.started.append(process)
        return process


def wait_until(happened: Callable[[], bool], what: str) -> None:
    """Look every few milliseconds."""
    deadline = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < deadline, f"waited too long for {what}"
        time.sleep(0.01)
