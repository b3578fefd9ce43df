"""Plots of several runs: validation accuracy against time or epochs, and test accuracies with their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mvtn_cli.core.reporting import plots, words
from mvtn_cli.core.training.figures import figure_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LONGEST_NAME = 34
NUMBERED = 12  # lines; the numbers of more would cover one another
TOUCHING = 9.0  # points between the numbers at the ends of two lines that can still be read apart
TICKS = {  # seconds
    0.1: "0.1 s", 0.3: "0.3 s", 1: "1 s", 3: "3 s", 10: "10 s", 30: "30 s", 60: "1 min", 180: "3 min", 600: "10 min",
    1800: "30 min", 3600: "1 h", 10800: "3 h", 36000: "10 h", 86400: "1 d", 259200: "3 d", 864000: "10 d",
}  # fmt: skip
COLORS = ("#1f6fb4", "#d1652b", "#2e8b57", "#8b4aa8", "#8a6d3b", "#777777", "#c2185b", "#00838f")  # on white


class Line(NamedTuple):
    """The training of one run.

    Attributes:
        number: Of the run in the comparison.
        group: Of runs that differ in their seed alone; decides the colour.
        name: Of the group.
        curve: Points with `epoch`, `seconds` and `val_accuracy`.
        best_epoch: Whose weights were kept.
    """

    number: int
    group: int
    name: str
    curve: Sequence[dict[str, Any]]
    best_epoch: int | None


class Dot(NamedTuple):
    """The accuracy of one run: number, group, name, share in [0, 1] and its 95 % interval, if it is known."""

    number: int
    group: int
    name: str
    share: float
    interval: tuple[float, float] | None


def progress(lines: Sequence[Line], groups: int, by: str) -> str:
    """Draw validation accuracies against `seconds` (of training so far, log scale) or `epoch`; numbers name the runs.

    Args:
        lines: One a run; at least one has points.
        groups: How many groups there are in the comparison.
        by: `seconds` or `epoch`.
    """
    figure, axes = plots._panel(height=3.1)
    colors = plots.view_colors(groups)
    ends = _draw_lines(axes, lines, colors, by)
    axes.grid(axis="x", color=plots.LINE, linewidth=0.8)
    axes.set_title("validation accuracy (%)", loc="left", fontsize=9, color=plots.INK, pad=8)
    axes.set_xlabel("time of training" if by == "seconds" else "epoch")
    if len(ends) <= NUMBERED:
        _number_ends(axes, ends)
    what = "time of training" if by == "seconds" else "epochs"
    return plots._finish(
        figure, f"progress {by} {lines[0].number}", f"Validation accuracy against {what}, one line a run"
    )


def draw_progress(lines: Sequence[Line], groups: int, title: str, form: str) -> bytes:
    """Draw validation accuracies against the time of training as a picture of its own; same numbers, same bytes.

    Args:
        lines: As for `progress`.
        groups: As for `progress`.
        title: Stands over it.
        form: `svg` or `png`.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.4), layout="constrained")
    axes = figure.add_subplot()
    colors = [COLORS[i] for i in range(groups)] if groups <= len(COLORS) else plots.view_colors(groups)
    _draw_lines(axes, lines, colors, "seconds")
    axes.set_ylabel("validation accuracy, %")
    axes.set_xlabel("time of training")
    figure.suptitle(title, x=0.01, ha="left", fontsize=9.5, parse_math=False)
    axes.grid(color="#dddddd", linewidth=0.8)
    axes.set_axisbelow(True)
    named = dict(reversed([(line.group, line.name) for line in lines if line.curve]))
    handles = [axes.plot([], [], color=colors[group], linewidth=1.6)[0] for group in sorted(named)]
    labels = [_short(named[group]) for group in sorted(named)]
    columns = max(1, min(len(labels), 120 // (max(map(len, labels)) + 8)))
    legend = figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=8)
    for text in legend.get_texts():
        text.set_parse_math(False)
    return figure_bytes(figure, form, "comparison")


def _draw_lines(axes: Axes, lines: Sequence[Line], colors: Sequence[Any], by: str) -> list[tuple[float, float, Line]]:
    """Draw them, and return where each ends."""
    ends, lowest, highest = [], 100.0, 0.0
    for line in lines:
        x = np.array([max(point[by], 0.05) for point in line.curve], dtype=float)
        y = 100 * np.array([np.nan if (v := point["val_accuracy"]) is None else v for point in line.curve], dtype=float)
        known = np.flatnonzero(np.isfinite(y))
        if not known.size:
            continue
        color = colors[line.group]
        few: dict[str, Any] = {"marker": "o", "markersize": 3} if known.size < 4 else {}
        axes.plot(x, y, color=color, linewidth=1.5, solid_capstyle="round", **few)
        best = [i for i in map(int, known) if line.curve[i]["epoch"] == line.best_epoch]
        axes.plot(x[best], y[best], "o", color=color, markersize=5, clip_on=False)
        ends.append((float(x[known[-1]]), float(y[known[-1]]), line))
        lowest, highest = min(lowest, float(np.nanmin(y))), max(highest, float(np.nanmax(y)))
    axes.set_ylim(max(0.0, lowest - 4), min(100.0, highest + 4))
    if by == "seconds":
        _time_axis(axes)
    else:
        plots._whole_epochs(axes)
    return ends


def _time_axis(axes: Axes) -> None:
    from matplotlib.ticker import NullFormatter, NullLocator

    left, right = axes.dataLim.intervalx
    axes.set_xscale("log")
    axes.set_xlim(left / 1.25, right * 1.25)
    shown = {second: word for second, word in TICKS.items() if left / 1.25 <= second <= right * 1.25}
    if len(shown) < 2:  # all within a factor of three
        shown |= {float(round(x)) or 0.1: words.duration(float(round(x)) or 0.1) for x in (left, right)}
    axes.set_xticks(list(shown), list(shown.values()))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_formatter(NullFormatter())


def _number_ends(axes: Axes, ends: Sequence[tuple[float, float, Line]]) -> None:
    """Write the runs' numbers beside the ends of their lines; those that would touch stand together."""
    clusters: list[list[tuple[Any, Line]]] = []
    for x, y, line in sorted(ends, key=lambda end: (end[1], end[2].number)):
        place = axes.transData.transform((x, y)) * 72 / axes.figure.dpi
        near = [c for c in clusters if abs(c[0][0] - place)[1] < TOUCHING and abs(c[0][0] - place)[0] < 3 * TOUCHING]
        (near[0] if near else clusters.append([]) or clusters[-1]).append((place, line))  # type: ignore[func-returns-value]
    for cluster in clusters:
        numbers = sorted(line.number for _, line in cluster)
        shown = " ".join(map(str, numbers[:5])) + (" …" if len(numbers) > 5 else "")
        right = max(place[0] for place, _ in cluster)
        where = (right + 4, cluster[0][0][1])
        axes.annotate(shown, where, xycoords="figure points", fontsize=8, color=plots.INK, va="center")


def accuracy_dots(dots: Sequence[Dot], groups: int, label: str) -> str:
    """Draw accuracies as dots on their 95 % intervals, the highest on top.

    Args:
        dots: At least one.
        groups: How many groups there are in the comparison.
        label: What the numbers are, in percent.
    """
    from matplotlib.figure import Figure

    colors = plots.view_colors(groups)
    rows = sorted(dots, key=lambda dot: (-dot.share, dot.number))
    height = 0.24 * len(rows) + 0.62
    figure = Figure(figsize=(7.2, height))
    axes = figure.add_axes((0.33, 0.3 / height, 0.56, 1 - 0.62 / height))
    axes.set_facecolor("none")
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.grid(axis="x", color=plots.LINE, linewidth=0.8)
    axes.set_axisbelow(True)
    for row, dot in enumerate(rows):
        color = colors[dot.group]
        low, high = dot.interval or (dot.share, dot.share)
        axes.plot([100 * low, 100 * high], [row, row], color=color, linewidth=1.4, solid_capstyle="butt")
        axes.plot([100 * dot.share], [row], "o", color=color, markersize=5.5)
        for x, text, side in (
            (-0.015, f"{dot.number}  {_short(dot.name)}", "right"),
            (1.015, words.percent(dot.share), "left"),
        ):
            axes.text(
                x, row, text, transform=axes.get_yaxis_transform(), color=plots.INK, fontsize=8.5, ha=side,
                va="center", parse_math=False,
            )  # fmt: skip
    ends = [100 * x for dot in rows for x in dot.interval or (dot.share,)]
    axes.set_xlim(max(0.0, min(ends) - 1), min(100.0, max(ends) + 1))
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_yticks([])
    axes.tick_params(colors=plots.MUTED, labelsize=8, length=0, pad=5)
    axes.set_title(f"{label} (%)", loc="left", fontsize=9, color=plots.INK, pad=8)
    return plots._finish(figure, f"dots {rows[0].number}", f"{label} of the runs with 95 % intervals")


def _short(name: str) -> str:
    """A long name without its middle: the ends tell runs apart."""
    half = LONGEST_NAME // 2
    return name if len(name) <= LONGEST_NAME else f"{name[: half - 1]}…{name[-half:]}"
