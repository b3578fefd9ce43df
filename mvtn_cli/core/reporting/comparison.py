"""`comparison.html`: several runs side by side, in one file that opens anywhere without a network."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

from mvtn_cli import __version__
from mvtn_cli.console import counted
from mvtn_cli.core.reporting.comparison_page import render_comparison, render_plot
from mvtn_cli.core.reporting.comparison_runs import RunFiles, read_runs
from mvtn_cli.core.reporting.comparison_tables import (
    class_table,
    confusion_table,
    data_key,
    differing_settings,
    identity,
    seed_groups,
)
from mvtn_cli.core.reporting.comparison_tests import paired_tests
from mvtn_cli.core.training.checkpoint import write_run_file
from mvtn_cli.network_config import POINT_NETWORKS

SCHEMA = "mvtn.comparison/1"
RETRIEVAL = ("protocol", "checkpoint", "metric", "queries", "split")
ROBUSTNESS = ("count", "seed", "repeats", "checkpoint")


def write_comparison(
    paths: Sequence[Path], page: Path, command: str = "", *, plot: Path | None = None
) -> dict[str, Any]:
    """Compare runs and write the page.

    Args:
        paths: Folders of runs, each once.
        page: The file to write.
        command: What was typed, for the page.
        plot: Also draw accuracy against the time of training alone, as .svg or .png.

    Returns:
        The document that `compare_runs` makes, with `command`, `page` and `plot`.

    Raises:
        DataError: A `run.json` can't be read.
        UsageError: The plot can't be drawn: several data sets, or no epochs. Then nothing is written.
    """
    document = {**compare_runs(paths), "command": command, "page": str(page), "plot": str(plot) if plot else None}
    picture = render_plot(document, plot.suffix.lower().removeprefix(".")) if plot else b""
    write_run_file(page, render_comparison(document, page).encode())
    if plot:
        write_run_file(plot, picture)
    return document


def compare_runs(paths: Sequence[Path]) -> dict[str, Any]:
    """Put side by side what lies in the folders of runs; nothing is computed anew.

    Returns:
        `runs`, an entry each; `settings` that differ; `groups` of runs that differ in their seed alone; `data`, an
        entry a data set with `classes`, `confusions` and `tests` of its runs that were judged on the same split;
        `remarks`, sentences on what can't be compared. All of it plain Python.
    """
    runs = read_runs(paths)
    entries = [_entry(run, number) for number, run in enumerate(runs, 1)]
    groups = seed_groups(runs, entries)
    for entry in entries:
        entry["group"] = next(i for i, group in enumerate(groups) if entry["name"] in group["runs"])
    data = [_of_data(runs, entries, key) for key in dict.fromkeys(map(data_key, runs))]
    return {
        "schema": SCHEMA,
        "runs": entries,
        "settings": differing_settings(runs),
        "groups": groups,
        "data": data,
        "remarks": [*_remarks(data, entries), *_hidden_differences(runs, entries)],
        "versions": {"mvtn": __version__},
    }


def _entry(run: RunFiles, number: int) -> dict[str, Any]:
    """What is said of one run."""
    result, config = run.result, run.config
    network = str(config.get("network", "mvcnn"))
    looks = bool(config) and network not in POINT_NETWORKS
    curve = _curve(run.epochs)
    report = run.path / "report.html"
    return {
        "number": number,
        "name": run.label,
        "run": str(run.path),
        "state": run.info.get("state"),
        "data": {key: run.info.get(source) for key, source in (("spec", "dataset"), ("address", "data_address"))},
        "network": network,
        "views": config.get("views") if looks else None,
        "num_views": config.get("num_views") if looks else None,
        "image_size": config.get("image_size") if looks else None,
        "seed": config.get("seed", run.info.get("seed")),
        "evaluated": bool(result),
        "evaluate": None if result else shlex.join(["mvtn", "eval", str(run.path)]),
        "source": "result.json" if result else run.tested.get("source"),
        **{key: (result or run.tested).get(key) for key in ("split", "accuracy", "class_accuracy")},
        **{key: result.get(key) for key in ("accuracy_interval", "checkpoint", "count", "correct")},
        "outdated": _outdated(run),
        "retrieval": _retrieval(run.retrieval),
        "robustness": _robustness(run.robustness),
        "seconds": curve[-1]["seconds"] if curve else None,
        "epochs": len(run.epochs),
        "best_epoch": run.best.get("epoch"),
        "selected_by": run.best.get("selected_by") or run.info.get("selected_by"),
        "parameters": _parameters(run.info),
        "report": str(report) if report.is_file() else None,
        "curve": curve,
    }


def _curve(epochs: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Validation accuracy after each epoch, and the seconds of training until then."""
    points, seconds = [], 0.0
    for index, epoch in enumerate(epochs, 1):
        seconds += epoch.get("seconds") or 0.0
        accuracy = epoch.get("val_accuracy")
        points.append({"epoch": epoch.get("epoch", index), "seconds": round(seconds, 3), "val_accuracy": accuracy})
    return points


def _outdated(run: RunFiles) -> bool:
    """Whether training went on after the evaluation, and found better weights."""
    judged = (run.result.get("best") or {}).get("epoch")
    return run.result.get("checkpoint") == "best" and None not in (judged, run.best.get("epoch")) and (
        judged != run.best["epoch"]
    )  # fmt: skip


def _retrieval(result: Mapping[str, Any]) -> dict[str, Any] | None:
    value = (result.get("micro") or {}).get("ap")
    if value is None:
        return None
    more = {"gallery": (result.get("gallery") or {}).get("count"), "lfda": bool(result.get("lfda"))}
    return {"map": value, **{key: result.get(key) for key in RETRIEVAL}, **more}


