"""The graph of M views on the sphere: their order, their neighbours, a spread-out choice of them.

Regular layouts are full of ties. Distances are therefore compared to 1e-4, and ties go to the view that comes
first in an order made from the directions themselves, so that no answer depends on how the views are numbered.
"""

from __future__ import annotations

import torch
from torch import Tensor

STEPS = 1e4  # distances and heights are compared in steps of 1e-4
AZIMUTH_STEPS = 3600  # azimuths in tenths of a degree


def pick(values: Tensor, index: Tensor) -> Tensor:
    """Take views of each shape: (B, N, C) by (B, ...) int64 -> (B, ..., C)."""
    shapes = torch.arange(len(values), device=values.device)
    return values[shapes.view(-1, *[1] * (index.ndim - 1)), index]


@torch.no_grad()
def canonical_order(directions: Tensor) -> Tensor:
    """From the lowest view up, at one height by azimuth: (B, M, 3) unit vectors -> (B, M) int64."""
    height = (directions[..., 1] * STEPS).round().long()
    turn = torch.atan2(directions[..., 0], directions[..., 2]) / (2 * torch.pi)
    azimuth = (turn * AZIMUTH_STEPS).round().long() % AZIMUTH_STEPS
    return (height * AZIMUTH_STEPS + azimuth).argsort(dim=1, stable=True)


@torch.no_grad()
def nearest_views(directions: Tensor, centres: Tensor, count: int) -> Tensor:
    """The nearest views of some of the views, each view itself first.

    Args:
        directions: (B, N, 3).
        centres: (B, S) int64, which of them.
        count: K.

    Returns:
        (B, S, K) int64.
    """
    distance = _steps_apart(pick(directions, centres)[:, :, None], directions[:, None])
    distance.scatter_(2, centres[..., None], -1)  # also before others at the same place
    return distance.argsort(dim=2, stable=True)[..., :count]


@torch.no_grad()
def farthest_views(directions: Tensor, count: int, first: Tensor) -> Tensor:
    """Choose views one by one, each as far as can be from those chosen before; none comes twice.

    Args:
        directions: (B, N, 3).
        count: S, at most N.
        first: (B,) int64, to begin with.

    Returns:
        (B, S) int64.
    """
    chosen = [first]
    nearest = _steps_apart(pick(directions, first)[:, None], directions)
    for _ in range(count - 1):
        nearest.scatter_(1, chosen[-1][:, None], -1)
        chosen.append(nearest.argmax(dim=1))
        nearest = torch.minimum(nearest, _steps_apart(pick(directions, chosen[-1])[:, None], directions))
    return torch.stack(chosen, dim=1)


def _steps_apart(one: Tensor, other: Tensor) -> Tensor:
    """Squared distances of (..., 3) and (..., 3) in whole steps."""
    return ((one - other).square().sum(dim=-1) * STEPS).round()
