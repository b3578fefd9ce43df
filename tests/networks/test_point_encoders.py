"""PointNet and DGCNN: their sizes, sets as input, the graph by brute force, and that they learn."""

from __future__ import annotations

import copy

import pytest
import torch
from torch import nn

from mvtn_cli.core.networks import DGCNN, PointClassifier, PointNet, build_encoder
from mvtn_cli.core.networks.dgcnn import EdgeConv, nearest_points
from mvtn_cli.core.networks.layers import BatchNorm
from mvtn_cli.core.networks.pointnet import TNet, not_orthogonal
from mvtn_cli.core.networks.points import ORTHOGONALITY
from mvtn_cli.errors import UsageError


def clouds(batch: int = 4, points: int = 50, seed: int = 0) -> torch.Tensor:
    return torch.randn(batch, points, 3, generator=torch.Generator().manual_seed(seed)) * 0.5


def weights_of(network: nn.Module) -> int:
    return sum(weight.numel() for weight in network.parameters())


def test_sizes_are_those_of_the_released_code_and_of_the_paper():
    """PointNet: MVTN's, counted by building it; DGCNN: by the sizes in its paper."""
    assert weights_of(build_encoder("pointnet", tnets=True)) == 3_467_457
    assert weights_of(build_encoder("pointnet")) == 3_467_457 - weights_of(TNet(3)) - weights_of(TNet(64))
    assert weights_of(build_encoder("dgcnn")) == weights_of(DGCNN(40)) == 1_809_576
    assert build_encoder("small").dimension == 64 and build_encoder("dgcnn").dimension == 40


@pytest.mark.parametrize("name", ["small", "pointnet", "dgcnn"])
def test_encoders_see_a_set(name):
    torch.manual_seed(0)
    encoder, points = build_encoder(name, tnets=True).eval(), clouds()
    features = encoder(points)
    assert features.shape == (4, encoder.dimension)
    torch.testing.assert_close(encoder(points[:, torch.randperm(50)]), features)
    torch.testing.assert_close(encoder(points[1:2]), features[1:2])
    assert (features[0] - features[1]).abs().max() > 1e-4


def test_transformers_begin_with_the_identity_and_then_turn_their_input():
    torch.manual_seed(0)
    plain, turned = PointNet(8).eval(), PointNet(8, tnets=True).eval()
    turned.load_state_dict({**turned.state_dict(), **plain.state_dict()})
    torch.testing.assert_close(turned(clouds()), plain(clouds()))
    torch.testing.assert_close(turned.describe(clouds())[1], torch.eye(64).expand(4, -1, -1))
    nn.init.normal_(turned.input_transform.head[-1].weight, std=0.1)
    assert (turned(clouds()) - plain(clouds())).abs().max() > 1e-3


def test_term_for_orthogonal_transforms_is_zero_for_rotations_and_known_for_a_stretch():
    turn = torch.linalg.qr(torch.randn(3, 5, 5, dtype=torch.float64)).Q
    assert not_orthogonal(turn) < 1e-20
    # I - (2 I)² = -3 I, whose squares sum to 9 · 5
    assert not_orthogonal(2 * torch.eye(5).expand(3, -1, -1)) == 45
    net, labels = PointClassifier("pointnet", 3, tnets=True), torch.tensor([0, 1, 2, 0])
    nn.init.normal_(net.encoder.feature_transform.head[-1].weight, std=0.1)
    output = net(clouds())
    terms = net.losses(output, labels)
    torch.testing.assert_close(terms["transform"], ORTHOGONALITY * not_orthogonal(output.extra["transform"]))
    assert set(PointClassifier("dgcnn", 3).losses(PointClassifier("dgcnn", 3)(clouds()), labels)) == {"classes"}


@pytest.mark.parametrize("channels", [3, 64])
@pytest.mark.parametrize("offset", [0.0, 100.0])
def test_nearest_points_are_those_of_a_full_table_however_it_is_cut(channels, offset):
    features = torch.randn(3, 40, channels, generator=torch.Generator().manual_seed(1)) + offset
    apart = torch.cdist(features.double(), features.double())
    for cells in (1, 500, 10**9):
        near = nearest_points(features, 7, cells=cells)
        torch.testing.assert_close(apart.gather(2, near), apart.sort(2).values[..., :7], rtol=0, atol=1e-3)
    assert nearest_points(features[:, :5], 7).shape == (3, 5, 5)


