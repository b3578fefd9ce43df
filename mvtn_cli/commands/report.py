"""`mvtn report`: the page of a run again, or several runs side by side."""

from __future__ import annotations

import glob
import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvtn_cli.commands.options import Call
from mvtn_cli.commands.sources import find_run
from mvtn_cli.console import counted, duration
from mvtn_cli.errors import UsageError
from mvtn_cli.report_config import ReportConfig

if TYPE_CHECKING:
    from mvtn_cli.core.training.run import Run

FEW_PAIRS = 6  # that are told as sentences, beside the page


def report(config: ReportConfig, call: Call) -> None:
    """Write the report of a run again, or one page that compares several runs.

    Both open offline and are made from what lies in the runs' folders: nothing is trained or measured.

    Example: mvtn report runs/three-mvcnn m40-fixed 'm24-*' --output comparison.html
    """
    check_plot(config.plot)
    runs = find_runs(config, call)
    if len(runs) == 1:
        _write_one(runs[0], config, call)
    else:
        _write_comparison(runs, config, call)


def check_plot(plot: Path | None) -> None:
    """Refuse a plot of a form that can't be drawn, before anything is read.

    Raises:
        UsageError: It is neither .svg nor .png.
    """
    if plot is not None and plot.suffix.lower() not in (".svg", ".png"):
        raise UsageError(
            f"--plot {plot}: a plot is .svg or .png", hint="for example --plot runs.svg", code="report.plot"
        )


def find_runs(config: ReportConfig, call: Call) -> list[Run]:
    """The runs that were named, each once and in that order, else the latest."""
    if not config.run:
        return [find_run(None, config.runs, call)]
    found = [run for name in config.run for run in _runs_of(name, config.runs)]
    return list({run.path.resolve(): run for run in found}.values())


def _runs_of(name: str, runs: Path) -> Sequence[Run]:
    """The run of this name, the runs in a folder, or those that a pattern matches."""
    from mvtn_cli.core.training.run import Run

    for place in _places(name, runs):
        here = [Run(path) for path in place if (path / "run.json").is_file()]
        beneath = [run for path in place if Run(path) not in here and path.is_dir() for run in Run.all(path)]
        if here or beneath:
            return sorted([*here, *beneath], key=lambda run: run.path)
    return [Run.open(name, runs)]  # says which runs there are


def _places(name: str, runs: Path) -> Iterator[list[Path]]:
    """Where a name may lead: seen from here, and from the folder of runs."""
    for folder in (Path(), runs):
        if glob.has_magic(name) and not (folder / name).exists():
            yield [Path(match) for match in sorted(glob.glob(os.path.join(folder, name)))]
        else:
            yield [folder / name]


def _write_one(run: Run, config: ReportConfig, call: Call) -> None:
    from mvtn_cli.core.reporting.report import write_report

    if config.plot is not None:
        raise UsageError("--plot compares several runs", hint="name them all: mvtn report RUN RUN", code="report.plot")
    page = write_report(run.path, page=config.output)
    call.console.result({"schema": "mvtn.report/1", "run": str(run.path), "report": str(page)}, str(page))
    call.console.note(f"wrote the report of {run.path} in {duration(call.seconds)}; next: mvtn report RUN RUN")


def _write_comparison(runs: Sequence[Run], config: ReportConfig, call: Call) -> None:
    from mvtn_cli.core.reporting.comparison import write_comparison

    page = config.output or config.runs / "comparison.html"
    command = shlex.join(["mvtn", "report", *config.run])
    document = write_comparison([run.path for run in runs], page, command, plot=config.plot)
    _show(document, call)
    call.console.result(document, str(page))
    plot = f"; plot: {config.plot}" if config.plot else ""
    call.console.note(f"compared {counted(len(runs), 'run')} in {duration(call.seconds)}{plot}")


def _show(document: Mapping[str, Any], call: Call) -> None:
    """The most important of the page, for the person who waits."""
    rows = [
        [
            run["name"],
            _percent(run["accuracy"]),
            " to ".join(_percent(end) for end in run["accuracy_interval"] or ()),
            _percent(run["class_accuracy"]),
            "" if run["seconds"] is None else f"{run['seconds']:.1f}",
            run["epochs"],
        ]
        for run in document["runs"]
    ]
    columns = ["run", "accuracy %", "95 %", "class accuracy %", "seconds", "epochs"]
    call.console.table("runs", columns, rows)
    for remark in document["remarks"]:
        call.console.warn(remark)
    if missing := [run for run in document["runs"] if not run["evaluated"]]:
        more = f" (and {len(missing) - 1} more: the page lists the commands)" if len(missing) > 1 else ""
        call.console.warn(f"{missing[0]['name']} is not evaluated: {missing[0]['evaluate']}{more}")
    tests = [test for one in document["data"] for test in one["tests"]]
    for test in tests if len(tests) <= FEW_PAIRS else []:
        call.console.note(test["sentence"])


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.1f}"
