"""View-GCN: against a twin with loops, for any number of views, and in no case by how they are numbered."""

from __future__ import annotations

import pytest
import torch
from torch.nn import functional

from mvtn_cli.core.networks import ViewGCN
from mvtn_cli.core.networks.view_graph import canonical_order, farthest_views, nearest_views
from mvtn_cli.core.networks.viewgcn import doubt
from mvtn_cli.core.views import camera_positions, layouts
from mvtn_cli.errors import UsageError


def head(num_views: int = 12, width: int | None = None, dimension: int = 6) -> ViewGCN:
    torch.manual_seed(0)
    return ViewGCN(dimension, 3, num_views, width=width)


def angles(num_views: int, batch: int = 4, spread: float = 20.0) -> tuple[torch.Tensor, torch.Tensor]:
    azimuth, elevation = (torch.from_numpy(a).float() for a in layouts("spherical", num_views))
    noise = torch.randn(2, batch, num_views, generator=torch.Generator().manual_seed(3)) * spread
    return azimuth + noise[0], elevation + noise[1]


def inputs(num_views: int = 12, batch: int = 4, spread: float = 20.0) -> tuple[torch.Tensor, torch.Tensor]:
    features = torch.randn(batch, num_views, 6, generator=torch.Generator().manual_seed(1))
    return features, camera_positions(*angles(num_views, batch, spread), 1.0).float()


def stirred(num_views: int = 12) -> ViewGCN:
    """A head in evaluation mode whose BatchNorm statistics are not the ones that it is made with."""
    net = head(num_views).train()
    with torch.no_grad():
        net(*inputs(num_views, 8))
    return net.eval()


def margin(logits: torch.Tensor) -> float:
    """Log odds of the largest logit against all others."""
    *others, best = logits.sort().values
    return float(best - torch.stack(others).logsumexp(0))


def twin(net: ViewGCN, features: torch.Tensor, directions: torch.Tensor) -> tuple[torch.Tensor, list[torch.Tensor]]:
    """One shape in float64, one sum at a time; the neighbours alone come from the same functions."""
    net = net.double()
    order = canonical_order(directions[None])[0]
    f, v, pooled, sampled = features.double()[order], directions.double()[order], [], []
    for level in range(3):
        layer, near = net.local[level], nearest_views(v[None], torch.arange(len(v))[None], 4)[0]
        sums = []
        for i in range(len(v)):
            edges = [torch.cat([v[i], v[j], v[i] - v[j], (v[i] - v[j]).norm()[None]]) for j in near[i]]
            sums.append(sum(layer.edge(edge) * f[j] for edge, j in zip(edges, near[i], strict=True)))
        f = torch.stack([layer.layer(row[None])[0] for row in sums])
        pooled.append(f.amax(0))
        if level == 2:
            break
        far = net.non_local[level]
        messages = [sum(far.relation(far.pair(torch.cat([own, other]))) for other in f) for own in f]
        f = torch.stack([far.fusion(torch.cat(pair)[None])[0] for pair in zip(f, messages, strict=True)])
        sampler = net.samplers[level]
        centres = farthest_views(v[None], sampler.count, torch.tensor([0]))[0]
        groups = nearest_views(v[None], centres[None], 4)[0]
        by_rank = [sampler.classifier(torch.cat([f[g] for g in groups[:, rank]])).view(sampler.count, -1)
                   for rank in range(4)]  # fmt: skip
        logits = torch.stack(by_rank, dim=1)
        surest = [max(range(4), key=lambda rank: margin(group[rank])) for group in logits]
        kept = groups[range(len(groups)), surest]
        f, v = f[kept], v[kept]
        sampled.append(logits.flatten(0, 1))
    return net.classifier(torch.cat(pooled)), sampled


@pytest.mark.parametrize("num_views", [4, 7, 12, 20])
@torch.no_grad()
def test_answers_are_those_of_a_twin_with_loops(num_views):
    net = stirred(num_views)
    features, directions = inputs(num_views)
    output = net(features, directions)
    for shape in range(2):
        logits, sampled = twin(net, features[shape], directions[shape])
        torch.testing.assert_close(output.logits[shape].double(), logits, rtol=1e-3, atol=1e-4)
        torch.testing.assert_close(output.extra["samplers"][shape].double(), torch.cat(sampled), rtol=1e-3, atol=1e-4)
        net.float()


@pytest.mark.parametrize("spread", [0.0, 20.0])
@pytest.mark.parametrize("num_views", [4, 9, 12, 20])
def test_numbering_of_the_views_plays_no_part(num_views, spread):
    """Also in a regular layout, where every distance comes several times."""
    net = stirred(num_views)
    features, directions = inputs(num_views, spread=spread)
    plain = net(features, directions)
    for seed in range(3):
        order = torch.randperm(num_views, generator=torch.Generator().manual_seed(seed))
        output = net(features[:, order], directions[:, order])
        torch.testing.assert_close(output.logits, plain.logits)
        torch.testing.assert_close(output.descriptor, plain.descriptor)
    assert (net(features[:, order], directions).logits - plain.logits).abs().max() > 1e-3


def test_parameters_are_as_many_as_in_the_paper():
    """With ResNet-18 (11,176,512 weights) and its unused classifier of 40 views each: the paper's 23.56 M."""
    count = sum(weight.numel() for weight in ViewGCN(512, 40, 12).parameters())
    assert count + 11_176_512 + 512 * 40 + 40 == 23_561_941


