"""A picture of where the cameras stand: the shape in the middle, a numbered pyramid for each camera around it."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from mvtn_cli.console import counted
from mvtn_cli.core.render import Look, ShapeBatch
from mvtn_cli.core.reporting import words
from mvtn_cli.core.reporting.camera_files import world_to_camera
from mvtn_cli.core.reporting.drawing import draw_with
from mvtn_cli.core.reporting.images import INK, MUTED, PAPER, encode, font, shorten
from mvtn_cli.core.views import Cameras

Array = NDArray[np.float64]
Color = tuple[int, int, int]

SIZE, FINER = 720, 2  # pixels, and how much finer lines are drawn
FROM_AZIMUTH, FROM_ELEVATION, FOV = 28.0, 24.0, 30.0  # whence the whole is seen, degrees
FARTHEST = 4.0  # shape radii; cameras farther away are drawn here, so that the shape stays visible
PYRAMID = 0.6, 0.2  # longest length and half width of a camera's pyramid, shape radii
SHAPE_COLOR = {"mesh": (0.80, 0.84, 0.90), "points": (0.25, 0.34, 0.46)}
LIGHT = (0.6, 1.0, 0.9)  # towards it; above the onlooker
HAZE = 0.6  # share of paper in the farthest point: on a light ground far things are paler
FAINT: Color = (176, 180, 182)
CROWD = 30  # cameras; more of them are drawn smaller, and without stalks
STEPS = 48  # pieces of a line, each of which is seen or hidden


def camera_picture(batch: ShapeBatch, kind: str, cameras: Cameras, look: Look, title: str) -> bytes:
    """Draw the cameras around a shape, as PNG.

    A ring at the height of the shape's centre shows the azimuths, a stalk under each camera its elevation. The pyramid
    is the part of space that the camera sees, and the small roof on it is where its picture's top is.

    Args:
        batch: One shape.
        kind: `mesh` or `points`.
        cameras: (1, M).
        look: How the shape is drawn, but for colours and size.
        title: Written over it.
    """
    distance = cameras.distance[0].double().numpy()
    radius = float(np.minimum(distance, FARTHEST).max())
    scene = _overview(batch, kind, look, radius)
    _draw_ring(scene, radius)
    matrices = world_to_camera(cameras)
    matrices[:, 2, 3] = -np.minimum(distance, FARTHEST)
    colors, share = _colors(len(matrices)), min(1.0, math.sqrt(CROWD / len(matrices)))
    far_to_near = np.argsort(-scene.project(_centres(matrices))[:, 2])
    for view in far_to_near:
        _draw_camera(scene, matrices[view], cameras.fov_deg, colors[view], share)
        if share == 1:
            _draw_stalk(scene, matrices[view], colors[view])
    picture = scene.finished()
    _write_azimuths(picture, scene, radius)
    for view in far_to_near:
        _write_number(picture, scene, matrices[view], view + 1, colors[view])
    _write_words(picture, title, distance)
    return encode(picture)


@dataclass(frozen=True)
class _Scene:
    """A drawing of the shape that knows how far away it is, so that lines can pass behind it.

    Attributes:
        canvas: SIZE × SIZE, `FINER` times finer.
        depth: (SIZE, SIZE) of the shape, infinite beside it.
        matrix: (3, 4) world to camera of the onlooker.
        focal: In pixels of SIZE.
    """

    canvas: Image.Image
    depth: NDArray[np.float32]
    matrix: Array
    focal: float

    def project(self, points: Array) -> Array:
        """Column, row and depth of world points (..., 3)."""
        x, y, z = np.moveaxis(points @ self.matrix[:, :3].T + self.matrix[:, 3], -1, 0)
        return np.stack([SIZE / 2 + self.focal * x / -z, SIZE / 2 - self.focal * y / -z, -z], axis=-1)

    def line(self, corners: Sequence[Array], color: Color, width: float) -> None:
        """Draw a line through world points, as far as the shape does not hide it."""
        draw = ImageDraw.Draw(self.canvas)
        for start, end in pairwise(corners):
            share = np.linspace(0, 1, STEPS + 1)[:, None]
            seen = self.project(start + share * (end - start))
            pixel = np.clip(seen[:, :2].astype(int), 0, SIZE - 1)
            visible = seen[:, 2] < self.depth[pixel[:, 1], pixel[:, 0]]
            for i in np.flatnonzero(visible[:-1] & visible[1:]):
                ends = [tuple(seen[j, :2] * FINER) for j in (i, i + 1)]
                draw.line(ends, fill=color, width=max(1, round(width * FINER)))

    def finished(self) -> Image.Image:
        """The drawing in its final size."""
        return self.canvas.resize((SIZE, SIZE), Image.Resampling.LANCZOS)


def _overview(batch: ShapeBatch, kind: str, look: Look, reach: float) -> _Scene:
    """Draw the shape as it is seen from far enough to have everything within `reach` in the picture."""
    distance = 1.1 * (reach + PYRAMID[1]) / math.sin(math.radians(FOV / 2))
    onlooker = Cameras.at([FROM_AZIMUTH], [FROM_ELEVATION], distance, fov_deg=FOV)
    own = replace(
        look,
        image_size=SIZE,
        background=(PAPER[0] / 255, PAPER[1] / 255, PAPER[2] / 255),
        colors=np.array([SHAPE_COLOR[kind]], np.float32),
        light_direction=np.array([LIGHT], np.float32) / np.float32(math.hypot(*LIGHT)),
        ambient=0.35,
        diffuse=0.65,
        specular=0.0,
        falloff=1.0,
        supersample=2,
        depth_cue=0.0,
    )
    seen = draw_with(own, batch, onlooker, geometry=True)
    assert seen.depth is not None
    picture = np.moveaxis(seen.rgb[0], 0, -1)
    depth = np.where(seen.depth[0] > 0, seen.depth[0], np.inf).astype(np.float32)
    if kind == "points":
        haze = HAZE * np.clip((depth - distance + 1) / 2, 0, 1)[..., None]
        picture = np.rint((1 - haze) * picture + haze * np.array(PAPER)).astype(np.uint8)
    shape = Image.fromarray(picture.copy())
    focal = SIZE / 2 / math.tan(math.radians(FOV / 2))
    large = shape.resize((SIZE * FINER, SIZE * FINER), Image.Resampling.BICUBIC)
    return _Scene(large, depth, world_to_camera(onlooker)[0], focal)


def _draw_ring(scene: _Scene, radius: float) -> None:
    """The circle at elevation 0, with a mark every 30°."""
    angles = np.radians(np.arange(0, 361, 3))
    scene.line(list(radius * _level(angles)), FAINT, 1.0)
    for outwards in _level(np.radians(np.arange(0, 360, 30))):
        scene.line([radius * outwards, (radius + 0.07) * outwards], FAINT, 1.0)


def _level(azimuth: Array) -> Array:
    """Unit vectors at elevation 0, (..., 3), for azimuths in radians."""
    return np.stack([np.sin(azimuth), np.zeros_like(azimuth), np.cos(azimuth)], axis=-1)


def _write_azimuths(picture: Image.Image, scene: _Scene, radius: float) -> None:
    draw = ImageDraw.Draw(picture)
    for azimuth in (-90, 0, 90, 180):
        column, row, _ = scene.project((radius + 0.2) * _level(np.radians(np.array(float(azimuth)))))
        draw.text((column, row), words.degrees(azimuth, 0), MUTED, font=font(11), anchor="mm")


def _draw_stalk(scene: _Scene, matrix: Array, color: Color) -> None:
    """A line from the camera to the ring's plane."""
    centre, backward = _centres(matrix), matrix[2, :3]
    foot = centre * [1, 0, 1]
    pale: Color = tuple(round(0.55 * c + 0.45 * p) for c, p in zip(color, PAPER, strict=True))  # type: ignore[assignment]
    scene.line([foot, centre], pale, 1.0)
    scene.line([foot - 0.02 * backward, foot + 0.02 * backward], color, 4.0)


