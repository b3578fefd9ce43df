"""What is wrong with a shape, and what can be mended.

Mended: non-finite-vertices, non-finite-points, unreferenced-vertices, duplicate-vertices,
repeated-index-faces, zero-area-faces, duplicate-faces, missing-colors, colors-out-of-range.
A mending that leaves nothing is fatal.
Always fatal: malformed-arrays, no-faces, no-points, index-out-of-range, single-point, too-large.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from mvtn_cli.core.shapes.geometry import (
    BoolArray,
    box_frame,
    doubled_normals,
    finite_rows,
    first_equal,
    longest_edges,
    referenced,
    repeated_faces,
)
from mvtn_cli.core.shapes.shape import ColorArray, FaceArray, FloatArray, Shape

MERGE_RADIUS = 1e-7  # of the half extent: vertices that agree to this are one
FLAT_HEIGHT = 1e-10  # of the longest edge: a face lower than this has no area. A sliver of 1e6 stays.
NO_COLOR = 1.0  # white, for vertices without a colour among coloured ones
_EPSILON = float(np.finfo(np.float64).eps)
_LARGEST, _SMALLEST = 1e300, 1e-300  # half extents; beyond, a radius or its inverse is no longer a number


@dataclass(frozen=True)
class Finding:
    """One kind of defect in one shape.

    Attributes:
        name: One of those listed above; scripts match it.
        count: How many vertices, faces or points have it.
        fatal: The shape can't be used.
        detail: One sentence for people.
        mended: The shape that came with it no longer has it.
    """

    name: str
    count: int
    fatal: bool
    detail: str
    mended: bool


class _UnusableError(Exception):
    """Carries the fatal finding out of the middle of the work."""

    def __init__(self, name: str, count: int, detail: str) -> None:
        super().__init__(detail)
        self.finding = Finding(name, count, fatal=True, detail=detail, mended=False)


def validate(shape: Shape) -> tuple[Shape, list[Finding]]:
    """Find what is wrong, and mend what can be mended.

    Never raises, whatever the arrays hold. A clean shape comes back as the same object.

    Returns:
        The mended shape, and what was found. If one is fatal (the last one), the shape is as given.
    """
    findings: list[Finding] = []
    try:
        _check_arrays(shape)
        mended = _mend_cloud(shape, findings) if shape.is_cloud else _mend_mesh(shape, findings)
    except _UnusableError as unusable:
        return shape, [*_by_name(findings), unusable.finding]
    return (mended if findings else shape), _by_name(findings)


def _by_name(findings: list[Finding]) -> list[Finding]:
    """Join the findings of one name."""
    joined: dict[str, Finding] = {}
    for finding in findings:
        before = joined.get(finding.name)
        if before is not None:
            detail = f"{before.detail}; then {finding.count} more"
            finding = replace(finding, count=before.count + finding.count, detail=detail)
        joined[finding.name] = finding
    return list(joined.values())


def _check_arrays(shape: Shape) -> None:
    """Refuse arrays whose form no reader makes."""
    tables: tuple[tuple[str, npt.NDArray[Any] | None], ...] = (
        ("vertices", shape.vertices),
        ("faces", shape.faces),
        ("points", shape.points),
    )
    for name, array in tables:
        if array is not None and (array.ndim != 2 or array.shape[1] != 3):
            raise _UnusableError("malformed-arrays", 1, f"{name} must have shape (n, 3), got {array.shape}")
    if shape.faces.dtype.kind not in "iu":
        raise _UnusableError("malformed-arrays", 1, f"faces must be whole numbers, got {shape.faces.dtype}")
    pairs = (("colors", shape.colors, shape.vertices), ("point_colors", shape.point_colors, shape.points))
    for name, colors, owner in pairs:
        if colors is not None and (owner is None or colors.shape != owner.shape):
            raise _UnusableError("malformed-arrays", 1, f"{name} must have one row for each point, got {colors.shape}")


# --- point clouds ---


def _mend_cloud(shape: Shape, findings: list[Finding]) -> Shape:
    """Drop what is not finite; refuse what has no extent. Points that coincide are fine."""
    points, colors = shape.points, shape.point_colors
    assert points is not None
    if not len(points):
        raise _UnusableError("no-points", 1, "there is no point")
    finite = finite_rows(points)
    if not finite.all():
        bad = int((~finite).sum())
        if bad == len(points):
            raise _UnusableError("non-finite-points", bad, "no point has finite coordinates")
        findings.append(_mended("non-finite-points", bad, f"{bad} of {len(points)} points dropped"))
        points, colors = points[finite], None if colors is None else colors[finite]
    _check_extent(points)
    return replace(shape, points=points, point_colors=_mend_colors(colors, findings))


# --- meshes ---


def _mend_mesh(shape: Shape, findings: list[Finding]) -> Shape:
    vertices, faces, count = shape.vertices, shape.faces, len(shape.vertices)
    if not len(faces):
        raise _UnusableError("no-faces", 1, f"there is no face (and {count} vertices)")
    _check_indices(faces, count)
    colors = _mend_colors(shape.colors, findings)
    used = referenced(faces, count)
    faces = _drop_non_finite(vertices, faces, findings)
    if (unused := int((~used & finite_rows(vertices)).sum())) > 0:
        findings.append(_mended("unreferenced-vertices", unused, f"{unused} vertices belong to no face; removed"))
    # Before merging too: a far face without area must not make the rest a point.
    faces = _drop_degenerate(vertices, faces, findings)
    faces = _merge_vertices(vertices, colors, faces, findings)
    faces = _drop_degenerate(vertices, faces, findings)
    faces = _drop(faces, repeated_faces(faces), "duplicate-faces", "have the corners of another", findings)
    return _compact(replace(shape, colors=colors), faces)


def _check_indices(faces: FaceArray, n_vertices: int) -> None:
    """Refuse indices that point at nothing, before anything uses them."""
    wrong = (faces < 0) | (faces >= n_vertices)
    if wrong.any():
        bad = int(wrong.any(axis=1).sum())
        raise _UnusableError(
            "index-out-of-range", bad,
            f"{bad} faces use a vertex that is not there: index {faces[wrong][0]} of {n_vertices} vertices",
        )  # fmt: skip


def _check_extent(xyz: FloatArray) -> None:
    """Refuse what is a single point, to the accuracy of its coordinates."""
    _, half = box_frame(xyz)
    if half < _SMALLEST or half <= 4 * _EPSILON * float(np.abs(xyz).max()):
        raise _UnusableError("single-point", len(xyz), f"all {len(xyz)} points lie in one place")
    if half > _LARGEST:
        raise _UnusableError("too-large", 1, f"the extent {half:.1e} is beyond what can be squared")


def _drop_non_finite(vertices: FloatArray, faces: FaceArray, findings: list[Finding]) -> FaceArray:
    finite = finite_rows(vertices)
    if finite.all():
        return faces
    bad, keep = int((~finite).sum()), finite[faces].all(axis=1)
    lost = int((~keep).sum())
    if lost == len(faces):
        raise _UnusableError("non-finite-vertices", bad, f"every face uses one of {bad} vertices that are not finite")
    findings.append(_mended("non-finite-vertices", bad, f"{bad} vertices removed, and the {lost} faces that use them"))
    return faces[keep]


def _drop_degenerate(vertices: FloatArray, faces: FaceArray, findings: list[Finding]) -> FaceArray:
    """Drop faces without area, again as long as that changes the extent by which it is judged."""
    faces = _drop(faces, _repeats_index(faces), "repeated-index-faces", "use a vertex twice", findings)
    while True:
        kept = referenced(faces, len(vertices))
        _check_extent(vertices[kept])
        flat = _flat(vertices, faces, kept)
        if not flat.any():
            return faces
        faces = _drop(faces, flat, "zero-area-faces", "have no area", findings)


def _merge_vertices(
    vertices: FloatArray, colors: ColorArray | None, faces: FaceArray, findings: list[Finding]
) -> FaceArray:
    """Let faces use the first of all vertices in one place and of one colour."""
    at = np.flatnonzero(referenced(faces, len(vertices)))
    center, half = box_frame(vertices[at])
    cells = np.rint((vertices[at] - center) / (half * MERGE_RADIUS)).astype(np.int64)
    columns = [cells[:, 0], cells[:, 1], cells[:, 2]]
    if colors is not None:
        columns += [colors[at, channel] for channel in range(3)]
    first = first_equal(columns)
    merged = int((first != np.arange(len(first))).sum())
    if not merged:
        return faces
    findings.append(_mended("duplicate-vertices", merged, f"{merged} vertices lie on another; merged"))
    representative = np.arange(len(vertices))
    representative[at] = at[first]
    return representative[faces].astype(np.int32)


def _repeats_index(faces: FaceArray) -> BoolArray:
    a, b, c = faces.T
    return (a == b) | (b == c) | (c == a)


def _flat(vertices: FloatArray, faces: FaceArray, kept: BoolArray) -> BoolArray:
    """Return which faces are no higher than rounding: of the face, or of its distance from the origin."""
    center, half = box_frame(vertices[kept])
    local = np.zeros_like(vertices)
    local[kept] = (vertices[kept] - center) / half
    noise = 8 * _EPSILON * float(np.abs(vertices[kept]).max()) / half
    longest = longest_edges(local, faces)
    doubled_area = np.linalg.norm(doubled_normals(local, faces), axis=1)
    return doubled_area <= longest * np.maximum(FLAT_HEIGHT * longest, noise)


def _drop(faces: FaceArray, bad: BoolArray, name: str, what: str, findings: list[Finding]) -> FaceArray:
    count = int(bad.sum())
    if not count:
        return faces
    if count == len(faces):
        raise _UnusableError(name, count, f"all {count} faces {what}")
    findings.append(_mended(name, count, f"{count} of {len(faces)} faces {what}; dropped"))
    return faces[~bad]


def _compact(shape: Shape, faces: FaceArray) -> Shape:
    """Remove the vertices that no face uses any more, in file order."""
    used = referenced(faces, len(shape.vertices))
    new = np.cumsum(used) - 1
    colors = None if shape.colors is None else shape.colors[used]
    return replace(shape, vertices=shape.vertices[used], faces=new[faces].astype(np.int32), colors=colors)


def _mend_colors(colors: ColorArray | None, findings: list[Finding]) -> ColorArray | None:
    """Fill missing colours with white, and clip to [0, 1]."""
    if colors is None:
        return None
    missing = ~finite_rows(colors)
    if missing.any():
        bad = int(missing.sum())
        findings.append(_mended("missing-colors", bad, f"{bad} of {len(colors)} vertices have no colour; made white"))
        colors = np.where(missing[:, None], np.float32(NO_COLOR), colors)
    outside = np.asarray(((colors < 0) | (colors > 1)).any(axis=1))
    if outside.any():
        bad = int(outside.sum())
        findings.append(_mended("colors-out-of-range", bad, f"{bad} colours beyond 0 to 1; clipped"))
        colors = np.clip(colors, 0, 1)
    return colors.astype(np.float32)


def _mended(name: str, count: int, detail: str) -> Finding:
    return Finding(name, count, fatal=False, detail=detail, mended=True)
