"""STL, binary and ASCII, one or several solids. Its triangles share no vertices: `validate` merges them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mvtn_cli.core.shapes.rows import Rows
from mvtn_cli.core.shapes.shape import FloatArray, Shape
from mvtn_cli.core.shapes.source import not_a, read_bytes, unreadable

_HEADER_BYTES, _FACET_BYTES = 84, 50


def read_stl(path: Path) -> Shape:
    """Read a mesh from an STL file.

    The size decides whether it is binary, because many binary files begin with the word `solid`.

    Raises:
        DataError: Neither form, truncated, or without a facet.
    """
    data = read_bytes(path)
    declared = int.from_bytes(data[80:84], "little") if len(data) >= _HEADER_BYTES else -1
    if declared >= 0 and len(data) == _HEADER_BYTES + declared * _FACET_BYTES:
        corners = _binary(data, declared)
    elif data.lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        corners = _ascii(path, data)
    else:
        size = _HEADER_BYTES + declared * _FACET_BYTES
        binary = f", or {size} bytes for the {declared} facets it declares" if declared >= 0 else ""
        raise not_a(path, "an STL file", data, expected=f"ASCII that begins with 'solid'{binary}")
    if not len(corners):
        raise unreadable(path, "has no facet")
    return Shape(vertices=corners, faces=np.arange(len(corners), dtype=np.int32).reshape(-1, 3))


def _binary(data: bytes, facets: int) -> FloatArray:
    facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows = np.frombuffer(data, facet, facets, _HEADER_BYTES)
    return rows["corners"].reshape(-1, 3).astype(np.float64)


def _ascii(path: Path, data: bytes) -> FloatArray:
    """Return (3·facets, 3) corners: the lines that begin with `vertex`."""
    rows = Rows.parse(path, data, comment=b"\0")
    at = [i for i, row in enumerate(rows.tokens) if row[0].lower() == b"vertex"]
    if not at:
        return np.zeros((0, 3))
    corners = Rows(path, [rows.tokens[i][1:] for i in at], [rows.lines[i] for i in at])
    if len(at) % 3:
        raise corners.error(len(at) - 1, f"{len(at)} vertices", expected="three for each facet (truncated?)")
    if not any(row[0].lower() == b"endsolid" for row in rows.tokens):
        raise unreadable(path, "has no 'endsolid' (truncated?)")
    numbers = corners.numbers("a vertex", least=3)
    if numbers.shape[1] != 3:
        raise corners.error(0, f"a vertex of {numbers.shape[1]} numbers", expected="3")
    return numbers
