"""Precision against recall: interpolated as is usual, in a table and as a plot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.evaluation.files import write_csv
from mvtn_cli.core.retrieval.ranks import LEVELS
from mvtn_cli.core.training.figures import save_figure

Float64 = NDArray[np.float64]
RECALL = np.linspace(0.0, 1.0, LEVELS).round(2)
Curves = dict[str, Any]  # of `curves_of`


def curves_of(values: Float64, names: NDArray[np.str_]) -> Curves:
    """Average the curves of Q queries.

    Args:
        values: (Q, 21) interpolated precision, the highest at this recall or a greater one, at recall 0, 0.05, …, 1; a
            row with NaN has no part.
        names: (Q,) class of each.

    Returns:
        Lists of 21: `recall`, `micro` (mean of queries), `macro` (mean of classes), and `classes` by name.
    """
    counted = ~np.isnan(values).any(axis=1)
    found = {str(name): values[counted & (names == name)].mean(axis=0) for name in dict.fromkeys(names[counted])}
    nothing = np.full(LEVELS, np.nan)
    return {
        "recall": RECALL.tolist(),
        "micro": (values[counted].mean(axis=0) if found else nothing).tolist(),
        "macro": (np.mean(list(found.values()), axis=0) if found else nothing).tolist(),
        "classes": {name: curve.tolist() for name, curve in found.items()},
    }


def interpolated(precision: Float64, relevant: int) -> Float64:
    """The curve (21,) of one ranked list, from its precision at each hit, the nearest first; 0 where it has ended.

    Args:
        precision: (H,).
        relevant: How many there are to be found, at least 1.
    """
    curve = np.zeros(LEVELS)
    np.maximum.at(curve, (LEVELS - 1) * np.arange(1, len(precision) + 1) // relevant, precision)
    return np.maximum.accumulate(curve[::-1])[::-1]


def write_curves(path: Path, curves: Curves) -> None:
    """Write a row a level of recall: `recall`, `micro`, `macro`, then each class."""
    classes = curves["classes"]
    columns = [curves[name] for name in ("recall", "micro", "macro")] + list(classes.values())
    write_csv(path, ("recall", "micro", "macro", *classes), list(zip(*columns, strict=True)))


def draw_curves(folder: Path, curves: Curves, title: str) -> None:
    """Write `precision_recall.svg` and `.png`; the same numbers give the same bytes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.2, 4.2), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlabel="recall, %", ylabel="precision, %", xlim=(0, 100), ylim=(0, 102))
    axes.set_title(title, loc="left", fontsize=10)
    axes.grid(color="#dddddd", linewidth=0.8)
    for values in curves["classes"].values():
        axes.plot(100 * RECALL, 100 * np.array(values), color="#bbbbbb", linewidth=0.7)
    axes.plot([], [], color="#bbbbbb", linewidth=0.7, label="a class")
    for name, color, line in (("micro", "#1f6fb4", "-"), ("macro", "#d1652b", "--")):
        axes.plot(100 * RECALL, 100 * np.array(curves[name]), color=color, linewidth=2, linestyle=line, label=name)
    axes.legend(loc="lower left", frameon=False)
    save_figure(figure, folder, "precision_recall", title)
