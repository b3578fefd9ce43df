"""The picture of the cameras: where each stands, and that the shape hides what is behind it."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import torch
from PIL import Image
from test_view_sheets import cloud, tetrahedron

from mvtn_cli.core.render import Look, pack
from mvtn_cli.core.reporting import camera_picture as page
from mvtn_cli.core.reporting.images import PAPER
from mvtn_cli.core.views import Cameras, camera_positions
from mvtn_cli.shared_config import PictureConfig


def picture(cameras: Cameras, kind: str = "mesh") -> np.ndarray:
    look = Look.evaluation(PictureConfig(), 1, kind)
    shape = tetrahedron() if kind == "mesh" else cloud()
    content = page.camera_picture(pack([shape]), kind, cameras, look, "a name")
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGB")).astype(int)


def colored(image: np.ndarray, color: tuple[int, int, int]) -> np.ndarray:
    """Pixels of a colour (row, column); lines are smooth, so that only their middle has it."""
    return np.argwhere(np.abs(image - color).max(axis=-1) < 40)


def test_a_camera_is_drawn_where_it_stands():
    """0° stands to the left in front of the onlooker at 28°, 90° to the right, 180° behind; 90° elevation above."""
    cameras = Cameras.at([0.0, 90.0, -152.0, 0.0], [0.0, 0.0, 0.0, 90.0])
    image = picture(cameras)
    front, right, back, above = (colored(image, color).mean(axis=0) for color in page._colors(4))
    middle = page.SIZE / 2
    assert front[1] < middle < right[1] and front[0] > back[0]
    assert abs(above[1] - middle) < 25 and above[0] < middle / 2


def test_what_is_behind_the_shape_is_hidden():
    behind = page.FROM_AZIMUTH + 180
    cameras = Cameras.at([behind, behind + 45], [-page.FROM_ELEVATION] * 2, 1.5)
    hidden, beside = (len(colored(picture(cameras), color)) for color in page._colors(2))
    assert hidden < beside / 3


def test_the_picture_is_not_cut_off_and_keeps_to_its_paper():
    for cameras in (
        Cameras.at([0.0, 120.0, 240.0], [90.0, -90.0, 0.0]),
        Cameras.at([28.0, 208.0], [0.0, 24.0], torch.tensor([[1.01, 60.0]]), fov_deg=150),
    ):
        for kind in ("mesh", "points"):
            image = picture(cameras, kind)
            edge = np.concatenate([image[:8].reshape(-1, 3), image[-8:].reshape(-1, 3), image[:, -8:].reshape(-1, 3)])
            assert image.shape == (page.SIZE, page.SIZE, 3) and (edge == PAPER).all()
            assert (image[300:420, 300:420] != PAPER).any()  # the shape is in the middle


def test_every_view_has_a_colour_of_its_own():
    colors = np.array(page._colors(12))
    apart = np.abs(colors[:, None] - colors[None]).max(axis=-1) + 255 * np.eye(12)
    assert apart.min() > 20 and colors.mean(axis=1).max() < 140  # dark on paper


def test_many_cameras_leave_room_for_each_other_and_the_shape():
    """Of three rings at three heights; a hundred have less ink each than thirty, which have stalks."""
    ink = []
    for count in (30, 99):
        azimuth = np.linspace(0, 360 * 3, count, endpoint=False)
        image = picture(Cameras.at(azimuth, np.repeat([-30.0, 20.0, 70.0], count // 3)))
        ink.append((np.ptp(image, axis=-1) > 60).sum() / count)
    assert ink[1] < ink[0] / 2


def test_far_points_are_paler_than_near_ones():
    def darkest(elevation: float) -> int:
        """Of a cloud of one point, at this height above the onlooker's azimuth."""
        direction = camera_positions(torch.tensor(page.FROM_AZIMUTH), torch.tensor(elevation), 1.0).numpy()
        shape = replace(cloud(), points=np.float32([direction]))
        look = Look.evaluation(PictureConfig(point_radius=0.2), 1, "points")
        cameras = Cameras.at([page.FROM_AZIMUTH + 90], [0.0])
        content = page.camera_picture(pack([shape]), "points", cameras, look, "")
        image = np.asarray(Image.open(io.BytesIO(content)).convert("L"))[200:520, 300:420]
        return int(image.min())

    near, far = darkest(page.FROM_ELEVATION), darkest(page.FROM_ELEVATION + 180)
    assert near + 60 < far < PAPER[0] - 30
