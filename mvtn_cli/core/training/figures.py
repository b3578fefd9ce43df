"""Plots as files."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from mvtn_cli.core.training.checkpoint import write_run_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def save_figure(figure: Figure, folder: Path, name: str, salt: str) -> list[Path]:
    """Write `NAME.svg` and `NAME.png`; the same plot gives the same bytes.

    Args:
        figure: The plot.
        folder: Where to.
        name: Of both files.
        salt: Tells the marks of different plots apart where several stand on one page.
    """
    import matplotlib

    paths = []
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": salt}):
        for suffix in ("svg", "png"):
            buffer = io.BytesIO()
            figure.savefig(buffer, format=suffix, dpi=150, metadata={"Date": None} if suffix == "svg" else None)
            paths.append(folder / f"{name}.{suffix}")
            write_run_file(paths[-1], buffer.getvalue())
    return paths
