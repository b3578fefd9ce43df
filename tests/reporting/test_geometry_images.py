"""Silhouette, depth and normals: what the files hold is what geometry says."""

from __future__ import annotations

import io

import numpy as np
import pytest
import torch
from PIL import Image
from test_view_sheets import cloud, tetrahedron

from mvtn_cli.core.render import pack
from mvtn_cli.core.reporting import drawing
from mvtn_cli.core.reporting.drawing import draw_pictures
from mvtn_cli.core.reporting.geometry_images import (
    depth_png,
    depth_range,
    depth_steps,
    depth_tile,
    normals_png,
    silhouette_png,
    silhouette_tile,
)
from mvtn_cli.core.store import StoredShape
from mvtn_cli.core.views import Cameras, camera_positions
from mvtn_cli.shared_config import PictureConfig


def opened(content: bytes) -> Image.Image:
    image = Image.open(io.BytesIO(content))
    image.load()
    return image


def test_a_silhouette_is_black_and_white():
    mask = np.array([[True, False], [False, True]])
    image = opened(silhouette_png(mask))
    assert image.mode == "L" and np.asarray(image).tolist() == [[255, 0], [0, 255]]
    assert silhouette_tile(mask).shape == (3, 2, 2)


def test_depth_is_written_in_16_bits_to_half_a_step():
    depth = np.random.default_rng(0).uniform(1.2, 3.2, (20, 30)).astype(np.float32)
    depth[0] = 0
    image = opened(depth_png(depth, 10_000))
    values = np.asarray(image)
    assert image.mode == "I;16" and "10000 steps to a shape radius" in image.info["depth"]
    assert np.abs(values / 10_000 - depth).max() <= 0.5 / 10_000 + 1e-7 and (values[0] == 0).all()
    assert np.asarray(opened(depth_png(np.float32([[1e-9, 99]]), 1000))).tolist() == [[1, 65_535]]


@pytest.mark.parametrize(("distance", "steps"), [(1.1, 10_000), (5.5, 10_000), (5.6, 1000), (64, 1000), (100, 100)])
def test_depth_steps_hold_the_far_side(distance: float, steps: int):
    assert depth_steps(distance) == steps and (distance + 1) * steps <= 65_535


def test_normals_are_colours_and_the_background_is_black():
    normals = np.zeros((3, 2, 2), np.float32)
    normals[:, 0, 0], normals[:, 0, 1], normals[:, 1, 0] = (1, 0, 0), (0, -1, 0), np.array([0.6, 0, -0.8])
    pixels = np.asarray(opened(normals_png(normals)))
    assert pixels[0, 0].tolist() == [255, 128, 128] and pixels[0, 1].tolist() == [128, 0, 128]
    assert pixels[1, 1].tolist() == [0, 0, 0]
    assert np.abs(pixels[1, 0] / 127.5 - 1 - [0.6, 0, -0.8]).max() < 0.5 / 127.5 + 1e-6


def test_depth_to_look_at_is_bright_where_it_is_near():
    depth = np.array([[0, 2.0], [2.5, 3.0]], np.float32)
    near, far = depth_range(depth)
    assert (near, far) == (2, 3) and depth_tile(depth, near, far)[0].tolist() == [[0, 255], [158, 60]]
    empty = np.zeros((2, 2), np.float32)
    assert not depth_tile(empty, *depth_range(empty)).any()


def seen(shape: StoredShape, kind: str, azimuth: list[float], elevation: list[float], **settings) -> drawing.Pictures:
    look = PictureConfig(**{"image_size": 48, **settings})
    cameras = Cameras.at(azimuth, elevation, look.distance, fov_deg=look.fov)
    return draw_pictures(pack([shape]), kind, cameras, look, geometry=True)


