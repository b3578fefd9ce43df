"""Random numbers of a batch that several processes share: drawn for the whole batch, each takes those of its shapes.

All processes have generators of the same seed, so that together they draw what one process would.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional
from torch.overrides import TorchFunctionMode

from mvtn_cli.core.networks.synced import Share
from mvtn_cli.core.render import Look


def look_of(share: Share, look: Look) -> Look:
    """The part of a whole batch's look that belongs to the shapes of this process."""
    light = look.light_direction
    return replace(look, colors=look.colors[share.rows], light_direction=None if light is None else light[share.rows])


class WholeBatchDraws(TorchFunctionMode):
    """While it is entered, what torch draws for the shapes of this process is drawn for the whole batch and cut.

    It knows the draws that the networks make: uniform and normal numbers (2, B, M) of cameras, whole numbers (B,) of
    View-GCN, and dropout with its relatives, whose rows (B · k, ...) belong to the shapes in order.

    Args:
        share: Of the batch at hand.
    """

    def __init__(self, share: Share) -> None:
        super().__init__()
        self.share = share

    def __torch_function__(
        self, func: Callable[..., Any], types: Any, args: Sequence[Any] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        kwargs = kwargs or {}
        if func in (torch.rand, torch.randn):
            axis, shapes, *rest = self._whole(args[0], 1)
            return func((axis, shapes, *rest), **kwargs)[:, self.share.rows]
        if func is torch.randint:
            return func(args[0], self._whole(args[1], 0), **kwargs)[self.share.rows]
        if func is functional.dropout:
            return self._dropout(*args, **kwargs)
        if func is torch.Tensor.bernoulli_:
            whole = args[0].new_empty(self._whole(args[0].shape, 0))
            return args[0].copy_(self._cut(func(whole, *args[1:], **kwargs)))
        return func(*args, **kwargs)

    def _dropout(self, values: Tensor, p: float = 0.5, training: bool = True, inplace: bool = False) -> Tensor:
        if not training or p == 0:
            return values
        whole = values.new_ones(self._whole(values.shape, 0))
        return values * self._cut(functional.dropout(whole, p, True))

    def _whole(self, shape: Sequence[int], axis: int) -> list[int]:
        """The size of the whole batch's numbers."""
        sizes = list(shape)
        if sizes[axis] % self.share.present:
            raise ValueError(f"numbers of size {tuple(shape)} are not of {self.share.present} shapes on axis {axis}")
        sizes[axis] = sizes[axis] // self.share.present * self.share.total
        return sizes

    def _cut(self, whole: Tensor) -> Tensor:
        """The rows of the shapes of this process."""
        each, rows = len(whole) // self.share.total, self.share.rows
        return whole[each * rows.start : each * rows.stop]
