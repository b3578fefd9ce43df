"""`mvtn eval`: how good a run is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvtn_cli.commands.options import Call
from mvtn_cli.commands.sources import find_run, open_shapes_of
from mvtn_cli.config import EvalConfig
from mvtn_cli.console import duration

if TYPE_CHECKING:
    from mvtn_cli.core.preprocess import Prepared
    from mvtn_cli.core.training.run import Run


def evaluate(config: EvalConfig, call: Call) -> None:
    """Measure a run: accuracy overall and by class, the error to the known view, tables and report.html.

    Example: mvtn eval --baseline
    """
    run = find_run(config.run, config.runs, call)
    prepared = open_shapes_of(run, config, call)
    if prepared.address != run.info["data_address"]:
        call.console.warn(f"{prepared.spec} is not what {run.path} was trained on: the shapes have changed")
    result = _evaluate(run, prepared, config, call)
    rows = [(row["name"], row["count"], row["correct"], _percent(row["accuracy"])) for row in result["per_class"]]
    rows.append(("all shapes", result["count"], result["correct"], _percent(result["accuracy"])))
    rows.append(("mean of classes", "", "", _percent(result["class_accuracy"])))
    title = f"{run.path}: {config.split}, {config.checkpoint} weights"
    call.console.table(title, ["class", "count", "correct", "accuracy %"], rows, stream="out")
    call.console.result(result, "\n".join(_sentences(result)))
    made = f"measured {run.path} in {duration(call.seconds)}; report: {result['report']}"
    call.console.note(f"{made}; next: mvtn predict FILES")


def measure(run: Run, prepared: Prepared, call: Call, *, device: str, threads: int | None) -> dict[str, Any]:
    """Evaluate a run on its test split, as a bare `mvtn eval` would, and write its report."""
    config = EvalConfig(run=str(run.path), device=device, threads=threads)
    return _evaluate(run, prepared, config, call)


def _evaluate(run: Run, prepared: Prepared, config: EvalConfig, call: Call) -> dict[str, Any]:
    from mvtn_cli.core.evaluation.evaluate import evaluate_run
    from mvtn_cli.core.reporting.report import write_report
    from mvtn_cli.core.training.device import use_threads

    use_threads(config.threads)
    result = evaluate_run(run, prepared, config, call.console)
    return {**result, "report": str(write_report(run.path, Path(result["folder"])))}


def _sentences(result: dict[str, Any]) -> list[str]:
    """What a number alone can't say."""
    lines = []
    if known := result["known_view"]:
        near, far = _percent(known["within_30"]), _percent(known["over_90"])
        median = f"{known['median_deg']:.1f}"
        lines.append(f"known view: median error {median}°, {near} % within 30°, {far} % over 90°")
    if baseline := result["baseline"]:
        lead = 100 * (result["accuracy"] - baseline["accuracy"])
        lines.append(f"baseline: histogram forest {_percent(baseline['accuracy'])} %, {lead:+.1f} points to this run")
    if analysis := result["view_analysis"]:
        lines += _of_views(analysis)
    return lines


def _of_views(analysis: dict[str, Any]) -> list[str]:
    if analysis["skipped"]:
        return [f"view analysis: {analysis['skipped']}"]
    each = ", ".join(f"{row['views']} {_percent(row['accuracy'])} %" for row in analysis["views"])
    leak = analysis["leak"]
    read, blind = _percent(leak["forest"]["accuracy"]), _percent(leak["majority"])
    return [
        f"views: {each}",
        f"class read from the angles of the cameras alone: {read} %; always the most frequent class: {blind} %",
    ]


def _percent(share: float) -> str:
    return f"{100 * share:.1f}"
