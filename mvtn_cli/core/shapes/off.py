"""OFF, as written by ModelNet, Geomview, CGAL, MeshLab and by hand.

Reference: http://www.geomview.org/docs/html/OFF.html
"""

from __future__ import annotations

import re
from itertools import chain
from pathlib import Path

import numpy as np

from mvtn_cli.core.shapes.colors import scaled_colors
from mvtn_cli.core.shapes.polygons import fan
from mvtn_cli.core.shapes.rows import Rows, floats, is_int
from mvtn_cli.core.shapes.shape import ColorArray, FaceArray, FloatArray, Shape
from mvtn_cli.core.shapes.source import not_a, quoted, read_text, unreadable

# ModelNet glues the counts to the keyword ("OFF490 518 0"); T, C, N announce numbers behind each vertex.
_KEYWORD = re.compile(rb"(?P<st>ST)?(?P<c>C)?(?P<n>N)?(?P<four>4)?(?P<dim>n)?OFF(?P<rest>.*)\Z", re.DOTALL)
_PLAIN_HEAD = re.compile(rb"\s*OFF\s*(\d{1,9})[ \t]+(\d{1,9})(?:[ \t]+\d+)?[ \t]*[\r\n]")


def read_off(path: Path) -> Shape:
    """Read a mesh from an OFF file.

    Allocates in proportion to the file, never to what its header claims.

    Raises:
        DataError: Not OFF, binary OFF, truncated, counts that don't match, or an index out of range.
    """
    data = read_text(path, "OFF")
    if (plain := _read_plain(data)) is not None:
        return plain
    rows = Rows.parse(path, data)
    flags, n_vertices, n_faces, body = _header(rows, data)
    if n_vertices + n_faces > len(body):
        raise unreadable(
            path, f"the header declares {n_vertices} vertices and {n_faces} faces, "
            f"but only {len(body)} lines follow (truncated?)", line=rows.lines[0],
        )  # fmt: skip
    if n_vertices + n_faces < len(body):
        raise body.error(
            n_vertices + n_faces, f"more lines than the {n_vertices} vertices and {n_faces} faces declared"
        )
    vertices, colors = _vertices(body[:n_vertices], flags)
    return Shape(vertices=vertices, faces=_faces(body[n_vertices:], n_vertices), colors=colors)


def _read_plain(data: bytes) -> Shape | None:
    """Read a file of triangles and three numbers a vertex, four times faster; None if it is another."""
    head = _PLAIN_HEAD.match(data)
    if head is None or b"#" in data:
        return None
    n_vertices, n_faces = int(head[1]), int(head[2])
    tokens = data[head.end() :].split()
    if len(tokens) != 3 * n_vertices + 4 * n_faces:
        return None
    try:
        numbers = floats(tokens, len(tokens))
    except ValueError:
        return None
    vertices, faces = numbers[: 3 * n_vertices].reshape(-1, 3), numbers[3 * n_vertices :].reshape(-1, 4)
    corners = faces[:, 1:]
    plain = (faces[:, 0] == 3).all() and ((corners >= 0) & (corners < n_vertices)).all()
    if not plain or not (corners == np.rint(corners)).all():
        return None
    return Shape(vertices=vertices, faces=corners.astype(np.int32))


def _header(rows: Rows, data: bytes) -> tuple[re.Match[bytes], int, int, Rows]:
    """Return the keyword's flags, both counts, and the rows after them."""
    match = _KEYWORD.match(rows.tokens[0][0]) if len(rows) else None
    if match is None:
        raise not_a(rows.path, "an OFF file", data, expected="'OFF' as its first word")
    if match["four"] or match["dim"]:
        raise rows.error(0, "vertices of more than three dimensions", expected="plain OFF, COFF or NOFF")
    first = rows.tokens[0]
    counts = ([match["rest"]] if match["rest"] else []) + first[1:]
    skip = 1
    if counts[:1] == [b"BINARY"]:
        raise rows.error(0, "is a binary OFF file", expected="OFF text")
    if not counts:
        counts, skip = (rows.tokens[1] if len(rows) > 1 else []), 2
    if len(counts) not in (2, 3) or not all(is_int(c) and int(c) >= 0 for c in counts):
        seen = quoted(b" ".join(counts)) if counts else "nothing"
        at = min(skip, len(rows)) - 1
        raise rows.error(at, f"the header has {seen}", expected="three counts: vertices, faces, edges")
    return match, int(counts[0]), int(counts[1]), rows[skip:]


def _vertices(rows: Rows, flags: re.Match[bytes]) -> tuple[FloatArray, ColorArray | None]:
    numbers = rows.numbers("a vertex", least=3)
    first = 6 if flags["n"] else 3
    last = numbers.shape[1] - (2 if flags["st"] else 0)
    colors = scaled_colors(numbers[:, first : first + 3]) if flags["c"] and last - first in (3, 4) else None
    return np.ascontiguousarray(numbers[:, :3]), colors


def _faces(rows: Rows, n_vertices: int) -> FaceArray:
    """Return (F, 3) triangles; what stands behind a face's indices is its colour, and is left."""
    for at, row in enumerate(rows.tokens):
        if not is_int(row[0]) or not 0 <= int(row[0]) < len(row):
            raise rows.error(at, f"a face of {quoted(row[0])} corners lists {len(row) - 1} numbers",
                             expected="the number of corners, then that many indices")  # fmt: skip
    counts = np.array([int(row[0]) for row in rows.tokens], np.int64)
    listed = chain.from_iterable(row[1 : int(row[0]) + 1] for row in rows.tokens)
    try:
        corners = np.fromiter(map(int, listed), np.int64, int(counts.sum()))
    except (ValueError, OverflowError):
        at, token = next((i, t) for i, row in enumerate(rows.tokens) for t in row[1 : int(row[0]) + 1] if not is_int(t))
        raise rows.error(at, f"{quoted(token)} is not a vertex index", expected="a whole number") from None
    wrong = np.flatnonzero((corners < 0) | (corners >= n_vertices))
    if len(wrong):
        at = int(np.searchsorted(np.cumsum(counts), wrong[0], side="right"))
        raise rows.error(at, f"vertex index {corners[wrong[0]]}", expected=f"0 to {n_vertices - 1}")
    return fan(corners, counts)
