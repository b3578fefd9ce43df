"""PLY, ASCII and binary of both byte orders, meshes with polygons of any size, and point clouds.

Reference: http://paulbourke.net/dataformats/ply/
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mvtn_cli.core.shapes.colors import scaled_colors
from mvtn_cli.core.shapes.polygons import fan
from mvtn_cli.core.shapes.rows import Rows
from mvtn_cli.core.shapes.shape import ColorArray, FaceArray, FloatArray, Shape, cloud
from mvtn_cli.core.shapes.source import not_a, quoted, read_bytes, unreadable

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "int64": "i8", "uint64": "u8",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_INDEX_LISTS = ("vertex_indices", "vertex_index")

Polygons = tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]  # all corners, corners of each polygon


@dataclass(frozen=True)
class _Property:
    name: str
    dtype: np.dtype
    length_dtype: np.dtype | None = None  # of a list's length; None for a single number


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)

    @property
    def has_list(self) -> bool:
        return any(p.length_dtype is not None for p in self.properties)


@dataclass(frozen=True)
class _Header:
    ascii: bool
    elements: list[_Element]
    lines: int
    body: int  # offset of the first byte after the header


def read_ply(path: Path) -> Shape:
    """Read a PLY file: a mesh if it has faces, a point cloud if it has none.

    Raises:
        DataError: Not PLY, a broken header, truncated, triangle strips, or an index out of range.
    """
    data = read_bytes(path)
    header = _parse_header(path, data)
    table: dict[str, FloatArray] = {}
    polygons: Polygons | None = None
    reader = _AsciiBody(path, data, header) if header.ascii else _BinaryBody(path, data, header)
    for element in header.elements:
        if element.name == "vertex":
            if element.has_list:
                raise unreadable(path, "the vertex element holds a list", expected="faces in an element of their own")
            table = reader.table(element)
        elif element.name == "face" and element.count:
            polygons = reader.polygons(element)
        else:
            reader.skip(element)
    return _shape(path, header, table, polygons)


def _shape(path: Path, header: _Header, table: dict[str, FloatArray], polygons: Polygons | None) -> Shape:
    if not table or not len(next(iter(table.values()))):
        raise unreadable(path, "has no vertices")
    if not {"x", "y", "z"} <= table.keys():
        raise unreadable(path, "its vertices lack x, y or z")
    xyz = np.column_stack([table[axis] for axis in "xyz"])
    vertex = next(e for e in header.elements if e.name == "vertex")
    colors = _colors(vertex, table)
    if polygons is None:
        if any(e.name == "tristrips" for e in header.elements):
            raise unreadable(path, "holds triangle strips", expected="a 'face' element")
        return cloud(xyz, colors)
    return Shape(vertices=xyz, faces=_triangles(path, polygons, len(xyz)), colors=colors)


def _triangles(path: Path, polygons: Polygons, n_vertices: int) -> FaceArray:
    corners, counts = polygons
    wrong = np.flatnonzero((corners < 0) | (corners >= n_vertices))
    if len(wrong):
        face = int(np.searchsorted(np.cumsum(counts), wrong[0], side="right"))
        raise unreadable(path, f"face {face} has vertex index {corners[wrong[0]]}", expected=f"0 to {n_vertices - 1}")
    return fan(corners, counts)


def _colors(vertex: _Element, table: dict[str, FloatArray]) -> ColorArray | None:
    for prefix in ("", "diffuse_"):
        names = [prefix + c for c in ("red", "green", "blue")]
        if set(names) <= table.keys():
            rgb = np.column_stack([table[name] for name in names])
            dtype = next(p.dtype for p in vertex.properties if p.name == names[0])
            return (rgb / np.iinfo(dtype).max).astype(np.float32) if dtype.kind == "u" else scaled_colors(rgb)
    return None


# --- header ---


def _parse_header(path: Path, data: bytes) -> _Header:
    """Parse the header. Counts are held against the file's size before anybody believes them."""
    if data[:3] != b"ply":
        raise not_a(path, "a PLY file", data, expected="'ply' as its first line")
    newline = b"\r\n" if data[3:5] == b"\r\n" else b"\r" if data[3:4] == b"\r" else b"\n"
    end = data.find(b"end_header")
    stop = data.find(newline, end)
    if end < 0 or stop < 0:
        raise unreadable(path, "the header has no end (truncated?)", expected="a line 'end_header'")
    lines = data[:end].split(newline)
    order, elements = "", []
    for number, line in enumerate(lines[1:], 2):
        words = line.decode("ascii", "replace").split()
        match words:
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as order, *_]:
                pass
            case ["element", name, count] if count.isdecimal() and len(count) < 19:
                elements.append(_Element(name, int(count)))
                if int(count) > len(data):
                    raise unreadable(path, f"declares {count} of '{name}', more than the file has bytes", line=number)
            case ["property", *parts] if elements and (new := _property(parts, order)):
                elements[-1].properties.append(new)
            case _:
                raise unreadable(path, f"{quoted(line.strip())} makes no sense in a PLY header", line=number)
    if not order:
        raise unreadable(path, "the header names no format", expected="'format ascii 1.0' or binary")
    return _Header(order == "ascii", elements, len(lines), stop + len(newline))


