"""Point clouds from text, NumPy and HDF5."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from mvtn_cli.core.shapes import normalise, read_shape, sample_surface, validate
from mvtn_cli.errors import DataError

POINTS = np.array([[0.5, -1, 2], [3, 4.25, -5], [1e-3, 0, 7]])


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.xyz", "0.5 -1 2\n3 4.25 -5\n1e-3 0 7"),
        ("a.XYZ", "# x y z\r\n0.5\t-1  2 \r\n\r\n3 4.25 -5\r\n1e-3 0 7 # last\r\n"),
        ("a.txt", "0.5,-1,2\n3,4.25,-5\n1e-3,0,7\n"),
        ("a.txt", "0.5; -1; 2\n3; 4.25; -5\n1e-3; 0; 7\n"),
        ("a.pts", "3\n0.5 -1 2\n3 4.25 -5\n1e-3 0 7\n"),
        ("a.txt", "//X Y Z\n0.5 -1 2 0 0 1\n3 4.25 -5 0 1 0\n1e-3 0 7 -1 0 0\n"),
    ],
)
def test_text_clouds_of_all_habits_read_alike(tmp_path: Path, name: str, text: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    shape = read_shape(path)
    assert shape.is_cloud
    assert np.array_equal(shape.points, POINTS)
    assert shape.point_colors is None


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ([[255, 0, 51], [0, 0, 0], [9, 9, 9]], [1, 0, 0.2]),
        ([[0.25, 0.5, 0.125], [0, 0, 0], [0.5, 0, 0]], [0.25, 0.5, 0.125]),
        ([[0, 0, 1, 255, 0, 51], [0, 1, 0, 0, 0, 0], [1, 0, 0, 9, 9, 9]], [1, 0, 0.2]),  # normal, then colour
        ([[-40, 255, 0, 51], [7, 0, 0, 0], [-3, 9, 9, 9]], [1, 0, 0.2]),  # .pts: intensity, then colour
        ([[0, 0, 1], [0, 1, 0], [0.6, 0.8, 0]], None),  # unit vectors: normals
        ([[1.5, 0, 2], [0, 0.5, 0], [0, 0, 0]], None),  # neither bytes nor unit range
    ],
)
def test_further_columns_are_colours_only_if_they_look_like_it(
    tmp_path: Path, columns: list[list[float]], expected: list[float] | None
) -> None:
    np.save(tmp_path / "a.npy", np.hstack([POINTS, columns]))
    shape = read_shape(tmp_path / "a.npy")
    assert np.array_equal(shape.points, POINTS)
    if expected is None:
        assert shape.point_colors is None
    else:
        assert shape.point_colors is not None
        assert np.allclose(shape.point_colors[0], expected)


def test_hdf5_of_one_cloud_reads_and_one_of_many_names_the_way_out(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["data"] = POINTS[None].astype(np.float32)
        file["label"] = np.zeros((1, 1), np.uint8)
    assert np.allclose(read_shape(path).points, POINTS)
    with h5py.File(path, "w") as file:
        file["data"] = np.zeros((40, 1024, 3), np.float32)
    with pytest.raises(DataError, match="holds 40 clouds") as caught:
        read_shape(path)
    assert "modelnet40:" in caught.value.hint


def test_a_dataset_that_declares_more_points_than_memory_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:  # nothing is written: the file has 2 kB
        file.create_dataset("data", shape=(10**12, 3), dtype="f4", chunks=(1024, 3))
    with pytest.raises(DataError, match="has 1000000000000 points"):
        read_shape(tmp_path / "a.h5")
    np.save(tmp_path / "a.npy", np.zeros((4, 3)))
    data = (tmp_path / "a.npy").read_bytes().replace(b"(4, 3), }         ", b"(4000000000, 3), }")
    assert b"4000000000" in data
    (tmp_path / "a.npy").write_bytes(data)
    with pytest.raises(DataError, match="not a whole NumPy file"):
        read_shape(tmp_path / "a.npy")
    (tmp_path / "a.npy").write_bytes(data.replace(b"}", b"("))  # NumPy trips over this in its tokeniser
    with pytest.raises(DataError, match="not a whole NumPy file"):
        read_shape(tmp_path / "a.npy")


@pytest.mark.parametrize(
    ("array", "wanted"),
    [
        (np.zeros((3, 50)), "transposed?"),
        (np.zeros((0, 3)), "shape (0, 3)"),
        (np.zeros(3), "shape (3,)"),
        (np.zeros((5, 3), complex), "complex128"),
        (np.array([[None] * 3]), "not a whole NumPy file"),  # would be unpickled
    ],
)
def test_arrays_that_are_no_cloud_are_refused(tmp_path: Path, array: np.ndarray, wanted: str) -> None:
    np.save(tmp_path / "a.npy", array, allow_pickle=True)
    with pytest.raises(DataError) as caught:
        read_shape(tmp_path / "a.npy")
    assert wanted in caught.value.message


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("5\n0 0 0\n", "line 1: declares 5 points, but 1 lines follow"),
        ("0 0 0\n1 1\n", "line 2: a point has 2 numbers; expected 3"),
        ("0 0\n1 1\n", "line 1: a point has 2 numbers; expected 3"),
        ("0 0 0\n1 one 1\n", "line 2: 'one' is not a number"),
        ("x\n", "line 1: a line of one word"),
        ("# nothing\n", "has no points"),
        ("\x89PNG\0", "is not point text"),
    ],
)
def test_a_broken_text_cloud_is_refused_with_its_line(tmp_path: Path, text: str, wanted: str) -> None:
    path = tmp_path / "a.xyz"
    path.write_text(text)
    with pytest.raises(DataError) as caught:
        read_shape(path)
    assert wanted in caught.value.message


def test_a_cloud_goes_all_the_way_without_its_bad_points(tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    table = np.hstack([generator.normal(size=(50, 3)) + 100, generator.random((50, 3))])
    table[7, 1], table[9, 4] = np.inf, np.nan
    (tmp_path / "a.xyz").write_text("\n".join(" ".join(map(repr, row.tolist())) for row in table))
    shape = read_shape(tmp_path / "a.xyz")
    mended, findings = validate(shape)
    assert [(f.name, f.count, f.fatal) for f in findings] == [("non-finite-points", 1, False)]
    unit, center, radius = normalise(mended)
    assert unit.points is not None and mended.points is not None
    assert np.linalg.norm(unit.points, axis=1).max() == pytest.approx(1, abs=1e-12)
    assert np.allclose(unit.points * radius + center, mended.points)
    points, _ = sample_surface(unit, 2048, seed=3)
    assert {tuple(p) for p in points} == {tuple(p) for p in unit.points}
