"""Between two neighbouring samples, where does the seen surface break off? All faces are asked, exactly."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np


@dataclass(frozen=True)
class Piece:
    """A stretch of the way from one sample (0) to the next (1) along which one face (or none, -1) is seen."""

    low: float
    high: float
    face: int


def seen_along(camera: np.ndarray, faces: np.ndarray, ray: np.ndarray, step: np.ndarray) -> list[Piece]:
    """Return what the ray sees on its way from `ray` to `ray + step`, in order.

    Args:
        camera: (V, 3) vertices: right, down, ahead.
        faces: (F, 3).
        ray, step: (3,) in camera coordinates.
    """
    low, high = spans(camera[faces], ray, step)
    hit = np.flatnonzero(low < high)
    meets = meetings(camera, faces, hit, ray, step)
    breaks = sorted({0.0, 1.0, *low[hit].tolist(), *high[hit].tolist(), *meets})
    pieces: list[Piece] = []
    for start, end in pairwise(breaks):
        middle = (start + end) / 2
        here = [n for n in hit if low[n] <= middle <= high[n]]
        face = max(here, key=lambda n: inverse_depth(camera[faces[n]], ray + middle * step), default=-1)
        if pieces and pieces[-1].face == face:
            pieces[-1] = Piece(pieces[-1].low, end, face)
        elif end - start > 1e-12:
            pieces.append(Piece(start, end, face))
    return pieces


def spans(corners: np.ndarray, ray: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return from where to where on the way, (F,) each, triangles (F, 3, 3) are hit; from > to: never."""
    orientation = np.sign(np.linalg.det(corners))[:, None, None]
    sides = orientation * np.cross(corners, np.roll(corners, -1, axis=1))
    start, change = sides @ ray, sides @ step
    with np.errstate(divide="ignore", invalid="ignore"):
        zero = -start / change
    low = np.where(change > 0, zero, 0.0).max(axis=1, initial=0.0)
    high = np.where(change < 0, zero, 1.0).min(axis=1, initial=1.0)
    never = ((change == 0) & (start < 0)).any(axis=1)
    return low, np.where(never, -1.0, high)


def inverse_depth(corners: np.ndarray, ray: np.ndarray) -> float:
    """Return 1/z of where a ray meets the plane of a triangle."""
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    return (normal @ ray) / (normal @ corners[0])


def meetings(camera: np.ndarray, faces: np.ndarray, hit: np.ndarray, ray: np.ndarray, step: np.ndarray) -> list[float]:
    """Return where on the way two of the faces that are hit are equally near."""
    ends = [[inverse_depth(camera[faces[n]], at) for at in (ray, ray + step)] for n in hit]
    found = []
    for (start_a, end_a), (start_b, end_b) in combinations(ends, 2):
        start, end = start_a - start_b, end_a - end_b
        if start * end < 0:
            found.append(float(start / (start - end)))
    return found


@dataclass(frozen=True)
class Jump:
    """Where the seen surface breaks off, and by how much 1/z changes there, relative to the nearer side."""

    share: float
    depth_step: float


def jumps(camera: np.ndarray, faces: np.ndarray, ray: np.ndarray, step: np.ndarray) -> list[Jump]:
    """Return every place between two samples where the seen surface doesn't go on."""
    found = []
    for before, after in pairwise(seen_along(camera, faces, ray, step)):
        at = ray + before.high * step
        depths = [inverse_depth(camera[faces[p.face]], at) if p.face >= 0 else 0.0 for p in (before, after)]
        change = abs(depths[0] - depths[1]) / max(depths)
        if change > 1e-9 or not neighbours(camera, faces, before.face, after.face):
            found.append(Jump(before.high, change))
    return found


def neighbours(camera: np.ndarray, faces: np.ndarray, first: int, second: int) -> bool:
    """Say whether two faces have two places in common."""
    places = [{tuple(camera[v]) for v in faces[face]} for face in (first, second)]
    return len(places[0] & places[1]) >= 2
