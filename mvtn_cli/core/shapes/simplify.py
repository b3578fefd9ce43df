"""Fewer triangles, and what that costs."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from threading import Lock

import fast_simplification
import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from mvtn_cli.core.shapes.distance import distance_to_mesh
from mvtn_cli.core.shapes.geometry import first_equal, referenced
from mvtn_cli.core.shapes.normalise import normalise
from mvtn_cli.core.shapes.sample import sample_surface
from mvtn_cli.core.shapes.shape import FloatArray, Shape
from mvtn_cli.core.shapes.validate import validate

ERROR_SAMPLES = 2_000
ACCEPTED_PERCENT = 5.0  # worst distance, of the radius, with which no other method is tried
_ATTEMPTS = 6
_LIBRARY = Lock()  # fast_simplification keeps its mesh in global variables


@dataclass(frozen=True)
class Simplification:
    """What simplifying did.

    Attributes:
        error_percent: Mean distance of 2,000 samples of the original to the result, in percent of the radius.
        seconds: Time of simplifying, that of measuring the error included.
        worst_percent: The largest of those distances.
        method: `collapse`, `collapse-keeping-borders` or `grid`.
    """

    vertices_before: int
    vertices_after: int
    faces_before: int
    faces_after: int
    error_percent: float
    seconds: float
    worst_percent: float = 0.0
    method: str = "collapse"


def simplify(shape: Shape, max_vertices: int) -> tuple[Shape, Simplification | None]:
    """Reduce a mesh to at most `max_vertices` vertices.

    Quadric edge collapses come first. They can swallow thin open sheets whole, and can't get meshes of loose
    pieces below the limit; so where a sample of the original ends up farther than 5 % of the radius from the
    result, collapses that leave borders alone and merging on a grid are tried too, and the best one is taken.
    Vertex colours come from the nearest vertex of the original.

    Args:
        shape: Validated; file units or normalised.
        max_vertices: At least 4.

    Returns:
        The shape and what was done; the shape given and None if it is a point cloud or under the limit
        (or, with a limit of a few vertices, if nothing of it would be left).
    """
    if max_vertices < 4:
        raise ValueError(f"max_vertices must be at least 4, got {max_vertices}")
    if shape.is_cloud or len(shape.vertices) <= max_vertices:
        return shape, None
    begin = time.perf_counter()
    unit, center, radius = normalise(shape)
    samples, _ = sample_surface(unit, ERROR_SAMPLES, seed=0)
    tried: list[tuple[float, float, str, Shape]] = []
    for method, reduced in _candidates(unit, max_vertices):
        distance = distance_to_mesh(samples, reduced.vertices, reduced.faces)
        tried.append((float(distance.max()), float(distance.mean()), method, reduced))
        if 100 * tried[-1][0] <= ACCEPTED_PERCENT:
            break
    if not tried:
        return shape, None
    worst, mean, method, reduced = min(tried, key=lambda one: one[:2])
    if unit.colors is not None:
        reduced = replace(reduced, colors=unit.colors[KDTree(unit.vertices).query(reduced.vertices)[1]])
    report = Simplification(
        vertices_before=len(shape.vertices),
        vertices_after=len(reduced.vertices),
        faces_before=len(shape.faces),
        faces_after=len(reduced.faces),
        error_percent=100 * mean,
        seconds=time.perf_counter() - begin,
        worst_percent=100 * worst,
        method=method,
    )
    return replace(reduced, vertices=reduced.vertices * radius + center), report


def _candidates(unit: Shape, max_vertices: int) -> Iterator[tuple[str, Shape]]:
    """Yield what each method makes within the limit, the usually best first."""
    for keep_borders, method in ((False, "collapse"), (True, "collapse-keeping-borders")):
        if (reduced := _by_collapses(unit, max_vertices, keep_borders)) is not None:
            yield method, reduced
    if (reduced := _on_grid(unit, max_vertices)) is not None:
        yield "grid", reduced


def _by_collapses(unit: Shape, max_vertices: int, keep_borders: bool) -> Shape | None:
    """Collapse edges; None if that does not get below the limit.

    The library's target counts triangles: converted by the mesh's own ratio, checked, and lowered if over.
    """
    target = len(unit.faces) * max_vertices / len(unit.vertices)
    for _ in range(_ATTEMPTS):
        with _LIBRARY:
            vertices, faces = fast_simplification.simplify(
                unit.vertices, unit.faces, target_count=max(int(target), 1), preserve_border=keep_borders
            )
        reduced = _clean(unit, vertices, faces)
        if reduced is None:
            return None
        if len(reduced.vertices) <= max_vertices:
            return reduced
        target *= 0.95 * max_vertices / len(reduced.vertices)
    return None


def _on_grid(unit: Shape, max_vertices: int) -> Shape | None:
    """Merge all vertices of a grid cell into the first, on the finest grid that fits; None if none does."""
    fits: Shape | None = None
    coarse, fine = 1, 1 << 14  # cells along the radius
    while fine - coarse > 1:
        cells = (coarse + fine) // 2
        at = np.rint(unit.vertices * cells).astype(np.int64)
        first = first_equal([at[:, 0], at[:, 1], at[:, 2]])
        reduced = _clean(unit, unit.vertices, first[unit.faces])
        if reduced is not None and len(reduced.vertices) > max_vertices:
            fine = cells
        else:
            coarse, fits = cells, reduced or fits
    return fits


def _clean(unit: Shape, vertices: FloatArray, faces: npt.NDArray[np.integer]) -> Shape | None:
    """Return what is left after degenerate faces and loose vertices are dropped; None if nothing is."""
    used = referenced(faces, len(vertices))
    new = np.cumsum(used) - 1
    raw = replace(unit, vertices=np.asarray(vertices, np.float64)[used], faces=new[faces].astype(np.int32), colors=None)
    mended, findings = validate(raw)
    return None if any(finding.fatal for finding in findings) else mended