def _property(words: list[str], order: str) -> _Property | None:
    sign = ">" if "big" in order else "<"
    match words:
        case ["list", length, kind, name] if _TYPES.get(length, "f")[0] != "f" and kind in _TYPES:
            return _Property(name, np.dtype(sign + _TYPES[kind]), np.dtype(sign + _TYPES[length]))
        case [kind, name] if kind in _TYPES:
            return _Property(name, np.dtype(sign + _TYPES[kind]))
    return None


def _index_list(path: Path, element: _Element) -> int:
    """Return which property of the face element lists its corners."""
    for at, prop in enumerate(element.properties):
        if prop.name in _INDEX_LISTS and prop.length_dtype is not None and prop.dtype.kind in "iu":
            return at
    raise unreadable(path, "its faces list no vertices", expected="a list 'vertex_indices' of whole numbers")


# --- bodies ---


class _AsciiBody:
    """Takes one element after the other from lines of text."""

    def __init__(self, path: Path, data: bytes, header: _Header) -> None:
        self.path = path
        rows = Rows.parse(path, data[header.body :], comment=b"\0")
        self.rows = Rows(path, rows.tokens, [line + header.lines for line in rows.lines])

    def _take(self, element: _Element) -> Rows:
        if element.count > len(self.rows):
            raise unreadable(
                self.path,
                f"declares {element.count} of '{element.name}', but {len(self.rows)} lines follow (cut?)",
            )
        taken, self.rows = self.rows[: element.count], self.rows[element.count :]
        return taken

    def skip(self, element: _Element) -> None:
        self._take(element)

    def table(self, element: _Element) -> dict[str, FloatArray]:
        rows = self._take(element)
        numbers = rows.numbers("a vertex", least=len(element.properties))
        return {prop.name: numbers[:, at] for at, prop in enumerate(element.properties)}

    def polygons(self, element: _Element) -> Polygons:
        rows = self._take(element)
        wanted = _index_list(self.path, element)
        lists = []
        for at, row in enumerate(rows.tokens):
            try:
                lists.append(_corners(row, element, wanted))
            except (ValueError, IndexError, OverflowError):
                shown = quoted(b" ".join(row))
                raise rows.error(at, f"{shown} is no face", expected="a count, then that many indices") from None
        counts = np.array([len(corners) for corners in lists], np.int64)
        return np.fromiter(chain.from_iterable(lists), np.int64, int(counts.sum())), counts