def test_mesh_depth_and_normals_are_those_of_the_planes_that_are_seen():
    """A ray through each pixel, met with the plane of the face that is seen there, in float64."""
    shape, azimuth, elevation = tetrahedron(), [20.0, 200.0], [15.0, -40.0]
    pictures = seen(shape, "mesh", azimuth, elevation, shading="flat")
    assert pictures.depth is not None and pictures.normals is not None and pictures.face_ids is not None
    cameras = Cameras.at(azimuth, elevation)
    focal = 24 / np.tan(np.radians(30))
    for view in range(2):
        rows, columns = np.nonzero(pictures.face_ids[view] >= 0)
        assert len(rows) > 300
        axes = cameras.rt[0, view, :, :3].double().numpy()
        ray = np.stack([(columns + 0.5 - 24) / focal, -(rows + 0.5 - 24) / focal, -np.ones(len(rows))], -1) @ axes
        eye = camera_positions(cameras.azimuth_deg, cameras.elevation_deg, cameras.distance)[0, view].numpy()
        a, b, c = shape.vertices.astype(float)[shape.faces[pictures.face_ids[view][rows, columns]]].swapaxes(0, 1)
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        depth = ((a - eye) * normal).sum(1) / (ray * normal).sum(1)
        normal *= -np.sign((ray * normal).sum(1, keepdims=True))
        assert np.abs(pictures.depth[view][rows, columns] - depth).max() < 1e-4
        assert np.abs(pictures.normals[view][:, rows, columns].T - normal).max() < 1e-5
        assert not pictures.depth[view][pictures.face_ids[view] < 0].any()


def points(*xyz: tuple[float, float, float]) -> StoredShape:
    shape = cloud()
    return StoredShape(**{**vars(shape), "points": np.array(xyz, np.float32)})


@pytest.mark.parametrize("depth_cue", [0.0, 0.8, 1.0])
def test_depth_of_points_is_that_of_the_point_in_front(depth_cue: float):
    """Two opaque discs one behind the other, and one aside; the far one farthest from the origin."""
    shape = points((0, 0, 0.5), (0, 0, -1.0), (0.5, 0.25, -0.25))
    pictures = seen(shape, "points", [0.0, 180.0, 90.0], [0.0, 0.0, 0.0], point_radius=0.2, depth_cue=depth_cue)
    assert pictures.depth is not None and pictures.silhouette is not None
    assert pictures.normals is None and pictures.face_ids is None
    centre = pictures.depth[:, 23:25, 23:25]
    assert np.abs(centre[0] - 1.7).max() < 0.02 and np.abs(centre[1] - 1.2).max() < 0.02
    # From +x all three stand side by side: the depth of the first two is that of the origin, of the third 0.5 less.
    values = pictures.depth[2][pictures.silhouette[2]]
    assert np.isclose(values, 2.2, atol=0.001).sum() > 20 and np.isclose(values, 1.7, atol=0.001).sum() > 10
    assert np.isclose(values, 2.2, atol=0.001).sum() + np.isclose(values, 1.7, atol=0.001).sum() == len(values)
    assert np.array_equal(pictures.silhouette, pictures.depth > 0)
    assert (pictures.rgb[~np.repeat(pictures.silhouette[:, None], 3, 1)] <= 128).all()  # at most half covered


def test_many_views_come_in_groups_and_give_the_same(monkeypatch):
    angles = np.linspace(0, 300, 5).tolist()
    for shape, kind in ((tetrahedron(), "mesh"), (cloud(), "points")):
        whole = seen(shape, kind, angles, angles, point_radius=0.3)
        monkeypatch.setattr(drawing, "PIXELS_AT_ONCE", 2 * 48 * 48)
        parts = seen(shape, kind, angles, angles, point_radius=0.3)
        for name, array in vars(whole).items():
            assert np.array_equal(array, getattr(parts, name)), name
        monkeypatch.undo()


def test_a_learned_light_falls_on_each_view_of_its_own():
    light = torch.tensor([[[0.0, 0, 1], [0.0, 0, -1], [0.0, 0, 0]]])
    cameras = Cameras.at([0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    settings = PictureConfig(image_size=32)
    batch = pack([tetrahedron()])
    lit = draw_pictures(batch, "mesh", cameras, settings, light=light).rgb
    plain = draw_pictures(batch, "mesh", cameras, settings).rgb
    assert np.array_equal(lit[0], plain[0]) and np.array_equal(lit[2], plain[2])  # from the camera; a headlight
    assert not np.array_equal(lit[1], plain[1]) or plain[1].max() == 0