def _robustness(result: Mapping[str, Any]) -> dict[str, Any] | None:
    measured = result.get("runs") or []
    if len(measured) != 1:
        return None
    corruptions = [
        {key: one.get(key) for key in ("kind", "strength", "crop", "mean", "sd")} for one in measured[0]["corruptions"]
    ]
    return {
        **{key: result.get(key) for key in ROBUSTNESS},
        "clean": measured[0]["clean"]["accuracy"],
        "corruptions": corruptions,
    }


def _parameters(info: Mapping[str, Any]) -> int | None:
    counts = (info.get("model") or {}).get("parameters")
    return sum(counts.values()) if counts else None


def _of_data(runs: Sequence[RunFiles], entries: Sequence[Mapping[str, Any]], key: str) -> dict[str, Any]:
    """What can be compared among the runs on one data set: those that were judged on the same shapes."""
    mine = [(run, entry) for run, entry in zip(runs, entries, strict=True) if data_key(run) == key]
    judged = [run for run, _ in mine if run.result]
    kinds = [_judged_on(run) for run in judged]
    main = max(dict.fromkeys(kinds), key=lambda kind: (kinds.count(kind), kind[0] == "test"), default=None)
    alike = [run for run, kind in zip(judged, kinds, strict=True) if kind == main]
    comparable = len(alike) > 1
    return {
        "spec": mine[0][0].info.get("dataset"),
        "title": mine[0][0].info.get("title") or mine[0][0].info.get("dataset"),
        "address": mine[0][0].info.get("data_address"),
        "runs": [entry["name"] for _, entry in mine],
        "split": main[0] if main else next((entry["split"] for _, entry in mine if entry["split"]), None),
        "compared": [run.label for run in alike],
        "others": [run.label for run in judged if run not in alike],
        "untested": [run.label for run in alike if run.answers is None],
        "classes": class_table(alike) if comparable else [],
        "confusions": confusion_table(alike) if comparable else [],
        "tests": paired_tests(alike),
    }


def _judged_on(run: RunFiles) -> tuple[Any, ...]:
    result = run.result
    return result["split"], result["count"], tuple((row["name"], row["count"]) for row in result["per_class"])


def _remarks(data: Sequence[Mapping[str, Any]], entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """What can't be compared, or only with care."""
    remarks = []
    if len(data) > 1:
        listed = ", ".join(f"{_short_spec(one)} ({counted(len(one['runs']), 'run')})" for one in data)
        remarks.append(
            f"The runs stand on {len(data)} data sets, {listed}: an accuracy on one says nothing about one on another. "
            "What can be compared is given for each data set by itself."
        )
    for one in data:
        about = f"{_short_spec(one)}: " if len(data) > 1 else ""
        mine = [entry for entry in entries if entry["name"] in one["runs"]]
        remarks += [about + remark for remark in _shape_remarks(one)]
        remarks += [about + remark if about else remark[0].upper() + remark[1:] for remark in _protocol_remarks(mine)]
    return remarks


def _short_spec(data: Mapping[str, Any]) -> str:
    return PurePath(str(data["spec"])).name


def _shape_remarks(data: Mapping[str, Any]) -> list[str]:
    """Runs that were judged on other shapes than most, or of which single answers are missing."""
    remarks = []
    if data["others"]:
        remarks.append(
            f"{', '.join(data['others'])}: judged on other shapes than most, which are the {data['split']} split; "
            "therefore in the table of runs and the curves alone."
        )
    if data["untested"] and len(data["compared"]) > 1:
        remarks.append(f"{', '.join(data['untested'])}: no predictions.csv, so that single shapes can't be compared.")
    return remarks


def _protocol_remarks(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """What was measured in more than one way."""
    remarks = []
    if len({entry["checkpoint"] for entry in entries if entry["evaluated"]}) > 1:
        remarks.append("some runs were judged with their last weights, others with their best.")
    retrievals = [entry["retrieval"] for entry in entries if entry["retrieval"]]
    if len({tuple(value for key, value in sorted(one.items()) if key != "map") for one in retrievals}) > 1:
        remarks.append("retrieval was not measured in one way for all: compare mAP with care.")
    tested = [entry["robustness"] for entry in entries if entry["robustness"]]
    if len({tuple(one[key] for key in ROBUSTNESS) for one in tested}) > 1:
        remarks.append("robustness was not measured in one way for all: compare those columns with care.")
    chosen = {entry["selected_by"] for entry in entries if entry["selected_by"]}
    if len(chosen) > 1:
        remarks.append(
            f"the best epochs were not chosen by the same shapes ({'; '.join(sorted(chosen))}), so that validation "
            "accuracies are not of the same shapes either."
        )
    return remarks


def _hidden_differences(runs: Sequence[RunFiles], entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Runs that should be the same and are not."""
    same: dict[tuple[str, Any], list[Mapping[str, Any]]] = {}
    for run, entry in zip(runs, entries, strict=True):
        same.setdefault((identity(run), entry["seed"]), []).append(entry)
    other = [
        (first["name"], entry["name"])
        for first, *more in same.values()
        for entry in more
        if [point["val_accuracy"] for point in entry["curve"]] != [point["val_accuracy"] for point in first["curve"]]
    ]
    if not other:
        return []
    more = f" (and {counted(len(other) - 1, 'pair')} more)" if len(other) > 1 else ""
    return [
        f"{other[0][0]} and {other[0][1]}{more} have the same settings and seed and yet other accuracies: what differs "
        "is no setting, such as the version of a program or the kind of machine."
    ]
