"""OBJ: what real programs write, and what they break."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mvtn_cli.core.shapes import Shape, read_shape, validate
from mvtn_cli.errors import DataError

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def read(folder: Path, text: str) -> Shape:
    path = folder / "shape.obj"
    path.write_text(text)
    return read_shape(path)


@pytest.mark.parametrize(
    "face",
    [
        "f 1 2 3",
        "f 1/1 2/2 3/3",
        "f 1//1 2//1 3//1",
        "f 1/1/1 2 3//",
        "f -4 -3 -2",
        "f 1 2 3 # end",
        "f\t1\t2  3 ",
        "f 1 \\\n2 3",
    ],
)
def test_all_ways_to_name_a_corner_give_the_same_face(tmp_path: Path, face: str) -> None:
    assert read(tmp_path, SQUARE + face).faces.tolist() == [[0, 1, 2]]


def test_negative_indices_count_from_their_own_line(tmp_path: Path) -> None:
    shape = read(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf -3 -2 -1\n")
    assert shape.faces.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_lines_groups_missing_materials_and_smoothing_are_skipped(tmp_path: Path) -> None:
    extra = "mtllib gone.mtl\nusemtl\no f 1 2 3\ng v\ns 1\nl 1 2\np 1\nvn 0 0 1\nvt 0 0\nvp 1\n"
    shape = read(tmp_path, extra + SQUARE + "f 1 2 3 4")
    assert shape.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert shape.colors is None


def test_vertex_colours_are_kept_and_missing_ones_made_white(tmp_path: Path) -> None:
    rows = "v 0 0 0 1 0 0\nv 1 0 0 nan nan nan\nv 0 1 0\nf 1 2 3\n"
    shape = read(tmp_path, rows)
    assert shape.colors is not None
    assert np.isnan(shape.colors[1:]).all()
    mended, findings = validate(shape)
    assert mended.colors is not None
    assert mended.colors.tolist() == [[1, 0, 0], [1, 1, 1], [1, 1, 1]]
    assert [(f.name, f.count) for f in findings] == [("missing-colors", 2)]
    assert read(tmp_path, "v 0 0 0 255 0 51\nv 1 0 0 0 0 0\nv 0 1 0 0 0 0\nf 1 2 3\n").colors[0].tolist() == [
        1, 0, np.float32(0.2),
    ]  # fmt: skip


def test_a_fourth_number_is_a_weight_not_a_colour(tmp_path: Path) -> None:
    assert read(tmp_path, "v 0 0 0 .1\nv 1 0 0 .2\nv 0 1 0 .3\nf 1 2 3").colors is None


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (SQUARE + "f 1 2 5", "line 5: vertex index '5'; expected 1 to 4"),
        (SQUARE + "f 1 2 0", "line 5: vertex index '0'; expected 1 to 4"),
        (SQUARE + "f 1 2 -5", "line 5: vertex index '-5'; expected -4 to -1"),
        (SQUARE + "f 1 2 99999999999999999999999", "line 5: vertex index"),
        (SQUARE + "f 1 2 x", "line 5: 'x' is no corner"),
        (SQUARE + "f 1 2 3.0", "line 5: '3.0' is no corner"),
        ("f -1 -2 -3\n" + SQUARE, "line 1: vertex index '-1'; expected a vertex before"),
        ("v 0 0\n" + SQUARE + "f 1 2 3", "line 1: a vertex of 2 numbers"),
        ("v 0 0 3.1+e2\n" + SQUARE + "f 1 2 3", "line 1: '0 0 3.1+e2' is no vertex"),
        (SQUARE, "has 4 vertices but no face"),
        ("# only words\n", "is not OBJ"),
        ("OFF\n0 0 0\n", "it looks like an OFF file"),
    ],
)
def test_a_broken_file_is_refused_with_its_line(tmp_path: Path, text: str, wanted: str) -> None:
    with pytest.raises(DataError) as caught:
        read(tmp_path, text)
    assert wanted in caught.value.message
    assert caught.value.message.isprintable()


def test_points_alone_are_refused_and_the_hint_says_which_formats_hold_points(tmp_path: Path) -> None:
    with pytest.raises(DataError) as caught:
        read(tmp_path, SQUARE)
    assert ".xyz" in caught.value.hint
