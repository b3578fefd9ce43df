"""The page of a comparison, made from its document alone."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from mvtn_cli.console import counted
from mvtn_cli.core.reporting import plots, words
from mvtn_cli.core.reporting.comparison_plots import Dot, Line, accuracy_dots, draw_progress, progress
from mvtn_cli.core.reporting.comparison_tests import interval_words, p_words, points
from mvtn_cli.core.reporting.sections import NETWORK_NAMES
from mvtn_cli.core.reporting.templating import template
from mvtn_cli.errors import UsageError
from mvtn_cli.fields import is_number

SHOWN_TESTS = 40  # pairs; the document has them all
SHOWN_MISSING = 12  # commands
LONGEST_VALUE = 30  # characters of a setting; of a path its end says most
NAMED_COLUMNS = 5  # runs; the heads of more columns are their numbers alone
Entry = Mapping[str, Any]


def render_comparison(document: Mapping[str, Any], page: Path) -> str:
    """Make the page. The same document gives the same text.

    Args:
        document: What `compare_runs` gives, and the `command`.
        page: Where it will lie: reports beneath that folder are linked.
    """
    runs = document["runs"]
    colors = css_colors(len(document["groups"]))
    shown = [{**entry, **_words(entry), "color": colors[entry["group"]], "link": _link(entry, page)} for entry in runs]
    repeated = any(len(group["seeds"]) > 1 for group in document["groups"])
    return template("comparison.html.jinja").render(
        version=document["versions"]["mvtn"],
        title=f"{counted(len(runs), 'run')} compared",
        lead=_lead(document),
        command=document["command"],
        figures=headline(document),
        runs=shown,
        by_name={run["name"]: run for run in shown},
        several_data=len(document["data"]) > 1,
        has_map=any(run["retrieval"] for run in runs),
        missing=[run for run in shown if not run["evaluated"]],
        remarks=document["remarks"],
        data=[_data_section(document, one) for one in document["data"]],
        settings=[{**setting, **_cells(setting["values"])} for setting in document["settings"]],
        seeds=_seed_rows(document, colors) if repeated else [],
        robustness=robustness_columns(runs),
        named_columns=NAMED_COLUMNS,
        shown_tests=SHOWN_TESTS,
        shown_missing=SHOWN_MISSING,
        points=points,
        p_words=p_words,
    )


def render_plot(document: Mapping[str, Any], form: str) -> bytes:
    """Draw validation accuracies against the time of training, alone, as `svg` or `png`.

    Raises:
        UsageError: The runs stand on several data sets, or none has finished an epoch.
    """
    if len(document["data"]) > 1:
        listed = ", ".join(str(one["spec"]) for one in document["data"])
        raise UsageError(
            f"one plot can't compare runs on {len(document['data'])} data sets: {listed}",
            hint="name the runs of one of them, or leave --plot out: the page has a plot for each",
            code="report.data",
        )
    lines = _lines(document, document["data"][0])
    if not lines:
        raise UsageError(
            "there is nothing to plot: none of these runs has a validation accuracy yet",
            hint="go on training: mvtn train",
            code="report.no-epochs",
        )
    title = document["data"][0]["title"] or document["data"][0]["spec"] or ""
    return draw_progress(lines, len(document["groups"]), _plain_title(title), form)


def css_colors(count: int) -> list[str]:
    """The colour of each group as the page's style sheet has it."""
    from matplotlib.colors import to_hex

    return [
        f"var(--{plots.VARIABLES[color]})" if color in plots.VARIABLES else to_hex(color)
        for color in plots.view_colors(count)
    ]


def headline(document: Mapping[str, Any]) -> list[dict[str, str]]:
    """The few numbers on top."""
    runs = document["runs"]
    judged = [run for run in runs if run["evaluated"]]
    figures = []
    if len(document["data"]) == 1 and (shown := _side_by_side(document, document["data"][0])):
        top = max(shown, key=lambda run: run["accuracy"])
        interval = f"; 95 % interval {interval_words(top['accuracy_interval'])}" if top["accuracy_interval"] else ""
        figures.append(
            {
                "value": words.percent(top["accuracy"]),
                "label": f"highest {top['split']} accuracy",
                "note": top["name"] + interval,
            }
        )
        if clear := _clear(document["data"][0]["tests"]):
            figures.append(clear)
    figures.append(
        {"value": f"{len(judged)} of {len(runs)}", "label": "runs evaluated", "note": "the others: see below the table"}
        if len(judged) < len(runs)
        else {"value": str(len(runs)), "label": "runs", "note": "all evaluated"}
    )
    known = [run["seconds"] for run in runs if run["seconds"] is not None]
    if known:
        span = f"{words.duration(min(known))} to {words.duration(max(known))} a run"
        figures.append({"value": words.duration(sum(known)), "label": "training time in all", "note": span})
    return figures


def _clear(tests: Sequence[Mapping[str, Any]]) -> dict[str, str] | None:
    if not tests:
        return None
    clear = sum(test["p_holm"] < 0.05 for test in tests)
    return {
        "value": f"{clear} of {len(tests)}",
        "label": "pair differs clearly" if len(tests) == 1 else "pairs differ clearly",
        "note": "McNemar's exact test, Holm's correction",
    }


