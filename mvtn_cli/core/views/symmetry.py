"""The turns that map a set of views onto itself: RotationNet's candidates for how a shape is aligned.

If a shape is turned by one of them, the same pictures come out again, in another order (and some of them
rolled, unless the turn is about the y axis).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

TOLERANCE = 1e-3  # of unit vectors; layouts are exact to 1e-15, and their views are 0.05 or more apart


class Symmetries(NamedTuple):
    """The turns of M views, the identity first.

    Attributes:
        rotations: (G, 3, 3) float64, proper rotations R of the world.
        permutations: (G, M) int64: R takes the direction of view k to that of view `permutations[g, k]`.
    """

    rotations: NDArray[np.float64]
    permutations: NDArray[np.int64]


def layout_symmetries(layout: str, azimuth_deg: ArrayLike, elevation_deg: ArrayLike) -> Symmetries:
    """The turns of a layout: of a circle those about its axis, of every other layout all that there are.

    A circle on the equator could also be flipped over, which an upright shape never is.

    Args:
        layout: Its name, as `layouts` takes it.
        azimuth_deg: (M,).
        elevation_deg: (M,).
    """
    if layout == "circular":
        return turns_about_y(azimuth_deg, elevation_deg)
    return symmetries(view_directions(azimuth_deg, elevation_deg))


def view_directions(azimuth_deg: ArrayLike, elevation_deg: ArrayLike) -> NDArray[np.float64]:
    """Unit vectors from the origin to the cameras, (M, 3) float64."""
    a, e = (np.deg2rad(np.asarray(angle, dtype=np.float64)) for angle in (azimuth_deg, elevation_deg))
    return np.stack([np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)], axis=-1)


def symmetries(directions: ArrayLike) -> Symmetries:
    """All proper rotations that map a set of directions onto itself.

    A rotation is given by where it takes two directions that are not parallel, so every pair of views that is
    as far apart as one chosen pair is tried. Where two views coincide, no turn but the identity is sure.

    Args:
        directions: (M, 3) unit vectors.
    """
    views = np.asarray(directions, dtype=np.float64)
    cosines = views @ views.T
    second = int(np.abs(cosines[0]).argmin())  # the view that is nearest to square with the first
    if np.abs(cosines[0, second]) > 1.0 - TOLERANCE**2 / 2:
        return _symmetries_of_a_line(views)
    source = _frame(views[0], views[second])
    pairs = np.argwhere(np.abs(cosines - cosines[0, second]) < TOLERANCE)
    rotations = [_frame(views[i], views[j]) @ source.T for i, j in pairs.tolist()]
    return _that_permute(views, rotations)


def turns_about_y(azimuth_deg: ArrayLike, elevation_deg: ArrayLike) -> Symmetries:
    """The turns about the y axis that take every camera, with its upright picture, to another one.

    Args:
        azimuth_deg: (M,).
        elevation_deg: (M,); all may stand on a pole, where they differ by the roll of their pictures.
    """
    azimuth, elevation = (np.asarray(angle, dtype=np.float64) for angle in (azimuth_deg, elevation_deg))
    # direction and right-hand axis of each camera: the second tells cameras on a pole apart
    right = view_directions(azimuth + 90.0, np.zeros_like(azimuth))
    cameras = np.concatenate([view_directions(azimuth, elevation), right], axis=1)
    rotations = [_about_y(turn) for turn in azimuth - azimuth[0]]
    return _that_permute(cameras, rotations)


def _that_permute(vectors: NDArray[np.float64], rotations: list[NDArray[np.float64]]) -> Symmetries:
    """Those rotations that take each row of one or more vectors (M, 3n) to a row of its own; none comes twice."""
    found: dict[tuple[int, ...], NDArray[np.float64]] = {tuple(range(len(vectors))): np.eye(3)}
    for rotation in rotations:
        turned = (vectors.reshape(len(vectors), -1, 3) @ rotation.T).reshape(vectors.shape)
        apart = np.linalg.norm(turned[:, None] - vectors, axis=2)
        nearest = apart.argmin(axis=1)
        if apart.min(axis=1).max() < TOLERANCE and len(set(nearest.tolist())) == len(vectors):
            found.setdefault(tuple(nearest.tolist()), rotation)
    permutations = sorted(found)  # the identity is the least of all permutations
    return Symmetries(np.stack([found[order] for order in permutations]), np.array(permutations, dtype=np.int64))


def _symmetries_of_a_line(views: NDArray[np.float64]) -> Symmetries:
    """Of one view, or of two that face each other: half a turn about an axis square to them swaps those."""
    square = np.eye(3)[int(np.abs(views[0]).argmin())]
    square -= (square @ views[0]) * views[0]
    square /= np.linalg.norm(square)
    return _that_permute(views, [2.0 * np.outer(square, square) - np.eye(3)])


def _frame(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Right-handed orthonormal columns: `first`, `second` without its part along it, and what completes them."""
    across = second - (first @ second) * first
    across /= np.linalg.norm(across)
    return np.stack([first, across, np.cross(first, across)], axis=1)


def _about_y(angle_deg: float) -> NDArray[np.float64]:
    """The rotation that adds `angle_deg` to every azimuth."""
    angle = np.deg2rad(angle_deg)
    return np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
