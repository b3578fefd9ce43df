"""Learned views beyond the plain ones: the released regressor, random starts, distance, light."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from tetrahedra import config
from torch import nn

from mvtn_cli.core.networks import ViewSelector, class_mean_views, make_selector
from mvtn_cli.core.networks.lighting import LightGradient
from mvtn_cli.core.networks.regressors import build_regressor, light_from
from mvtn_cli.core.views import camera_rotations, wrap_degrees
from mvtn_cli.errors import UsageError

LEARNED = ["learned-direct", "learned-circular", "learned-spherical", "learned-random"]


def selector(views: str, seed: int = 0, **more: Any) -> ViewSelector:
    torch.manual_seed(seed)
    return make_selector(config(views=views, **more))


def some_points(batch: int = 4) -> torch.Tensor:
    return torch.randn(batch, 32, 3, generator=torch.Generator().manual_seed(0)) * 0.5


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.mark.parametrize(("num_views", "weights"), [(1, 3757), (6, 5762), (12, 9092), (20, 15_100)])
def test_reference_regressor_has_as_many_weights_as_the_released_one(num_views, weights):
    regressor = build_regressor("reference", 40, 2 * num_views, 2, num_views)
    assert sum(weight.numel() for weight in regressor.parameters()) == weights
    assert weights == 14 * num_views**2 + 303 * num_views + 3440
    assert regressor(torch.randn(3, 40 + 2 * num_views)).shape == (3, 2 * num_views)


def test_reference_selector_has_that_regressor_behind_the_released_encoder():
    chooser = selector("learned-spherical", num_views=12, encoder="pointnet", tnets=True, regressor="reference")
    counts = [sum(weight.numel() for weight in part.parameters()) for part in (chooser.encoder, chooser.head)]
    assert counts == [3_467_457, 9092]
    assert sum(isinstance(layer, nn.Linear) for layer in chooser.head) == 5


@pytest.mark.parametrize("views", LEARNED)
@pytest.mark.parametrize("encoder", ["pointnet", "dgcnn"])
@pytest.mark.parametrize("regressor", ["small", "reference"])
@pytest.mark.parametrize("batch", [1, 3])
def test_every_part_learns_from_the_cameras(views, encoder, regressor, batch):
    chooser = selector(views, encoder=encoder, regressor=regressor).train()
    optimiser = torch.optim.AdamW(chooser.parameters(), 1e-2)
    for _ in range(2):
        optimiser.zero_grad()
        cameras = chooser(some_points(batch), generator=generator())
        (cameras.rt * torch.linspace(0.5, 1.5, 12).reshape(3, 4)).sum().backward()
        assert all(torch.isfinite(weight.grad).all() for weight in chooser.parameters())
        optimiser.step()
    assert batch == 1 or chooser.head[-1].weight.grad.abs().max() > 0
    assert batch == 1 or any(weight.grad.abs().max() > 0 for weight in chooser.encoder.parameters())


def test_random_starts_are_new_in_each_step_the_same_in_each_evaluation_and_begin_without_offset():
    plain, chooser = selector("random"), selector("learned-random")
    for training in (True, False):
        drawn = plain.train(training)(some_points(), generator=generator(3) if training else None)
        begun = chooser.train(training)(some_points(), generator=generator(3) if training else None)
        assert torch.equal(begun.azimuth_deg, drawn.azimuth_deg)
        assert torch.equal(begun.elevation_deg, drawn.elevation_deg)
    chooser.train()
    assert not torch.equal(*(chooser(some_points(), generator=generator(s)).azimuth_deg for s in (1, 2)))


@pytest.mark.parametrize("regressor", ["small", "reference"])
def test_random_start_is_told_to_the_network_which_stays_within_its_bounds(regressor):
    chooser = selector("learned-random", regressor=regressor).eval()
    nn.init.normal_(chooser.head[-1].weight, std=2.0, generator=generator())
    points = some_points(1).expand(64, -1, -1)
    start = selector("random").eval()(points, generator=generator(1))
    cameras = chooser(points, generator=generator(1))
    offset = cameras.azimuth_deg - start.azimuth_deg, cameras.elevation_deg - start.elevation_deg
    assert offset[0].abs().max() <= 45.001 and offset[1].abs().max() <= 90.001
    assert offset[0].std(dim=0).min() > 0.1  # one shape, other starts, other offsets


@pytest.mark.parametrize("views", LEARNED)
def test_distance_and_light_begin_at_the_plain_setting_and_change_nothing_else(views):
    plain = selector(views).train().place(some_points(), generator=generator(), explore_deg=10.0)
    both = selector(views, learn_distance=1.5, learn_light=True).train()
    placed = both.place(some_points(), generator=generator(), explore_deg=10.0)
    for name in ("azimuth_deg", "elevation_deg", "distance"):
        assert torch.equal(getattr(placed.cameras, name), getattr(plain.cameras, name))
    assert plain.light is None
    torch.testing.assert_close(placed.light * 2.2, placed.cameras.positions)


@pytest.mark.parametrize("views", ["learned-direct", "learned-circular"])
def test_distance_keeps_within_its_factor_and_light_is_a_unit_vector_before_the_shape(views):
    chooser = selector(views, learn_distance=1.5, learn_light=True)
    nn.init.normal_(chooser.scene.layer.weight, std=50.0, generator=generator())
    cameras, light = chooser.place(some_points(64))
    assert (cameras.distance >= 2.2 / 1.5 - 1e-5).all() and (cameras.distance <= 2.2 * 1.5 + 1e-5).all()
    assert cameras.distance.max() > 3.2 and cameras.distance.min() < 1.5
    torch.testing.assert_close(light.norm(dim=-1), torch.ones(64, 4))
    facing = (light * cameras.positions / cameras.distance[..., None]).sum(-1)
    assert (facing > 0).all() and facing.min() < 0.2


def test_distance_and_light_have_gradients_of_their_own():
    for more, used in (({"learn_distance": 1.5}, 1), ({"learn_light": True}, 2)):
        chooser = selector("learned-spherical", **more)
        assert chooser.scene.layer.out_features == used * 4
        cameras, light = chooser.place(some_points())
        told = cameras.distance if light is None else light * torch.tensor([0.3, 0.5, -0.7])
        told.sum().backward()
        assert (chooser.scene.layer.bias.grad.abs() > 0).all()


def test_light_is_to_the_right_of_and_above_the_camera_as_said():
    azimuth, elevation = torch.tensor([[30.0, -100.0]]), torch.tensor([[20.0, 60.0]])
    axes = camera_rotations(azimuth, elevation).float()
    light = light_from(torch.tensor([[[1.0, 0.0], [0.0, -1.0]]]), axes)
    torch.testing.assert_close(light[0, 0], (axes[0, 0, 0] + axes[0, 0, 2]) / 2**0.5)
    torch.testing.assert_close(light[0, 1], (axes[0, 1, 2] - axes[0, 1, 1]) / 2**0.5)


def test_gradient_of_the_light_is_that_of_the_picture():
    """Pictures with a known formula, square in the light."""
    normals = torch.randn(2, 3, 3, 4, 4, generator=generator(), dtype=torch.float64)

    def pictures(light: torch.Tensor) -> torch.Tensor:
        return torch.einsum("bmc,bmchw->bmhw", light, normals)[:, :, None] ** 2

    offset = torch.randn(2, 3, 3, generator=generator(1), dtype=torch.float64, requires_grad=True)
    weight = torch.randn(2, 3, 1, 4, 4, generator=generator(2), dtype=torch.float64)
    gradients = []
    for way in ("autograd", "differences"):
        light = nn.functional.normalize(offset, dim=-1)
        drawn = pictures(light) if way == "autograd" else LightGradient.apply(pictures(light.detach()), light, pictures)
        gradients.append(torch.autograd.grad((drawn * weight).sum(), offset)[0])
    torch.testing.assert_close(gradients[1], gradients[0], rtol=5e-3, atol=5e-3)


def test_settings_that_do_not_go_together_are_refused():
    with pytest.raises(UsageError, match="not with fixed ones"):
        selector("fixed", learn_light=True)
    with pytest.raises(UsageError, match="let a camera into the shape") as caught:
        selector("learned-direct", learn_distance=2.1)
    assert "below 2.10" in caught.value.hint
    with pytest.raises(UsageError, match="unknown regressor"):
        selector("learned-direct", regressor="large")
    with pytest.raises(UsageError, match="unknown views 'learned'"):
        selector("learned")


def test_mean_views_of_classes_go_around_the_seam_and_leave_unlabelled_shapes_out():
    azimuth = np.array([[170.0, 10], [-170, 20], [0, 0], [0, 90], [77, 77]])
    elevation = np.array([[80.0, 0], [100, 10], [0, 0], [0, 0], [77, 77]])
    azimuths, elevations = class_mean_views(azimuth, elevation, [2, 2, 0, 0, -1], 4)
    np.testing.assert_allclose(wrap_degrees(azimuths[2] + 180), [0, -165], atol=1e-9)
    np.testing.assert_allclose(elevations[2], [90, 5])
    np.testing.assert_allclose(azimuths[0], [0, 45])
    np.testing.assert_allclose(azimuths[1], azimuths[3])  # classes without shapes have the mean of all
    assert azimuths.shape == elevations.shape == (4, 2) and np.isfinite(azimuths).all()
