"""What painting needs of the G-buffers of one shape, and no more, so that it can be kept for later epochs.

Painting reads whether a sample is covered, its normal and its tint, and of each jump its share, slope and part; face
ids, depth, links and the crossing points serve the gradient to the cameras alone. Samples outside the covered box and
uncovered ones within it are not kept. All that is kept is kept bit for bit, so that pictures are the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.render.compiled import njit, prange
from mvtn_cli.core.render.edges import COLUMNS, PART, SHARE, SLOPE
from mvtn_cli.core.render.gbuffer import GBuffers
from mvtn_cli.core.render.view import paint_view

BLEND = [SHARE, SLOPE, PART]  # columns of a jump's record that `blend` reads


@dataclass(frozen=True)
class KeptViews:
    """M views of one shape: 12 bytes a covered sample, 12 more with colours, a bit a sample of the box, 16 a jump.

    Attributes:
        rts: (M, 3, 4) float64 [R|t].
        boxes: (M, 4) int64 first and last row, first and last column of the covered box.
        covered: (Σ⌈box / 8⌉,) uint8: a bit for each sample of the boxes, row by row; each view begins a byte.
        samples: (M,) int64 covered samples.
        normals: (Σ samples, 3) float32 world normals towards the eye.
        tints: (Σ samples, 3) float32 interpolated colours, or (0, 3) for shapes without.
        jumps: (M,) int64 how many jumps there are.
        records: (Σ jumps, 3) float32 share, slope and part of each.
        where: (Σ jumps,) int32 its place.
    """

    rts: NDArray[np.float64]
    boxes: NDArray[np.int64]
    covered: NDArray[np.uint8]
    samples: NDArray[np.int64]
    normals: NDArray[np.float32]
    tints: NDArray[np.float32]
    jumps: NDArray[np.int64]
    records: NDArray[np.float32]
    where: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.rts)

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """By name, to be written."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def nbytes(self) -> int:
        """Bytes that they take in memory."""
        return sum(array.nbytes for array in self.arrays.values())

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]]) -> KeptViews:
        """The inverse of `arrays`."""
        return cls(**{field.name: arrays[field.name] for field in fields(cls)})


def trim(buffers: GBuffers) -> list[KeptViews]:
    """Keep of the G-buffers of B shapes with M views each what painting needs, shape by shape."""
    seen_for = buffers.shape_of[buffers.view_of]
    return [_trim_shape(buffers, buffers.view_of[seen_for == b]) for b in range(int(seen_for.max(initial=-1)) + 1)]


def _trim_shape(buffers: GBuffers, views: NDArray[np.int64]) -> KeptViews:
    has_tints = buffers.tints.shape[1] > 0
    covered, normals, tints, records, where = [], [], [], [], []
    for n in views:
        top, bottom, left, right = buffers.boxes[n]
        box = (n, slice(top, bottom + 1), slice(left, right + 1))
        mask = buffers.depth[box] != 0.0
        covered.append(np.packbits(mask))
        normals.append(buffers.normals[box][mask])
        tints.append(buffers.tints[box][mask] if has_tints else np.zeros((0, 3), np.float32))
        records.append(buffers.records[n, : buffers.jumps[n], BLEND].T)
        where.append(buffers.where[n, : buffers.jumps[n]])
    return KeptViews(
        rts=buffers.rts[views],
        boxes=buffers.boxes[views],
        covered=np.concatenate(covered),
        samples=np.array([len(part) for part in normals], np.int64),
        normals=np.concatenate(normals),
        tints=np.concatenate(tints),
        jumps=buffers.jumps[views],
        records=np.ascontiguousarray(np.concatenate(records)),
        where=np.concatenate(where),
    )


@dataclass(frozen=True)
class PackedViews:
    """The kept views of several shapes, one after another.

    Attributes:
        rts, boxes, covered, normals, tints, records, where: Of all shapes, as in `KeptViews`.
        shape_of: (N,) number of the shape.
        starts: (4, N + 1) where each view begins in `covered`, `normals`, `tints` and `records`; a view of a shape
            without colours has no tints.
    """

    rts: np.ndarray
    shape_of: np.ndarray
    boxes: np.ndarray
    covered: np.ndarray
    normals: np.ndarray
    tints: np.ndarray
    records: np.ndarray
    where: np.ndarray
    starts: np.ndarray


def put_together(kept: Sequence[KeptViews]) -> PackedViews:
    """Join the views of B shapes, to be painted in one go."""

    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(views, name) for views in kept])

    boxes, samples = joined("boxes"), joined("samples")
    area = (boxes[:, 1] + 1 - boxes[:, 0]).clip(0) * (boxes[:, 3] + 1 - boxes[:, 2]).clip(0)
    tinted = np.concatenate([np.full(len(views), len(views.tints) > 0) for views in kept])
    counts = np.stack([(area + 7) // 8, samples, samples * tinted, joined("jumps")])
    starts = np.zeros((4, len(boxes) + 1), np.int64)
    np.cumsum(counts, axis=1, out=starts[:, 1:])
    return PackedViews(
        rts=joined("rts"),
        shape_of=np.repeat(np.arange(len(kept)), [len(views) for views in kept]),
        boxes=boxes,
        covered=joined("covered"),
        normals=joined("normals"),
        tints=joined("tints"),
        records=joined("records"),
        where=joined("where"),
        starts=starts,
    )


@njit
def spread_out(box, covered, normals, tints, depth, normal_image, tint_image):
    """Fill the box of one view's images again; of depth, painting only asks whether it is 0."""
    bit = sample = 0
    for j in range(box[0], box[1] + 1):
        for i in range(box[2], box[3] + 1):
            seen = (covered[bit >> 3] >> (7 - (bit & 7))) & 1
            bit += 1
            depth[j, i] = seen
            if seen:
                for axis in range(3):
                    normal_image[j, i, axis] = normals[sample, axis]
                    if tint_image.shape[0] > 0:
                        tint_image[j, i, axis] = tints[sample, axis]
                sample += 1


@njit(parallel=True)
def paint_kept_views(
    rts, shape_of, side, focal, supersample, lights, albedos, material, background, skips, boxes, covered, normals,
    tints, records, where, starts, out,
):  # fmt: skip
    """Fill `out` (N,3,H,W) from kept views of `side` squared samples; a view's images live while it is painted."""
    for n in prange(rts.shape[0]):
        b = shape_of[n]
        mine, jumps = slice(starts[1, n], starts[1, n + 1]), starts[3, n + 1] - starts[3, n]
        tint_side = side if starts[2, n + 1] > starts[2, n] else 0
        depth, normal_image = np.empty((side, side), np.float32), np.empty((side, side, 3), np.float32)
        tint_image, image = np.empty((tint_side, tint_side, 3), np.float32), np.empty((side, side, 3), np.float32)
        spread_out(
            boxes[n], covered[starts[0, n] : starts[0, n + 1]], normals[mine], tints[starts[2, n] : starts[2, n + 1]],
            depth, normal_image, tint_image,
        )  # fmt: skip
        record = np.empty((jumps, COLUMNS), np.float32)
        for k in range(jumps):
            kept = records[starts[3, n] + k]
            record[k, SHARE], record[k, SLOPE], record[k, PART] = kept[0], kept[1], kept[2]
        paint_view(
            rts[n], focal, supersample, lights[b], albedos[b], material, background, skips, depth, normal_image,
            tint_image, boxes[n], record, where[starts[3, n] : starts[3, n + 1]], jumps, image, out[n],
        )  # fmt: skip
