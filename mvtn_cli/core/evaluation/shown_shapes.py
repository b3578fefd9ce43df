"""Small copies of the shapes that a report shows: what it draws where a shape can be turned."""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mvtn_cli.console import Console
from mvtn_cli.core.shapes import Shape, simplify, validate
from mvtn_cli.core.store import StoredShape
from mvtn_cli.core.training.checkpoint import write_run_file

if TYPE_CHECKING:
    from mvtn_cli.core.preprocess import Prepared

MAX_POINTS, MAX_VERTICES = 1000, 600


def save_shapes(path: Path, prepared: Prepared, names: Iterable[str], console: Console) -> None:
    """Write K shapes with at most 600 vertices, or 1,000 points where there is no mesh; without any, an old file goes.

    The file holds names, and points (1000, 3) float32, vertices (V, 3) float32 and faces (F, 3) uint16 of all
    shapes, one after another, with `point_counts`, `vertex_counts` and `face_counts` (K,) to take them apart again.
    A name that the data set doesn't have is left out.
    """
    where = {record.name: index for index, record in enumerate(prepared.records)}
    known = [name for name in dict.fromkeys(names) if name in where]
    if not known:
        path.unlink(missing_ok=True)
        return
    kept = []
    with console.progress("shapes of the report", len(known)) as ticker:
        for name in known:
            kept.append(_reduced(prepared.load(where[name])))
            ticker.advance(1)
    points, vertices, faces = zip(*kept, strict=True)
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        names=np.array(known, dtype=str),
        points=np.concatenate(points).astype(np.float32),
        vertices=np.concatenate(vertices).astype(np.float32),
        faces=np.concatenate(faces).astype(np.uint16),
        point_counts=list(map(len, points)),
        vertex_counts=list(map(len, vertices)),
        face_counts=list(map(len, faces)),
    )
    write_run_file(path, buffer.getvalue())


def shown_names(path: Path) -> list[str]:
    """The names in `views_best.npz` of a run; none if there is no such file."""
    if not path.is_file():
        return []
    with np.load(path, allow_pickle=False) as arrays:
        return [str(name) for name in arrays["names"]]


def _reduced(stored: StoredShape) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if not stored.has_mesh:
        return stored.points[:MAX_POINTS], np.zeros((0, 3)), np.zeros((0, 3))
    # stored vertices are split where the surface has a crease: they are merged again, or it would tear
    whole, findings = validate(Shape(stored.vertices.astype(np.float64), stored.faces))
    if any(finding.fatal for finding in findings):
        return stored.points[:MAX_POINTS], np.zeros((0, 3)), np.zeros((0, 3))
    shape, _ = simplify(whole, MAX_VERTICES)
    return np.zeros((0, 3)), shape.vertices, shape.faces
