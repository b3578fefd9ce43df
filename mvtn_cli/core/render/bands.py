"""Views seen in bands of rows: all cores have work also where there are fewer views than cores.

Nothing depends on where bands begin: a sample's value is never a sum over rows, jumps are listed row by row, and sums
over a view's samples are always taken block by block of a fixed size and added in their order.
"""

from __future__ import annotations

import numba
import numpy as np

from mvtn_cli.core.render.compiled import njit
from mvtn_cli.core.render.gbuffer import GBuffers
from mvtn_cli.core.render.skips import EMPTY_SAMPLES, SAMPLES

# A band goes through all faces for itself, so that of few rows is no gain.
FEWEST_ROWS = 16
# Rows of samples whose share of a gradient is one sum.
BLOCK = 32


def bands_for(views: int, side: int) -> int:
    """How many bands of its `side` rows each of the views is seen in: one where there are views for all threads."""
    return max(1, min(-(-numba.get_num_threads() // max(1, views)), side // FEWEST_ROWS))


@njit
def band_rows(band, bands, height):
    """First and last row of a band; first > last where no row is left for it."""
    rows = -(-height // bands)
    return band * rows, min(height, (band + 1) * rows) - 1


def join_bands(buffers: GBuffers, boxes: np.ndarray, jumps: np.ndarray, counts: np.ndarray) -> None:
    """Make whole views of bands: their boxes (N, K, 4), numbers of jumps (N, K) and counters (N, K, COUNTERS).

    The jumps of band k begin at k K-ths of the room there is; they are moved together.
    """
    buffers.boxes[:, 0::2], buffers.boxes[:, 1::2] = boxes[..., 0::2].min(axis=1), boxes[..., 1::2].max(axis=1)
    buffers.jumps[:], buffers.counts[:] = jumps.sum(axis=1), counts.sum(axis=1)
    first, last = buffers.boxes[:, 0::2], buffers.boxes[:, 1::2]
    buffers.counts[:, EMPTY_SAMPLES] = buffers.counts[:, SAMPLES] - (last + 1 - first).clip(0).prod(axis=1)
    bands = jumps.shape[1]
    room = buffers.records.shape[1] // bands
    for n, ends in enumerate(jumps.cumsum(axis=1)):
        for k in range(1, bands):
            here, there = slice(k * room, k * room + jumps[n, k]), slice(ends[k - 1], ends[k])
            buffers.records[n, there], buffers.where[n, there] = buffers.records[n, here], buffers.where[n, here]
