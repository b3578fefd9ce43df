"""Plots as SVG that lives inside a page and takes the page's colours, light or dark.

matplotlib draws with stand-in colours; `_finish` replaces each by a CSS variable of the page. Text stays
text, in the page's font. The same numbers give the same bytes.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mvtn_cli.core.evaluation.views import standard_angles
from mvtn_cli.core.views import wrap_degrees

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, MUTED, LINE, ACCENT, WARM, PAPER = (f"#00000{i}" for i in range(1, 7))
VIEW_COLORS = [f"#0000a{i}" for i in range(8)]
VARIABLES = {INK: "ink", MUTED: "muted", LINE: "line", ACCENT: "accent", WARM: "warm", PAPER: "paper"} | {
    color: f"v{i}" for i, color in enumerate(VIEW_COLORS)
}
MAX_DOTS = 1500


def curves(
    series: Sequence[tuple[str, Sequence[float | None]]],
    *,
    label: str,
    percent: bool = False,
    best_epoch: int | None = None,
    reference: tuple[float, str] | None = None,
    from_zero: bool = True,
) -> str:
    """Draw up to two curves over the epochs, each named at its end.

    Args:
        series: Name and one value an epoch; None or NaN leaves a gap.
        label: What the numbers are; stands over the plot.
        percent: The values are shares in [0, 1], shown as percent.
        best_epoch: Index (from 0) of the epoch that is kept; marked by a dot on the last curve.
        reference: A level to compare with, and its name.
        from_zero: Start the axis at 0.
    """
    figure, axes = _panel()
    ends = []
    for (name, values), color in zip(series, [MUTED, ACCENT][-len(series) :], strict=True):
        y = np.array([np.nan if v is None else v for v in values], dtype=float) * (100 if percent else 1)
        axes.plot(np.arange(1, len(y) + 1), y, color=color, linewidth=1.6, solid_capstyle="round")
        known = np.flatnonzero(np.isfinite(y))
        if known.size:
            ends.append((known[-1] + 1, y[known[-1]], name, color))
    if best_epoch is not None and np.isfinite(y[best_epoch]):
        axes.plot([best_epoch + 1], [y[best_epoch]], "o", color=ACCENT, markersize=5, clip_on=False)
    low, high = axes.get_ylim()
    if percent:
        low, high = (0.0 if from_zero else max(low, 0.0)), 100.0
    elif from_zero:
        low = 0.0
    if reference is not None:
        high = max(high, reference[0] * 1.05)
        axes.axhline(reference[0], color=MUTED, linewidth=0.8, dashes=(3, 3))
        axes.text(1, reference[0], reference[1], color=MUTED, fontsize=8, va="bottom", ha="left")
    axes.set_ylim(low, high * (1.0 if percent else 1.02))
    _name_ends(axes, ends)
    axes.set_xlim(1, max(2, len(series[0][1])))
    _whole_epochs(axes)
    axes.set_title(label + (" (%)" if percent else ""), loc="left", fontsize=9, color=INK, pad=8)
    axes.set_xlabel("epoch")
    return _finish(figure, f"curves {label}", f"{label} over the epochs")


def _name_ends(axes: Axes, ends: list[tuple[int, float, str, str]]) -> None:
    """Write each curve's name beside its last value, moved apart where they would touch."""
    low, high = axes.get_ylim()
    apart = (high - low) * 0.09
    ends = sorted(ends, key=lambda end: end[1])
    heights = [end[1] for end in ends]
    for i in range(1, len(heights)):
        heights[i] = max(heights[i], heights[i - 1] + apart)
    over = max([*heights, high]) - high
    for (x, _, name, color), height in zip(ends, heights, strict=True):
        axes.annotate(
            name,
            (x, height - over),
            (5, 0),
            textcoords="offset points",
            color=color,
            fontsize=8.5,
            va="center",
        )


def _whole_epochs(axes: Axes) -> None:
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, integer=True, min_n_ticks=1))


def azimuth_histogram(turns_deg: ArrayLike, start_deg: ArrayLike | None = None, *, near_deg: float = 30.0) -> str:
    """Draw where the nearest view stands relative to the known side.

    Args:
        turns_deg: (N,) signed differences in degrees; NaN is left out.
        start_deg: The same before learning; drawn as an outline.
        near_deg: The band around 0 that counts as found.
    """
    figure, axes = _panel(width=5.8, height=2.5)
    edges = np.arange(-180, 181, 10)

    def shares(turns: ArrayLike) -> NDArray[np.float64]:
        values = wrap_degrees(np.asarray(turns)[np.isfinite(turns)])
        return 100.0 * np.histogram(values, edges)[0] / max(1, len(values))

    axes.axvspan(-near_deg, near_deg, color=ACCENT, alpha=0.10, linewidth=0)
    axes.bar(edges[:-1] + 5, shares(turns_deg), width=9, color=ACCENT, linewidth=0)
    if start_deg is not None and np.isfinite(start_deg).any():
        axes.stairs(shares(start_deg), edges, color=WARM, linewidth=1.2, label="before learning")
        axes.legend(
            frameon=False, fontsize=8.5, labelcolor=WARM, handlelength=1.4, borderaxespad=0,
            loc="lower right", bbox_to_anchor=(1, 1.02),
        )  # fmt: skip
    axes.set_xlim(-180, 180)
    axes.set_xticks(
        range(-180, 181, 60), [_degrees(x, signed=True) if x else "known side" for x in range(-180, 181, 60)]
    )
    axes.set_title("share of shapes (%)", loc="left", fontsize=9, color=INK, pad=8)
    return _finish(figure, "azimuth", "Histogram of the angle between the nearest view and the known side")


