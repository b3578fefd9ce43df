"""Cosines, distances, directions and blurs, against cases solved by hand."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from mvtn_cli.core.bench.pose import blur_twice, blurred_difference, learning_rate, offsets
from mvtn_cli.core.bench.subjects import golden_spiral, light_and_color
from mvtn_cli.core.bench.vectors import cosine, mean_cosine, mean_of, relative_l2, rmse
from mvtn_cli.core.bench.weights import gaussian_matrix, network_weights, smooth_weights, white_weights
from mvtn_cli.core.views import angle_between


@pytest.mark.parametrize(
    ("candidate", "truth", "expected"),
    [
        ([3, 4], [3, 4], 1.0),
        ([3, 4], [-6, -8], -1.0),
        ([1, 0], [0, 5], 0.0),
        ([1, 0], [1, 1], math.sqrt(0.5)),
        ([3, 4], [4, 3], 24 / 25),
        ([0, 0], [1, 2], 0.0),  # no direction is not the right one
        ([1e-200, 0], [1e-200, 1e-200], math.sqrt(0.5)),
        ([1e200, 0], [1e200, 1e200], math.sqrt(0.5)),
    ],
)
def test_cosine_of_hand_cases(candidate, truth, expected):
    assert cosine(candidate, truth) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize(("candidate", "truth"), [([1, 2], [0, 0]), ([math.nan, 1], [1, 1]), ([1, 1], [math.inf, 1])])
def test_cosine_has_no_answer_without_a_true_direction_or_with_a_broken_number(candidate, truth):
    assert math.isnan(cosine(candidate, truth))


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=5), st.floats(1e-3, 1e3))
def test_cosine_does_not_see_length_and_the_l2_error_of_a_stretch_is_the_stretch(vector, factor):
    if np.linalg.norm(vector) < 1e-3:
        return
    stretched = factor * np.array(vector)
    assert cosine(stretched, vector) == pytest.approx(1)
    assert relative_l2(stretched, vector) == pytest.approx(abs(factor - 1), abs=1e-12)


def test_relative_l2_of_hand_cases():
    assert relative_l2([3, 0], [3, 4]) == pytest.approx(4 / 5)
    assert relative_l2([0, 0], [3, 4]) == 1
    assert relative_l2([3, 4], [3, 4]) == 0
    assert math.isnan(relative_l2([1, 1], [0, 0]))


def test_the_mean_over_views_leaves_out_views_without_true_gradient_and_keeps_failures():
    truth = [[1, 0], [0, 2], [0, 0]]
    assert mean_cosine([[5, 0], [1, 0], [7, 7]], truth) == pytest.approx((1 + 0) / 2)
    assert math.isnan(mean_cosine([[5, 0], [math.nan, 0], [7, 7]], truth))
    assert math.isnan(mean_of([]))


def test_rmse_of_a_hand_case():
    assert rmse([0, 0, 0, 0], [1, 1, 1, 3]) == pytest.approx(math.sqrt(12 / 4))


@pytest.mark.parametrize("count", [1, 2, 12, 40])
def test_a_golden_spiral_is_balanced_and_its_directions_keep_apart(count):
    azimuth, elevation = golden_spiral(count)
    heights = np.sin(np.radians(elevation))
    assert np.allclose(np.diff(heights), -2 / count) and heights.sum() == pytest.approx(0, abs=1e-12)
    assert ((azimuth >= -180) & (azimuth < 180)).all()
    apart = angle_between(azimuth[:, None], elevation[:, None], azimuth, elevation) + 360 * np.eye(count)
    assert apart.min() > 0.8 * math.degrees(math.sqrt(4 * math.pi / count) * 0.95)


def test_a_gaussian_matrix_blurs_as_scipy_does():
    from scipy.ndimage import gaussian_filter

    image = np.random.default_rng(0).normal(size=(40, 40))
    blur = gaussian_matrix(40, 3.0)
    wanted = gaussian_filter(image, 3.0, mode="constant", truncate=20)
    assert np.allclose(blur @ image @ blur.T, wanted, atol=1e-10)
    assert np.allclose(blur, blur.T) and blur[20].sum() == pytest.approx(1, abs=1e-9)


def test_smooth_weights_are_smooth_and_all_weights_are_of_one_scale():
    smooth, white = smooth_weights(2, 56, seed=1), white_weights(2, 56, seed=1)
    rms = [weights.square().mean().sqrt().item() for weights in (smooth, white)]
    assert rms == pytest.approx([1, 1], abs=0.02)
    steps = [(weights[..., 1:] - weights[..., :-1]).square().mean().sqrt().item() for weights in (smooth, white)]
    assert steps[0] < 0.4 < 1.3 < steps[1]
    assert torch.equal(smooth, smooth_weights(2, 56, seed=1)) and not torch.equal(smooth, smooth_weights(2, 56, seed=2))


def test_network_weights_are_the_gradient_of_one_and_the_same_network():
    images = torch.rand(2, 3, 32, 32, generator=torch.Generator().manual_seed(0))
    before = torch.get_rng_state()
    weights = network_weights(images, seed=3)
    assert torch.equal(torch.get_rng_state(), before)
    assert weights.shape == images.shape and weights.square().mean().item() == pytest.approx(1, abs=1e-4)
    assert torch.allclose(weights, network_weights(images, seed=3), atol=1e-4)


def test_the_gradient_of_the_pose_loss_is_that_of_autograd():
    images, target = torch.rand(2, 1, 1, 3, 20, 20, generator=torch.Generator().manual_seed(0)).double()
    images.requires_grad_()
    blur = torch.from_numpy(gaussian_matrix(20, 6 / 224 * 20))
    (blur @ (images - target) @ blur.T).square().sum().backward()
    wanted = blurred_difference(images.detach(), target, blur_twice(20).double())
    assert images.grad is not None and torch.allclose(images.grad, wanted, atol=1e-6)


def test_pose_starts_are_8_to_15_degrees_off_in_both_angles_and_to_either_side():
    off = offsets(200, seed=0)
    assert ((np.abs(off) >= 8) & (np.abs(off) <= 15)).all()
    assert 0.3 < (off > 0).mean() < 0.7
    assert (offsets(3, (1, 2)) == offsets(3, (1, 2))).all() and (offsets(3, 1) != offsets(3, 2)).all()


def test_the_learning_rate_falls_from_1_to_003_degrees():
    rates = [learning_rate(step, 80) for step in range(80)]
    assert rates[0] == 1 and rates[-1] == pytest.approx(0.03)
    assert all(a > b for a, b in itertools.pairwise(rates))
    assert learning_rate(0, 1) == 1


def test_a_drawn_light_is_a_unit_vector_and_its_colour_is_bright():
    light, color = light_and_color(3, seed=0)
    assert np.linalg.norm(light) == pytest.approx(1)
    assert color.max() == 1 and color.min() >= 0.3
