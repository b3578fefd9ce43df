"""Pictures of what was found: a query and its hits in a row, the wrong ones framed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.evaluation.pictures import draw_shapes
from mvtn_cli.core.reporting.images import contact_sheet

if TYPE_CHECKING:
    from mvtn_cli.core.preprocess import Prepared

RED = (205, 35, 35)
FRAME = 4  # pixels
PAPER = 252  # where there is no picture
TILE = 112  # pixels
PER_ROW = 10  # hits beside the query
MOST = 50  # hits that are pictured
SIDE = (35.0, 25.0)  # azimuth and elevation from which all are seen, degrees
Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class Found:
    """A query and its hits.

    Attributes:
        query: (3, H, W).
        title: Of the query.
        hits: (K, 3, H, W), the nearest first.
        captions: K texts.
        wrong: (K,) which ones have another class than the query; all False where its class is not known.
    """

    query: Bytes
    title: str
    hits: Bytes
    captions: Sequence[str]
    wrong: Sequence[bool]


def tiles(prepared: Prepared, indices: Sequence[int], settings: Any) -> Bytes:
    """Draw shapes (N, 3, H, W) from one side, white, under a headlight.

    Args:
        prepared: The data set.
        indices: N of its records.
        settings: Those of the run: its look, distance and way of drawing hold.
    """
    small = settings.model_copy(update={"image_size": TILE, "supersample": 2})
    return draw_shapes(prepared, indices, [[SIDE[0]]], [[SIDE[1]]], small)[:, 0]


def framed(image: Bytes, color: tuple[int, int, int] = RED) -> Bytes:
    """Return a copy of a picture (3, H, W) with a frame inside its border."""
    inner = np.zeros(image.shape[1:], bool)
    inner[FRAME:-FRAME, FRAME:-FRAME] = True
    return np.where(inner, image, np.array(color, np.uint8)[:, None, None])


def found_sheet(rows: Sequence[Found], title: str = "") -> bytes:
    """Lay queries and their hits out as PNG: the query to the left, wrong hits framed red.

    Args:
        rows: One or more; at most 50 hits of each are shown, ten beside each other.
        title: Written over everything.
    """
    across = min(PER_ROW, max((len(row.hits) for row in rows), default=0))
    lines = [line for row in rows for line in _lines(row, max(1, across))]
    images = np.stack([line[0] for line in lines])
    return contact_sheet(
        images,
        [line[2] for line in lines],
        ["query", *(str(place) for place in range(1, across + 1))],
        captions=[line[1] for line in lines],
        title=title,
    )


def _lines(row: Found, across: int) -> list[tuple[Bytes, list[str], str]]:
    """Pictures (1 + across, 3, H, W), captions and title of each line that a query takes."""
    blank = np.full_like(row.query, PAPER)
    shown = min(len(row.hits), MOST)
    lines = []
    for begin in range(0, max(shown, 1), across):
        places = range(begin, min(begin + across, shown))
        hits = [framed(row.hits[k]) if row.wrong[k] else row.hits[k] for k in places]
        empty = across - len(hits)
        pictures = np.stack([blank if begin else row.query, *hits, *[blank] * empty])
        captions = ["", *(row.captions[k] for k in places), *[""] * empty]
        lines.append((pictures, captions, "" if begin else row.title))
    return lines
