"""Plots as files."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from mvtn_cli.core.training.checkpoint import write_run_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure_bytes(figure: Figure, form: str, salt: str) -> bytes:
    """The plot as a file of a format, "svg" or "png"; the same plot gives the same bytes.

    Args:
        figure: The plot.
        form: The format.
        salt: Tells the marks of different plots apart where several stand on one page.
    """
    import matplotlib

    buffer = io.BytesIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": salt}):
        figure.savefig(buffer, format=form, dpi=150, metadata={"Date": None} if form == "svg" else None)
    return buffer.getvalue()


def save_figure(figure: Figure, folder: Path, name: str, salt: str) -> list[Path]:
    """Write `NAME.svg` and `NAME.png` into a folder; else as `figure_bytes`."""
    paths = [folder / f"{name}.{form}" for form in ("svg", "png")]
    for path in paths:
        write_run_file(path, figure_bytes(figure, path.suffix[1:], salt))
    return paths
