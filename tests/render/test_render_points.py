"""Point clouds (T16): images and their exact gradient against the float64 twin."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import scenes
from reference.drawing import cameras, gradients, image
from reference.points import draw_points

from mvtn_cli.core.render import render
from mvtn_cli.core.render.mesh import camera_matrices

WHITE_AND_RED = np.array([[1, 1, 1], [1, 0, 0]], np.float32)


def ball(count, seed=0):
    """Return points on a lopsided closed surface."""
    points = np.random.default_rng(seed).standard_normal((count, 3))
    return (points / np.linalg.norm(points, axis=1, keepdims=True) * [0.8, 0.6, 0.4]).astype(np.float32)


def look(size, radius, **changes):
    return scenes.look(size, kind="points", point_radius=radius, **changes)


def twin(points, view, size, radius, *, colors=None, background=(0.0, 0.0, 0.0), cue=0.0):
    rt = camera_matrices(*(torch.tensor(value, dtype=torch.float64) for value in view)).numpy()
    colors = np.ones(points.shape) if colors is None else colors
    return draw_points(points, colors, rt, scenes.focal(size), size, radius, background, cue)


def twin_gradient(points, view, size, radius, weights, colors=None, step=1e-5, axes=(0, 1, 2), cue=0.0):
    """Return central differences of <weights, image> by azimuth, elevation, distance."""
    gradient = []
    for axis in axes:
        ends = []
        for sign in (1, -1):
            moved = list(view)
            moved[axis] += sign * step
            ends.append((twin(points, moved, size, radius, colors=colors, cue=cue) * weights).sum())
        gradient.append((ends[0] - ends[1]) / (2 * step))
    return np.array(gradient)


CLOUDS = {
    "one point": (np.float32([[0.1, 0.2, 0.1]]), 0.1, 11),
    "points under a tenth of a pixel": (ball(200), 0.004, 16),
    "a thin cloud": (ball(100), 0.05, 16),
    "a dense cloud": (ball(1500), 0.1, 16),
    "discs larger than the image": (ball(5), 3.0, 8),
}
VIEW = (31.0, 17.0, 2.2)


@pytest.mark.parametrize("colored", [False, True], ids=["white", "coloured"])
@pytest.mark.parametrize("name", CLOUDS)
def test_image_equals_the_twin(name, colored):
    points, radius, size = CLOUDS[name]
    colors = np.random.default_rng(1).uniform(0, 1, points.shape).astype(np.float32) if colored else None
    drawn = image(scenes.cloud(points, colors), cameras(VIEW), look(size, radius, background=(0.2, 0.1, 0.6)))[0]
    expected = twin(points, VIEW, size, radius, colors=colors, background=(0.2, 0.1, 0.6))
    np.testing.assert_allclose(drawn, expected, atol=1e-5)


@pytest.mark.parametrize("cue", [0.5, 1.0])
@pytest.mark.parametrize("name", CLOUDS)
def test_points_grow_darker_with_depth_and_the_gradient_knows(name, cue):
    points, radius, size = CLOUDS[name]
    points = (1.6 * points).astype(np.float32)  # some lie beyond the depths between which the shade changes
    weights = np.random.default_rng(2).standard_normal((1, 3, size, size)).astype(np.float32)
    drawn = image(scenes.cloud(points), cameras(VIEW), look(size, radius, depth_cue=cue))[0]
    np.testing.assert_allclose(drawn, twin(points, VIEW, size, radius, cue=cue), atol=1e-5)
    got = gradients(scenes.cloud(points), cameras(VIEW), look(size, radius, depth_cue=cue), weights)[0]
    expected = twin_gradient(points, VIEW, size, radius, weights[0], cue=cue)
    np.testing.assert_allclose(got, expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("name", "colored"),
    [(name, colored) for name in CLOUDS for colored in (False, True)],
)
def test_gradient_equals_central_differences_of_the_twin(name, colored):
    """White points on black: alpha blending has a gradient where normalised weights have none."""
    points, radius, size = CLOUDS[name]
    colors = np.random.default_rng(1).uniform(0, 1, points.shape).astype(np.float32) if colored else None
    weights = np.random.default_rng(2).standard_normal((1, 3, size, size)).astype(np.float32)
    got = gradients(scenes.cloud(points, colors), cameras(VIEW), look(size, radius), weights)[0]
    expected = twin_gradient(points, VIEW, size, radius, weights[0], colors)
    np.testing.assert_allclose(got[:2], expected[:2], atol=1e-4 * np.abs(expected[:2]).max())
    assert got[2] == pytest.approx(expected[2], rel=1e-4)
    assert np.abs(got).min() > 0


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 40),
    radius=st.floats(1e-4, 0.5),
    azimuth=st.floats(-720, 720, width=32),
    elevation=st.floats(-180, 180, width=32),
    distance=st.floats(0, 3, width=32),
    size=st.integers(1, 12),
)
def test_any_cloud_equals_the_twin_and_has_a_finite_gradient(seed, count, radius, azimuth, elevation, distance, size):
    points, view = ball(count, seed), (azimuth, elevation, distance)
    colors = np.random.default_rng(seed).uniform(0, 1, points.shape).astype(np.float32)
    shape = scenes.cloud(points, colors)
    drawn = image(shape, cameras(view), look(size, radius))[0]
    np.testing.assert_allclose(drawn, twin(points, view, size, radius, colors=colors), atol=1e-5)
    weights = np.random.default_rng(seed).standard_normal((1, 3, size, size))
    assert np.isfinite(gradients(shape, cameras(view), look(size, radius), weights)).all()


def test_mass_is_kept_while_a_point_smaller_than_a_pixel_moves():
    for radius in (0.002, 0.01, 0.05):
        sums = []
        for x in np.linspace(-0.3, 0.3, 25):
            cloud = scenes.cloud([[x, 0.37 * x, 0]])
            sums.append(image(cloud, cameras((0, 0, 2.2)), look(16, radius))[0, 0].astype(np.float64).sum())
        assert np.ptp(sums) < 1e-6 * max(sums) and min(sums) > 0
        radius_pixels = radius * scenes.focal(16) / 2.2
        assert sums[0] == pytest.approx(np.pi / 3 * radius_pixels**2, rel=1e-4)  # the disc's own mass


@pytest.mark.parametrize("count", [2, 16, 100])
def test_coincident_points_are_drawn_in_their_own_order(count):
    points, radius = np.full((count, 3), 0.1, np.float32), 0.4
    colors = np.random.default_rng(0).uniform(0, 1, points.shape).astype(np.float32)
    drawn = image(scenes.cloud(points, colors), cameras(VIEW), look(8, radius))[0]
    np.testing.assert_allclose(drawn, twin(points, VIEW, 8, radius, colors=colors), atol=1e-5)


def test_coincident_white_points_have_the_gradient_of_the_twin():
    points, weights = (
        np.full((40, 3), 0.1, np.float32),
        np.random.default_rng(0).standard_normal((1, 3, 8, 8)),
    )
    weights = weights.astype(np.float32)
    got = gradients(scenes.cloud(points), cameras(VIEW), look(8, 0.05), weights)[0]
    np.testing.assert_allclose(got, twin_gradient(points, VIEW, 8, 0.05, weights[0]), rtol=1e-3)


def test_points_on_and_behind_the_camera_are_left_out():
    rest = ball(30)
    near = np.float32([[0, 0, 1], [0, 0, 0.995], [0, 0, 1.5], [0.3, -0.2, 1]])
    cloud, without = scenes.cloud(np.concatenate([near, rest])), scenes.cloud(rest)
    view, weights = cameras((0, 0, 1)), np.random.default_rng(0).standard_normal((1, 3, 12, 12))
    np.testing.assert_array_equal(image(cloud, view, look(12, 0.05)), image(without, view, look(12, 0.05)))
    np.testing.assert_array_equal(
        gradients(cloud, view, look(12, 0.05), weights), gradients(without, view, look(12, 0.05), weights)
    )


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_points_that_are_no_numbers_are_left_out(bad):
    rest = ball(100)
    broken = np.insert(rest, [3, 50, 50, 100], bad, axis=0)
    for view in (cameras((0, 0, 2.2)), cameras(VIEW)):
        np.testing.assert_allclose(
            image(scenes.cloud(broken), view, look(12, 0.1)),
            image(scenes.cloud(rest), view, look(12, 0.1)),
            atol=1e-6,
        )
        weights = np.ones((1, 3, 12, 12))
        assert np.isfinite(gradients(scenes.cloud(broken), view, look(12, 0.1), weights)).all()


@pytest.fixture(scope="module")
def crowd():
    """100,000 points on 8 by 8 pixels, their image by the twin."""
    points = ball(100_000)
    return points, twin(points, VIEW, 8, 0.02)


def test_a_hundred_thousand_points_equal_the_twin(crowd):
    points, expected = crowd
    np.testing.assert_allclose(image(scenes.cloud(points), cameras(VIEW), look(8, 0.02))[0], expected, atol=2e-5)
    assert expected.max() > 0.9


def test_a_hundred_thousand_points_have_the_gradient_of_the_twin(crowd):
    """Of the last of them 1e-20 of a pixel is seen; the image's own rounding must not stand in for it."""
    points, weights = crowd[0], np.random.default_rng(2).standard_normal((1, 3, 8, 8)).astype(np.float32)
    got = gradients(scenes.cloud(points), cameras(VIEW), look(8, 0.02), weights)[0]
    np.testing.assert_allclose(got[:1], twin_gradient(points, VIEW, 8, 0.02, weights[0], axes=[0]), rtol=1e-3)


