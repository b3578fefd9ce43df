"""Settings of `mvtn report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator

from mvtn_cli.fields import option
from mvtn_cli.shared_config import RunsConfig


def _one_or_several(value: Any) -> Any:
    """One name, as a file or the environment gives it, is a list of one."""
    return (value,) if isinstance(value, str) else value


class ReportConfig(RunsConfig):
    """Pages on one run, or on several side by side."""

    run: Annotated[tuple[str, ...], BeforeValidator(_one_or_several)] = option(
        (), "Runs, folders of runs, or patterns as 'm40-*'; several are compared; auto: the latest run", "Run",
        argument="many", names="runs",
    )  # fmt: skip
    output: Path | None = option(
        None, "The page; auto: report.html in the run, for several runs RUNS/comparison.html", "Answer",
        metavar="FILE", short="-o",
    )  # fmt: skip
    plot: Path | None = option(
        None, "Also draw accuracy against the time of training alone, as .svg or .png", "Answer", metavar="FILE"
    )
