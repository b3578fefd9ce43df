"""One stage of `mvtn bench growth`: the real command in a process of its own, and what that process took."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import mvtn_cli
from mvtn_cli.errors import MvtnError

MIB = 2**20 if sys.platform == "darwin" else 2**10  # in what `ru_maxrss` counts
NAME = "growth"  # of the run


@dataclass(frozen=True)
class Spent:
    """What a process took.

    Attributes:
        cpu: Seconds on all threads, user and system; None where the system does not tell.
        wall: Seconds from start to end.
        peak_mib: The most memory that it held; None where the system does not tell.
        ranking: Of retrieve: wall seconds of ranking and all measures, without describing shapes.
    """

    cpu: float | None
    wall: float
    peak_mib: float | None
    ranking: float | None = None


def run_stage(stage: str, size: int, folder: Path, settings: Mapping[str, int]) -> Spent:
    """Run one stage.

    Args:
        stage: preprocess, train, eval or retrieve, each of which needs those before it.
        size: How many shapes.
        folder: Its own; what an interrupted try has left there is deleted.
        settings: image_size, views, seed, threads.

    Raises:
        MvtnError: The command failed.
    """
    for left in {"preprocess": ("cache", "runs"), "train": ("runs",), "retrieve": ("cache/descriptors",)}.get(
        stage, ()
    ):
        shutil.rmtree(folder / left, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    answer, words = folder / f"{stage}.json", folder / f"{stage}.err"
    command = [
        sys.executable,
        "-m",
        "mvtn_cli",
        *_words(stage, size, settings),
        "--cache",
        "cache",
        "--quiet",
        "--json",
    ]
    with answer.open("wb") as out, words.open("wb") as err:
        begun = time.perf_counter()
        code, cpu, peak_mib = _weighed(command, folder, _environment(settings["threads"]), out, err)
        wall = time.perf_counter() - begun
    if code:
        last = words.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        told = next((line for line in last if line.startswith("error: ")), last[-1] if last else "it said nothing")
        raise MvtnError(
            f"mvtn {stage} of {size} shapes failed: {told.removeprefix('error: ')}",
            hint=f"all of it stands in {words}",
            code="bench.growth",
        )
    return Spent(cpu, wall, peak_mib, _ranking(answer) if stage == "retrieve" else None)


def _words(stage: str, size: int, settings: Mapping[str, int]) -> list[str]:
    train = size * 2 // 3
    seed, threads = ["--seed", str(settings["seed"])], ["--threads", str(settings["threads"]), "--device", "cpu"]
    spec = f"builtin:shapes?train={train}&test={size - train}"
    pictures = ["--image-size", str(settings["image_size"]), "--num-views", str(settings["views"])]
    return {
        "preprocess": ["preprocess", spec, *seed],
        "train": ["train", spec, "--name", NAME, "--epochs", "1", "--val-fraction", "0", *pictures, *seed, *threads],
        "eval": ["eval", NAME, *threads],
        "retrieve": ["retrieve", NAME, "--figure", "0", *threads],
    }[stage] + ["--workers", "1"]


def _environment(threads: int) -> dict[str, str]:
    """This process's, without the user's settings, with the code that runs here."""
    own = {name: value for name, value in os.environ.items() if not name.startswith("MVTN_")}
    here = str(Path(mvtn_cli.__file__).resolve().parent.parent)
    path = os.pathsep.join(filter(None, [here, own.get("PYTHONPATH")]))
    return own | {"PYTHONPATH": path, "OMP_NUM_THREADS": str(threads), "NUMBA_NUM_THREADS": str(threads)}


def _weighed(
    command: list[str], folder: Path, environment: dict[str, str], out: IO[bytes], err: IO[bytes]
) -> tuple[int, float | None, float | None]:
    """Run a command; return its exit code, CPU seconds and peak memory in MiB. Whatever stops this, stops it."""
    report = folder / "spent.json"
    can_weigh = hasattr(os, "wait4") and hasattr(os, "posix_spawn")
    scales = [sys.executable, "-I", str(Path(__file__).with_name("weighing.py")), report.name] if can_weigh else []
    process = subprocess.Popen(
        [*scales, *command], cwd=folder, env=environment, stdout=out, stderr=err, start_new_session=True
    )
    try:
        code = process.wait()
    finally:
        if process.returncode is None:
            _stop(process)
    if not can_weigh:
        return code, None, None
    cpu, peak = json.loads(report.read_text(encoding="ascii"))
    return code, cpu, peak / MIB


def _stop(process: subprocess.Popen[bytes]) -> None:
    """End a process and what it has started, politely."""
    if hasattr(os, "killpg"):
        os.killpg(process.pid, signal.SIGTERM)
    else:
        process.terminate()
    process.wait()


def _ranking(answer: Path) -> float | None:
    document = json.loads(answer.read_text(encoding="utf-8"))
    return document.get("seconds_scoring")
