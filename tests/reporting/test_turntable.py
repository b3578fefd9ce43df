"""A turn as an animated GIF."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image
from test_view_sheets import tetrahedron

from mvtn_cli.core.render import pack
from mvtn_cli.core.reporting.drawing import draw_pictures
from mvtn_cli.core.reporting.turntable import FRAMES, animation, turntable
from mvtn_cli.core.views import Cameras
from mvtn_cli.shared_config import PictureConfig


def frames_of(content: bytes) -> tuple[Image.Image, list[np.ndarray]]:
    image = Image.open(io.BytesIO(content))
    frames = []
    for number in range(getattr(image, "n_frames", 1)):
        image.seek(number)
        frames.append(np.asarray(image.convert("RGB")))
    return image, frames


def test_a_turn_has_all_sides_in_order_without_loss_of_grey():
    settings = PictureConfig(image_size=24, distance=2.5)
    batch = pack([tetrahedron()])
    image, frames = frames_of(turntable(batch, "mesh", settings, 10.0))
    assert image.format == "GIF" and image.info["loop"] == 0 and len(frames) == FRAMES
    quarter = draw_pictures(batch, "mesh", Cameras.at([0.0, 90.0], [10.0, 10.0], 2.5), settings).rgb
    assert np.array_equal(np.moveaxis(frames[0], -1, 0), quarter[0])
    assert np.array_equal(np.moveaxis(frames[FRAMES // 4], -1, 0), quarter[1])


def test_colours_stay_close_in_every_frame():
    row = np.linspace(0, 255, 16).astype(np.uint8)
    still = np.stack([np.tile(row, (16, 1)), np.tile(row[:, None], (1, 16)), np.full((16, 16), 90, np.uint8)])
    moving = np.stack([np.roll(still, shift, axis=-1) for shift in range(5)])
    _, frames = frames_of(animation(moving))
    apart = [np.abs(np.moveaxis(moving[i], 0, -1).astype(int) - frame).mean() for i, frame in enumerate(frames)]
    assert len(frames) == 5 and max(apart) < 8


def test_a_shape_that_looks_alike_from_all_sides_is_a_picture_that_stands_still():
    _, frames = frames_of(animation(np.full((6, 3, 8, 8), 77, np.uint8)))
    assert all((frame == 77).all() for frame in frames)
