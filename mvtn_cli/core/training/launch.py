"""Starts the processes of `--devices N` on this machine, and sees to it that they end together.

They are told of each other as torchrun would, so that a training need not know which of the two it was.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from mvtn_cli.errors import ExitCode, MvtnError

GRACE_SECONDS = 10.0  # for the others, after one has failed: to notice by themselves, then to answer SIGTERM
LAUNCHER = "MVTN_LAUNCHER"  # in the environment of each process: the one that started it
SPOKEN = frozenset({ExitCode.FAILED, ExitCode.USAGE})  # such a process has said what went wrong
PEACEFUL = frozenset({ExitCode.OK, ExitCode.INTERRUPTED})

Process = subprocess.Popen[bytes]


def started_with_others() -> bool:
    """Whether this process is one of several, started by torchrun or by `run_together`."""
    return "RANK" in os.environ and int(os.environ.get("WORLD_SIZE", "1")) > 1


def launcher_process() -> int | None:
    """Number of the process that started this one and the others; None for torchrun and for a single one."""
    number = os.environ.get(LAUNCHER)
    return int(number) if number else None


def run_together(count: int, words: Sequence[str], variables: Mapping[str, str]) -> ExitCode:
    """Run `mvtn WORDS...` in several processes to their end; the first one has this one's input and output.

    Ctrl-C and a terminate signal are passed on to all of them. If one fails, the others get some seconds to end.

    Args:
        count: Number of processes.
        words: Of the command line.
        variables: More of the environment.

    Returns:
        What the first one that failed answered, else what they all did.

    Raises:
        MvtnError: One was killed or has crashed.
    """
    crew = [_start(rank, words, environment) for rank, environment in enumerate(_environments(count, variables))]
    try:
        with _passing_signals(crew) as signals:
            codes = _wait(crew, signals)
    finally:
        for process in crew:
            if process.poll() is None:
                process.kill()
                process.wait()
    for rank, code in enumerate(codes):
        if code not in PEACEFUL | SPOKEN:
            how = f"was killed by {_signal_name(-code)}" if code < 0 else f"ended with code {code}"
            raise MvtnError(
                f"process {rank + 1} of {count} {how}, and the others were stopped",
                hint="the same command goes on from what was saved last",
                code="train.process-lost",
            )
    if signals and ExitCode.INTERRUPTED in codes:
        return ExitCode.INTERRUPTED
    return ExitCode(next((code for code in codes if code in SPOKEN), max(codes)))


def _environments(count: int, variables: Mapping[str, str]) -> Iterator[dict[str, str]]:
    """What torchrun would say to each process."""
    own = {**os.environ, **variables, LAUNCHER: str(os.getpid())}
    own |= {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(_free_port())}
    own |= {"WORLD_SIZE": str(count), "LOCAL_WORLD_SIZE": str(count), "GROUP_RANK": "0"}
    own.setdefault("TORCH_CPP_LOG_LEVEL", "ERROR")
    if sys.platform == "linux":
        own.setdefault("GLOO_SOCKET_IFNAME", "lo")  # they are all here; no other interface needs to know
    for rank in range(count):
        yield {**own, "RANK": str(rank), "LOCAL_RANK": str(rank)}


def _start(rank: int, words: Sequence[str], environment: Mapping[str, str]) -> Process:
    """In a session of its own, so that a Ctrl-C at the terminal comes once, from here."""
    silent: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL}
    command = [sys.executable, "-m", "mvtn_cli", *words]
    return subprocess.Popen(command, env=environment, start_new_session=True, **(silent if rank else {}))


def _wait(crew: Sequence[Process], signals: list[int]) -> list[int]:
    """Wait for all; after a failure, or a second signal, for so long and no longer. A killed one counts as it was."""
    stages = [signal.SIGTERM, signal.SIGKILL]
    deadline: float | None = None
    forced: set[int] = set()
    while any(process.poll() is None for process in crew):
        failed = any(process.poll() not in PEACEFUL | {None} for process in crew)
        if deadline is None and (failed or len(signals) > 1):
            deadline = time.monotonic() + GRACE_SECONDS
        if deadline is not None and time.monotonic() > deadline and stages:
            number, deadline = stages.pop(0), time.monotonic() + GRACE_SECONDS
            for rank, process in enumerate(crew):
                if process.poll() is None:
                    forced.add(rank)
                    process.send_signal(number)
        time.sleep(0.05)
    codes = [process.wait() for process in crew]
    for rank, code in enumerate(codes):
        if code < 0 and (rank in forced or -code in signals):
            codes[rank] = ExitCode.INTERRUPTED if signals else ExitCode.FAILED
    return codes


@contextmanager
def _passing_signals(crew: Sequence[Process]) -> Iterator[list[int]]:
    """Pass Ctrl-C and terminate signals on; gives the list of those that came."""
    came: list[int] = []

    def pass_on(number: int, frame: Any) -> None:
        came.append(number)
        for process in crew:
            if process.poll() is None:
                process.send_signal(number)

    before = {number: signal.signal(number, pass_on) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
