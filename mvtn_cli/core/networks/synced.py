"""BatchNorm over a batch that several processes share: its moments are those of the whole batch.

torch's own SyncBatchNorm works on GPUs alone and takes the moments of all rows that there are; here a process without
a shape of its own still takes part, with weight zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, distributed, nn
from torch.nn import functional
from torch.nn.modules.batchnorm import _BatchNorm

from mvtn_cli.core.networks.layers import BatchNorm


@dataclass(frozen=True)
class Share:
    """Which shapes of a batch are this process's: contiguous ones, as evenly as can be.

    A process that gets none takes the first one with weight zero: all processes must call the same exchanges.

    Attributes:
        total: Shapes of the whole batch.
        rank: Of this process, from 0.
        size: Number of processes.
    """

    total: int
    rank: int = 0
    size: int = 1

    @property
    def counts(self) -> list[int]:
        """Shapes of each process."""
        return [self.total // self.size + (rank < self.total % self.size) for rank in range(self.size)]

    @property
    def weights(self) -> list[float]:
        """What part of the batch is each process's, sum 1."""
        return [count / self.total for count in self.counts]

    @property
    def weight(self) -> float:
        """What part of the batch is this process's; 0 for a borrowed shape."""
        return self.weights[self.rank]

    @property
    def own(self) -> int:
        """Shapes of this process; 0 if it borrows one."""
        return self.counts[self.rank]

    @property
    def rows(self) -> slice:
        """Where its shapes are in the batch."""
        start = sum(self.counts[: self.rank])
        return slice(start, start + self.own) if self.own else slice(0, 1)

    @property
    def present(self) -> int:
        """Shapes that it computes, a borrowed one included."""
        return self.rows.stop - self.rows.start


@dataclass
class Exchange:
    """What all synchronised layers of a model hang on.

    Attributes:
        group: Of processes, for these layers alone: their exchanges can't get among others.
        share: Of the batch at hand; set before each forward pass in training mode.
    """

    group: Any
    share: Share


class SyncedBatchNorm(BatchNorm):
    """A BatchNorm of any kind, with the same weights, buffers and names, that normalises by the whole batch's moments.

    Args:
        layer: What it takes the place of; its weights and buffers are taken over, not copied.
        exchange: With whom.
    """

    def __init__(self, layer: _BatchNorm, exchange: Exchange) -> None:
        super().__init__(layer.num_features, layer.eps, layer.momentum)
        self.weight, self.bias = layer.weight, layer.bias
        self.running_mean, self.running_var = layer.running_mean, layer.running_var
        self.num_batches_tracked = layer.num_batches_tracked
        self.channels_last = isinstance(layer, BatchNorm)  # (..., C), where torch's own layers have (N, C, ...)
        self.exchange = exchange
        self.train(layer.training)

    def forward(self, input: Tensor) -> Tensor:  # noqa: A002  (the base class's name)
        if not self.training:
            rows = input.flatten(0, -2) if self.channels_last else input
            return functional.batch_norm(
                rows, self.running_mean, self.running_var, self.weight, self.bias, False, 0.0, self.eps
            ).view_as(input)
        values = input if self.channels_last else input.movedim(1, -1)
        variance, mean = torch.var_mean(values.float(), tuple(range(values.ndim - 1)), correction=0)
        normed = self.by_moments(values, mean, variance, values.shape[:-1].numel()).to(input.dtype)
        return normed if self.channels_last else normed.movedim(-1, 1)

    def by_moments(self, values: Tensor, mean: Tensor, variance: Tensor, count: int) -> Tensor:
        """As the base class's, from the moments of the rows of this process."""
        share = self.exchange.share
        mine = torch.stack([mean, variance])
        each = [mine if rank == share.rank else torch.zeros_like(mine) for rank in range(share.size)]
        means, variances = SumOfProcesses.apply(torch.stack(each), self.exchange.group).unbind(1)
        weights = mean.new_tensor(share.weights)[:, None]
        mean = (weights * means).sum(0)
        variance = (weights * (variances + (means - mean).square())).sum(0)
        return super().by_moments(values, mean, variance, count // share.present * share.total)


class SumOfProcesses(torch.autograd.Function):
    """The sum of a tensor over all processes; what each of them learns from it goes back to all."""

    @staticmethod
    def forward(ctx, values: Tensor, group: Any) -> Tensor:
        ctx.group = group
        total = values.clone()
        distributed.all_reduce(total, group=group)
        return total

    @staticmethod
    def backward(ctx, upstream: Tensor) -> tuple[Tensor, None]:
        total = upstream.clone()
        distributed.all_reduce(total, group=ctx.group)
        return total, None


def synchronise_batch_norm(model: nn.Module, exchange: Exchange) -> None:
    """Put a `SyncedBatchNorm` in the place of every BatchNorm that learns its statistics; names stay as they are."""
    for name, layer in list(model.named_children()):
        if isinstance(layer, _BatchNorm) and layer.affine and layer.track_running_stats:
            setattr(model, name, SyncedBatchNorm(layer, exchange))
        else:
            synchronise_batch_norm(layer, exchange)
