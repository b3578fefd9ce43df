"""The plot of `mvtn bench growth`: time and memory over the number of shapes, both logarithmic."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mvtn_cli.core.bench.outcome import Row
from mvtn_cli.core.bench.plot import COLORS, MARKERS


def draw_growth(path: Path, rows: Sequence[Row]) -> None:
    """Write the plot as SVG or PNG; dotted lines have the slope of what grows like the number of shapes."""
    import matplotlib
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.4), layout="constrained")
    time, memory = figure.subplots(1, 2)
    stages = list(dict.fromkeys(row["stage"] for row in rows))
    for axes, column, words in ((time, _seconds, "CPU seconds"), (memory, _memory, "peak memory, MiB")):
        axes.set(xscale="log", yscale="log", xlabel="shapes", ylabel=words)
        axes.grid(which="major", color="#dddddd", linewidth=0.8)
        for stage, color, marker in zip(stages, COLORS, MARKERS, strict=False):
            points = [(row["shapes"], column(row)) for row in rows if row["stage"] == stage]
            points = [(shapes, cost) for shapes, cost in points if cost is not None and cost > 0]
            if points:
                axes.plot(*zip(*points, strict=True), marker=marker, color=color, label=stage, markersize=5)
                (first, _), (last, top) = points[0], points[-1]
                if column is _seconds:
                    axes.plot([first, last], [top * first / last, top], ":", color=color, linewidth=0.8)
    time.legend(fontsize=8, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "growth"}):
        figure.savefig(path, dpi=150, metadata={"Date": None} if path.suffix.lower() == ".svg" else None)


def _seconds(row: Row) -> float | None:
    return row["seconds"] if row["cpu_seconds"] is None else row["cpu_seconds"]


def _memory(row: Row) -> float | None:
    return row["peak_mib"]
