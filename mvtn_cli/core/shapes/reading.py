"""From a file to a `Shape`: the one door to all formats."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from mvtn_cli.core.shapes.gltf import read_gltf
from mvtn_cli.core.shapes.obj import read_obj
from mvtn_cli.core.shapes.off import read_off
from mvtn_cli.core.shapes.ply import read_ply
from mvtn_cli.core.shapes.points import read_hdf5, read_npy, read_point_text
from mvtn_cli.core.shapes.shape import Shape, UpAxis, turn_y_up
from mvtn_cli.core.shapes.source import shown, unreadable
from mvtn_cli.core.shapes.stl import read_stl

_READERS: dict[str, Callable[[Path], Shape]] = {
    ".off": read_off,
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": read_stl,
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".npy": read_npy,
    ".xyz": read_point_text,
    ".txt": read_point_text,
    ".pts": read_point_text,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
}

SUFFIXES: frozenset[str] = frozenset(_READERS)  # lower case, with the dot


def read_shape(path: str | os.PathLike[str], *, up: UpAxis = "y") -> Shape:
    """Read one mesh or point cloud.

    Args:
        path: The suffix, in any case, decides the format.
        up: The file's up axis; a z-up shape is turned, so that y is up in every `Shape`.

    Returns:
        The shape as it stands in the file: nothing mended, nothing dropped; see `validate`.

    Raises:
        DataError: One line that says which file, where, what was wrong and what was expected.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise unreadable(
            path, f"has the suffix '{shown(path.suffix)}'", expected=f"one of {', '.join(sorted(SUFFIXES))}"
        )
    shape = replace(reader(path), name=shown(path.stem), source=shown(path))
    return turn_y_up(shape) if up == "z" else shape