@pytest.mark.parametrize("momentum", [0.1, None])
@pytest.mark.parametrize("training", [True, False])
def test_edge_convolution_is_one_layer_on_each_pair(momentum, training):
    """Against the table of all pairs in float64: values, all gradients, and what BatchNorm remembers."""
    torch.manual_seed(0)
    layer = EdgeConv(6, 5, 4)
    layer.norm.momentum = momentum
    nn.init.normal_(layer.norm.weight)  # of both signs
    nn.init.uniform_(layer.norm.running_var)
    table, norm = copy.deepcopy(layer.pair).double(), copy.deepcopy(layer.norm).double().train(training)
    one = (torch.randn(2, 9, 6) + 3).requires_grad_()
    other = one.detach().double().requires_grad_()

    def by_table(features: torch.Tensor) -> torch.Tensor:
        near = nearest_points(features.detach(), 4)
        neighbours = torch.stack([cloud[index] for cloud, index in zip(features, near, strict=True)])
        own = features[:, :, None].expand_as(neighbours)
        return nn.functional.leaky_relu(norm(table(torch.cat([own, neighbours - own], dim=-1))), 0.2).amax(2)

    weight = torch.randn(2, 9, 5)
    for _ in range(2):
        found, expected = layer.train(training)(one), by_table(other)
        torch.testing.assert_close(found.double(), expected, rtol=1e-4, atol=1e-4)
    (found * weight).sum().backward()
    (expected * weight).sum().backward()
    mine = [one.grad, layer.pair.weight.grad, layer.norm.weight.grad, layer.norm.bias.grad]
    theirs = [other.grad, table.weight.grad, norm.weight.grad, norm.bias.grad]
    for got, wanted in zip(mine, theirs, strict=True):
        torch.testing.assert_close(got.double(), wanted, rtol=1e-3, atol=1e-3)
    for name, value in norm.named_buffers():
        torch.testing.assert_close(layer.norm.get_buffer(name).double(), value.double(), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("name", ["pointnet", "dgcnn"])
def test_classifier_learns_cubes_from_spheres(name):
    torch.manual_seed(0)
    net, labels = PointClassifier(name, 2), torch.arange(8) % 2
    points = clouds(8, 32)
    scale = torch.where(labels[:, None] == 0, points.norm(dim=-1), points.abs().amax(-1))
    points = points / scale[..., None]
    optimiser = torch.optim.AdamW(net.parameters(), 1e-3)
    for _ in range(12):
        optimiser.zero_grad()
        net.loss(net(points), labels).backward()
        optimiser.step()
    for layer in net.modules():
        if isinstance(layer, BatchNorm):
            layer.momentum = None
            layer.reset_running_stats()
    net(points)
    output = net.eval()(points)
    assert (output.logits.argmax(1) == labels).all() and output.descriptor.shape == (8, 256)
    torch.testing.assert_close(net.encoder.head[-1](output.descriptor), output.logits)


@pytest.mark.parametrize("name", ["small", "pointnet", "dgcnn"])
@pytest.mark.parametrize("scale", [0.0, 1e-20, 1.0, 1e6])
@pytest.mark.parametrize("batch", [1, 3])
def test_features_and_gradients_stay_finite_for_extreme_points_and_one_shape(name, scale, batch):
    encoder, points = build_encoder(name, tnets=True), clouds(batch, 12) * scale
    features = encoder(points.requires_grad_())
    features.square().sum().backward()
    assert torch.isfinite(features).all() and torch.isfinite(points.grad).all()


def test_single_row_is_normalised_by_the_running_statistics():
    layer = BatchNorm(3)
    layer(torch.randn(64, 3) * 3 + 1)
    row, before = torch.randn(1, 3), layer.running_mean.clone()
    assert torch.equal(layer.train()(row), layer.eval()(row)) and torch.equal(layer.running_mean, before)


def test_unknown_names_are_refused_with_the_nearest():
    with pytest.raises(UsageError, match="unknown encoder 'pointnt'; did you mean 'pointnet'"):
        build_encoder("pointnt")
    with pytest.raises(UsageError, match="unknown point classifier"):
        PointClassifier("small", 2)
