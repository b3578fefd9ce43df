"""Cameras as files: `cameras.json` with everything, and `transforms.json` as programs for radiance fields read it.

Both hold float64 matrices made from the very float32 angles that the picture was drawn with, so that reading a
`transforms.json` back gives those angles again, and the same picture bit for bit. `docs/cameras.md` states the
conventions.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from mvtn_cli.core.views import Cameras, camera_rotations, wrap_degrees
from mvtn_cli.errors import DataError

Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # what radiance field programs take as upright
PICTURE = ("look", "shading", "supersample", "render", "point_radius", "depth_cue")  # what a matrix does not hold
ASTRAY = 1e-3  # radians, or shares of the distance, that a foreign file's rounding may move a camera


class CameraFile(NamedTuple):
    """What a `transforms.json` says.

    Attributes:
        cameras: (1, M), as drawn.
        image_size: In pixels, or None.
        picture: Settings of the picture beside those, as far as the file has them.
        light: (1, M, 3) unit vectors towards the light of each view, mvtn's world; None is a headlight.
    """

    cameras: Cameras
    image_size: int | None
    picture: dict[str, Any]
    light: torch.Tensor | None = None


def as_drawn(cameras: Cameras) -> Cameras:
    """Name the same cameras by float32 angles in [-180, 180), which is what their matrices can be read back to.

    Angles inside that range come back as they are, to the last bit.
    """
    azimuth, elevation = (_wrapped(angle) for angle in (cameras.azimuth_deg, cameras.elevation_deg))
    distance = cameras.distance.detach().cpu().float()
    return Cameras(azimuth, elevation, distance, cameras.fov_deg)


def _wrapped(angle_deg: torch.Tensor) -> torch.Tensor:
    angle = angle_deg.detach().cpu().float().numpy()
    inside = (angle >= -180) & (angle < 180)
    wrapped = np.where(inside, angle, wrap_degrees(angle)).astype(np.float32)
    return torch.from_numpy(np.where(wrapped == 180, np.float32(-180), wrapped) + np.float32(0))  # no -0


def world_to_camera(cameras: Cameras) -> NDArray[np.float64]:
    """[R | t] of one shape's cameras, (M, 3, 4) float64; `Cameras.rt` has the same in float32."""
    rotation = camera_rotations(cameras.azimuth_deg[0], cameras.elevation_deg[0]).numpy()
    shift = np.zeros((len(rotation), 3, 1))
    shift[:, 2, 0] = -cameras.distance[0].double().numpy()
    return np.concatenate([rotation, shift], axis=-1)


def intrinsics(cameras: Cameras, image_size: int) -> dict[str, float]:
    """Size, field of view, focal length and principal point in pixels; a pixel's centre lies at + 0.5."""
    focal = image_size / 2 / math.tan(math.radians(cameras.fov_deg) / 2)
    return {
        "width": image_size,
        "height": image_size,
        "fov_deg": cameras.fov_deg,
        "focal": focal,
        "cx": image_size / 2,
        "cy": image_size / 2,
    }


def cameras_document(
    cameras: Cameras, image_size: int, views: list[dict[str, Any]], about: Mapping[str, Any]
) -> dict[str, Any]:
    """Describe one shape's cameras.

    Args:
        cameras: (1, M), as drawn.
        image_size: In pixels.
        views: Of each view what else there is to say: its pictures, and `light` where it is no headlight.
        about: Of the shape: name, file, `center` and `radius` in file units, depth steps.
    """
    numbers = torch.stack([cameras.azimuth_deg[0], cameras.elevation_deg[0], cameras.distance[0]], dim=-1).tolist()
    return {
        "schema": "mvtn.shape-cameras/1",
        "world": "right-handed, y up, units are shape radii: in the file's units (turned to y up) x * radius + center",
        "camera": "x right, y up, looking along -z: x_camera = R x_world + t, world_to_camera = [R | t]",
        **about,
        "intrinsics": intrinsics(cameras, image_size),
        "views": [
            {
                **view,
                "azimuth_deg": azimuth,
                "elevation_deg": elevation,
                "distance": distance,
                "position": (-matrix[:, :3].T @ matrix[:, 3]).tolist(),
                "world_to_camera": matrix.tolist(),
            }
            for view, (azimuth, elevation, distance), matrix in zip(
                views, numbers, world_to_camera(cameras), strict=True
            )
        ],
    }


