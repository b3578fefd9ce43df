"""Accuracy against seconds of training, one mark a combination."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvtn_cli.core.training.figures import save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLORS = ("#1f6fb4", "#d1652b", "#2e8b57", "#8b4aa8", "#8a6d3b", "#777777", "#c2185b", "#00838f")
MARKERS = "osD^vP*X"
NAMED = 16  # marks; more of them are told by colour and form alone


def draw_plots(folder: Path, cells: Sequence[Mapping[str, Any]], fields: Sequence[str], title: str) -> list[Path]:
    """Write `sweep.svg` and `sweep.png`; the same numbers give the same bytes.

    Args:
        folder: Where to.
        cells: As in the document: `settings`, `accuracy` and `seconds`, with mean and sd.
        fields: The settings that are varied; the first one decides the colour, the second one the form of a mark.
        title: Stands over it.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xscale="log", xlabel="seconds of training", ylabel="test accuracy, %")
    axes.set_title(title, loc="left", fontsize=10)
    axes.grid(which="major", color="#dddddd", linewidth=0.8)
    axes.set_axisbelow(True)
    _limit(axes, cells)
    for cell in cells:
        _mark(axes, cell, _style(cells, cell, fields))
        if len(cells) <= NAMED:
            _name(axes, cell)
    return save_figure(figure, folder, "sweep", title)


def _limit(axes: Axes, cells: Sequence[Mapping[str, Any]]) -> None:
    """Room around the marks, also around a single one."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    seconds = [max(cell["seconds"]["mean"], 1e-3) for cell in cells]
    axes.set_xlim(min(seconds) / 1.8, max(seconds) * 1.8)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    lowest, highest = (
        [100 * (cell["accuracy"]["mean"] + sign * (cell["accuracy"]["sd"] or 0.0)) for cell in cells]
        for sign in (-1, 1)
    )
    room = max(2.0, 0.1 * (max(highest) - min(lowest)))
    axes.set_ylim(min(lowest) - room, max(highest) + room)


def _style(cells: Sequence[Mapping[str, Any]], cell: Mapping[str, Any], fields: Sequence[str]) -> tuple[str, str]:
    """Colour and marker."""
    places = []
    for field in fields[:2]:
        values = list(dict.fromkeys(str(other["settings"][field]) for other in cells))
        places.append(values.index(str(cell["settings"][field])))
    color, marker = [*places, 0, 0][:2]
    return COLORS[color % len(COLORS)], MARKERS[marker % len(MARKERS)]


def _mark(axes: Axes, cell: Mapping[str, Any], style: tuple[str, str]) -> None:
    seconds, accuracy = cell["seconds"], cell["accuracy"]
    axes.errorbar(
        [max(seconds["mean"], 1e-3)],
        [100 * accuracy["mean"]],
        yerr=[100 * (accuracy["sd"] or 0.0)],
        xerr=[min(seconds["sd"] or 0.0, 0.9 * seconds["mean"])],
        color=style[0],
        marker=style[1],
        markersize=6,
        linewidth=1.0,
        capsize=2.5,
    )


def _name(axes: Axes, cell: Mapping[str, Any]) -> None:
    seconds = max(cell["seconds"]["mean"], 1e-3)
    left, right = axes.get_xlim()
    side = ("left", 6) if seconds**2 < left * right else ("right", -6)  # towards the middle
    place = (seconds, 100 * cell["accuracy"]["mean"])
    words = cell["word"].replace("+", ", ")
    axes.annotate(words, place, (side[1], 5), textcoords="offset points", ha=side[0], fontsize=7)
