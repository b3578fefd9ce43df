"""The G-buffers of several views: what is seen at each sample, before any light."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mvtn_cli.core.render.edges import COLUMNS
from mvtn_cli.core.render.skips import COUNTERS

# Jumps that there is room for, per row of samples; views with more are seen again with enough.
ROOM = 64


@dataclass(frozen=True)
class GBuffers:
    """N different views of S x S samples: 21 bytes a sample, 12 more for shapes with colours, and 28 a jump.

    Attributes:
        rts: (N, 3, 4) [R|t].
        shape_of: (N,) number of the shape in its batch.
        view_of: (K,) which of the N views is the k-th that was asked for.
        ids: (N, S, S) int32 face ids, -1 for background.
        depth: (N, S, S) float32 1/z, 0 for background.
        normals: (N, S, S, 3) float32 world normals towards the eye.
        tints: (N, S, S, 3) float32 interpolated colours, or (N, 0, 0, 3).
        links: (N, S, S) uint8: whether the surface goes on smoothly to the right (1) and downward (2).
        boxes: (N, 4) first and last row, first and last column that see anything; the rest of the arrays is undefined.
        records, where: (N, room, COLUMNS) float32 and (N, room) int32, the jumps (`edges.py`).
        jumps: (N,) how many there are.
        counts: (N, COUNTERS) what was left out (`skips.py`).
    """

    rts: np.ndarray
    shape_of: np.ndarray
    view_of: np.ndarray
    ids: np.ndarray
    depth: np.ndarray
    normals: np.ndarray
    tints: np.ndarray
    links: np.ndarray
    boxes: np.ndarray
    records: np.ndarray
    where: np.ndarray
    jumps: np.ndarray
    counts: np.ndarray

    @property
    def seen(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Depth, normals and tints."""
        return self.depth, self.normals, self.tints

    @property
    def edges(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Records, where they are and their number."""
        return self.records, self.where, self.jumps


def empty_buffers(rts: np.ndarray, shape_of: np.ndarray, view_of: np.ndarray, side: int, *, tinted: bool) -> GBuffers:
    """Room for N views of `side` squared samples."""
    count = len(rts)
    samples, tint = (count, side, side), side if tinted else 0
    return GBuffers(
        rts=rts,
        shape_of=shape_of,
        view_of=view_of,
        ids=np.empty(samples, np.int32),
        depth=np.empty(samples, np.float32),
        normals=np.empty((*samples, 3), np.float32),
        tints=np.empty((count, tint, tint, 3), np.float32),
        links=np.empty(samples, np.uint8),
        boxes=np.empty((count, 4), np.int64),
        records=np.empty((count, ROOM * side, COLUMNS), np.float32),
        where=np.empty((count, ROOM * side), np.int32),
        jumps=np.zeros(count, np.int64),
        counts=np.zeros((count, COUNTERS), np.int64),
    )


def with_room(buffers: GBuffers, room: int) -> GBuffers:
    """The same buffers with room for more jumps, to be filled again."""
    count = len(buffers.rts)
    records, where = np.empty((count, room, COLUMNS), np.float32), np.empty((count, room), np.int32)
    return replace(buffers, records=records, where=where)
