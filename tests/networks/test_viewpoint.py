"""View selectors: what the released code gets wrong, start, exploration, saturation, extreme inputs."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from mvtn_cli.config import TrainConfig
from mvtn_cli.core.networks import make_selector
from mvtn_cli.core.networks.learned import OffsetViews, SafeAngle
from mvtn_cli.core.networks.pointnet import PointNetEncoder
from mvtn_cli.core.views import angle_between, layouts

LEARNED = ["learned-direct", "learned-circular", "learned-spherical"]


def selector(views: str, num_views: int = 6, seed: int = 0, **more):
    torch.manual_seed(seed)
    return make_selector(TrainConfig(views=views, num_views=num_views, **more))


def some_points(batch: int = 4, seed: int = 0) -> torch.Tensor:
    return torch.randn(batch, 64, 3, generator=torch.Generator().manual_seed(seed)) * 0.5


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def pull(cameras) -> torch.Tensor:
    """Some loss of the cameras, of which every angle has a gradient."""
    weight = torch.linspace(0.5, 1.5, 12).reshape(3, 4)
    return (cameras.rt * weight).sum()


@pytest.mark.parametrize("views", ["learned-circular", "learned-spherical"])
@pytest.mark.parametrize("num_views", [1, 5, 12])
def test_offset_views_start_at_their_layout_exactly_whatever_the_shape(views, num_views):
    cameras = selector(views, num_views)(some_points())
    azimuth, elevation = layouts(views.removeprefix("learned-"), num_views)
    assert torch.equal(cameras.azimuth_deg, torch.tensor(azimuth).float().expand(4, -1))
    assert torch.equal(cameras.elevation_deg, torch.tensor(elevation).float().expand(4, -1))


@pytest.mark.parametrize("views", LEARNED)
@pytest.mark.parametrize("num_views", [1, 4])
def test_learned_views_move_after_a_step(views, num_views):
    """The released code never trains circular views."""
    chooser = selector(views, num_views)
    before = chooser(some_points())
    optimiser = torch.optim.AdamW(chooser.parameters(), 1e-2)
    for step in range(2):
        optimiser.zero_grad()
        pull(chooser(some_points())).backward()
        gradients = {name: float(weight.grad.abs().max()) for name, weight in chooser.named_parameters()}
        # a last layer of zeros lets the layers before it wait for one step
        moving = {name for name, size in gradients.items() if size > 0}
        assert moving == set(gradients) or (step == 0 and {n for n in moving if n.startswith("head.2")})
        optimiser.step()
    after = chooser(some_points())
    assert (before.azimuth_deg - after.azimuth_deg).abs().min() > 1e-4
    assert (before.elevation_deg - after.elevation_deg).abs().min() > 1e-4


@pytest.mark.parametrize("views", LEARNED)
def test_trained_views_depend_on_the_shape_and_in_evaluation_not_on_the_rest_of_the_batch(views):
    chooser = selector(views)
    torch.nn.init.normal_(chooser.head[2].weight, generator=generator())
    for mode in (True, False):
        together = chooser.train(mode)(some_points())
        assert together.azimuth_deg.std(dim=0).min() > 1e-3
    alone = chooser(some_points()[1:2])
    torch.testing.assert_close(alone.azimuth_deg[0], together.azimuth_deg[1])


@pytest.mark.parametrize("training", [True, False])
def test_start_angles_reach_the_offsets(training):
    """In the released code a BatchNorm behind the first layer subtracts them again."""
    one, other = (OffsetViews((torch.tensor([a, 90.0]), torch.tensor([0.0, 10.0]))) for a in (0.0, 40.0))
    torch.nn.init.normal_(one.head[2].weight, generator=generator())
    other.load_state_dict(one.state_dict())
    offsets = []
    for chooser in (one, other):
        cameras = chooser.train(training)(some_points())
        offsets.append(torch.stack([cameras.azimuth_deg, cameras.elevation_deg]) - torch.stack(chooser.start)[:, None])
    assert (offsets[0] - offsets[1]).abs().min() > 1e-3


def test_start_angles_enter_as_sines_and_cosines():
    one, other = (OffsetViews((torch.tensor([a]), torch.tensor([20.0]))) for a in (-180.0, 180.0))
    torch.nn.init.normal_(one.head[2].weight, generator=generator())
    other.load_state_dict(one.state_dict())
    torch.testing.assert_close(one(some_points()).rt, other(some_points()).rt, atol=1e-5, rtol=0)


@pytest.mark.parametrize("angles", ["periodic", "tanh"])
@pytest.mark.parametrize("num_views", [2, 6, 20])
def test_several_direct_views_start_near_the_layout(angles, num_views):
    cameras = selector("learned-direct", num_views, angles=angles)(some_points())
    azimuth, elevation = layouts("spherical", num_views)
    # tanh has no slope at ±180°, so that a view from behind starts at 162° there
    azimuth = np.clip((azimuth + 180) % 360 - 180, -162, 162) if angles == "tanh" else azimuth
    off = angle_between(cameras.azimuth_deg.detach(), cameras.elevation_deg.detach(), azimuth, elevation)
    assert off.max() < 12
    assert cameras.azimuth_deg.std(dim=0).min() > 0


def test_a_single_direct_view_starts_as_its_random_weights_say():
    starts = [selector("learned-direct", 1, seed=seed)(some_points()).azimuth_deg.detach() for seed in range(8)]
    assert np.std([float(start.mean()) for start in starts]) > 30


def test_tanh_form_stays_within_its_bounds_and_periodic_form_goes_all_around():
    points = some_points(64)
    for angles in ("periodic", "tanh"):
        chooser = selector("learned-direct", 1, angles=angles)
        torch.nn.init.normal_(chooser.head[2].weight, std=3.0, generator=generator())
        torch.nn.init.zeros_(chooser.head[2].bias)
        cameras = chooser(points)
        assert cameras.azimuth_deg.abs().max() <= 180 and cameras.elevation_deg.abs().max() <= 90


def test_offsets_keep_their_bounds():
    chooser = selector("learned-spherical", 6)
    torch.nn.init.normal_(chooser.head[2].weight, std=100.0, generator=generator())
    cameras = chooser(some_points())
    assert ((cameras.azimuth_deg - chooser.start_azimuth).abs() <= 30.001).all()
    assert ((cameras.elevation_deg - chooser.start_elevation).abs() <= 90.001).all()
    assert cameras.elevation_deg.abs().max() > 90  # the pole may be crossed


@pytest.mark.parametrize("views", LEARNED)
def test_exploration_moves_views_in_training_only(views):
    chooser = selector(views)
    plain = chooser.train()(some_points())
    noisy = chooser.train()(some_points(), explore_deg=20.0, generator=generator())
    assert (noisy.azimuth_deg - plain.azimuth_deg).abs().min() > 0
    still = chooser.eval()(some_points())
    quiet = chooser(some_points(), explore_deg=20.0, generator=generator())
    assert torch.equal(quiet.azimuth_deg, still.azimuth_deg)
    assert torch.equal(quiet.elevation_deg, still.elevation_deg)


def test_exploration_has_the_given_deviation_and_a_third_of_it_in_elevation():
    chooser, points = selector("learned-spherical"), torch.zeros(2000, 8, 3)
    noisy, plain = chooser(points, explore_deg=20.0, generator=generator()), chooser(points)
    azimuth = (noisy.azimuth_deg - plain.azimuth_deg).detach()
    elevation = (noisy.elevation_deg - plain.elevation_deg).detach()
    assert float(azimuth.std()) == pytest.approx(20.0, rel=0.03)
    assert float(elevation.std()) == pytest.approx(6.0, rel=0.03)
    assert abs(float(torch.corrcoef(torch.stack([azimuth.flatten(), elevation.flatten()]))[0, 1])) < 0.03


def test_gradient_at_the_explored_place_goes_to_the_prediction_unchanged():
    chooser = selector("learned-spherical")
    gradients = []
    for explore in (0.0, 30.0):
        chooser.zero_grad()
        cameras = chooser(some_points(), explore_deg=explore, generator=generator())
        (cameras.azimuth_deg * 2 + cameras.elevation_deg).sum().backward()
        gradients.append(chooser.head[2].weight.grad.clone())
    assert torch.equal(*gradients)


@pytest.mark.parametrize("views", ["jittered", "random", *LEARNED])
def test_all_draws_come_from_the_generator(views):
    chooser = selector(views).train()
    one, same, other = (
        chooser(some_points(), explore_deg=10.0, generator=generator(seed)).azimuth_deg for seed in (1, 1, 2)
    )
    assert torch.equal(one, same)
    assert not torch.equal(one, other)


def test_fixed_views_stay_and_have_nothing_to_learn():
    chooser = selector("fixed", layout="circular", elevation=10, azimuth=5, num_views=3).train()
    cameras = chooser(some_points(), explore_deg=45.0, generator=generator())
    assert cameras.azimuth_deg[2].tolist() == [5, 125, 245] and cameras.elevation_deg.unique().tolist() == [10]
    assert not list(chooser.parameters()) and not chooser.learned
    assert math.isnan(chooser.saturation())


def test_jitter_fills_the_bounds_of_the_learned_offsets_in_training_and_is_off_in_evaluation():
    chooser, points = selector("jittered", 6), torch.zeros(2000, 1, 3)
    cameras = chooser.train()(points, generator=generator())
    for got, start, bound in (
        (cameras.azimuth_deg, chooser.start_azimuth, 30),
        (cameras.elevation_deg, chooser.start_elevation, 90),
    ):
        offset = got - start
        assert offset.abs().max() <= bound
        assert float(offset.std()) == pytest.approx(bound / math.sqrt(3), rel=0.02)
    assert torch.equal(chooser.eval()(points).azimuth_deg[7], chooser.start_azimuth)


def test_random_views_are_uniform_on_the_sphere_and_repeat_in_evaluation():
    chooser, points = selector("random"), torch.zeros(2000, 1, 3)
    cameras = chooser.train()(points, generator=generator())
    heights = torch.sin(torch.deg2rad(cameras.elevation_deg)).flatten()
    for values, low, high in ((heights, -1, 1), (cameras.azimuth_deg.flatten(), -180, 180)):
        share = torch.histc(values, 8, low, high) / len(values)
        assert (share - 1 / 8).abs().max() < 4 * math.sqrt(7 / 64 / len(values))
    assert not torch.equal(chooser.train()(points).azimuth_deg, chooser(points).azimuth_deg)
    assert torch.equal(chooser.eval()(points).azimuth_deg, chooser(points).azimuth_deg)


@pytest.mark.parametrize(("views", "angles"), [("learned-spherical", "periodic"), ("learned-direct", "tanh")])
def test_t31_saturated_angles_are_counted(views, angles):
    chooser = selector(views, angles=angles)
    chooser(some_points())
    assert chooser.saturation() < 0.05
    torch.nn.init.constant_(chooser.head[2].bias, 4.0)
    chooser(some_points())
    assert chooser.saturation() == 1.0


@pytest.mark.parametrize(("views", "angles"), [*((views, "periodic") for views in LEARNED), ("learned-direct", "tanh")])
@pytest.mark.parametrize("scale", [0.0, 1e-20, 1.0, 1e6, 1e18])
def test_gradient_is_finite_for_extreme_points_and_weights(views, angles, scale):
    for weights in (0.0, 1.0, 1e3):
        chooser = selector(views, angles=angles)
        with torch.no_grad():
            for parameter in chooser.head[2].parameters():
                parameter.mul_(weights)
        cameras = chooser(some_points() * scale)
        pull(cameras).backward()
        assert torch.isfinite(cameras.rt).all()
        assert all(torch.isfinite(weight.grad).all() for weight in chooser.parameters())


def test_safe_angle_is_atan2_away_from_zero_and_bounded_at_it():
    y, x = (torch.randn(100, generator=generator(seed), requires_grad=True) for seed in (1, 2))
    SafeAngle.apply(y, x).sum().backward()
    y2, x2 = y.detach().double().requires_grad_(), x.detach().double().requires_grad_()
    torch.rad2deg(torch.atan2(y2, x2)).sum().backward()
    long = torch.hypot(y, x) > 0.3
    torch.testing.assert_close(y.grad[long].double(), y2.grad[long], rtol=2e-3, atol=1e-4)
    torch.testing.assert_close(x.grad[long].double(), x2.grad[long], rtol=2e-3, atol=1e-4)
    for length in (0.0, 1e-30, 1e-2, 1e30):
        y, x = (torch.tensor([part * length], requires_grad=True) for part in (0.6, 0.8))
        SafeAngle.apply(y, x).backward()
        assert torch.hypot(y.grad, x.grad) <= torch.rad2deg(torch.tensor(50.001))


def test_t25_views_are_the_same_under_autocast():
    chooser = selector("learned-direct", 4)
    plain = chooser(some_points())
    with torch.autocast("cpu", dtype=torch.bfloat16):
        cast = chooser(some_points())
    assert torch.equal(plain.azimuth_deg, cast.azimuth_deg) and cast.azimuth_deg.dtype == torch.float32


@pytest.mark.parametrize("norm", [False, True])
def test_point_encoder_sees_a_set(norm):
    encoder = PointNetEncoder((8, 16), norm=norm).eval()
    points = some_points()
    shuffled = points[:, torch.randperm(64, generator=generator())]
    torch.testing.assert_close(encoder(points), encoder(shuffled))
    torch.testing.assert_close(encoder(points), encoder(torch.cat([points, points[:, :5]], dim=1)))
    assert encoder(points).shape == (4, 16)
    assert (encoder(points)[0] - encoder(points)[1]).abs().max() > 1e-3


def test_point_features_tell_shapes_apart_before_anything_is_learned():
    elongated = some_points(32) * (1 + torch.arange(32)[:, None, None] % 3)
    plain, normed = (PointNetEncoder(norm_last=norm).train()(elongated) for norm in (False, True))
    assert normed.std(dim=0).median() > 0.9
    assert normed.mean(dim=0).abs().max() < 1e-4 < plain.mean(dim=0).abs().max()
