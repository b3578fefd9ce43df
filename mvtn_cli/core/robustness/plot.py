"""Accuracy against strength: one panel a kind of corruption, one line a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvtn_cli.core.training.figures import save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLORS = ("#1f6fb4", "#d1652b", "#2e8b57", "#8b4aa8", "#8a6d3b", "#777777")
MARKERS = "osD^vP"
PANELS = 3  # side by side
AXES = {  # kind: what its strength is, and where clean shapes stand
    "rotate": ("turn about the up axis, up to ±°", 0.0),
    "so3": ("any turn; dotted: clean", None),
    "occlude": ("share taken away", 0.0),
    "noise": ("noise, shape radii", 0.0),
    "drop-points": ("share of points removed", 0.0),
    "scale": ("size", 1.0),
}


def draw_plots(folder: Path, runs: Sequence[Mapping[str, Any]], title: str) -> list[Path]:
    """Write `robustness.svg` and `robustness.png`; the same numbers give the same bytes.

    Args:
        folder: Where to.
        runs: As in the document: `name`, `clean` and `corruptions`.
        title: Stands over all panels.
    """
    from matplotlib.figure import Figure

    kinds = [kind for kind in AXES if any(entry["kind"] == kind for entry in runs[0]["corruptions"])]
    across = min(PANELS, max(1, len(kinds)))
    down = max(1, -(-len(kinds) // across))
    figure = Figure(figsize=(1.2 + 3.2 * across, 0.4 + 2.9 * down), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=10)
    panels = figure.subplots(down, across, sharey=True, squeeze=False)
    for axes, kind in zip(panels.flat, kinds, strict=False):
        _draw_panel(axes, kind, runs)
    for axes in panels.flat[len(kinds) :]:
        axes.set_axis_off()
    for axes in panels[:, 0]:
        axes.set_ylabel("accuracy, %")
    panels[0, 0].set_ylim(0, 100)
    if len(runs) > 1:
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower left", fontsize=8, frameon=False)
    return save_figure(figure, folder, "robustness", title)


def _draw_panel(axes: Axes, kind: str, runs: Sequence[Mapping[str, Any]]) -> None:
    label, clean_at = AXES[kind]
    crops = {entry["crop"] for entry in runs[0]["corruptions"] if entry["kind"] == kind and entry["crop"]}
    axes.set_xlabel(f"{label} ({', '.join(sorted(crops))})" if crops else label, fontsize=9)
    axes.grid(axis="y", color="#dddddd", linewidth=0.8)
    axes.set_axisbelow(True)
    for number, run in enumerate(runs):
        entries = [entry for entry in run["corruptions"] if entry["kind"] == kind]
        points = [(entry["strength"], entry["mean"], entry["sd"] or 0.0) for entry in entries]
        if clean_at is not None and clean_at not in [strength for strength, *_ in points]:
            points = sorted([*points, (clean_at, run["clean"]["accuracy"], 0.0)])
        if clean_at is None:
            axes.axhline(100 * run["clean"]["accuracy"], color=COLORS[number % len(COLORS)], linestyle=":", linewidth=1)
        shift = 0.06 * (number - (len(runs) - 1) / 2) if kind == "so3" else 0.0
        axes.errorbar(
            [strength + shift for strength, *_ in points],
            [100 * mean for _, mean, _ in points],
            [100 * sd for *_, sd in points],
            color=COLORS[number % len(COLORS)],
            marker=MARKERS[number % len(MARKERS)],
            markersize=5,
            linewidth=1.5,
            capsize=2.5,
            label=run["name"],
        )
    if kind == "so3":
        axes.set_xticks([0], ["SO(3)"])
        axes.set_xlim(-0.5, 0.5)
    elif kind == "rotate":
        axes.set_xticks(
            sorted({0.0, *(entry["strength"] for entry in runs[0]["corruptions"] if entry["kind"] == kind)})
        )
