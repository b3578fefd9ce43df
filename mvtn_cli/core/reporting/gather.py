"""Read the folder of a run back: everything that a report shows lies there."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.evaluation.files import read_csv
from mvtn_cli.errors import DataError


@dataclass(frozen=True)
class Views:
    """Pictures of a few shapes with the cameras that took them.

    Attributes:
        names: N names.
        labels: (N,) class indices, -1 where unknown.
        azimuth_deg: (N, M).
        elevation_deg: (N, M).
        distance: (N, M) shape radii, NaN where it was not kept.
        images: (N, M, 3, H, W) uint8.
    """

    names: tuple[str, ...]
    labels: NDArray[np.int64]
    azimuth_deg: NDArray[np.float64]
    elevation_deg: NDArray[np.float64]
    distance: NDArray[np.float64]
    images: NDArray[np.uint8]


class Solid(NamedTuple):
    """A small copy of a shape: a mesh, or points where it has none.

    Attributes:
        points: (P, 3); (0, 3) for a mesh.
        vertices: (V, 3).
        faces: (F, 3) indices.
    """

    points: NDArray[np.float32]
    vertices: NDArray[np.float32]
    faces: NDArray[np.int64]


@dataclass(frozen=True)
class CameraTable:
    """The cameras of all judged shapes.

    Attributes:
        names: N names.
        labels: N names of classes, empty where unknown.
        azimuth_deg: (N, M).
        elevation_deg: (N, M).
        known_azimuth_deg: (N,), NaN where no side is known.
    """

    names: tuple[str, ...]
    labels: tuple[str, ...]
    azimuth_deg: NDArray[np.float64]
    elevation_deg: NDArray[np.float64]
    known_azimuth_deg: NDArray[np.float64]


@dataclass(frozen=True)
class Findings:
    """What a report is made of. Each part may be missing, and its section then is, too.

    Attributes:
        name: Name of the run.
        result: `result.json`.
        config: The settings of the training.
        run: `run.json`.
        epochs: The lines of `metrics.jsonl`.
        start: Views of a few shapes before learning.
        best: Views of the same shapes with the best weights.
        mistakes: Views of misclassified shapes, in the order of `result["mistakes"]`.
        cameras: `views.csv`.
        solids: `shapes.npz`, by the name of the shape; may be empty.
        command: What to type to get this run again.
    """

    name: str
    result: Mapping[str, Any]
    config: Mapping[str, Any] = field(default_factory=dict)
    run: Mapping[str, Any] = field(default_factory=dict)
    epochs: tuple[Mapping[str, Any], ...] = ()
    start: Views | None = None
    best: Views | None = None
    mistakes: Views | None = None
    cameras: CameraTable | None = None
    solids: Mapping[str, Solid] = field(default_factory=dict)
    command: str = ""


def gather(run: Path, folder: Path | None = None) -> Findings:
    """Read a run and the evaluation in `folder` (the run's own by default).

    Raises:
        DataError: The run hasn't been evaluated there.
    """
    run, folder = Path(run), Path(folder or run)
    result = read_json(folder / "result.json")
    if not result:
        raise DataError(
            f"no evaluation in {folder}", hint=f"make one first: mvtn eval {run}", code="report.no-evaluation"
        )
    config = read_toml(run / "config.toml")
    return Findings(
        name=run.name,
        result=result,
        config=config,
        run=read_json(run / "run.json"),
        epochs=tuple(read_lines(run / "metrics.jsonl")),
        start=read_views(run / "views_start.npz"),
        best=read_views(run / "views_best.npz"),
        mistakes=read_views(folder / "mistakes.npz"),
        cameras=read_cameras(folder / "views.csv"),
        solids=read_solids(folder / "shapes.npz"),
        command=repeat_command(config),
    )


def read_views(path: Path) -> Views | None:
    """Read pictures with their cameras; None if the file is missing or is not one of these."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            azimuth = arrays["azimuth"].astype(np.float64)
            distance = arrays["distance"] if "distance" in arrays else np.full(azimuth.shape, np.nan)
            views = Views(
                tuple(str(name) for name in arrays["names"]),
                arrays["labels"].astype(np.int64),
                azimuth,
                arrays["elevation"].astype(np.float64),
                np.broadcast_to(distance, azimuth.shape).astype(np.float64),
                arrays["images"].astype(np.uint8),
            )
    except (OSError, KeyError, ValueError, EOFError, BadZipFile):
        return None
    count, num_views = views.azimuth_deg.shape
    fits = views.images.shape[:3] == (count, num_views, 3) and len(views.names) == count
    return views if fits and count else None


def read_solids(path: Path) -> dict[str, Solid]:
    """Read small copies of shapes by their names; none if the file is missing or is not one of these."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            names = [str(name) for name in arrays["names"]]
            parts = [
                np.split(arrays[kind].astype(dtype), np.cumsum(arrays[f"{count}_counts"])[:-1])
                for kind, count, dtype in (
                    ("points", "point", np.float32), ("vertices", "vertex", np.float32), ("faces", "face", np.int64)
                )
            ]  # fmt: skip
            solids = {name: Solid(*part) for name, *part in zip(names, *parts, strict=True)}
    except (OSError, KeyError, ValueError, EOFError, BadZipFile):
        return {}
    return solids if all(_is_sound(solid) for solid in solids.values()) else {}


def _is_sound(solid: Solid) -> bool:
    return (
        all(part.ndim == 2 and part.shape[1] == 3 and np.isfinite(part).all() for part in solid)
        and bool(len(solid.points) or len(solid.faces))
        and (not len(solid.faces) or 0 <= solid.faces.min() <= solid.faces.max() < len(solid.vertices))
    )


def read_cameras(path: Path) -> CameraTable | None:
    """Read `views.csv`; None if it is missing or empty."""
    if not path.is_file():
        return None
    rows = read_csv(path)
    num_views = 1 + max((int(row["view"]) for row in rows), default=-1)
    if not num_views:
        return None
    first = rows[::num_views]

    def column(name: str, of: list[dict[str, str]]) -> NDArray[np.float64]:
        return np.array([float(row[name] or "nan") for row in of])

    return CameraTable(
        tuple(row["name"] for row in first),
        tuple(row["label"] for row in first),
        column("azimuth_deg", rows).reshape(-1, num_views),
        column("elevation_deg", rows).reshape(-1, num_views),
        column("known_azimuth_deg", first),
    )


def repeat_command(config: Mapping[str, Any]) -> str:
    """Write the command that trains with these settings: what differs from the defaults, and the seed."""
    import shlex

    from mvtn_cli.config import TrainConfig
    from mvtn_cli.core.training.run import NOT_SETTINGS

    words = ["mvtn", "train", *([shlex.quote(str(config["dataset"]))] if config.get("dataset") else [])]
    for name, field_info in TrainConfig.model_fields.items():
        value = config.get(name)
        if name in NOT_SETTINGS or value is None or (value == field_info.default and name != "seed"):
            continue
        option = "--" + name.replace("_", "-")
        match value:
            case True:
                words.append(option)
            case False:
                words.append(option.replace("--", "--no-", 1))
            case _:
                words += [option, shlex.quote(str(value))]
    return " ".join(words)


def read_json(path: Path) -> dict[str, Any]:
    """Read a document; an empty one if the file is missing or broken."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return document if isinstance(document, dict) else {}


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Read the epochs; a last line that a crash cut off ends them."""
    lines: list[dict[str, Any]] = []
    if path.is_file():
        for line in path.read_text(encoding="utf-8").splitlines():
            try:
                lines.append(json.loads(line))
            except ValueError:
                break
    return lines


def read_toml(path: Path) -> dict[str, Any]:
    """Read settings; none if the file is missing or broken."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
