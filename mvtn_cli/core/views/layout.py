"""Fixed view layouts: M camera directions, for every M from 1 to 100."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.errors import UsageError, choose_error

LAYOUTS = ("circular", "spherical", "dodecahedral", "icosahedral", "random")
MAX_VIEWS = 100

Angles = tuple[NDArray[np.float64], NDArray[np.float64]]


def layouts(
    name: str, num_views: int, elevation_deg: float = 30.0, azimuth_deg: float = 0.0, *, seed: int = 0
) -> Angles:
    """Azimuths and elevations of a named layout.

    Args:
        name: One of `LAYOUTS`.
        num_views: M, 1..100; 20 for dodecahedral, 12 for icosahedral.
        elevation_deg: Of the circle, and of a single view.
        azimuth_deg: Where the circle starts, and where a single view stands.
        seed: Of `random` alone.

    Returns:
        Azimuth and elevation, each (M,) float64, degrees.

    Raises:
        UsageError: Unknown name, or a number of views that the layout doesn't have.
    """
    if not 1 <= num_views <= MAX_VIEWS:
        raise UsageError(
            f"the number of views must lie in 1..{MAX_VIEWS}, got {num_views}", code="views.number-of-views"
        )
    match name:
        case "circular":
            return _circular(num_views, elevation_deg, azimuth_deg)
        case "spherical" if num_views == 1:
            return _circular(1, elevation_deg, azimuth_deg)
        case "spherical":
            return _rings(_deserno_ring_sizes(num_views) or _even_ring_sizes(num_views))
        case "dodecahedral":
            return _solid(_dodecahedron(), name, num_views)
        case "icosahedral":
            return _solid(_icosahedron(), name, num_views)
        case "random":
            return _random(num_views, seed)
        case _:
            raise choose_error("layout", name, LAYOUTS)


def _circular(num_views: int, elevation_deg: float, azimuth_deg: float) -> Angles:
    azimuth = azimuth_deg + 360.0 * np.arange(num_views) / num_views
    return azimuth, np.full(num_views, float(elevation_deg))


def _ring_count(num_views: int) -> int:
    """Rings so far apart as the side of a square of each view's share of the sphere."""
    return max(1, round(math.pi / math.sqrt(4 * math.pi / num_views)))


def _ring_elevations(rings: int) -> NDArray[np.float64]:
    return 180.0 * (np.arange(rings) + 0.5) / rings - 90.0


def _deserno_ring_sizes(num_views: int) -> list[int] | None:
    """Ring sizes of the regular grid that the paper uses, or None where they don't sum to M.

    Source: M. Deserno, How to generate equidistributed points on the surface of a sphere (2004).
    """
    rings = _ring_count(num_views)
    arc = (4 * math.pi / num_views) / (math.pi / rings)
    sizes = [round(2 * math.pi * math.cos(math.radians(elevation)) / arc) for elevation in _ring_elevations(rings)]
    return sizes if sum(sizes) == num_views and min(sizes) >= 1 else None


def _even_ring_sizes(num_views: int) -> list[int]:
    """Ring sizes in proportion to the rings' lengths that sum to M, by largest remainder.

    At equal remainders the lower ring comes first.
    """
    rings = _ring_count(num_views)
    elevations = _ring_elevations(rings)
    length = np.cos(np.deg2rad(elevations))
    share = num_views * length / length.sum()
    sizes = np.maximum(np.floor(share).astype(int), 1)
    # rounded, so that the two rings of a mirror pair tie in every arithmetic
    order = np.argsort(-np.round(share - sizes, 9), kind="stable")
    for ring in order[: num_views - int(sizes.sum())]:
        sizes[ring] += 1
    return [int(size) for size in sizes]


def _rings(sizes: list[int]) -> Angles:
    """Rings from the lowest to the highest, each of equally spaced azimuths from 0 on."""
    azimuth = np.concatenate([360.0 * np.arange(size) / size for size in sizes])
    return azimuth, np.repeat(_ring_elevations(len(sizes)), sizes)


def _dodecahedron() -> NDArray[np.float64]:
    g = (1 + math.sqrt(5)) / 2
    corners = [(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
    for s in (-1, 1):
        for t in (-1, 1):
            corners += [(0, s / g, t * g), (s / g, t * g, 0), (s * g, 0, t / g)]
    return np.array(corners)


def _icosahedron() -> NDArray[np.float64]:
    g = (1 + math.sqrt(5)) / 2
    corners = []
    for s in (-1, 1):
        for t in (-1, 1):
            corners += [(0, s, t * g), (s, t * g, 0), (s * g, 0, t)]
    return np.array(corners, dtype=np.float64)


def _solid(corners: NDArray[np.float64], name: str, num_views: int) -> Angles:
    """The corners of a regular solid, from the lowest up, each height by azimuth in 0..360."""
    if num_views != len(corners):
        raise UsageError(
            f"the {name} layout has {len(corners)} views, got {num_views}",
            hint=f"--num-views {len(corners)}, or --layout spherical for any number",
            code="views.number-of-views",
        )
    azimuth, elevation = _angles(corners)
    azimuth = np.mod(np.round(azimuth, 9), 360.0)
    order = np.lexsort((azimuth, np.round(elevation, 6)))
    return azimuth[order], elevation[order]


def _random(num_views: int, seed: int) -> Angles:
    """Uniform on the sphere (the direction of a Gaussian vector)."""
    return _angles(np.random.default_rng(seed).standard_normal((num_views, 3)))


def _angles(directions: NDArray[np.float64]) -> Angles:
    """Azimuth in [-180, 180] and elevation of (M, 3) directions of any length."""
    x, y, z = directions.T
    return np.rad2deg(np.arctan2(x, z)), np.rad2deg(np.arctan2(y, np.hypot(x, z)))
