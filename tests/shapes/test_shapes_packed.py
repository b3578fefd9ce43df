"""PLY, STL and glTF."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mvtn_cli.core.shapes import read_shape, validate
from mvtn_cli.errors import DataError

XYZ = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 2, 0]], np.float32)
POLYGONS = [[0, 1, 2], [0, 1, 2, 4, 3], [3, 2, 1, 0]]
FANS = [[0, 1, 2], [0, 1, 2], [0, 2, 4], [0, 4, 3], [3, 2, 1], [3, 1, 0]]


def ply(folder: Path, order: str, polygons: list[list[int]], colors: bool = True) -> Path:
    """Write a PLY with a list in front of the faces, a byte behind each face, and an element to skip."""
    properties = "property float x\nproperty float y\nproperty float z\n"
    if colors:
        properties += "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    header = f"ply\nformat {order} 1.0\ncomment made here \nelement junk 2\nproperty list uchar short odd\n"
    header += f"element vertex {len(XYZ)}\n{properties}element face {len(polygons)}\n"
    header += "property uchar flag\nproperty list uchar int vertex_indices\nproperty float weight\nend_header\n"
    sign = ">" if "big" in order else "<"
    body = b""
    if order == "ascii":
        shades = [f" {51 * i} 0 255" if colors else "" for i in range(len(XYZ))]
        lines = ["1 7", "0"]
        lines += [f"{x} {y} {z}{shade}" for (x, y, z), shade in zip(XYZ, shades, strict=True)]
        lines += [f"9 {len(p)} {' '.join(map(str, p))} 0.5" for p in polygons]
        body = "\n".join(lines).encode()
    else:
        body += struct.pack(sign + "BhB", 1, 7, 0)
        for i, row in enumerate(XYZ):
            body += struct.pack(sign + "3f", *row) + (struct.pack("3B", 51 * i, 0, 255) if colors else b"")
        for p in polygons:
            body += struct.pack(f"{sign}BB{len(p)}if", 9, len(p), *p, 0.5)
    path = folder / f"{order}.ply"
    path.write_bytes(header.encode() + body)
    return path


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_of_mixed_polygons_reads_alike_in_all_encodings(tmp_path: Path, order: str) -> None:
    shape = read_shape(ply(tmp_path, order, POLYGONS))
    assert np.array_equal(shape.vertices, XYZ)
    assert shape.faces.tolist() == FANS
    assert shape.colors is not None
    assert np.allclose(shape.colors[:, 0], np.arange(5) / 5)
    assert np.allclose(shape.colors[:, 1:], [0, 1])


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_a_ply_cut_anywhere_is_refused_and_never_read_as_something_else(tmp_path: Path, order: str) -> None:
    path = ply(tmp_path, order, [[0, 1, 2], [0, 2, 3]])
    whole = path.read_bytes()
    end = len(whole) - (6 if order == "ascii" else 1)  # of text, the last number may go: nobody can tell
    for length in {*range(0, end, 11), *range(end - 20, end)}:
        path.write_bytes(whole[:length])
        with pytest.raises(DataError) as caught:
            read_shape(path)
        assert caught.value.message.isprintable()


def test_a_ply_without_faces_is_a_point_cloud(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    header = "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\nproperty double z\n"
    path.write_text(header + "element face 0\nproperty list uchar int vertex_index\nend_header\n1 2 3\n4 5 6\n")
    shape = read_shape(path)
    assert shape.is_cloud
    assert shape.points is not None
    assert shape.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert len(shape.vertices) == len(shape.faces) == 0


@pytest.mark.parametrize(
    ("header", "wanted"),
    [
        ("element vertex 99999999999\nproperty float x\n", "more than the file has bytes"),
        ("element vertex " + "9" * 5000 + "\n", "makes no sense"),
        ("property float x\n", "makes no sense"),
        ("element vertex 1\nproperty quaternion x\n", "makes no sense"),
        ("element vertex 1\nproperty float x\nproperty float y\n", "1 of 'vertex', but 0 lines follow"),
        ("element vertex 1\nproperty list uchar int vertex_indices\n", "vertex element holds a list"),
        ("element face 0\nproperty list uchar int vertex_indices\n", "has no vertices"),
    ],
)
def test_a_broken_ply_header_is_refused(tmp_path: Path, header: str, wanted: str) -> None:
    path = tmp_path / "bad.ply"
    path.write_text(f"ply\nformat ascii 1.0\n{header}end_header\n")
    with pytest.raises(DataError) as caught:
        read_shape(path)
    assert wanted in caught.value.message


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian"])
def test_a_ply_index_out_of_range_is_named_with_its_face(tmp_path: Path, order: str) -> None:
    for bad in (5, -1):
        with pytest.raises(DataError, match=f"face 1 has vertex index {bad}; expected 0 to 4"):
            read_shape(ply(tmp_path, order, [[0, 1, 2], [0, 1, bad]]))


def test_stl_reads_alike_as_text_and_binary_also_if_the_binary_begins_with_solid(tmp_path: Path) -> None:
    box = trimesh.creation.box(extents=(1, 2, 4))
    text, binary = tmp_path / "text.stl", tmp_path / "binary.STL"
    text.write_text(trimesh.exchange.stl.export_stl_ascii(box))
    packed = trimesh.exchange.stl.export_stl(box)
    binary.write_bytes(b"solid binary".ljust(80) + packed[80:])
    for path in (text, binary):
        mended, findings = validate(read_shape(path))
        assert [(f.name, f.count) for f in findings] == [("duplicate-vertices", 28)]
        assert len(mended.vertices) == 8 and len(mended.faces) == 12
        assert trimesh.Trimesh(mended.vertices, mended.faces, process=False).volume == pytest.approx(8)


@pytest.mark.parametrize(
    ("content", "wanted"),
    [
        (b"solid x\nendsolid x\n", "has no facet"),
        (b"solid x\nfacet\nvertex 0 0 0\nvertex 1 0 0\n", "truncated?"),
        (b"solid x\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n", "no 'endsolid'"),
        (b"solid x\nvertex 0 0 0\nvertex 1 0 q\nvertex 0 1 0\nendsolid", "line 3: 'q' is not a number"),
        (b"x" * 80 + struct.pack("<I", 4_000_000_000) + b"y" * 50, "200000000084 bytes"),
        (b"\x89PNG\r\n\x1a\n" + b"\0" * 200, "a PNG picture"),
        (b"hello", "is not an STL file"),
        (b"\0" * 34, "is not an STL file"),  # 84 + 50 · (-1)
    ],
)
def test_a_broken_stl_is_refused(tmp_path: Path, content: bytes, wanted: str) -> None:
    path = tmp_path / "bad.stl"
    path.write_bytes(content)
    with pytest.raises(DataError) as caught:
        read_shape(path)
    assert wanted in caught.value.message


@pytest.mark.parametrize(
    ("content", "wanted"),
    [
        (b"glTF\2\0\0", "has 7 bytes; expected a header of 20 (truncated?)"),
        (b"glTF" + struct.pack("<IIII", 2, 99, 40, 0) + b"{}", "declares 99 bytes but has 22 (truncated?)"),
        (b"%PDF" + b"\0" * 40, "is not a binary glTF file (it looks like a PDF document)"),
    ],
)
def test_a_broken_glb_is_refused(tmp_path: Path, content: bytes, wanted: str) -> None:
    path = tmp_path / "bad.glb"
    path.write_bytes(content)
    with pytest.raises(DataError) as caught:
        read_shape(path)
    assert caught.value.message == f"{path}: {wanted}"


def test_a_gltf_scene_puts_each_instance_at_its_place_and_keeps_vertex_colours(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    box.visual.vertex_colors = np.tile([255, 0, 51, 255], (8, 1)).astype(np.uint8)
    plain = trimesh.creation.box()
    scene = trimesh.Scene()
    scene.add_geometry(box, node_name="a", geom_name="red")
    scene.add_geometry(plain, node_name="b", transform=trimesh.transformations.translation_matrix([10, 0, 0]))
    path = tmp_path / "two.glb"
    path.write_bytes(trimesh.exchange.gltf.export_glb(scene))
    shape = read_shape(path)
    assert len(shape.faces) == 24
    assert (shape.vertices.min(axis=0).tolist(), shape.vertices.max(axis=0).tolist()) == (
        [-0.5] * 3, [10.5, 0.5, 0.5],
    )  # fmt: skip
    assert shape.colors is not None
    red = shape.vertices[:, 0] < 5
    assert np.allclose(shape.colors[red], [1, 0, 0.2])
    assert np.isnan(shape.colors[~red]).all()


def test_a_gltf_count_that_its_buffers_cannot_hold_is_refused_before_memory_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "bomb.gltf"
    accessors = [{"componentType": 5126, "type": "VEC3", "count": 10**12}]
    meshes = [{"primitives": [{"attributes": {"POSITION": 0}}]}]
    path.write_text(json.dumps({"asset": {"version": "2.0"}, "accessors": accessors, "meshes": meshes}))
    with pytest.raises(DataError, match="declares 1000000000000 items"):
        read_shape(path)
    path.write_text(json.dumps({"asset": {"version": "2.0"}, "buffers": [{"uri": "gone.bin", "byteLength": 4}]}))
    with pytest.raises(DataError, match=r"buffer 'gone.bin' is not there"):
        read_shape(path)