def transforms_document(
    cameras: Cameras, image_size: int, views: list[dict[str, Any]], about: Mapping[str, Any]
) -> dict[str, Any]:
    """Describe one shape's cameras the way that NeRF, instant-ngp and nerfstudio do; arguments as above.

    Camera-to-world matrices, z up; `applied_transform` is what turned mvtn's world, y up, into that.
    """
    inside = intrinsics(cameras, image_size)
    angle = math.radians(cameras.fov_deg)
    lit = {"light": [view["light"] for view in views]} if all("light" in view for view in views) else {}
    return {
        "camera_model": "OPENCV",
        "camera_angle_x": angle,
        "camera_angle_y": angle,
        "fl_x": inside["focal"],
        "fl_y": inside["focal"],
        "cx": inside["cx"],
        "cy": inside["cy"],
        "w": image_size,
        "h": image_size,
        "applied_transform": np.hstack([Z_UP, np.zeros((3, 1))]).tolist(),
        "mvtn": {"schema": "mvtn.transforms/1", "fov_deg": cameras.fov_deg, **lit, **about},
        "frames": [
            {
                "file_path": view["picture"],
                **({"depth_file_path": view["depth"]} if "depth" in view else {}),
                "transform_matrix": camera_to_world(matrix).tolist(),
            }
            for view, matrix in zip(views, world_to_camera(cameras), strict=True)
        ],
    }


