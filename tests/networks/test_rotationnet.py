"""RotationNet: which pose each picture is given, and that turning a shape changes nothing but that."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from torch.nn import functional

from mvtn_cli.core.networks import RotationNet
from mvtn_cli.core.views import layout_symmetries, layouts

LAYOUTS = [("circular", 5), ("spherical", 6), ("dodecahedral", 20), ("icosahedral", 12)]


def head(layout: str, num_views: int, classes: int = 3) -> RotationNet:
    torch.manual_seed(0)
    return RotationNet(6, classes, layout_symmetries(layout, *layouts(layout, num_views)).permutations)


def features(num_views: int, batch: int = 4) -> torch.Tensor:
    return torch.randn(batch, num_views, 6, generator=torch.Generator().manual_seed(1))


@pytest.mark.parametrize(("layout", "num_views"), LAYOUTS)
def test_pictures_in_the_order_of_a_turned_shape_give_the_same_answer_and_loss(layout, num_views):
    net, labels = head(layout, num_views), torch.tensor([0, 1, 2, 1])
    plain = net(features(num_views))
    for turn in net.candidates[:: max(1, len(net.candidates) // 6)]:
        turned = net(features(num_views)[:, turn])
        torch.testing.assert_close(turned.logits, plain.logits)
        torch.testing.assert_close(turned.descriptor, plain.descriptor)
        torch.testing.assert_close(net.loss(turned, labels), net.loss(plain, labels))


def test_order_that_is_no_turn_does_change_the_answer():
    net = head("circular", 5)
    swapped = features(5)[:, [1, 0, 2, 3, 4]]
    assert (net(swapped).logits - net(features(5)).logits).abs().max() > 1e-3


def by_hand(net: RotationNet, answers: torch.Tensor, labels: list[int]) -> tuple[np.ndarray, float]:
    """Scores and loss in float64, one loop a sum."""
    chances = answers.double().softmax(-1).numpy()
    candidates, classes = net.candidates.numpy(), chances.shape[-1] - 1
    scores = np.zeros((len(chances), len(candidates), classes))
    for b, g, c in itertools.product(range(len(chances)), range(len(candidates)), range(classes)):
        pairs = [(candidates[g, k], k) for k in range(candidates.shape[1])]
        scores[b, g, c] = np.mean([np.log(chances[b, i, k, c] / chances[b, i, k, classes]) for i, k in pairs])
    total, count = 0.0, 0
    for b, label in enumerate(labels):
        right = candidates[scores[b, :, label].argmax()]
        for i, k in itertools.product(range(candidates.shape[1]), repeat=2):
            target = label if right[k] == i else classes
            total, count = total - np.log(chances[b, i, k, target]), count + 1
    return scores.max(axis=1), total / count


@pytest.mark.parametrize(("layout", "num_views"), [("circular", 4), ("spherical", 6)])
def test_scores_and_loss_are_those_of_the_definition(layout, num_views):
    net, labels = head(layout, num_views), [2, 0, 1, 1]
    output = net(features(num_views))
    logits, loss = by_hand(net, output.extra["answers"].detach(), labels)
    np.testing.assert_allclose(output.logits.detach().numpy(), logits, rtol=1e-4, atol=1e-5)
    assert net.loss(output, torch.tensor(labels)).item() == pytest.approx(loss, rel=1e-5)


def test_as_many_answers_get_the_label_as_there_are_views_and_in_each_pose_once():
    net = head("dodecahedral", 20)
    targets = net.targets(net(features(20)).extra["answers"], torch.tensor([0, 1, 2, 0]))
    right = targets != 3
    assert (right.sum(dim=1) == 1).all() and (right.sum(dim=2) == 1).all()
    assert [set(t[r].tolist()) for t, r in zip(targets, right, strict=True)] == [{0}, {1}, {2}, {0}]


def test_identity_alone_is_m_classifiers_for_m_poses():
    net = RotationNet(6, 3, [[0, 1, 2]])
    output = net(features(3))
    answers = output.extra["answers"][:, range(3), range(3)]
    torch.testing.assert_close(output.logits, (answers[..., :3] - answers[..., 3:]).mean(1))


def test_it_finds_out_how_turned_shapes_are_aligned():
    """Two classes with the same five features in another order, each shape turned by chance."""
    net, generator = head("circular", 5, classes=2), torch.Generator().manual_seed(2)
    looks = torch.randn(5, 6, generator=generator)
    orders = torch.tensor([[0, 1, 2, 3, 4], [0, 2, 4, 1, 3]])
    optimiser = torch.optim.AdamW(net.parameters(), 3e-2)

    def draw(count: int) -> tuple[torch.Tensor, torch.Tensor]:
        labels = torch.randint(2, (count,), generator=generator)
        turns = torch.randint(5, (count, 1), generator=generator)
        return looks[orders[labels][torch.arange(count)[:, None], (torch.arange(5) + turns) % 5]], labels

    for _ in range(150):
        shapes, labels = draw(32)
        optimiser.zero_grad()
        net.loss(net(shapes), labels).backward()
        optimiser.step()
    shapes, labels = draw(200)
    assert (net(shapes).logits.argmax(1) == labels).float().mean() > 0.99


@pytest.mark.parametrize("scale", [0.0, 1e-20, 1e10, 1e30])
def test_answers_stay_finite_for_extreme_features(scale):
    net = head("spherical", 6)
    given = (features(6) * scale).requires_grad_()
    output = net(given)
    loss = net.loss(output, torch.tensor([0, 1, 2, 1]))
    loss.backward()
    assert torch.isfinite(output.logits).all() and torch.isfinite(loss) and torch.isfinite(given.grad).all()


def test_smoothed_loss_is_that_of_all_answers():
    net, labels = head("circular", 5), torch.tensor([0, 1, 2, 1])
    output = net(features(5))
    answers = output.extra["answers"]
    expected = functional.cross_entropy(
        answers.reshape(-1, 4), net.targets(answers, labels).reshape(-1), label_smoothing=0.1
    )
    assert torch.equal(net.loss(output, labels, 0.1), expected)