def _lead(document: Mapping[str, Any]) -> str:
    titles = [_plain_title(one["title"] or one["spec"] or "") for one in document["data"]]
    return titles[0] if len(titles) == 1 else " · ".join(titles)


def _plain_title(title: str) -> str:
    """The title of a data set without the folder that it came from."""
    return title[:1].upper() + title[1:].split(";")[0]


def _words(entry: Entry) -> dict[str, Any]:
    """What a table says of a run, beside its numbers."""
    notes = []
    if entry["state"] != "finished":
        notes.append(f"training {'goes on' if entry['state'] == 'running' else entry['state'] or 'of unknown state'}")
    if not entry["evaluated"]:
        notes.append(f"accuracy from {entry['source']}" if entry["source"] else "not evaluated")
    if entry["checkpoint"] == "last":
        notes.append("last weights")
    if entry["outdated"]:
        notes.append("trained on since its evaluation")
    return {
        "data_name": _cells([PurePath(str(entry["data"]["spec"] or words.DASH)).name])["short"][0],
        "network_name": NETWORK_NAMES.get(entry["network"], entry["network"]),
        "interval": interval_words(entry["accuracy_interval"]) if entry["accuracy_interval"] else words.DASH,
        "notes": "; ".join(notes),
    }


def _link(entry: Entry, page: Path) -> str | None:
    """The way from the page to the run's own report, if that lies beneath."""
    if entry["report"] is None:
        return None
    way = os.path.relpath(Path(entry["report"]).resolve(), page.resolve().parent)
    return None if way.startswith("..") or os.path.isabs(way) else quote(Path(way).as_posix())


def _cells(values: Sequence[str]) -> dict[str, Any]:
    """How the values of a setting stand in the table."""
    short = [value if len(value) <= LONGEST_VALUE else "…" + value[1 - LONGEST_VALUE :] for value in values]
    return {"short": short, "numeric": all(is_number(value) or value in ("auto", words.DASH) for value in values)}


def _data_section(document: Mapping[str, Any], data: Mapping[str, Any]) -> dict[str, Any]:
    """Plots and tables of the runs on one data set."""
    groups = len(document["groups"])
    lines = _lines(document, data)
    dots = [
        Dot(run["number"], run["group"], run["name"], run["accuracy"], run["accuracy_interval"])
        for run in _side_by_side(document, data)
    ]
    return {
        **data,
        "heading": _plain_title(data["title"] or data["spec"] or ""),
        "curves": [Markup(progress(lines, groups, by)) for by in ("seconds", "epoch")] if lines else [],
        "dots": Markup(accuracy_dots(dots, groups, f"{data['split']} accuracy")) if dots else None,
    }


def _lines(document: Mapping[str, Any], data: Mapping[str, Any]) -> list[Line]:
    return [
        Line(run["number"], run["group"], document["groups"][run["group"]]["name"], run["curve"], run["best_epoch"])
        for run in document["runs"]
        if run["name"] in data["runs"] and any(point["val_accuracy"] is not None for point in run["curve"])
    ]


def _side_by_side(document: Mapping[str, Any], data: Mapping[str, Any]) -> list[Entry]:
    """Runs whose accuracies are of the same shapes."""
    return [
        run
        for run in document["runs"]
        if run["name"] in data["runs"] and run["name"] not in data["others"]
        if run["accuracy"] is not None and run["split"] == data["split"]
    ]


def _seed_rows(document: Mapping[str, Any], colors: Sequence[str]) -> list[dict[str, Any]]:
    numbers = {run["name"]: run["number"] for run in document["runs"]}
    return [
        {**group, "numbers": [numbers[name] for name in group["runs"]], "color": color}
        for group, color in zip(document["groups"], colors, strict=True)
    ]


def robustness_columns(runs: Sequence[Entry]) -> dict[str, Any] | None:
    """The runs' accuracies on changed shapes, a column a change; None if none was measured."""
    tested = [run for run in runs if run["robustness"]]
    if not tested:
        return None
    columns: dict[tuple[Any, ...], str] = {}
    for run in tested:
        for one in run["robustness"]["corruptions"]:
            columns.setdefault(_kind(one), _kind_words(one))
    rows = []
    for run in tested:
        found = {_kind(one): one for one in run["robustness"]["corruptions"]}
        cells = [found.get(kind) for kind in columns]
        rows.append({"name": run["name"], "clean": run["robustness"]["clean"], "cells": cells})
    return {"columns": list(columns.values()), "rows": rows}


def _kind(one: Mapping[str, Any]) -> tuple[Any, ...]:
    return one["kind"], one["strength"], one["crop"]


def _kind_words(one: Mapping[str, Any]) -> str:
    if one["kind"] == "so3":
        return "any turn"
    unit = "°" if one["kind"] == "rotate" else ""
    crop = f" ({one['crop']})" if one["crop"] not in (None, "quantile") else ""
    return f"{one['kind'].replace('_', ' ')} {one['strength']:g}{unit}{crop}"