@pytest.mark.parametrize("cue", [0.0, 0.5])
@pytest.mark.parametrize("colored", [False, True], ids=["white", "coloured"])
def test_each_point_may_have_a_radius_of_its_own(colored, cue):
    """From far below a pixel to half of the image, in no order of depth."""
    points, random = ball(120), np.random.default_rng(3)
    radii = np.exp(random.uniform(np.log(2e-3), np.log(0.5), len(points)))
    colors = random.uniform(0, 1, points.shape).astype(np.float32) if colored else None
    weights = random.standard_normal((1, 3, 16, 16)).astype(np.float32)
    cloud, drawn_as = scenes.cloud(points, colors), look(16, radii[None], depth_cue=cue)
    expected = twin(points, VIEW, 16, radii, colors=colors, cue=cue)
    np.testing.assert_allclose(image(cloud, cameras(VIEW), drawn_as)[0], expected, atol=1e-5)
    assert np.abs(expected - twin(points, VIEW, 16, radii[::-1], colors=colors, cue=cue)).max() > 0.1
    got = gradients(cloud, cameras(VIEW), drawn_as, weights)[0]
    np.testing.assert_allclose(got, twin_gradient(points, VIEW, 16, radii, weights[0], colors, cue=cue), rtol=1e-3)


def test_radii_are_for_all_for_each_shape_or_for_each_point():
    clouds, views = [scenes.cloud(ball(60, seed)) for seed in range(2)], cameras(VIEW, (0, 0, 1.5))
    alone = [image(cloud, views, look(16, radius)) for cloud, radius in zip(clouds, (0.05, 0.2), strict=True)]
    for radii in (np.array([0.05, 0.2]), np.repeat([[0.05], [0.2]], 60, axis=1)):
        both = render(
            scenes.batch_of(*clouds), cameras(VIEW, (0, 0, 1.5), count=2), look(16, radii, count=2), gradient="none"
        ).rgb.numpy()
        np.testing.assert_array_equal(both, np.stack(alone))


