"""BatchNorm over a batch that several processes share: its moments are those of the whole batch.

torch's own SyncBatchNorm works on GPUs alone and takes the moments of all rows that there are; here a process without
a shape of its own still takes part, with weight zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, distributed, nn
from torch.autograd.function import once_differentiable
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

    def __deepcopy__(self, memo: dict[int, Any]) -> Exchange:
        """Itself: copies of layers exchange with the same processes, which can't be copied."""
        return self


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
        rows = input.flatten(0, -2) if self.channels_last else input
        count = rows.numel() // self.num_features // self.exchange.share.present * self.exchange.share.total
        if self.training and count > 1:
            normed, mean, variance = NormByWholeBatch.apply(
                rows, self.weight, self.bias, self.eps, count, self.exchange.group, self.exchange.share
            )
            self._remember(mean, variance * count / (count - 1))
        else:  # a single row has no variance
            normed = self.by_running(rows)
        # no needless view: an activation that works in place would copy all of its gradient
        return normed.view_as(input) if self.channels_last else normed

    def by_moments(self, values: Tensor, mean: Tensor, variance: Tensor, count: int) -> Tensor:
        """As the base class's, from the moments of the rows of this process."""
        share, group = self.exchange.share, self.exchange.group
        mean, variance = _of_all(SumOfProcesses.apply(_apart(mean, variance, share), group), share)
        return super().by_moments(values, mean, variance, count // share.present * share.total)


def _apart(mean: Tensor, variance: Tensor, share: Share) -> Tensor:
    """Moments (C,) of this process in a tensor (processes, 2, C) that has room for those of the others."""
    mine = torch.stack([mean, variance])
    return torch.stack([mine if rank == share.rank else torch.zeros_like(mine) for rank in range(share.size)])


def _of_all(each: Tensor, share: Share) -> tuple[Tensor, Tensor]:
    """Mean and biased variance (C,) of all rows, from (processes, 2, C)."""
    means, variances = each.unbind(1)
    weights = means.new_tensor(share.weights)[:, None]
    mean = (weights * means).sum(0)
    return mean, (weights * (variances + (means - mean).square())).sum(0)


class NormByWholeBatch(torch.autograd.Function):
    """BatchNorm of the rows of this process by the moments of those of all processes, with torch's own kernels.

    With x̂ = (x − mean) / std over all N rows, dx = w / std · (dy − Σdy / N − x̂ · Σ(dy · x̂) / N), where both sums are
    over all processes (Ioffe and Szegedy 2015, section 3).
    """

    @staticmethod
    def forward(
        ctx, rows: Tensor, weight: Tensor, bias: Tensor, eps: float, count: int, group: Any, share: Share
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Give rows (N, C, ...) normalised, and mean and biased variance (C,) of all `count` rows."""
        every = _apart(*torch.batch_norm_update_stats(rows.float(), None, None, 0.0), share)
        distributed.all_reduce(every, group=group)
        mean, variance = _of_all(every, share)
        ctx.save_for_backward(rows, weight, mean, torch.rsqrt(variance + eps))
        ctx.eps, ctx.count, ctx.group, ctx.counts_here = eps, count, group, share.own > 0
        ctx.mark_non_differentiable(mean, variance)
        return functional.batch_norm(rows, mean, variance, weight, bias, False, 0.0, eps), mean, variance

    @staticmethod
    @once_differentiable
    def backward(ctx, upstream: Tensor, *_: Tensor) -> tuple[Tensor | None, ...]:
        rows, weight, mean, inverse = ctx.saved_tensors
        _, to_weight, to_bias = torch.ops.aten.native_batch_norm_backward(
            upstream, rows, weight, None, None, mean, inverse, True, ctx.eps, [False, True, True]
        )
        sums = torch.stack([to_weight, to_bias]).float()
        distributed.all_reduce(sums, group=ctx.group)
        slope = weight * inverse
        # a borrowed shape has no part in the moments
        along, level = -slope / ctx.count * sums if ctx.counts_here else torch.zeros_like(sums)
        along = along * inverse
        spread = (1, -1) + (1,) * (rows.ndim - 2)
        to_rows = torch.addcmul((level - along * mean).view(spread), rows, along.view(spread))
        to_rows = to_rows.addcmul_(upstream, slope.view(spread)).to(rows.dtype)
        return to_rows, to_weight, to_bias, None, None, None, None


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
