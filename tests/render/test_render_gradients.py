"""The gradient of mesh images to the cameras, by edge flow and by finite differences."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import scenes
from reference.drawing import cameras, gradients, image, matrices
from reference.rasteriser import to_camera
from scipy.ndimage import gaussian_filter

from mvtn_cli.core.render import render
from mvtn_cli.core.views import Cameras

MODES = ("edge-flow", "fd")
SIDE_LIGHT = np.array([[0.48, 0.6, 0.64]], np.float32)
VIEWS = [(60.0 * k + 7, (-40.0, -10.0, 20.0, 45.0, 70.0, 5.0)[k % 6] + k // 6 * 3.3, 2.2) for k in range(12)]
STIFF = scenes.stiff()


def smooth_weights(views, size, sigma=3.0, seed=0):
    """Return what a loss that looks at large parts of the image would ask for."""
    noise = np.random.default_rng(seed).standard_normal((views, 3, size, size))
    return gaussian_filter(noise, (0, 0, sigma, sigma)).astype(np.float32)


def cosine(a, b):
    return (a * b).sum() / np.linalg.norm(a) / np.linalg.norm(b)


@pytest.mark.parametrize("fine", [1, 2])
def test_finite_differences_are_those_of_the_very_images(fine):
    """By hand, with the same step; a distance step is as many radii as the angular step has radians."""
    shape, look, view = scenes.chair(), scenes.look(20, supersample=fine), (37.0, 21.0, 2.25)
    weights = smooth_weights(1, 20, sigma=1)
    for axis, how in ((0, 2.0), (1, 2.0), (2, math.degrees(1 / 32))):
        step = 1 / 32 if axis == 2 else how
        moved = [list(view), list(view)]
        moved[0][axis] += step
        moved[1][axis] -= step
        ahead, behind = image(shape, cameras(*moved), look).astype(np.float64)
        expected = (weights[0] * (ahead - behind)).sum() / (2 * step)
        got = gradients(shape, cameras(view), look, weights, gradient="fd", fd_step_deg=how)[0, axis]
        assert got == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("mode", "least"), [("edge-flow", 0.97), ("fd", 0.95)])
@pytest.mark.parametrize(
    ("shape", "light", "shading"),
    [
        (scenes.bumpy(6), None, "smooth"),
        (scenes.bumpy(6), SIDE_LIGHT, "smooth"),
        (scenes.bumpy(6), None, "flat"),
        (scenes.icosahedron(), SIDE_LIGHT, "flat"),
        (scenes.chair(), None, "smooth"),
    ],
    ids=["bumpy", "bumpy, side light", "bumpy, flat", "icosahedron, flat, side light", "chair"],
)
def test_gradient_points_where_much_finer_images_say(shape, light, shading, mode, least):
    """Truth: central differences over a tenth of a degree of 8 by 8 samples a pixel."""
    look, views = scenes.look(48, light_direction=light, shading=shading), cameras(*VIEWS)
    weights = smooth_weights(12, 48)
    truth = gradients(shape, views, replace(look, supersample=8), weights, gradient="fd", fd_step_deg=0.1)
    got = gradients(shape, views, replace(look, supersample=2), weights, gradient=mode)
    assert cosine(got[:, :2], truth[:, :2]) > least
    assert cosine(got[:, 2], truth[:, 2]) > 0.97
    assert 0.85 < np.linalg.norm(got[:, :2]) / np.linalg.norm(truth[:, :2]) < 1.15


def test_gradient_of_a_mesh_whose_faces_are_smaller_than_a_pixel_points_the_right_way():
    """T10: 14,400 faces on 24 by 24 pixels."""
    look, views, weights = scenes.look(24), cameras(*VIEWS[:6]), smooth_weights(6, 24, sigma=2)
    shape = scenes.bumpy(60)
    truth = gradients(shape, views, replace(look, supersample=8), weights, gradient="fd", fd_step_deg=0.1)
    got = gradients(shape, views, replace(look, supersample=2), weights)
    assert cosine(got[:, :2], truth[:, :2]) > 0.98


def area(shape, view, size):
    """Return how many pixels a flat convex outline covers, exactly."""
    corners = to_camera(shape.vertices, matrices(cameras(view))[0, 0])
    x, y = (corners[:, :2] * scenes.focal(size) / corners[:, 2:]).T
    return abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("view", [(0.0, 0.0, 2.2), (30.0, 0.0, 2.0), (-50.0, 35.0, 1.8)], ids=str)
def test_area_of_a_polygon_changes_as_on_paper(view, mode):
    """Ambient light, weights one: the sum is the area, whose change follows from the corners alone."""
    flat = scenes.stored([[-0.5, -0.4, 0], [0.5, -0.5, 0], [0.45, 0.5, 0], [-0.5, 0.3, 0]], [[0, 1, 2], [0, 2, 3]])
    size = 40
    look = scenes.look(size, supersample=4, ambient=1.0, diffuse=0.0)
    got = gradients(flat, cameras(view), look, np.ones((1, 3, size, size)) / 3, gradient=mode, fd_step_deg=1.0)[0]
    step = 1 / 128
    for axis in range(3):
        ends = []
        for sign in (1, -1):
            moved = list(view)
            moved[axis] += sign * step
            ends.append(area(flat, tuple(moved), size))
        expected = (ends[0] - ends[1]) / (2 * step)
        perimeter_share = 0.02 * 4 * math.sqrt(area(flat, view, size)) * (1 if axis == 2 else math.radians(1))
        assert got[axis] == pytest.approx(expected, rel=0.02, abs=perimeter_share * scenes.focal(size) / 2.2 / 4)


@pytest.mark.parametrize("mode", MODES)
def test_gradient_is_linear_in_what_comes_in(mode):
    look, views = scenes.look(24, supersample=2), cameras(*VIEWS[:4])
    one, two = smooth_weights(4, 24, seed=1), smooth_weights(4, 24, seed=2)
    parts = [gradients(scenes.chair(), views, look, w, gradient=mode) for w in (one, two, one - 2 * two)]
    np.testing.assert_allclose(parts[2], parts[0] - 2 * parts[1], atol=1e-4 * np.abs(parts[0]).max())


@pytest.mark.parametrize("mode", MODES)
def test_inside_a_box_all_change_is_shading_and_its_gradient_is_right_too(mode):
    """T4: nothing but walls, lit by the camera, with a highlight."""
    look = scenes.look(32, ambient=0.5, diffuse=0.3, specular=0.2, shininess=8.0, falloff=1.0)
    views, weights = cameras((20, 10, 0.3), (130, -35, 0.3), (250, 60, 0.3)), smooth_weights(3, 32)
    truth = gradients(scenes.box(), views, replace(look, supersample=8), weights, gradient="fd", fd_step_deg=0.1)
    got = gradients(scenes.box(), views, replace(look, supersample=2), weights, gradient=mode)
    assert (image(scenes.box(), views, look) > 0.4).all()
    assert cosine(got[:, :2], truth[:, :2]) > 0.97


@pytest.mark.parametrize("mode", MODES)
def test_a_view_that_sees_nothing_has_no_gradient(mode):
    behind = STIFF["behind the camera"]
    assert (gradients(behind, cameras((0, 0, 2.2)), scenes.look(16), smooth_weights(1, 16), gradient=mode) == 0).all()


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", STIFF)
def test_gradient_of_stiff_shapes_is_finite(name, mode):
    """T15."""
    views = cameras((33, 21, 1.0), (0, 0, 2.2), (90, 90, 2.2), (200, -75, 0.3), (0, 0, 1e-3), (10, 100, 1e4))
    for shading in ("smooth", "flat"):
        look = scenes.look(15, shading=shading, specular=0.2, supersample=2)
        assert np.isfinite(image(STIFF[name], views, look)).all()
        assert np.isfinite(gradients(STIFF[name], views, look, smooth_weights(6, 15), gradient=mode)).all()


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    faces=st.integers(1, 30),
    edge=st.sampled_from([1e-3, 0.1, 0.8, 3.0]),
    azimuth=st.floats(-720, 720, width=32),
    elevation=st.floats(-180, 180, width=32),
    distance=st.floats(0, 5, width=32),
    size=st.integers(1, 16),
    headlight=st.booleans(),
)
def test_gradient_of_any_soup_is_finite(seed, faces, edge, azimuth, elevation, distance, size, headlight):
    """T15."""
    shape, views = scenes.soup(faces, seed, edge=edge, colored=True), cameras((azimuth, elevation, distance))
    look = scenes.look(size, light_direction=None if headlight else SIDE_LIGHT, specular=0.2)
    for mode in MODES:
        assert np.isfinite(gradients(shape, views, look, smooth_weights(1, size), gradient=mode)).all()


def test_gradient_is_finite_where_an_edge_is_level_to_the_last_bit():
    """T15. Seen along the middle row, an edge that rises by 1e-40 has a slope that no float32 holds."""
    shape = scenes.stored([[-0.8, 1e-40, 0], [0.8, -1e-43, 0], [0, -0.7, 0]], [[0, 1, 2]])
    got = gradients(shape, cameras((0, 0, 2.2)), scenes.look(25), np.ones((1, 3, 25, 25)))
    assert np.isfinite(got).all()


@pytest.mark.parametrize("kind", ["mesh", "points"])
@pytest.mark.parametrize("mode", MODES)
def test_a_nan_that_comes_in_stays_in_its_own_view(mode, kind):
    """T15."""
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3))
    shape = replace(scenes.chair(), points=points.astype(np.float32))
    leaves = cameras(*VIEWS[:3], count=2, grad=True)
    look = scenes.look(16, 2, kind=kind, point_radius=0.1)
    rgb = render(scenes.batch_of(shape, shape), leaves, look, gradient=mode).rgb
    weights = torch.ones_like(rgb)
    weights[1, 2, 0, 8, 8] = torch.nan
    rgb.backward(weights)
    for leaf in (leaves.azimuth_deg, leaves.elevation_deg, leaves.distance):
        expected = torch.ones(2, 3, dtype=torch.bool)
        expected[1, 2] = False
        assert torch.equal(torch.isfinite(leaf.grad), expected)


@pytest.mark.parametrize("mode", MODES)
def test_only_the_cameras_that_want_a_gradient_get_one(mode):
    azimuth = torch.tensor([[20.0]], requires_grad=True)
    elevation, distance = torch.tensor([[10.0]]), torch.tensor([[2.2]])
    rgb = render(
        scenes.batch_of(scenes.chair()), Cameras(azimuth, elevation, distance), scenes.look(16), gradient=mode
    ).rgb
    weights = torch.as_tensor(smooth_weights(1, 16))[None]
    (rgb * weights).sum().backward()
    alone = azimuth.grad.clone()
    every = gradients(scenes.chair(), cameras((20, 10, 2.2)), scenes.look(16), weights[0].numpy(), gradient=mode)
    assert alone.item() == pytest.approx(every[0, 0], rel=1e-6) and alone.item() != 0
    assert elevation.grad is None and distance.grad is None


def test_both_gradients_and_none_belong_to_the_same_image():
    shape, look, views = scenes.chair(), scenes.look(24, supersample=2), cameras(*VIEWS[:3], grad=True)
    plain = image(shape, views, look)
    for mode in MODES:
        with_gradient = render(scenes.batch_of(shape), views, look, gradient=mode).rgb[0].detach().numpy()
        np.testing.assert_array_equal(with_gradient, plain)


@pytest.mark.parametrize("mode", MODES)
def test_across_the_pole_azimuth_keeps_its_gradient_and_elevation_turns_its(mode):
    """T2. From elevation 100 the picture is that from 80 on the other side, upside down."""
    look, shape = scenes.look(32, supersample=2, light_direction=SIDE_LIGHT), scenes.bumpy(6)
    weights = smooth_weights(1, 32)
    over = gradients(shape, cameras((25, 100, 2.2)), look, weights, gradient=mode)[0]
    here = gradients(shape, cameras((205, 80, 2.2)), look, weights[:, :, ::-1, ::-1].copy(), gradient=mode)[0]
    np.testing.assert_allclose(over * [1, -1, 1], here, rtol=0.02, atol=0.02 * np.abs(here[:2]).max())