@pytest.mark.parametrize(("num_views", "kept"), [(4, (4, 4)), (5, (4, 4)), (12, (6, 4)), (20, (10, 5)), (33, (16, 8))])
def test_levels_have_half_and_a_quarter_of_the_views_and_at_least_four(num_views, kept):
    net = head(num_views)
    output = net(*inputs(num_views))
    assert tuple(sampler.count for sampler in net.samplers) == kept
    assert output.logits.shape == (4, 3) and output.descriptor.shape == (4, 18)
    assert output.extra["samplers"].shape == (4, 4 * sum(kept), 3)


def test_three_views_are_too_few_and_another_width_goes_through_a_layer():
    with pytest.raises(UsageError, match="at least 4 views, not 3") as caught:
        head(3)
    assert "--num-views 4" in caught.value.hint
    assert head(12, width=5)(*inputs()).descriptor.shape == (4, 15)
    assert ViewGCN(1024, 3, 4)(torch.randn(2, 4, 1024), inputs(4, 2)[1]).descriptor.shape == (2, 3 * 512)


def test_loss_is_that_of_the_shape_and_of_all_samplers():
    net, labels = head().eval(), torch.tensor([0, 1, 2, 1])
    output = net(*inputs())
    terms = net.losses(output, labels)
    samplers = output.extra["samplers"]
    expected = functional.cross_entropy(samplers.reshape(-1, 3), labels.repeat_interleave(samplers.shape[1]))
    torch.testing.assert_close(terms["samplers"], expected)
    torch.testing.assert_close(net.loss(output, labels), functional.cross_entropy(output.logits, labels) + expected)


def test_directions_get_a_gradient_of_the_graph_alone_and_it_is_the_slope():
    """Features held still: what moves is the weight of the edges."""
    net, labels = stirred(5).double(), torch.tensor([0, 1])
    features = inputs(5, 2)[0].double()
    azimuth, elevation = (a.double().requires_grad_() for a in angles(5, 2))

    def loss(azimuth: torch.Tensor, elevation: torch.Tensor) -> torch.Tensor:
        return net.loss(net(features, camera_positions(azimuth, elevation, 1.0)), labels)

    loss(azimuth, elevation).backward()
    assert azimuth.grad.abs().min() > 0 and elevation.grad.abs().min() > 0
    step = torch.zeros_like(azimuth)
    step[1, 2] = 1e-4
    with torch.no_grad():
        slope = (loss(azimuth + step, elevation) - loss(azimuth - step, elevation)) / 2e-4
    assert azimuth.grad[1, 2].item() == pytest.approx(slope.item(), rel=1e-4)


def test_surest_row_is_found_also_where_probabilities_round_to_one():
    logits = torch.tensor([[[0.0, 40.0, 1.0], [0.0, 50.0, 1.0], [1.0, 2.0, 3.0]]])
    assert logits.softmax(-1).amax(-1)[0, 0] == logits.softmax(-1).amax(-1)[0, 1] == 1
    assert doubt(logits).argsort()[0].tolist() == [1, 0, 2]
    generator = torch.Generator().manual_seed(0)
    rows = torch.randn(50, 4, 5, generator=generator)
    assert torch.equal(doubt(rows).argmin(-1), rows.double().softmax(-1).amax(-1).argmax(-1))


def test_coinciding_cameras_do_no_harm():
    net = stirred()
    features, directions = inputs()
    same = directions[:, :1].expand_as(directions).clone().requires_grad_()
    output = net.train()(features, same)
    net.loss(output, torch.tensor([0, 1, 2, 1])).backward()
    assert torch.isfinite(output.logits).all() and torch.isfinite(same.grad).all()


@pytest.mark.parametrize("scale", [0.0, 1e-20, 1e6, 1e12])
@pytest.mark.parametrize("training", [True, False])
def test_answers_and_gradients_stay_finite_for_extreme_features(scale, training):
    net = stirred().train(training)
    features, directions = inputs()
    given, towards = (features * scale).requires_grad_(), directions.clone().requires_grad_()
    output = net(given, towards)
    loss = net.loss(output, torch.tensor([0, 1, 2, 1]))
    loss.backward()
    assert torch.isfinite(output.logits).all() and torch.isfinite(loss)
    assert torch.isfinite(given.grad).all() and torch.isfinite(towards.grad).all()


def test_choice_starts_by_chance_in_training_and_repeats_in_evaluation():
    net = head()
    torch.manual_seed(5)
    one = net.train()(*inputs()).extra["samplers"]
    torch.manual_seed(6)
    other = net(*inputs()).extra["samplers"]
    torch.manual_seed(5)
    assert torch.equal(net(*inputs()).extra["samplers"], one) and not torch.equal(one, other)
    net.eval()
    assert torch.equal(net(*inputs()).logits, net(*inputs()).logits)


def test_one_shape_alone_can_be_trained_on():
    output = head().train()(*inputs(batch=1))
    assert torch.isfinite(output.logits).all()


def test_it_learns_two_classes_that_differ_by_where_a_feature_is_seen():
    """The same features from above or from below: only the directions tell the classes apart."""
    net, generator = head(8, width=16), torch.Generator().manual_seed(2)
    directions = inputs(8, 16, spread=5.0)[1]
    labels = torch.arange(16) % 2
    above = (directions[..., 1] > 0) == labels[:, None].bool()
    features = torch.randn(16, 8, 6, generator=generator) * 0.1 + above[..., None].float()
    optimiser = torch.optim.AdamW(net.parameters(), 3e-3)
    for _ in range(40):
        optimiser.zero_grad()
        net.loss(net(features, directions), labels).backward()
        optimiser.step()
    assert (net.eval()(features, directions).logits.argmax(1) == labels).float().mean() == 1