def _corners(row: list[bytes], element: _Element, wanted: int) -> list[int]:
    """Return the indices of one face's line; ValueError or IndexError if the line is malformed."""
    at = 0
    for number, prop in enumerate(element.properties):
        length = 1
        if prop.length_dtype is not None:
            length = int(row[at])
            at += 1
            if length < 0 or at + length > len(row):
                raise IndexError
        if number == wanted:
            corners = [int(token) for token in row[at : at + length]]
            if any(abs(corner) >= 2**63 for corner in corners):
                raise OverflowError
            return corners
        at += length
    raise IndexError


class _BinaryBody:
    """Takes one element after the other from packed bytes."""

    def __init__(self, path: Path, data: bytes, header: _Header) -> None:
        self.path, self.data, self.at = path, data, header.body

    def _take(self, element: _Element, size: int) -> int:
        start, self.at = self.at, self.at + size
        if self.at > len(self.data):
            missing = self.at - len(self.data)
            raise unreadable(self.path, f"ends {missing} bytes before the end of element '{element.name}' (truncated?)")
        return start

    def skip(self, element: _Element) -> None:
        if element.has_list:
            self._walk(element, wanted=None)
        else:
            self._take(element, element.count * _packed(element.properties).itemsize)

    def table(self, element: _Element) -> dict[str, FloatArray]:
        dtype = _packed(element.properties)
        start = self._take(element, element.count * dtype.itemsize)
        if not element.count or not dtype.itemsize:
            return {}
        rows = np.frombuffer(self.data, dtype, element.count, start)
        return {p.name: rows[f"f{at}"].astype(np.float64) for at, p in enumerate(element.properties)}

    def polygons(self, element: _Element) -> Polygons:
        wanted = _index_list(self.path, element)
        return self._alike(element, wanted) or self._walk(element, wanted)

    def _alike(self, element: _Element, wanted: int) -> Polygons | None:
        """Read all faces at once, if each has as many corners as the first and no other list (the rule)."""
        lead = _packed(element.properties[:wanted]).itemsize
        length = element.properties[wanted].length_dtype
        others = [p for p in element.properties if p.length_dtype is not None]
        if length is None or len(others) > 1 or self.at + lead + length.itemsize > len(self.data):
            return None
        n = int(np.frombuffer(self.data, length, 1, self.at + lead)[0])
        if not 0 <= n * element.count <= len(self.data):
            return None
        fields: list[Any] = [(f"f{at}", p.dtype) for at, p in enumerate(element.properties)]
        fields[wanted : wanted + 1] = [("n", length), ("corners", element.properties[wanted].dtype, (n,))]
        face = np.dtype(fields)
        if self.at + face.itemsize * element.count > len(self.data):
            return None
        rows = np.frombuffer(self.data, face, element.count, self.at)
        if (rows["n"] != n).any():
            return None
        self.at += face.itemsize * element.count
        return _signed(rows["corners"].reshape(-1)), np.full(element.count, n, np.int64)

    def _walk(self, element: _Element, wanted: int | None) -> Polygons:
        """Read row by row: lists of different lengths."""
        pieces, counts = [], []
        for _ in range(element.count):
            for number, prop in enumerate(element.properties):
                n = 1
                if prop.length_dtype is not None:
                    start = self._take(element, prop.length_dtype.itemsize)
                    n = int(np.frombuffer(self.data, prop.length_dtype, 1, start)[0])
                    if n < 0:
                        raise unreadable(self.path, f"a list of {n} numbers in element '{element.name}'")
                start = self._take(element, n * prop.dtype.itemsize)
                if number == wanted:
                    pieces.append(self.data[start : self.at])
                    counts.append(n)
        if wanted is None:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        return _signed(np.frombuffer(b"".join(pieces), element.properties[wanted].dtype)), np.array(counts, np.int64)


def _packed(properties: list[_Property]) -> np.dtype:
    return np.dtype([(f"f{at}", prop.dtype) for at, prop in enumerate(properties)])


def _signed(corners: npt.NDArray[np.integer]) -> npt.NDArray[np.int64]:
    """Return int64 indices; an unsigned one that is too large becomes negative, so it stays out of range."""
    return corners.astype(np.int64)
