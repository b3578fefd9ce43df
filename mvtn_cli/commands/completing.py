"""What a shell offers for options and arguments that name something: choices, presets, runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path

Complete = Callable[[str], list[str]]


def completion(names: Callable[[], Iterable[str]]) -> Complete:
    """Offers those names that begin as what stands there; they are looked for when the shell asks."""

    def complete(incomplete: str) -> list[str]:
        return sorted(name for name in names() if name.startswith(incomplete))

    return complete


def preset_names() -> list[str]:
    """All presets."""
    from mvtn_cli.presets import PRESETS

    return list(PRESETS)


def run_names() -> list[str]:
    """Runs in the folder of runs and in its groups (comparisons, sweeps): by name and by path."""
    folder = Path(os.environ.get("MVTN_RUNS") or "runs")
    runs = [file.parent for pattern in ("*/run.json", "*/*/run.json") for file in folder.glob(pattern)]
    return [run.relative_to(folder).as_posix() for run in runs] + [run.as_posix() for run in runs]


NAMES = {"presets": preset_names, "runs": run_names}  # by what a field says of itself
