"""Plots of a view analysis: where the cameras of each class stand, and accuracies side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mvtn_cli.core.evaluation.views import standard_angles
from mvtn_cli.core.reporting import plots, words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MAX_DOTS = 6000
LONGEST_NAME = 18
Bar = tuple[str, float, tuple[float, float] | None, bool]


def class_strips(
    labels: Sequence[str], azimuth_deg: ArrayLike, elevation_deg: ArrayLike, classes: Sequence[str]
) -> str:
    """Draw the cameras of each class on a row of its own: azimuths on the left, elevations on the right.

    Args:
        labels: N names of classes.
        azimuth_deg: (N, M), coloured by view; at most 6,000 dots are drawn, taken evenly from each class.
        elevation_deg: (N, M).
        classes: Rows from top to bottom; one without shapes is left out.
    """
    from matplotlib.figure import Figure

    azimuth, elevation = standard_angles(azimuth_deg, elevation_deg)
    label = np.asarray(labels)
    rows = [name for name in classes if (label == name).any()]
    views = azimuth.shape[1]
    most = max(1, MAX_DOTS // (2 * views * max(1, len(rows))))
    tall = 0.2 if len(rows) > 12 else 0.27
    height = tall * len(rows) + 0.62
    figure = Figure(figsize=(7.2, height))
    bottom, top = 0.28 / height, 1 - 0.3 / height
    left = figure.add_axes((0.19, bottom, 0.5, top - bottom))
    right = figure.add_axes((0.755, bottom, 0.225, top - bottom))
    drawn = [_evenly(np.flatnonzero(label == name), most) for name in rows]
    mine, row = np.concatenate(drawn), np.repeat(np.arange(len(rows)), list(map(len, drawn)))
    for view, color in enumerate(plots.view_colors(views)):
        # each view has a height of its own within the row, so that those at one place are all seen
        y = row + (0.0 if views == 1 else 0.56 * (view / (views - 1) - 0.5))
        for axes, angles in ((left, azimuth), (right, elevation)):
            axes.scatter(angles[mine, view], y, s=5, color=color, alpha=0.65, linewidths=0, zorder=3, clip_on=False)
    _rows(left, rows, (-180, 180), 90, "azimuth")
    _rows(right, rows, (-90, 90), 45, "elevation")
    right.set_yticklabels([])
    return plots._finish(figure, "strips", "Azimuth and elevation of the cameras by class")


def _evenly(indices: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    return indices[np.linspace(0, len(indices) - 1, min(len(indices), count)).round().astype(int)]


def _rows(axes: Axes, names: Sequence[str], limits: tuple[int, int], step: int, title: str) -> None:
    axes.set_facecolor("none")
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.set_xlim(*limits)
    axes.set_ylim(len(names) - 0.5, -0.5)
    ticks = range(limits[0], limits[1] + 1, step)
    axes.set_xticks(ticks, [plots._degrees(x) for x in ticks])
    short = [name if len(name) <= LONGEST_NAME else name[: LONGEST_NAME - 1] + "…" for name in names]
    axes.set_yticks(range(len(names)), short)
    axes.tick_params(colors=plots.MUTED, labelsize=8 if len(names) <= 24 else 7, length=0, pad=5)
    for edge in np.arange(-0.5, len(names)):
        axes.axhline(edge, color=plots.LINE, linewidth=0.6, zorder=1)
    for x in ticks:
        axes.axvline(x, color=plots.LINE, linewidth=0.6, zorder=1)
    axes.set_title(title, loc="left", fontsize=9, color=plots.INK, pad=6)


def accuracy_bars(bars: Sequence[Bar], description: str) -> str:
    """Draw shares as horizontal bars with their 95 % intervals.

    Args:
        bars: Name, share in [0, 1], interval or None, and whether it is one of those that matter (coloured).
        description: For those who don't see it.
    """
    from matplotlib.figure import Figure

    height = 0.3 * len(bars) + 0.12
    figure = Figure(figsize=(5.2, height))
    axes = figure.add_axes((0.36, 0.06 / height, 0.52, 1 - 0.12 / height))
    axes.set_facecolor("none")
    axes.set_axis_off()
    for row, (name, share, interval, matters) in enumerate(bars):
        color: Any = plots.ACCENT if matters else plots.MUTED
        axes.barh(row, 100 * share, height=0.5, color=color, alpha=0.9 if matters else 0.45, linewidth=0)
        end = 100 * share
        if interval is not None:
            axes.plot([100 * x for x in interval], [row, row], color=plots.INK, linewidth=1)
            end = max(end, 100 * interval[1])
        axes.text(-2, row, name, color=plots.INK, fontsize=8.5, ha="right", va="center")
        axes.text(end + 2, row, words.percent(share), color=plots.INK, fontsize=8.5, va="center")
    axes.axvline(0, color=plots.LINE, linewidth=0.8)
    axes.set_xlim(0, 100)
    axes.set_ylim(len(bars) - 0.5, -0.5)
    return plots._finish(figure, f"bars {description}", description)
