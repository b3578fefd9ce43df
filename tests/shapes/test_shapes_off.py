"""OFF: the defects of ModelNet's files, and of hand-made ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mvtn_cli.core.shapes import read_shape, validate
from mvtn_cli.errors import DataError

TRIANGLE = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


def write(folder: Path, text: str | bytes, name: str = "shape.off") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def refusal(path: Path) -> str:
    with pytest.raises(DataError) as caught:
        read_shape(path)
    message = caught.value.message
    assert message.isprintable()  # one line
    assert path.name in message
    return message


@pytest.mark.parametrize(
    "header",
    [
        "OFF\n3 1 0\n",
        "OFF3 1 0\n",
        "OFF 3 1 0\n",
        "  \t OFF3 1 0 # glued\n",
        "OFF\n# a comment\n\n  \n3 1 0\n",
        "OFF\r\n3 1 0\r\n",
        "OFF\n3 1\n",
        "\ufeffOFF\n3 1 0\n",
    ],
)
def test_every_header_seen_in_the_wild_gives_the_same_triangle(tmp_path: Path, header: str) -> None:
    shape = read_shape(write(tmp_path, header + TRIANGLE))
    assert shape.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert shape.faces.tolist() == [[0, 1, 2]]
    assert shape.vertices.dtype == np.float64 and shape.faces.dtype == np.int32


def test_polygons_become_fans_in_file_order_and_trailing_colours_are_no_indices(tmp_path: Path) -> None:
    square = "0 0 0 \n1 0 0\t\n1 1 0\r\n0 1 0\n.5 2 0\n"
    faces = "3 0 1 2 255 0 0\n5 0 1 2 4 3 0.1 0.2 0.3 1\n4 3 2 1 0\n"
    shape = read_shape(write(tmp_path, "OFF\n5 3 0\n" + square + faces))
    assert shape.faces.tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 4], [0, 4, 3], [3, 2, 1], [3, 1, 0]]


def test_a_face_of_two_corners_is_dropped_and_counted_by_validate(tmp_path: Path) -> None:
    text = "OFF\n3 4 0\n0 0 0\n1 0 0\n0 1 0\n2 0 1\n3 0 1 2\n1 2\n0\n"
    mended, findings = validate(read_shape(write(tmp_path, text)))
    assert mended.faces.tolist() == [[0, 1, 2]]
    assert [(f.name, f.count, f.fatal) for f in findings] == [("repeated-index-faces", 2, False)]


def test_vertex_colours_of_coff_are_brought_to_unit_range(tmp_path: Path) -> None:
    rows = "0 0 0 255 0 0 255\n1 0 0 0 51 0 255\n0 1 0 0 0 255 255\n3 0 1 2\n"
    shape = read_shape(write(tmp_path, "COFF\n3 1 0\n" + rows))
    assert shape.colors is not None
    assert np.allclose(shape.colors, [[1, 0, 0], [0, 0.2, 0], [0, 0, 1]])
    floats = read_shape(write(tmp_path, "CNOFF\n3 1 0\n" + "0 0 0 0 0 1 .5 .25 1 1\n" * 3 + "3 0 1 2\n"))
    assert floats.colors is not None
    assert np.allclose(floats.colors, [0.5, 0.25, 1])  # behind the normal
    assert read_shape(write(tmp_path, "NOFF\n3 1 0\n" + "0 0 1 0 0 1\n" * 3 + "3 0 1 2\n")).colors is None


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("OFF\n353535235358 6 0\n" + TRIANGLE, "353535235358 vertices"),
        ("OFF\n3 2147483647 0\n" + TRIANGLE, "only 4 lines follow"),
        ("OFF\n" + "9" * 5000 + " 1 0\n" + TRIANGLE, "three counts"),
        ("OFF\n3 2 0\n" + TRIANGLE, "truncated?"),
        ("OFF\n3 1 0\n" + TRIANGLE + "3 0 1 2\n", "line 7: more lines"),
        ("OFF\n2 1 0\n" + TRIANGLE, "more lines"),
        ("OFF\n2 2 0\n" + TRIANGLE, "line 6: vertex index 2; expected 0 to 1"),
        ("OFF\n-3 1 0\n" + TRIANGLE, "three counts"),
        ("OFF\n", "three counts"),
        ("OFF\n3.5 1 0\n" + TRIANGLE, "three counts"),
        ("OFF\n3 1 0\n0 0 0\n1 0\n0 1 0\n3 0 1 2\n", "line 4: a vertex has 2 numbers; expected 3"),
        ("OFF\n3 1 0\n0 0 0\n1 x 0\n0 1 0\n3 0 1 2\n", "line 4: 'x' is not a number"),
        ("OFF\n3 1 0\n0 0 0\n1 1.#IND 0\n0 1 0\n3 0 1 2\n", "line 4: '1.#IND' is not a number"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "line 6: vertex index 3; expected 0 to 2"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "line 6: vertex index -1"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 99999999999999999999\n", "line 6: '99999999999999999999'"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 4294967296\n", "line 6: vertex index 4294967296"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 1.5\n", "line 6: '1.5' is not a vertex index"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n2000000000 0 1 2\n", "line 6: a face of '2000000000' corners"),
        ("OFF BINARY\n" + TRIANGLE, "is a binary OFF file"),
        ("4OFF\n3 1 0\n" + TRIANGLE, "more than three dimensions"),
        ("v 0 0 0\nf 1 1 1\n", "expected 'OFF'"),
        ("", "is empty (0 bytes)"),
        (" \n\t\n", "holds only blanks"),
        ("# nothing\n", "is not an OFF file"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "it looks like a PNG picture"),
        (b"OFF\n3 1 0\n0 0 0\n\0\0\0\0", "without zero bytes"),
        ("OFF\n3 1 0\n".encode("utf-16"), "UTF-16 text"),
        (b"version https://git-lfs.github.com/spec/v1\n", "Git LFS pointer"),
    ],
)
def test_a_broken_file_is_refused_in_one_line_that_says_where_and_why(
    tmp_path: Path, text: str | bytes, wanted: str
) -> None:
    assert wanted in refusal(write(tmp_path, text))


def test_names_that_are_not_utf8_or_hold_a_newline_stay_printable(tmp_path: Path) -> None:
    odd = tmp_path / b"caf\xe9\nnoir.off".decode("utf-8", "surrogateescape")
    odd.write_text("OFF\n3 1 0\n" + TRIANGLE)
    shape = read_shape(odd)
    assert shape.name == "caf\\xe9\\nnoir"
    shape.source.encode("utf-8")  # else it could not be written into a report
    odd.write_text("nothing")
    with pytest.raises(DataError) as caught:
        read_shape(odd)
    assert caught.value.message.isprintable()


def test_what_is_not_a_file_is_refused(tmp_path: Path) -> None:
    assert "no such file" in refusal(tmp_path / "missing.off")
    (tmp_path / "folder.off").mkdir()
    assert "is a folder" in refusal(tmp_path / "folder.off")
    assert "suffix '.docx'; expected one of .glb" in refusal(write(tmp_path, "x", "shape.docx"))


def test_z_up_is_turned_about_x(tmp_path: Path) -> None:
    path = write(tmp_path, "OFF\n3 1 0\n1 2 3\n1 0 0\n0 1 0\n3 0 1 2\n")
    turned = read_shape(path, up="z").vertices
    assert turned.tolist() == [[1, 3, -2], [1, 0, 0], [0, 0, -1]]
    matrix = np.linalg.solve(read_shape(path).vertices, turned)
    assert np.linalg.det(matrix) == pytest.approx(1)  # a rotation, not a mirror


coordinates = st.floats(allow_nan=False, allow_infinity=False, width=64)
blanks = st.sampled_from([" ", "  ", "\t", " \t "])
ends = st.sampled_from(["\n", "\r\n", " \n", "\n\n", "  # said\n", "\n# alone\n", "\n \r\n"])


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_mesh_written_in_any_style_comes_back_bit_for_bit(tmp_path: Path, data: st.DataObject) -> None:
    vertices = data.draw(st.lists(st.tuples(coordinates, coordinates, coordinates), min_size=1, max_size=6))
    index = st.integers(0, len(vertices) - 1)
    polygons = data.draw(st.lists(st.lists(index, min_size=3, max_size=6), max_size=5))
    blank = data.draw(blanks)
    rows = [blank.join(map(repr, v)) for v in vertices]
    rows += [blank.join(map(str, [len(p), *p])) for p in polygons]
    keyword = data.draw(st.sampled_from(["OFF", "OFF\n", "OFF\r\n", "OFF ", "\n\nOFF"]))
    text = f"{keyword}{len(vertices)}{blank}{len(polygons)}{blank}0\n"
    text += "".join(row + data.draw(ends) for row in rows)
    if data.draw(st.booleans()):
        text = text.rstrip()
    shape = read_shape(write(tmp_path, text))
    assert np.array_equal(shape.vertices, np.array(vertices))
    fans = [[p[0], p[i], p[i + 1]] for p in polygons for i in range(1, len(p) - 1)]
    assert shape.faces.tolist() == fans