def test_a_point_of_no_radius_is_not_there():
    points, radii = ball(60), np.full((1, 60), 0.1)
    radii[0, ::3] = 0
    rest, weights = scenes.cloud(points[radii[0] > 0]), np.random.default_rng(0).standard_normal((1, 3, 12, 12))
    found = [f(scenes.cloud(points), cameras(VIEW), look(12, radii), *more) for f, more in (
        (image, ()), (gradients, (weights,)),
    )]  # fmt: skip
    np.testing.assert_array_equal(found[0], image(rest, cameras(VIEW), look(12, 0.1)))
    np.testing.assert_array_equal(found[1], gradients(rest, cameras(VIEW), look(12, 0.1), weights))


@pytest.mark.parametrize("radii", [np.ones(3), np.ones((1, 4)), [-0.1], [np.nan], np.inf], ids=str)
def test_radii_that_fit_no_batch_or_no_disc_are_refused(radii):
    with pytest.raises(ValueError, match="point radii"):
        image(scenes.cloud(ball(5)), cameras(VIEW), look(8, radii))


def test_colours_of_points_and_of_shapes_multiply():
    points = ball(60)
    green = np.tile(np.float32([0.2, 1, 0]), (60, 1))
    batch = scenes.batch_of(scenes.cloud(points, green), scenes.cloud(points))
    drawn = render(
        batch, cameras(VIEW, count=2), look(16, 0.1, colors=WHITE_AND_RED, count=2), gradient="none"
    ).rgb.numpy()
    white = image(scenes.cloud(points), cameras(VIEW), look(16, 0.1))[0, 0]
    np.testing.assert_allclose(drawn[0, 0], np.stack([0.2 * white, white, 0 * white]), atol=1e-6)
    np.testing.assert_allclose(drawn[1, 0], np.stack([white, 0 * white, 0 * white]), atol=1e-6)
