"""All files that belong to one shape: its sheet, its pictures, its cameras."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.evaluation.views import standard_angles
from mvtn_cli.core.render import Look, ShapeBatch
from mvtn_cli.core.reporting import geometry_images as geometry
from mvtn_cli.core.reporting import words
from mvtn_cli.core.reporting.camera_files import (
    PICTURE,
    cameras_document,
    intrinsics,
    transforms_document,
    world_to_camera,
)
from mvtn_cli.core.reporting.camera_picture import camera_picture
from mvtn_cli.core.reporting.drawing import Pictures, draw_pictures
from mvtn_cli.core.reporting.file_names import write_document, write_picture
from mvtn_cli.core.reporting.images import contact_sheet, png, reduced
from mvtn_cli.core.reporting.turntable import turntable
from mvtn_cli.core.reporting.view_cameras import Placed
from mvtn_cli.core.views import Cameras

if TYPE_CHECKING:
    from mvtn_cli.render_views_config import RenderViewsConfig

SHEET_COLUMNS = 6  # of a sheet that is wider than high; one of more tiles is about square
SHEET_PIXELS = 16_000_000  # of all tiles together; 15 of 1024²
SMALLEST_TILE = 96  # pixels
TURN_ELEVATION = 30.0  # degrees, of a turntable for which no elevation is named; that of the circular layout


@dataclass(frozen=True)
class Subject:
    """One shape, and where it is looked at from.

    Attributes:
        file_name: That no other shape has.
        batch: The shape.
        kind: Whether it is drawn as `mesh` or as `points`.
        placed: Its cameras, (1, M), and their light.
        about: What is said about it: `file`, `name`, `label`, and `center` and `radius` in file units.
    """

    file_name: str
    batch: ShapeBatch
    kind: str
    placed: Placed
    about: dict[str, Any]

    @property
    def cameras(self) -> Cameras:
        """(1, M)."""
        return self.placed.cameras

    @property
    def depth_steps(self) -> int:
        """Of its depth images, see `geometry_images.depth_steps`."""
        return geometry.depth_steps(float(self.cameras.distance.max()))


def write_shape(out: Path, subject: Subject, settings: Any, config: RenderViewsConfig) -> dict[str, Any]:
    """Draw one shape and write everything that is asked for.

    OUT/NAME.png                          the sheet
    OUT/NAME/view_01.png …                `per_view`, and with `cameras`, whose files name these pictures
    OUT/NAME/silhouette_01.png …          `outputs`; also depth_01.png, normals_01.png and arrays.npz
    OUT/NAME/cameras.json, transforms.json, cameras.png     `cameras`
    OUT/NAME/turntable.gif                `turntable`

    Args:
        out: Folder.
        subject: The shape.
        settings: Of the pictures.
        config: What is asked for.

    Returns:
        The paths of what was written, and `views`.
    """
    batch, kind, cameras = subject.batch, subject.kind, subject.cameras
    pictures = draw_pictures(batch, kind, cameras, settings, geometry=bool(config.outputs), light=subject.placed.light)
    views = _views(cameras)
    folder, whole = out / subject.file_name, out / f"{subject.file_name}.png"
    answer: dict[str, Any] = {"picture": str(whole), "views": views}
    write_picture(whole, sheet(pictures, views, str(subject.about["name"]), config.outputs))
    _write_views(folder, pictures, views, config, subject.depth_steps)
    if "arrays" in config.outputs:
        write_picture(folder / "arrays.npz", arrays_npz(pictures, cameras, subject.about))
        answer["arrays"] = str(folder / "arrays.npz")
    if config.cameras:
        answer |= _write_cameras(folder, subject, views, settings, config)
    if config.turntable:
        elevation = config.elevation[0] if config.elevation else TURN_ELEVATION
        write_picture(folder / "turntable.gif", turntable(batch, kind, settings, elevation))
        answer["turntable"] = str(folder / "turntable.gif")
    return answer


def _views(cameras: Cameras) -> list[dict[str, Any]]:
    azimuth, elevation = standard_angles(cameras.azimuth_deg[0].numpy(), cameras.elevation_deg[0].numpy())
    return [
        {"azimuth_deg": round(float(a), 4), "elevation_deg": round(float(e), 4), "distance": round(float(d), 4)}
        for a, e, d in zip(azimuth, elevation, cameras.distance[0], strict=True)
    ]


def _write_views(
    folder: Path, pictures: Pictures, views: list[dict[str, Any]], config: RenderViewsConfig, steps: int
) -> None:
    """Write each view's pictures and name them in `views`."""
    digits = max(2, len(str(len(views))))

    def write(what: str, key: str, contents: Sequence[bytes]) -> None:
        for number, (view, content) in enumerate(zip(views, contents, strict=True), 1):
            path = folder / f"{what}_{number:0{digits}d}.png"
            write_picture(path, content)
            view[key] = str(path)

    if config.per_view or config.cameras:
        write("view", "picture", [png(image) for image in pictures.rgb])
    if "silhouette" in config.outputs and pictures.silhouette is not None:
        write("silhouette", "silhouette", [geometry.silhouette_png(mask) for mask in pictures.silhouette])
    if "depth" in config.outputs and pictures.depth is not None:
        write("depth", "depth", [geometry.depth_png(depth, steps) for depth in pictures.depth])
    if "normals" in config.outputs and pictures.normals is not None:
        write("normals", "normals", [geometry.normals_png(normals) for normals in pictures.normals])


