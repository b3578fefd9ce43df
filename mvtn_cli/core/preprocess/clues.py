"""What can be told about a shape from its geometry alone: is it a copy, is it inside out, which way is up."""

from __future__ import annotations

from hashlib import blake2b
from typing import Literal

import numpy as np
import numpy.typing as npt

from mvtn_cli.core.shapes.geometry import box_frame

FloatArray = npt.NDArray[np.float64]
Winding = Literal["out", "in", "unclear"]

CELL = 1e-5  # of the half extent: points that agree to this count as one
MIXED = 0.05  # share of an open surface's volumes; below it, faces look inwards as much as outwards
ROUNDING = 1e-9  # the same of a closed one, whose sum is exact but for rounding
BINS = 8  # of the height profile
LEAST = 12  # shapes: a few chairs don't tell the axis of a set
CLEAR = 1.25  # times the next axis' asymmetry: then the up axis is told


def fingerprint(xyz: FloatArray) -> str:
    """Return a hash of (n, 3) points that order, repetition, place and scale don't change.

    Networks see shapes centred and of one size, so that a moved or scaled copy is the same shape to them. Coordinates
    are rounded to `CELL`, so copies that were written with fewer digits are not found.
    """
    center, half = box_frame(xyz)
    cells = np.rint((xyz - center) / (half * CELL)).astype(np.int32)
    cells = cells[np.lexsort(cells.T)]
    new = np.ones(len(cells), bool)
    new[1:] = (cells[1:] != cells[:-1]).any(axis=1)
    return blake2b(cells[new].tobytes(), digest_size=16).hexdigest()


def winding(vertices: FloatArray, faces: npt.NDArray[np.int32]) -> Winding:
    """Tell whether a mesh's faces look outwards.

    Each face spans a tetrahedron with the centre of the box, of positive volume if it looks away from there. For a
    closed surface the sum is its volume, whatever its form; for an open one the sign still tells, if it is clear.

    Args:
        vertices: (V, 3).
        faces: (F, 3), counter-clockwise seen from outside.
    """
    center, half = box_frame(vertices)
    local = (vertices - center) / half
    a, b, c = (local[faces[:, corner]] for corner in range(3))
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c))
    total, whole = float(volumes.sum()), float(np.abs(volumes).sum())
    if abs(total) <= (ROUNDING if is_closed(faces) else MIXED) * whole:
        return "unclear"
    return "out" if total > 0 else "in"


def is_closed(faces: npt.NDArray[np.int32]) -> bool:
    """Tell whether each edge of (F, 3) faces is passed as often one way as the other."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    count = int(edges.max()) + 1
    there, back = (np.sort(edges @ np.array(order)) for order in ((count, 1), (1, count)))
    return bool((there == back).all())


def asymmetry(xyz: FloatArray) -> tuple[float, float, float]:
    """Return how much (n, 3) points differ from their mirror image along x, y and z, 0 to 1.

    Compared are the shares of points in `BINS` slices. Most things are alike on the left and on the right, many in
    front and behind, few above and below.
    """
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    spread = np.where(high > low, high - low, 1.0)
    slices = np.minimum((xyz - low) / spread * BINS, BINS - 1).astype(np.int64)
    shares = [np.bincount(slices[:, axis], minlength=BINS) / len(xyz) for axis in range(3)]
    x, y, z = (float(np.abs(share - share[::-1]).sum() / 2) for share in shares)
    return x, y, z


def up_axis(asymmetries: FloatArray) -> str:
    """Return the axis `x`, `y` or `z` that seems to point up in most of (n, 3) asymmetries; empty if none does."""
    if len(asymmetries) < LEAST:
        return ""
    mean = asymmetries.mean(axis=0)
    first, second = np.argsort(mean)[::-1][:2]
    return "xyz"[first] if mean[first] > CLEAR * mean[second] else ""
