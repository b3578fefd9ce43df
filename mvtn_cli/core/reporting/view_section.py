"""The section of a report on what the views are worth and what they know."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from markupsafe import Markup

from mvtn_cli.core.reporting import view_plots, words
from mvtn_cli.core.reporting.gather import Findings

NAMES = {
    "per-instance": "each shape's own",
    "per-class-mean": "mean of its class",
    "overall-mean": "mean of all shapes",
}


def view_analysis_section(findings: Findings) -> dict[str, Any] | None:
    """Sentences, a table and plots of `result["view_analysis"]`; None if none was made."""
    analysis = findings.result.get("view_analysis")
    if analysis is None:
        return None
    if analysis["skipped"]:
        return {"skipped": analysis["skipped"]}
    return {
        "skipped": None,
        "how": _how(analysis),
        "rows": [{**row, "name": NAMES[row["views"]]} for row in analysis["views"]],
        "verdict": _verdict(analysis["views"]),
        "spread": _spread(analysis["spread"]),
        "strips": _strips(findings),
        "leak": _leak(findings, analysis["leak"]),
        "bars": Markup(_bars(findings, analysis["leak"])),
    }


def _how(analysis: Mapping[str, Any]) -> str:
    return (
        f"The cameras of {words.count(analysis['train_count'])} training shapes were averaged, view by view, over "
        f"each class and over all shapes, and {words.count(analysis['test_count'])} shapes were judged again from "
        "these mean views. A shape gets those of its true class: this uses its label, and so favours the class means."
    )


def _verdict(rows: list[dict[str, Any]]) -> str:
    """Whether single shapes need views of their own; rows are own, class mean, overall mean."""
    _, by_class, overall = rows
    text = (
        f"Right only from their own views: {words.count(by_class['lost'])}; "
        f"only from those of their class: {words.count(by_class['gained'])} shapes"
    )
    sure = abs(by_class["lost"] - by_class["gained"]) > 1.96 * (by_class["lost"] + by_class["gained"]) ** 0.5
    if sure and by_class["lost"] > by_class["gained"]:
        text += ": looking at the single shape helps, beyond its class."
    elif sure:
        text += ": views of their own do worse than those of their class."
    else:
        text += ": no clear difference, so nothing here shows that single shapes need views of their own."
    fewer = overall["lost"] - overall["gained"]
    if abs(fewer) <= 1.96 * (overall["lost"] + overall["gained"]) ** 0.5:
        text += " One set of views for all shapes does as well."
    return text


def _spread(spread: Mapping[str, Any]) -> str:
    total, within = words.degrees(spread["total_deg"]), words.degrees(spread["within_deg"])
    if words.unknown(spread["explained"]):
        return f"From shape to shape the cameras spread by {total}: all have practically the same ones."
    share, chance = words.percent(spread["explained"], 0), words.percent(spread["by_chance"], 0)
    return (
        f"From shape to shape a camera spreads by {total}, within a class by {within}. The class explains {share} of "
        f"the variance of its direction; labels dealt out at random would explain {chance}."
    )


def _strips(findings: Findings) -> Markup | None:
    cameras = findings.cameras
    if cameras is None:
        return None
    return Markup(
        view_plots.class_strips(cameras.labels, cameras.azimuth_deg, cameras.elevation_deg, findings.result["classes"])
    )


def _leak(findings: Findings, leak: Mapping[str, Any]) -> str:
    forest = leak["forest"]
    low, high = forest["accuracy_interval"]
    text = (
        f"A random forest that is shown nothing but the angles names the class of "
        f"{words.percent(forest['accuracy'])} of the shapes (95 %: {words.span(low, high)}); always saying the most "
        f"frequent class gives "
        f"{words.percent(leak['majority'])}. "
    )
    if low <= max(leak["majority"], leak["chance"]):
        return text + "So the cameras tell nothing of the class that could be shown here."
    text += (
        "So the viewpoint network, which sees the points of the shape, writes some of the class into its cameras. "
        "That share of an accuracy need not come from the pictures. "
    )
    if (findings.result.get("model") or {}).get("network") == "viewgcn":
        return text + "View-GCN is given the directions of its cameras, and can read it there."
    return text + "The classifier is not given the angles, but pictures show from which side they were taken."


def _bars(findings: Findings, leak: Mapping[str, Any]) -> str:
    def span(row: Mapping[str, Any]) -> tuple[float, float]:
        low, high = row["accuracy_interval"]
        return low, high

    bars: list[view_plots.Bar] = [
        ("chance", leak["chance"], None, False),
        ("most frequent class", leak["majority"], None, False),
        ("angles, logistic regression", leak["logistic"]["accuracy"], span(leak["logistic"]), True),
        ("angles, random forest", leak["forest"]["accuracy"], span(leak["forest"]), True),
        ("this run, from pictures", findings.result["accuracy"], span(findings.result), False),
    ]
    known = [bar for bar in bars if not words.unknown(bar[1])]
    return view_plots.accuracy_bars(known, "Share of shapes whose class is read from the angles of the cameras alone")