def _write_cameras(
    folder: Path, subject: Subject, views: list[dict[str, Any]], settings: Any, config: RenderViewsConfig
) -> dict[str, Any]:
    """Write the cameras as two files and a picture; returns their paths."""
    files = ("picture", "silhouette", "depth", "normals")
    named: list[dict[str, Any]] = [{key: Path(view[key]).name for key in files if key in view} for view in views]
    if subject.placed.light is not None and subject.kind == "mesh":
        for view, towards in zip(named, subject.placed.light[0].tolist(), strict=True):
            view["light"] = towards
    scale = {"depth_steps_per_radius": subject.depth_steps} if "depth" in config.outputs else {}
    about = {**subject.about, **scale, **{key: getattr(settings, key) for key in PICTURE}, "render": subject.kind}
    cameras, size = subject.cameras, settings.image_size
    write_document(folder / "cameras.json", cameras_document(cameras, size, named, about))
    write_document(folder / "transforms.json", transforms_document(cameras, size, named, about))
    look, title = Look.evaluation(settings, 1, subject.kind), str(about["name"])
    write_picture(folder / "cameras.png", camera_picture(subject.batch, subject.kind, cameras, look, title))
    return {
        "cameras": str(folder / "cameras.json"),
        "transforms": str(folder / "transforms.json"),
        "cameras_picture": str(folder / "cameras.png"),
    }


def arrays_npz(pictures: Pictures, cameras: Cameras, about: dict[str, Any]) -> bytes:
    """Pack all pictures of a shape, as they were computed, with their cameras; `Pictures` says what each array is."""
    inside = intrinsics(cameras, pictures.rgb.shape[-1])
    focal, cx, cy = inside["focal"], inside["cx"], inside["cy"]
    arrays: dict[str, NDArray[Any] | None] = {
        "rgb": pictures.rgb,
        "silhouette": pictures.silhouette,
        "depth": pictures.depth,
        "normals": pictures.normals,
        "face_ids": pictures.face_ids,
        "world_to_camera": world_to_camera(cameras),
        "azimuth_deg": cameras.azimuth_deg[0].numpy(),
        "elevation_deg": cameras.elevation_deg[0].numpy(),
        "distance": cameras.distance[0].numpy(),
        "fov_deg": np.array(cameras.fov_deg),
        "intrinsics": np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1]]),
        "center": np.array(about["center"]),
        "radius": np.array(about["radius"]),
    }
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **{key: a for key, a in arrays.items() if a is not None})
    return buffer.getvalue()


def sheet(pictures: Pictures, views: Sequence[dict[str, Any]], title: str, outputs: Sequence[str] = ()) -> bytes:
    """Lay the views of one shape out in rows as even as they can be, each above its outputs."""
    count, kinds = len(views), _tiles(pictures, outputs)
    rows = min(-(-count // SHEET_COLUMNS), max(1, round(math.sqrt(count / len(kinds)))))
    columns = -(-count // rows)
    blank = rows * columns - count
    captions = [caption(view["azimuth_deg"], view["elevation_deg"]) for view in views]
    captions += [""] * blank
    grid, under = [], []
    for begin in range(0, rows * columns, columns):
        for what, tiles in kinds.items():
            paper = np.full((blank, *tiles.shape[1:]), 252, np.uint8)
            grid.append(np.concatenate([tiles, paper])[begin : begin + columns])
            under.append(captions[begin : begin + columns] if what == list(kinds)[-1] else [""] * columns)
    titles = list(kinds) * rows if len(kinds) > 1 else []
    return contact_sheet(np.stack(grid), titles, captions=under, title=title)


def caption(azimuth_deg: float, elevation_deg: float) -> str:
    """Name a camera in whole degrees; from behind is 180°, as people say it."""
    azimuth = 180 if azimuth_deg < -179.5 else azimuth_deg
    return f"{words.degrees(azimuth, 0)} / {words.degrees(elevation_deg, 0)}"


def _tiles(pictures: Pictures, outputs: Sequence[str]) -> dict[str, NDArray[np.uint8]]:
    """What a sheet shows of every view, by name: (M, 3, S, S) each, S so small that the sheet can be opened."""
    makers: dict[str, Callable[[int], NDArray[np.uint8]]] = {"view": lambda m: pictures.rgb[m]}
    mask, depth, normals = pictures.silhouette, pictures.depth, pictures.normals
    if "silhouette" in outputs and mask is not None:
        makers["silhouette"] = lambda m: geometry.silhouette_tile(mask[m])
    if "depth" in outputs and depth is not None:
        near, far = geometry.depth_range(depth)
        makers["depth"] = lambda m: geometry.depth_tile(depth[m], near, far)
    if "normals" in outputs and normals is not None:
        makers["normals"] = lambda m: geometry.normals_tile(normals[m])
    count = len(pictures.rgb)
    size = max(SMALLEST_TILE, math.isqrt(SHEET_PIXELS // (count * len(makers))))
    return {name: np.stack([reduced(make(m), size) for m in range(count)]) for name, make in makers.items()}
