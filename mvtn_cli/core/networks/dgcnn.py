"""DGCNN: each point learns from the points whose features are nearest to its own."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from mvtn_cli.core.networks.layers import BatchNorm, leaky, norm_layers

CELLS = 2**22  # of a table of distances at a time: 16 MiB


class DGCNN(nn.Module):
    """Four edge convolutions on graphs that are made anew from the features, then maximum and mean of the cloud.

    Widths 64, 64, 128, 256; 1024 of the four together; 512-256-outputs. With 40 outputs it has 1,809,576
    parameters.

    Args:
        outputs: Classes, or features for the viewpoint network.
        neighbours: K, of each point, itself included.
        dropout: After each hidden layer of the head.

    References:
        Wang, Sun, Liu, Sarma, Bronstein, Solomon. Dynamic Graph CNN for Learning on Point Clouds. TOG 2019.
    """

    WIDTHS = (64, 64, 128, 256)
    GLOBAL = 1024

    def __init__(self, outputs: int = 40, *, neighbours: int = 20, dropout: float = 0.0) -> None:
        super().__init__()
        self.dimension = outputs
        inputs = (3, *self.WIDTHS[:-1])
        self.edges = nn.ModuleList(EdgeConv(i, o, neighbours) for i, o in zip(inputs, self.WIDTHS, strict=True))
        self.embed = nn.Sequential(*norm_layers(sum(self.WIDTHS), self.GLOBAL, leaky, bias=False))
        self.head = nn.Sequential(
            *norm_layers(2 * self.GLOBAL, 512, leaky, bias=False, dropout=dropout),
            *norm_layers(512, 256, leaky, dropout=dropout),
            nn.Linear(256, outputs),
        )

    def forward(self, points: Tensor) -> Tensor:
        """(B, P, 3) -> (B, outputs)."""
        features, _ = self.describe(points)
        return self.head(features)

    def describe(self, points: Tensor) -> tuple[Tensor, None]:
        """(B, P, 3) -> the cloud's features (B, 2048); there are no transforms."""
        levels, features = [], points
        for edge in self.edges:
            features = edge(features)
            levels.append(features)
        embedded = self.embed(torch.cat(levels, dim=-1))
        return torch.cat([embedded.amax(dim=1), embedded.mean(dim=1)], dim=-1), None


class EdgeConv(nn.Module):
    """One layer on (x_i, x_j - x_i) for the K nearest j of each point i, then the maximum over j.

    A linear layer on a pair is a sum, a_i + b_j, so no table of all pairs is made: their maximum over j is a_i
    plus that of b_j (the minimum where BatchNorm turns the sign), and the moments that BatchNorm needs come from
    sums over j.

    Args:
        inputs, outputs: Widths.
        neighbours: K.
    """

    def __init__(self, inputs: int, outputs: int, neighbours: int) -> None:
        super().__init__()
        self.neighbours = neighbours
        self.pair = nn.Linear(2 * inputs, outputs, bias=False)
        self.norm = BatchNorm(outputs)

    def forward(self, features: Tensor) -> Tensor:
        """(B, P, inputs) -> (B, P, outputs)."""
        near = nearest_points(features.detach(), self.neighbours)
        to_own, to_step = self.pair.weight.chunk(2, dim=1)
        own = functional.linear(features, to_own - to_step).flatten(0, 1).float()
        other = functional.linear(features, to_step).flatten(0, 1).float()
        bags = (near + features.shape[1] * torch.arange(len(near), device=near.device)[:, None, None]).flatten(0, 1)
        sign = torch.where(self.norm.weight.detach() < 0, -1.0, 1.0)
        largest = own + sign * functional.embedding_bag(bags, sign * other, mode="max")
        if self.norm.training:
            normed = self.norm.by_moments(largest, *_moments(own, other, bags), bags.numel())
        else:
            normed = self.norm(largest)
        return functional.leaky_relu(normed, 0.2).unflatten(0, features.shape[:2])


def _moments(own: Tensor, other: Tensor, bags: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and variance (C,) of own[i] + other[j] over all rows i and the K rows j of bags[i]."""
    count = bags.shape[1]
    hits = other.new_ones(1).expand(bags.numel())
    # not bincount, for whose result a GPU is waited for
    often = other.new_zeros(len(other)).scatter_add_(0, bags.flatten(), hits)[:, None] / bags.numel()
    mean_own, mean_other = own.mean(dim=0), (often * other).sum(dim=0)
    own, other = own - mean_own, other - mean_other  # first, so that no digits are lost in the squares
    together = (own * functional.embedding_bag(bags, other, mode="sum")).mean(dim=0) / count
    variance = own.square().mean(dim=0) + 2 * together + (often * other.square()).sum(dim=0)
    return mean_own + mean_other, variance.clamp_min(0.0)


@torch.no_grad()
def nearest_points(features: Tensor, count: int, *, cells: int = CELLS) -> Tensor:
    """The nearest rows of each row, itself among them, without a table of all distances at once.

    Args:
        features: (B, P, C).
        count: K; at most P are given.
        cells: Distances that are held at a time.

    Returns:
        (B, P, min(K, P)) int64, nearest first.
    """
    batch, points, _ = features.shape
    centred = (features - features.mean(dim=1, keepdim=True)).float()  # fewer digits lost in the products below
    half_squares = centred.square().sum(dim=-1)[:, None] / 2
    rows = max(1, cells // (batch * points))
    # -|a - b|² / 2, without the part that is the same in a whole row
    parts = [(part @ centred.mT - half_squares).topk(min(count, points)).indices for part in centred.split(rows, dim=1)]
    return torch.cat(parts, dim=1)
