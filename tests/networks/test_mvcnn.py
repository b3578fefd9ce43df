"""MVCNN: pooling and nothing else."""

from __future__ import annotations

import pytest
import torch

from mvtn_cli.core.networks import MVCNN


@pytest.mark.parametrize("pool", ["max", "mean"])
def test_views_of_a_shape_are_pooled_in_any_order_and_never_mixed_with_other_shapes(pool):
    head = MVCNN(7, 5, pool=pool)
    features = torch.randn(2, 4, 7)
    output = head(features)
    expected = features.amax(1) if pool == "max" else features.mean(1)
    torch.testing.assert_close(output.descriptor, expected)
    torch.testing.assert_close(output.logits, head.classifier(expected))
    torch.testing.assert_close(head(features.flip(1)).logits, output.logits)
    torch.testing.assert_close(head(features[:1]).logits, output.logits[:1])


def test_layer_norm_is_part_of_the_descriptor_and_wrong_pool_is_refused():
    output = MVCNN(7, 5, norm=True)(torch.rand(2, 4, 7))
    torch.testing.assert_close(output.descriptor.mean(1), torch.zeros(2), atol=1e-6, rtol=0)
    with pytest.raises(ValueError, match="pool must be 'max' or 'mean'"):
        MVCNN(7, 5, pool="median")  # type: ignore[arg-type]


def test_loss_is_cross_entropy_with_smoothing():
    head, labels = MVCNN(7, 5), torch.tensor([0, 3])
    output = head(torch.randn(2, 4, 7))
    expected = torch.nn.functional.cross_entropy(output.logits, labels, label_smoothing=0.2)
    assert torch.equal(head.loss(output, labels, 0.2), expected)
    assert set(head.losses(output, labels)) == {"classes"}
