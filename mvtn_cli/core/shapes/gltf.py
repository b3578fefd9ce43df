"""glTF 2.0, `.glb` and `.gltf`, by way of trimesh: all meshes of the scene, each at its place, as one."""

from __future__ import annotations

import io
import json
import logging
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvtn_cli.core.shapes.shape import ColorArray, FaceArray, FloatArray, Shape, cloud
from mvtn_cli.core.shapes.source import MAX_FILE_BYTES, not_a, read_bytes, unreadable
from mvtn_cli.errors import DataError

if TYPE_CHECKING:
    import trimesh

_MAX_FACES = 20_000_000  # over all instances of a scene: a small file can repeat a mesh without end
logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else its warnings go to the user's stderr


def read_gltf(path: Path) -> Shape:
    """Read a scene's meshes as one shape, with the vertex colours of those that have them.

    Raises:
        DataError: Not glTF 2, truncated, a buffer file that is missing, or no mesh in the scene.
    """
    import trimesh  # here, because the other formats do without, and it takes a while to load

    data = read_bytes(path)
    kind = path.suffix.lower().lstrip(".")
    _check_counts(path, _tree(path, data, kind), len(data))
    resolver = trimesh.resolvers.FilePathResolver(str(path.parent)) if kind == "gltf" else None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            scene = trimesh.load_scene(
                io.BytesIO(data), file_type=kind, process=False, skip_materials=True, resolver=resolver
            )
            return _join(path, scene)
    except DataError:
        raise
    except Exception as error:  # a parser of foreign files: it may trip over anything
        reason = (str(error).splitlines() or [""])[0][:120]
        raise unreadable(path, f"is not valid glTF ({type(error).__name__}: {reason})") from error


def _tree(path: Path, data: bytes, kind: str) -> dict[str, Any]:
    """Return the JSON part."""
    text = data
    if kind == "glb":
        if data[:4] != b"glTF":
            raise not_a(path, "a binary glTF file", data)
        if len(data) < 20:
            raise unreadable(path, f"has {len(data)} bytes", expected="a header of 20 (truncated?)")
        declared, length = int.from_bytes(data[8:12], "little"), int.from_bytes(data[12:16], "little")
        if declared > len(data) or 20 + length > len(data):
            raise unreadable(path, f"declares {declared} bytes but has {len(data)} (truncated?)")
        text = data[20 : 20 + length]
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise not_a(path, "glTF", data, expected="JSON") from error
    if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
        raise unreadable(path, "is not glTF", expected="a JSON object with an 'asset'")
    return tree


def _check_counts(path: Path, tree: dict[str, Any], size: int) -> None:
    """Refuse counts that the buffers can't hold: such an accessor would be allocated as zeros."""
    room = size
    for buffer in _dicts(tree, "buffers"):
        uri = buffer.get("uri", "")
        if uri and not str(uri).startswith("data:"):
            try:
                room += (path.parent / str(uri)).stat().st_size
            except (OSError, ValueError) as error:
                raise unreadable(path, f"its buffer {ascii(str(uri))[:80]} is not there") from error
    for accessor in _dicts(tree, "accessors"):
        count = accessor.get("count")
        if not isinstance(count, int) or not 0 <= count <= min(room, MAX_FILE_BYTES):
            seen = ascii(count)[:20]
            raise unreadable(path, f"an accessor declares {seen} items, but the data have {room} bytes")


def _dicts(tree: dict[str, Any], key: str) -> list[dict[str, Any]]:
    listed = tree.get(key, [])
    return [item for item in listed if isinstance(item, dict)] if isinstance(listed, list) else []


def _join(path: Path, scene: trimesh.Scene) -> Shape:
    """Put every instance of every mesh at its place; if there is none, every point cloud."""
    placed = [scene.graph[node] for node in scene.graph.nodes_geometry]
    parts = [(np.asarray(matrix, np.float64), scene.geometry[name]) for matrix, name in placed]
    meshes = [(matrix, part) for matrix, part in parts if len(getattr(part, "faces", ()))]
    if sum(len(part.faces) for _, part in meshes) > _MAX_FACES:
        raise unreadable(path, "its scene repeats meshes without end", expected=f"at most {_MAX_FACES} faces")
    clouds = [(matrix, part) for matrix, part in parts if type(part).__name__ == "PointCloud"]
    chosen = meshes or clouds
    if not chosen:
        raise unreadable(path, "has no mesh in its scene")
    xyz = np.concatenate([_moved(matrix, part.vertices) for matrix, part in chosen])
    each = [_part_colors(part) for _, part in chosen]
    colors = None if all(np.isnan(part).all() for part in each) else np.concatenate(each)
    if not meshes:
        return cloud(xyz, colors)
    return Shape(vertices=xyz, faces=_joined_faces(path, [part for _, part in meshes]), colors=colors)


def _joined_faces(path: Path, parts: list[Any]) -> FaceArray:
    """Number the parts' faces on. Out of range is refused here: later it would point into a neighbour."""
    joined, first = [], 0
    for part in parts:
        faces, count = np.asarray(part.faces), len(part.vertices)
        if faces.min() < 0 or faces.max() >= count:
            bad = faces[(faces < 0) | (faces >= count)][0]
            raise unreadable(path, f"a face has vertex index {bad}", expected=f"0 to {count - 1}")
        joined.append(faces + first)
        first += count
    return np.concatenate(joined).astype(np.int32)


def _moved(matrix: FloatArray, vertices: FloatArray) -> FloatArray:
    """Apply a node's matrix. An infinite coordinate may become NaN, which is as unusable."""
    return np.asarray(vertices, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def _part_colors(part: Any) -> ColorArray:
    """Return (n, 3) vertex colours, NaN where the part has none."""
    count = len(part.vertices)
    if type(part).__name__ == "PointCloud":
        rgba = np.asarray(part.colors)
    else:
        rgba = np.asarray(part.visual.vertex_colors) if part.visual.kind == "vertex" else np.zeros(0)
    if rgba.ndim != 2 or len(rgba) != count or rgba.shape[1] < 3:
        return np.full((count, 3), np.nan, np.float32)
    return (rgba[:, :3] / 255.0).astype(np.float32)
