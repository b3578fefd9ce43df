"""Layers that several networks are made of."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor, nn
from torch.nn import functional


class BatchNorm(nn.BatchNorm1d):
    """BatchNorm over all rows of (..., C).

    A single row has no variance: in training, too, it is normalised by the running statistics, so that a batch
    of one shape is no error.
    """

    def forward(self, input: Tensor) -> Tensor:  # noqa: A002  (the base class's name)
        rows = input.flatten(0, -2)
        normed = self.by_running(rows) if self.training and len(rows) == 1 else super().forward(rows)
        return normed.view_as(input)

    def by_running(self, rows: Tensor) -> Tensor:
        """Normalise (N, C, ...) by the running statistics, in training, too."""
        return functional.batch_norm(
            rows, self.running_mean, self.running_var, self.weight, self.bias, False, 0.0, self.eps
        )

    def by_moments(self, values: Tensor, mean: Tensor, variance: Tensor, count: int) -> Tensor:
        """Normalise (..., C) by the moments of something larger that `values` were taken from.

        Args:
            values: What is normalised.
            mean, variance: (C,), of `count` rows; they have a gradient, and the running statistics learn from
                them.
            count: Rows that the moments are of; a single one is normalised by the running statistics.
        """
        assert self.running_mean is not None and self.running_var is not None
        if count == 1:
            mean, variance = self.running_mean, self.running_var
        else:
            self._remember(mean.detach(), variance.detach() * count / (count - 1))
        return (values - mean) * (self.weight * torch.rsqrt(variance + self.eps)) + self.bias

    @torch.no_grad()
    def _remember(self, mean: Tensor, variance: Tensor) -> None:
        assert self.running_mean is not None and self.running_var is not None and self.num_batches_tracked is not None
        self.num_batches_tracked.add_(1)
        share = 1.0 / float(self.num_batches_tracked) if self.momentum is None else self.momentum
        self.running_mean.lerp_(mean, share)
        self.running_var.lerp_(variance, share)


def norm_layers(
    inputs: int,
    outputs: int,
    activation: Callable[[], nn.Module] | None = nn.ReLU,
    *,
    bias: bool = True,
    norm: bool = True,
    dropout: float = 0.0,
) -> list[nn.Module]:
    """Linear, BatchNorm, activation, dropout, on the last axis; each but the first can be left out."""
    layers: list[nn.Module] = [nn.Linear(inputs, outputs, bias=bias)]
    if norm:
        layers.append(BatchNorm(outputs))
    if activation is not None:
        layers.append(activation())
    if dropout > 0:
        layers.append(nn.Dropout(dropout))
    return layers


def leaky() -> nn.Module:
    """The LeakyReLU of View-GCN and DGCNN."""
    return nn.LeakyReLU(0.2)
