"""Compiled: where the relevant shapes of each query stand in its ranking, without sorting the ranking.

Only the relevant ones are sorted. Each shape of the gallery is then counted into the gap between two of them, which a
table of buckets finds in a few steps.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mvtn_cli.core.render.compiled import njit

BUCKETS_EACH = 8  # of a relevant shape: few gaps share one
LEVELS = 21  # of recall, from 0 to 1, at which precision is interpolated
MOST_BUCKETS = 32_768  # 128 kB: stay in the second cache


@njit
def _buckets(values: Any, low: float, scale: float, last: int) -> Any:
    """Number of each value's bucket, 0 to `last`; never falls when the value rises. A loop of its own for SIMD."""
    found = np.empty(len(values), np.int32)
    for i in range(len(values)):
        found[i] = int(min(max((values[i] - low) * scale, 0.0), float(last)))
    return found


@njit
def _first_not_less(relevant: Any, value: float, left: int, right: int) -> int:
    while left < right:
        middle = (left + right) >> 1
        if relevant[middle] < value:
            left = middle + 1
        else:
            right = middle
    return left


@njit
def _positions(relevant: Any, keys: Any, many: Any) -> Any:
    """For sorted keys of R relevant shapes: how many of the gallery are as near, and how many are equal, (2, R + 1).

    The second row counts at the first of equal relevant shapes alone; the last column is of no meaning.
    """
    count, low, high = len(relevant), relevant[0], relevant[-1]
    last = min(MOST_BUCKETS, BUCKETS_EACH * count)
    scale = last / (high - low) if high > low else 0.0
    if not math.isfinite(scale):
        scale = 0.0
    start = np.zeros(last + 2, np.int32)
    for b in _buckets(relevant, low, scale, last):
        start[b + 1] += 1
    for b in range(last + 1):
        start[b + 1] += start[b]
    found = np.zeros((2, count + 1), np.int64)
    bucket = _buckets(keys, low, scale, last)
    for u in range(len(keys)):
        gap, end = start[bucket[u]], start[bucket[u] + 1]
        if gap < end:
            gap = _first_not_less(relevant, keys[u], gap, end)
            if gap < end and relevant[gap] == keys[u]:
                found[1, gap] += many[u]
        found[0, gap] += many[u]
    for i in range(1, count):
        found[0, i] += found[0, i - 1]
    return found


@njit(nogil=True)
def rank_block(
    keys: Any, many: Any, place: Any, members: Any, offsets: Any, labels: Any, sums: Any, cuts: Any, out: Any
) -> None:
    """Measure the ranking of each query.

    Args:
        keys: (B, U) float64, by which distinct descriptors are ranked.
        many: (U,) int64, how many shapes have each.
        place: (N,) int64, which descriptor each shape has.
        members: (N,) int64 shapes, class by class.
        offsets: (C + 1,) int64, where each class begins in `members`.
        labels: (B,) int64 class of each query.
        sums: (2, N + 1) float64, over the first n positions: of 1/n, and of the discount 1/log2(n + 1).
        cuts: (K,) int64 positions after which hits are counted.
        out: (B, 3 + K + 21) float64, filled with AP, `ap_printed`, NDCG, the hits at each cut, and precision
            interpolated at recall 0, 0.05, …, 1; NaN where nothing is relevant. Equal distances share their positions:
            AP and the precision that is interpolated are taken at the end of the group (as scikit-learn does), all
            else is the mean over the group's positions.
    """
    for row in range(len(labels)):
        begin, end = offsets[labels[row]], offsets[labels[row] + 1]
        out[row] = np.nan
        if begin == end:
            continue
        relevant = np.empty(end - begin)
        for i in range(end - begin):
            relevant[i] = keys[row, place[members[begin + i]]]
        relevant.sort()
        found = _positions(relevant, keys[row], many)
        _measure(relevant, found, sums, cuts, out[row])


@njit
def _measure(relevant: Any, found: Any, sums: Any, cuts: Any, out: Any) -> None:
    count, first, curve = len(relevant), 0, out[3 + len(cuts) :]
    out[:] = 0.0
    while first < count:
        after = first + 1
        while after < count and relevant[after] == relevant[first]:
            after += 1
        within, group = found[0, first], found[1, first]
        closer, hits = within - group, after - first
        share = hits / group
        out[0] += hits * after / within
        out[1] += share * (sums[0, within] - sums[0, closer])
        out[2] += share * (sums[1, within] - sums[1, closer])
        for k in range(len(cuts)):
            out[3 + k] += share * min(max(cuts[k] - closer, 0), group)
        level = (LEVELS - 1) * after // count
        curve[level] = max(curve[level], after / within)
        first = after
    for level in range(LEVELS - 2, -1, -1):
        curve[level] = max(curve[level], curve[level + 1])
    out[0] /= count
    out[1] /= count
    out[2] /= sums[1, count]
