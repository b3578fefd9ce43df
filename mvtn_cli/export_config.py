"""Settings of `mvtn export`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from mvtn_cli.fields import option
from mvtn_cli.shared_config import RunsConfig


class ExportConfig(RunsConfig):
    """A run as files that other programs read."""

    run: str | None = option(None, "Run folder or its name; auto: the latest run", "Run", argument=True, names="runs")
    checkpoint: Literal["best", "last"] = option("best", "Weights to export", "Run")
    seed: int = option(
        0, "Seed of the random shapes that the exported networks are checked with", "Answer", ge=0, le=2**32 - 1
    )
    out: Path | None = option(None, "For the files; auto: RUN/export", "Answer", metavar="DIR", short="-o")