def camera_to_world(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert a world-to-camera matrix (3, 4) and turn its world to z up: (4, 4)."""
    inverse = np.eye(4)
    inverse[:3, :3] = Z_UP @ matrix[:, :3].T
    inverse[:3, 3] = Z_UP @ (-matrix[:, :3].T @ matrix[:, 3])
    return inverse


def read_transforms(path: Path) -> CameraFile:
    """Read cameras from a `transforms.json`, mvtn's own or another that fits.

    Those of others are taken to be z up where no `applied_transform` says what they are, and their units to be
    shape radii.

    Raises:
        DataError: The file can't be read, is something else, or has a camera that mvtn does not know: one that
            does not look at the origin, or is rolled.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise _refused(path, f"can't be read: {error.strerror or error}") from None
    except ValueError as error:
        raise _refused(path, f"is not JSON: {error}") from None
    frames = document.get("frames") if isinstance(document, dict) else None
    if frames is None and isinstance(document, dict) and str(document.get("schema", "")).startswith("mvtn."):
        raise DataError(
            f"{path} is another file of mvtn than a transforms.json",
            hint="mvtn render-views FILE --cameras writes transforms.json into the folder of each shape",
            code="cameras.file",
        )
    if not isinstance(frames, list) or not frames:
        raise _refused(path, "names no cameras: there is no list of frames in it")
    turn = _turn(path, document)
    found = [_angles(path, number, frame, turn) for number, frame in enumerate(frames, 1)]
    azimuth, elevation, distance = torch.tensor(found, dtype=torch.float64).float().T[:, None]
    width, height = document.get("w"), document.get("h")
    if width != height:
        raise _refused(path, f"has pictures of {width} x {height} pixels, mvtn's are square")
    own = document.get("mvtn") if isinstance(document.get("mvtn"), dict) else {}
    return CameraFile(
        as_drawn(Cameras(azimuth, elevation, distance, _fov_deg(path, document, own))),
        int(width) if isinstance(width, int | float) and width >= 1 else None,
        {name: own[name] for name in PICTURE if name in own},
        _light(path, own["light"], len(frames)) if "light" in own else None,
    )


def _light(path: Path, rows: Any, num_views: int) -> torch.Tensor:
    """The light of each view, (1, M, 3), as it is written: what was drawn with it is drawn again."""
    light = _numbers(rows)
    if light is None or light.shape != (num_views, 3) or np.abs(np.linalg.norm(light, axis=1) - 1).max() > ASTRAY:
        raise _refused(path, f"has a light that is not {num_views} directions, a unit vector for each frame")
    return torch.from_numpy(light).float()[None]


def _turn(path: Path, document: Mapping[str, Any]) -> NDArray[np.float64]:
    """The rotation from mvtn's world to the file's."""
    turn = _matrix(document["applied_transform"]) if "applied_transform" in document else Z_UP
    if turn is None or not _is_rotation(turn[:3, :3]):
        raise _refused(path, "has an applied_transform that is no rotation")
    return turn[:3, :3]


def _angles(path: Path, number: int, frame: Any, turn: NDArray[np.float64]) -> tuple[float, float, float]:
    """Azimuth and elevation in degrees and distance of one frame."""
    matrix = _matrix(frame.get("transform_matrix")) if isinstance(frame, dict) else None
    if matrix is None or not _is_rotation(matrix[:3, :3]):
        raise _refused(path, f"has no rotation and position in the transform_matrix of frame {number}")
    axes, centre = turn.T @ matrix[:3, :3], turn.T @ matrix[:3, 3]  # columns: right, up, backward
    distance = float(np.linalg.norm(centre))
    if distance == 0 or np.abs(centre / distance - axes[:, 2]).max() > ASTRAY:
        raise _refused(path, f"has a camera in frame {number} that does not look at the origin, as all of mvtn's do")
    if abs(axes[1, 0]) > ASTRAY:
        raise _refused(path, f"has a camera in frame {number} that is rolled, mvtn's are upright")
    azimuth, elevation = math.atan2(-axes[2, 0], axes[0, 0]), math.atan2(axes[1, 2], axes[1, 1])
    return math.degrees(azimuth), math.degrees(elevation), distance


def _fov_deg(path: Path, document: Mapping[str, Any], own: Mapping[str, Any]) -> float:
    """The field of view; mvtn's own number is taken where it means the same, since radians round."""
    angle, focal, width = (document.get(name) for name in ("camera_angle_x", "fl_x", "w"))
    if isinstance(angle, int | float):
        fov = math.degrees(angle)
    elif isinstance(focal, int | float) and isinstance(width, int | float) and focal > 0:
        fov = math.degrees(2 * math.atan(width / 2 / focal))
    else:
        raise _refused(path, "has neither camera_angle_x nor fl_x and w, so its field of view is not known")
    exact = own.get("fov_deg")
    fov = exact if isinstance(exact, int | float) and math.isclose(exact, fov, rel_tol=1e-9) else fov
    if not 0 < fov < 180:
        raise _refused(path, f"has a field of view of {fov:g}°")
    return float(fov)


def _matrix(rows: Any) -> NDArray[np.float64] | None:
    """A matrix of three or four rows of four finite numbers; None if it is not one."""
    matrix = _numbers(rows)
    return matrix if matrix is not None and matrix.shape in ((3, 4), (4, 4)) else None


def _numbers(rows: Any) -> NDArray[np.float64] | None:
    try:
        numbers = np.asarray(rows, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    return numbers if np.isfinite(numbers).all() else None


def _is_rotation(matrix: NDArray[np.float64]) -> bool:
    return bool(np.abs(matrix @ matrix.T - np.eye(3)).max() < ASTRAY and np.linalg.det(matrix) > 0)


def _refused(path: Path, what: str) -> DataError:
    return DataError(
        f"{path} {what}",
        hint="mvtn render-views FILE --cameras writes one that can be read",
        code="cameras.file",
    )
