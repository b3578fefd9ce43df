"""Point clouds: .xyz, .txt, .pts as text, .npy, and HDF5 files of a single cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mvtn_cli.core.shapes.colors import extra_colors
from mvtn_cli.core.shapes.rows import Rows, is_int
from mvtn_cli.core.shapes.shape import Shape, cloud
from mvtn_cli.core.shapes.source import check_file, read_text, unreadable
from mvtn_cli.errors import DataError

MAX_POINTS = 20_000_000


def read_point_text(path: Path) -> Shape:
    """Read points from text: three numbers a line, separated by blanks, commas or semicolons.

    Further columns are taken for colours where they look like it (see `extra_colors`). A first line with
    one number is the count that `.pts` files carry. `#` and `//` begin a comment.

    Raises:
        DataError: Lines of different lengths, something that is not a number, or no points.
    """
    data = read_text(path, "point")
    rows = Rows.parse(path, data.replace(b",", b" ").replace(b";", b" "))
    rows = _without_slashes(rows)
    if len(rows) and len(rows.tokens[0]) == 1:
        declared = rows.tokens[0][0]
        if not is_int(declared):
            raise rows.error(0, "a line of one word", expected="x y z")
        if int(declared) != len(rows) - 1:
            raise rows.error(0, f"declares {int(declared)} points, but {len(rows) - 1} lines follow (truncated?)")
        rows = rows[1:]
    if not len(rows):
        raise unreadable(path, "has no points", expected="lines of x y z")
    return _cloud(rows.numbers("a point", least=3))


def read_npy(path: Path) -> Shape:
    """Read points from a NumPy file of shape (N, 3) or wider. Never unpickles.

    Raises:
        DataError: Not NumPy, pickled objects, another shape, or truncated.
    """
    check_file(path)
    try:  # mapped, not read: the header's shape is held against the file's size before memory is taken
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # NumPy parses the header as Python, which can fail in many ways
        raise unreadable(path, "is not a whole NumPy file", expected="an array (N, 3) of numbers") from error
    if not isinstance(array, np.ndarray):
        raise unreadable(path, "holds several arrays", expected="one array (N, 3) of numbers")
    return _from_array(path, array, "the array")


def read_hdf5(path: Path) -> Shape:
    """Read the one cloud of an HDF5 file: its dataset `data` or `points`, else its only one.

    Raises:
        DataError: Not HDF5, several clouds (that is a data set, not a shape), or another shape.
    """
    import h5py

    check_file(path)
    try:
        with h5py.File(path, "r") as file:
            found = {key: item for key, item in file.items() if isinstance(item, h5py.Dataset)}
            name = next((key for key in ("data", "points") if key in found), None)
            if name is None and len(found) == 1:
                name = next(iter(found))
            if name is None:
                raise unreadable(path, f"has {len(found)} datasets at its top", expected="'data' or 'points'")
            return _from_array(path, found[name], f"dataset '{name}'")
    except DataError:
        raise
    except Exception as error:  # a parser of foreign files: it may trip over anything
        raise unreadable(path, "is not a whole HDF5 file", expected="a dataset (N, 3)") from error


def _from_array(path: Path, array: Any, what: str) -> Shape:
    shape = tuple(array.shape)
    if len(shape) == 3 and shape[0] == 1:
        shape = shape[1:]
    if len(shape) == 3:
        raise unreadable(
            path, f"{what} holds {shape[0]} clouds", expected="one, of shape (N, 3)",
            hint="open its folder as a data set: modelnet40:FOLDER",
        )  # fmt: skip
    if len(shape) != 2 or not 3 <= shape[1] <= 12 or shape[0] == 0:
        turned = " (transposed?)" if len(shape) == 2 and shape[0] == 3 else ""
        raise unreadable(path, f"{what} has shape {tuple(array.shape)}{turned}", expected="(N, 3)")
    if array.dtype.kind not in "fiu":
        raise unreadable(path, f"{what} holds {array.dtype}", expected="real numbers")
    if shape[0] > MAX_POINTS:
        raise unreadable(path, f"has {shape[0]} points", expected=f"at most {MAX_POINTS}")
    return _cloud(np.asarray(array[...], np.float64).reshape(shape))


def _cloud(table: npt.NDArray[np.float64]) -> Shape:
    colors = extra_colors(table[:, 3:]) if table.shape[1] >= 6 else None
    return cloud(np.ascontiguousarray(table[:, :3]), colors)


def _without_slashes(rows: Rows) -> Rows:
    keep = [i for i, row in enumerate(rows.tokens) if not row[0].startswith(b"//")]
    if len(keep) == len(rows):
        return rows
    return Rows(rows.path, [rows.tokens[i] for i in keep], [rows.lines[i] for i in keep])