def _draw_camera(scene: _Scene, matrix: Array, fov_deg: float, color: Color, share: float) -> None:
    """A pyramid from the camera's centre to its picture, `share` of its whole size, and a mark where up is."""
    centre = _centres(matrix)
    right, up, backward = matrix[:, :3]
    slope = math.tan(math.radians(fov_deg) / 2)
    length = share * min(PYRAMID[0], PYRAMID[1] / slope)
    half = length * slope
    middle = centre - length * backward
    corners = [middle + half * (x * right + y * up) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    for corner in corners:
        scene.line([centre, corner], color, 1.5)
    scene.line([*corners, corners[0]], color, 2.0)
    top = middle + half * up
    scene.line([top - 0.3 * half * right, top + 0.4 * half * up, top + 0.3 * half * right], color, 1.5)


def _centres(matrices: Array) -> Array:
    """World positions of cameras with matrices (..., 3, 4)."""
    return -np.einsum("...ij,...i->...j", matrices[..., :3], matrices[..., 3])


def _write_number(picture: Image.Image, scene: _Scene, matrix: Array, number: int, color: Color) -> None:
    """Write a view's number behind its camera, seen from the shape."""
    centre = _centres(matrix)
    column, row, depth = scene.project(centre * (1 + 0.16 / np.linalg.norm(centre)))
    x, y = int(np.clip(column, 0, SIZE - 1)), int(np.clip(row, 0, SIZE - 1))
    if depth < scene.depth[y, x]:
        draw = ImageDraw.Draw(picture)
        draw.text((x, y), str(number), color, font=font(13), anchor="mm", stroke_width=2, stroke_fill=PAPER)


def _write_words(picture: Image.Image, title: str, distance: Array) -> None:
    draw = ImageDraw.Draw(picture)
    draw.text((16, 14), shorten(title, SIZE - 32, 15), INK, font=font(15), anchor="lt")
    near, far = f"{distance.min():.3g}", f"{distance.max():.3g}"
    stand = f"{counted(len(distance), 'camera')}, {near if near == far else f'{near} to {far}'} radii away"
    if distance.max() > FARTHEST:
        stand += f", drawn at {FARTHEST:g}"
    draw.text((16, SIZE - 16), stand, MUTED, font=font(12), anchor="lb")


def _colors(count: int) -> list[Color]:
    """Distinct colours that are dark enough on paper."""
    steps = [colorsys.hls_to_rgb(view / count, 0.38, 0.70) for view in range(count)]
    return [(round(255 * r), round(255 * g), round(255 * b)) for r, g, b in steps]
