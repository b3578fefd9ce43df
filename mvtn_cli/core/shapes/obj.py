"""OBJ: positions, faces and the vertex colours that many programs append; all else is skipped.

Materials and pictures are never opened, so a missing one can do no harm.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mvtn_cli.core.shapes.colors import scaled_colors
from mvtn_cli.core.shapes.polygons import fan
from mvtn_cli.core.shapes.rows import Rows
from mvtn_cli.core.shapes.shape import ColorArray, FaceArray, FloatArray, Shape
from mvtn_cli.core.shapes.source import not_a, quoted, read_text, unreadable


def read_obj(path: Path) -> Shape:
    """Read a mesh from an OBJ file.

    A file of points alone is refused: an OBJ without a face is a failed export far more often than a scan.

    Raises:
        DataError: No vertices, no faces, a malformed number, or an index that points at nothing.
    """
    data = read_text(path, "OBJ")
    if b"\\" in data:  # a backslash joins a line with the next
        data = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    rows = Rows.parse(path, data)
    at_vertex = [i for i, row in enumerate(rows.tokens) if row[0] == b"v"]
    at_face = [i for i, row in enumerate(rows.tokens) if row[0] == b"f"]
    if not at_vertex and not at_face:
        raise not_a(path, "OBJ", data, expected="text with 'v' and 'f' lines")
    if not at_face:
        raise unreadable(
            path, f"has {len(at_vertex)} vertices but no face", expected="'f' lines",
            hint="export it with faces; points are read from .ply, .xyz, .npy and .h5",
        )  # fmt: skip
    vertices, colors = _vertices(rows, at_vertex)
    return Shape(vertices=vertices, faces=_faces(rows, at_vertex, at_face), colors=colors)


def _vertices(rows: Rows, at_vertex: list[int]) -> tuple[FloatArray, ColorArray | None]:
    """Parse `v x y z`, `v x y z w` and `v x y z r g b`, also mixed in one file."""
    table = np.full((len(at_vertex), 6), np.nan)
    for index, at in enumerate(at_vertex):
        row = rows.tokens[at]
        if len(row) < 4:
            raise rows.error(at, f"a vertex of {len(row) - 1} numbers", expected="3")
        try:
            table[index, :3] = (float(row[1]), float(row[2]), float(row[3]))
            if len(row) >= 7:
                table[index, 3:] = (float(row[4]), float(row[5]), float(row[6]))
        except ValueError:
            raise rows.error(at, f"{quoted(b' '.join(row[1:]))} is no vertex", expected="numbers") from None
    colored = bool(np.isfinite(table[:, 3:]).any())
    return np.ascontiguousarray(table[:, :3]), scaled_colors(table[:, 3:]) if colored else None


def _faces(rows: Rows, at_vertex: list[int], at_face: list[int]) -> FaceArray:
    """Parse `f v`, `v/vt`, `v//vn`, `v/vt/vn`; negative indices count back from the face's own line."""
    known_before = np.searchsorted(at_vertex, at_face) if at_vertex else np.zeros(len(at_face), np.int64)
    corners: list[int] = []
    counts = np.zeros(len(at_face), np.int64)
    for number, (at, known) in enumerate(zip(at_face, known_before.tolist(), strict=True)):
        row = rows.tokens[at]
        counts[number] = len(row) - 1
        for token in row[1:]:
            try:
                index = int(token.partition(b"/")[0])
            except ValueError:
                raise rows.error(at, f"{quoted(token)} is no corner", expected="v, v/vt or v/vt/vn") from None
            corners.append(index - 1 if index > 0 else index + known if index < 0 else -1)
            if not 0 <= corners[-1] < len(at_vertex):
                raise rows.error(at, f"vertex index {quoted(token)}", expected=_range(index, known, len(at_vertex)))
    return fan(np.array(corners, np.int64), counts)


def _range(index: int, known: int, n_vertices: int) -> str:
    if n_vertices == 0 or (index < 0 and known == 0):
        return "a vertex before this line"
    return f"-{known} to -1 (counted back from here)" if index < 0 else f"1 to {n_vertices}"
