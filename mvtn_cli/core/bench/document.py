"""The answer as one document: rows, summary, and where they come from."""

from __future__ import annotations

import csv
import os
import platform
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numba
import torch

from mvtn_cli import __version__
from mvtn_cli.console import dumps
from mvtn_cli.core.bench.outcome import Outcome, Row
from mvtn_cli.core.bench.peers import peers
from mvtn_cli.core.bench.plan import Plan, departures

SCHEMA = "mvtn.bench/1"
PACKAGES = ("torch", "torchvision", "numba", "numpy")


def document(what: str, outcome: Outcome, plan: Plan, command: str, seconds: float) -> dict[str, Any]:
    """Put everything into one document that `--json` prints and `--compare` reads."""
    return {
        "schema": SCHEMA,
        "what": what,
        "command": command,
        "seed": plan.seed,
        "image_size": plan.image_size,
        "num_views": plan.num_views,
        "look": plan.look,
        "reduced": departures(what, plan),
        "machine": machine(),
        "versions": versions(),
        **outcome.notes,
        "rows": outcome.rows,
        "omitted": [*outcome.omitted, *peers()],
        "summary": outcome.summary,
        "seconds": seconds,
    }


def machine() -> dict[str, Any]:
    """What this ran on: a time means nothing without it."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return {
        "cpu": cpu_name(),
        "cores": cores,
        "threads": {"torch": torch.get_num_threads(), "renderer": numba.get_num_threads()},
        "load": [round(value, 2) for value in os.getloadavg()] if hasattr(os, "getloadavg") else None,
        "system": f"{platform.system()} {platform.machine()}",
    }


def cpu_name(listing: Path = Path("/proc/cpuinfo")) -> str:
    """The processor's name as the system knows it."""
    if listing.is_file():
        for line in listing.read_text(encoding="utf-8", errors="replace").splitlines():
            key, _, value = line.partition(":")
            if key.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine() or "unknown"


def versions() -> dict[str, str]:
    """Of everything that has a say in a time or a bit."""
    found = {"mvtn": __version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "unknown"
    return found


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    """Write the rows under one header; what is missing or no number stays empty."""
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = list(dict.fromkeys(column for row in rows for column in row))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows([_cell(row.get(column)) for column in columns] for row in rows)


def _cell(value: Any) -> str:
    text = value if isinstance(value, str) else dumps(value)
    return "" if text == "null" else text
