"""Work-precision: error against run time, both logarithmic, all settings on one plot."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mvtn_cli.core.bench.outcome import Row
from mvtn_cli.errors import UsageError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SUFFIXES = (".svg", ".png")
PLOTTED = ("gradient", "image", "pose")  # error against time; growth has a plot of its own
MARKERS = "osD^vP*X<>"
COLORS = ("#1f6fb4", "#d1652b", "#2e8b57", "#8b4aa8", "#8a6d3b", "#777777")


@dataclass(frozen=True)
class Point:
    """One setting.

    Attributes:
        group: Gets a colour, and a band where the truth's uncertainty is known.
        setting: Gets a marker.
        seconds, error: Where it lies; an error that is not finite lies on the upper edge.
        hollow: Draw the marker empty: flat shading.
        failed: Why it counts as failing; such points are crossed and named.
    """

    group: str
    setting: str
    seconds: float
    error: float
    hollow: bool = False
    failed: str = ""


def check_plot(what: str, path: Path) -> None:
    """Refuse, before the work, a plot that can't be drawn after it.

    Raises:
        UsageError: This benchmark has no error to plot, or the file is neither SVG nor PNG.
    """
    if what not in (*PLOTTED, "growth"):
        raise UsageError(
            f"`bench {what}` measures no error that could be plotted against time",
            hint=f"--plot goes with: {', '.join(PLOTTED)}, growth",
            code="bench.plot",
        )
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"--plot {path} must end in .svg or .png", code="bench.plot")


def points_of(what: str, rows: Sequence[Row]) -> tuple[list[Point], dict[str, float], str]:
    """What to plot of a benchmark: the means over the meshes.

    Returns:
        The points, the truth's own uncertainty by group, and what the error is.
    """
    if what == "gradient":
        means = [row | {"group": _weights_words(row)} for row in rows if row["mesh"] == "mean"]
        bands = _bands(means, "group", "truth_l2")
        return [_gradient_point(row) for row in means], bands, "relative L2 of the gradient"
    if what == "image":
        means = [row | {"group": f"{row['image_size']} px"} for row in rows if row["mesh"] == "mean"]
        return [_image_point(row) for row in means], _bands(means, "group", "truth_rmse"), "RMSE of the image"
    return [_pose_point(row) for row in rows if row["mesh"] != "all"], {}, "median error after the descent, degrees"


def draw_plot(path: Path, points: Sequence[Point], bands: dict[str, float], error: str, title: str) -> None:
    """Write the plot as SVG or PNG."""
    import matplotlib
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.2), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xscale="log", yscale="log", xlabel="seconds", ylabel=error)
    axes.set_title(title, loc="left", fontsize=10)
    axes.grid(which="major", color="#dddddd", linewidth=0.8)
    axes.set_axisbelow(True)
    top = max((point.error for point in points if math.isfinite(point.error)), default=1.0) * 1.5
    colors = dict(zip(_distinct(point.group for point in points), COLORS * 9, strict=False))
    markers = dict(zip(_distinct(point.setting for point in points), MARKERS * 9, strict=False))
    for point in points:
        _mark(axes, point, colors[point.group], markers[point.setting], top)
    _draw_bands(axes, bands, colors)
    _legend(axes, colors, markers, hollow=any(point.hollow for point in points), bands=bool(bands))
    path.parent.mkdir(parents=True, exist_ok=True)
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": title}):
        figure.savefig(path, dpi=150, metadata={"Date": None} if path.suffix.lower() == ".svg" else None)


def _mark(axes: Axes, point: Point, color: str, marker: str, top: float) -> None:
    height = min(point.error, top) if math.isfinite(point.error) else top
    face = "none" if point.hollow else color
    axes.plot([point.seconds], [height], marker, color=color, markerfacecolor=face, markersize=7, zorder=3)
    if point.failed:
        axes.plot([point.seconds], [height], "x", color="black", markersize=11, zorder=4)
        words = f"{point.group} {point.setting}: {point.failed}"
        axes.annotate(words, (point.seconds, height), (7, 5), textcoords="offset points", fontsize=7)


def _draw_bands(axes: Axes, bands: dict[str, float], colors: dict[str, str]) -> None:
    """Below these heights no setting can be told from the truth."""
    usable = {group: height for group, height in bands.items() if math.isfinite(height) and height > 0}
    low = min([axes.get_ylim()[0], *(0.6 * height for height in usable.values())])
    for group, height in usable.items():
        axes.axhspan(low, height, color=colors[group], alpha=0.10, linewidth=0)
        axes.axhline(height, color=colors[group], linewidth=0.9, linestyle=":")
    axes.set_ylim(bottom=low)


def _legend(axes: Axes, colors: dict[str, str], markers: dict[str, str], *, hollow: bool, bands: bool) -> None:
    from matplotlib.lines import Line2D

    entries = [Line2D([], [], color=color, linewidth=3, label=group) for group, color in colors.items()]
    entries += [Line2D([], [], color="#444444", marker=m, linestyle="", label=name) for name, m in markers.items()]
    if hollow:
        words = "hollow: flat shading"
        entries.append(Line2D([], [], color="#444444", marker="o", markerfacecolor="none", linestyle="", label=words))
    if bands:
        entries.append(Line2D([], [], color="#444444", linestyle=":", label="the truth's own uncertainty"))
    axes.legend(handles=entries, fontsize=7.5, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)


def _weights_words(row: Row) -> str:
    """Points have a truth, and so a band, of their own."""
    return f"{row['weights']} weights" + (", points" if row["shading"].startswith("points") else "")


def _gradient_point(row: Row) -> Point:
    wrong = "" if row["l2"] < 1 else "no better than no gradient"  # NaN too
    setting = row["shading"] if row["shading"].startswith("points") else row["mode"]
    return Point(row["group"], setting, row["seconds"], row["l2"], row["shading"] == "flat", wrong)


def _image_point(row: Row) -> Point:
    wrong = "" if math.isfinite(row["rmse"]) else "not finite"
    n = row["supersample"]
    return Point(row["group"], f"{n}x{n} samples", row["seconds"], row["rmse"], row["shading"] == "flat", wrong)


def _pose_point(row: Row) -> Point:
    missed = row["of"] - row["within_1deg"]
    return Point(
        row["mode"], row["mesh"], row["seconds"], row["median_deg"], False, f"{missed} missed" if missed else ""
    )


def _bands(rows: Sequence[Row], group: str, figure: str) -> dict[str, float]:
    """The largest uncertainty in each group: the band must not promise too much."""
    bands: dict[str, float] = {}
    for row in rows:
        bands[row[group]] = max(bands.get(row[group], 0.0), row[figure])
    return bands


def _distinct(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(names))
