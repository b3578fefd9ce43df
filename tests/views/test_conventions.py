"""docs/cameras.md: the code on that page is run, and held against independent constructions."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import torch

from mvtn_cli.core.views import Cameras

PAGE = Path(__file__).resolve().parents[2] / "docs" / "cameras.md"
FOV, WIDTH, HEIGHT = 60.0, 96, 64


@pytest.fixture(scope="module")
def page() -> dict:
    """What the page's Python blocks define."""
    names: dict = {"np": np}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL):
        exec(block, names)
    return names


@pytest.fixture(params=[(0.0, 0.0), (30.0, 20.0), (-140.0, -65.0), (200.0, 80.0)])
def camera(request) -> tuple[float, float, np.ndarray, np.ndarray]:
    azimuth, elevation = request.param
    rt = Cameras.at([azimuth], [elevation], 2.2, fov_deg=FOV).rt[0, 0].double().numpy()
    return azimuth, elevation, rt[:, :3], rt[:, 3]


def some_points() -> np.ndarray:
    return np.random.default_rng(0).uniform(-0.6, 0.6, (20, 3))


def test_what_is_up_and_right_in_the_world_is_up_and_right_in_the_picture(page):
    rt = Cameras.at([0.0], [0.0]).rt[0, 0].double().numpy()
    column, row, depth = page["project"](np.array([0.5, 0.25, 0.0]), rt[:, :3], rt[:, 3], FOV, WIDTH, HEIGHT)
    assert column > WIDTH / 2 and row < HEIGHT / 2 and depth == pytest.approx(2.2)


def test_unit_sphere_fits_into_the_default_picture(page):
    rt = Cameras.at([0.0], [0.0]).rt[0, 0].double().numpy()
    limb = np.arcsin(1 / 2.2)  # half angle under which the sphere is seen; the tangent point lies on it
    touch = np.array([0.0, np.cos(limb), np.sin(limb)])
    _, row, _ = page["project"](touch, rt[:, :3], rt[:, 3], FOV, HEIGHT, HEIGHT)
    assert 0 < row < 0.06 * HEIGHT


def test_opencv(page, camera):
    _, _, rotation, shift = camera
    cv_rotation, cv_shift, matrix = page["to_opencv"](rotation, shift, FOV, WIDTH, HEIGHT)
    assert np.linalg.det(cv_rotation) == pytest.approx(1)
    for point in some_points():
        column, row, depth = page["project"](point, rotation, shift, FOV, WIDTH, HEIGHT)
        u, v, w = matrix @ (cv_rotation @ point + cv_shift)
        assert (u / w + 0.5, v / w + 0.5, w) == pytest.approx((column, row, depth))


def test_pytorch3d(page, camera):
    """Against `look_at_view_transform` as documented: rows, +x left, z into the scene."""
    azimuth, elevation, rotation, shift = camera
    a, e = np.deg2rad(azimuth), np.deg2rad(elevation)
    position = 2.2 * np.array([np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)])
    z = -position / np.linalg.norm(position)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    expected = np.stack([x, np.cross(z, x), z], axis=1)
    got, translation = page["to_pytorch3d"](rotation, shift)
    np.testing.assert_allclose(got, expected, atol=1e-6)
    np.testing.assert_allclose(translation, -expected.T @ position, atol=1e-6)
    for point in some_points():  # NDC: +x left, +y up, the shorter side spans -1..1
        view = point @ got + translation
        column, row, _ = page["project"](point, rotation, shift, FOV, WIDTH, HEIGHT)
        focal = 1 / np.tan(np.deg2rad(FOV) / 2)
        assert WIDTH / 2 - focal * view[0] / view[2] * HEIGHT / 2 == pytest.approx(column)
        assert HEIGHT / 2 - focal * view[1] / view[2] * HEIGHT / 2 == pytest.approx(row)


@pytest.mark.parametrize("z_up", [False, True])
def test_nerf(page, camera, z_up):
    """A ray through a pixel's centre, made as NeRF loaders make it, meets the point that is seen there."""
    _, _, rotation, shift = camera
    matrix, angle_x = page["to_nerf"](rotation, shift, FOV, WIDTH, HEIGHT, z_up=z_up)
    assert np.linalg.det(matrix) == pytest.approx(1)
    focal = WIDTH / (2 * np.tan(angle_x / 2))
    turn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]) if z_up else np.eye(3)
    for point in some_points():
        column, row, _ = page["project"](point, rotation, shift, FOV, WIDTH, HEIGHT)
        ray = matrix[:3, :3] @ np.array([(column - WIDTH / 2) / focal, -(row - HEIGHT / 2) / focal, -1.0])
        away = turn @ point - matrix[:3, 3]
        np.testing.assert_allclose(np.cross(ray, away), 0, atol=1e-6)
        assert ray @ away > 0


def test_deserno_numbers_in_the_table_are_true():
    from mvtn_cli.core.views.layout import _deserno_ring_sizes

    exact = [m for m in range(2, 101) if _deserno_ring_sizes(m)]
    assert ", ".join(map(str, exact[:8])) in PAGE.read_text(encoding="utf-8")
    assert torch.get_default_dtype() == torch.float32