def sphere_map(
    azimuth_deg: ArrayLike,
    elevation_deg: ArrayLike,
    start: tuple[ArrayLike, ArrayLike] | None = None,
    *,
    dots: bool = True,
) -> str:
    """Draw camera directions on an equal-area map of the sphere (Mollweide).

    Args:
        azimuth_deg: (N, M), coloured by view; at most 1,500 dots are drawn, taken evenly from the shapes.
        elevation_deg: (N, M).
        start: Azimuth and elevation (M,) before learning: numbered rings.
        dots: Draw the cameras of the single shapes.
    """
    azimuth, elevation = standard_angles(azimuth_deg, elevation_deg)
    views = azimuth.shape[1]
    colors = view_colors(views)
    rows = np.linspace(0, len(azimuth) - 1, min(len(azimuth), max(1, MAX_DOTS // views))).round().astype(int)
    size = float(np.clip(3000 / max(1, rows.size * views), 3.5, 16.0))
    figure, axes = _map()
    for v in range(views if dots and len(azimuth) else 0):
        x, y = np.radians(azimuth[rows, v]), np.radians(elevation[rows, v])
        axes.scatter(x, y, s=size, color=colors[v], alpha=0.7, linewidths=0, zorder=3, clip_on=False)
    if start is not None:
        a, e = standard_angles(*start)
        for v, (x, y) in enumerate(zip(np.radians(a), np.radians(e), strict=True)):
            axes.scatter([x], [y], s=60, facecolor="none", edgecolor=colors[v], linewidths=1.3, zorder=2, clip_on=False)
            axes.annotate(str(v + 1), (x, y), (5, 3), textcoords="offset points", color=INK, fontsize=6.5, zorder=5)
    return _finish(figure, "sphere", "Camera directions on a map of the sphere")


def view_colors(views: int) -> list[Any]:
    """Give each view a colour: named ones up to eight, then steps around the colour circle."""
    if views <= len(VIEW_COLORS):
        return VIEW_COLORS[:views]
    import colorsys

    return [colorsys.hls_to_rgb(i / views, 0.52, 0.55) for i in range(views)]


def _degrees(angle: int, *, signed: bool = False) -> str:
    return f"{angle:{'+' if signed else ''}d}°".replace("-", "−")


def _map() -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.8, 3.0))
    axes = figure.add_axes((0.06, 0.02, 0.93, 0.96), projection="mollweide")
    axes.set_facecolor("none")
    axes.set_xticks(np.radians(range(-120, 121, 60)), [_degrees(x) for x in range(-120, 121, 60)])
    axes.set_yticks(np.radians(range(-60, 61, 30)), [_degrees(y) for y in range(-60, 61, 30)])
    axes.set_longitude_grid_ends(90)  # type: ignore[attr-defined]
    axes.tick_params(colors=MUTED, labelsize=7)
    axes.grid(color=LINE, linewidth=0.8)
    axes.spines["geo"].set_edgecolor(LINE)
    axes.set_axisbelow(True)
    return figure, axes


def _panel(width: float = 4.4, height: float = 2.7) -> tuple[Figure, Axes]:
    """An empty plot with a bare left side and horizontal hairlines."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height))
    inches = (0.44, 0.46, 0.62 if width < 5 else 0.24, 0.36)  # left, bottom, right, top
    axes = figure.add_axes(
        (
            inches[0] / width,
            inches[1] / height,
            1 - (inches[0] + inches[2]) / width,
            1 - (inches[1] + inches[3]) / height,
        )
    )
    axes.set_facecolor("none")
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.spines["bottom"].set_color(LINE)
    axes.tick_params(colors=MUTED, labelsize=8, length=0, pad=5)
    axes.xaxis.label.set_color(MUTED)
    axes.xaxis.label.set_fontsize(8.5)
    axes.grid(axis="y", color=LINE, linewidth=0.8)
    axes.set_axisbelow(True)
    return figure, axes


def _finish(figure: Figure, salt: str, description: str) -> str:
    """Turn a figure into an SVG element without addresses, names that could clash, or colours of its own."""
    import matplotlib

    buffer = io.BytesIO()
    settings: Any = {"svg.fonttype": "none", "svg.hashsalt": salt, "font.family": "sans-serif"}
    with matplotlib.rc_context(settings):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue().decode()
    text = text[text.index("<svg") :]
    changes: list[tuple[str, str | Callable[[re.Match[str]], str]]] = [
        (r"<metadata>.*?</metadata>\s*", ""),
        (r"<!--.*?-->\s*", ""),
        (r' id="(figure|axes|patch|line2d|text|matplotlib|xtick|ytick|legend|[A-Z][A-Za-z]+)[\w.]*"', ""),
        (r' xmlns(:xlink)?="[^"]*"', ""),
        (r'<svg [^>]*?viewBox="([^"]*)"[^>]*>', rf'<svg viewBox="\1" role="img" aria-label="{description}">'),
        (r"<defs>\s*<style.*?</style>\s*</defs>", ""),
        (r" font-family: [^;\"]*;", ""),
        (r' transform="rotate\(-?0 [^"]*"', ""),
        (r"(\d+\.\d{2})\d+(?=[^<>]*>)", r"\1"),  # inside a tag: a name such as lr-0.0005 stays whole
        (r"#0000[0-9a-f]{2}\b", lambda match: f"var(--{VARIABLES[match[0]]})"),
        (r">\s+<", "><"),
        (r"\s*\n", " "),
    ]  # fmt: skip
    for pattern, replacement in changes:
        text = re.sub(pattern, replacement, text, flags=re.DOTALL)
    return text.strip()
