"""PointNet, small and at full size: from a point cloud to a feature vector."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

from mvtn_cli.core.networks.layers import BatchNorm, norm_layers

GLOBAL = 1024  # features of a cloud, after the maximum over its points


class PointNetEncoder(nn.Module):
    """The same small network for every point, then the maximum over the points.

    The order of the points does not matter, and copies of a point change nothing. It has no spatial
    transformers, and by default BatchNorm only on what comes out: untrained features of different shapes differ
    by a tenth of their size, so that without it whatever follows learns from what all shapes share, and cameras
    stay the same for all of them.

    Args:
        widths: Of the layers; the last is the number of features.
        norm: BatchNorm after each layer.
        norm_last: BatchNorm on the features, after the maximum.

    References:
        Qi, Su, Mo, Guibas. PointNet: Deep Learning on Point Sets for 3D Classification and Segmentation.
        CVPR 2017.
    """

    def __init__(self, widths: Sequence[int] = (32, 64, 64), *, norm: bool = False, norm_last: bool = True) -> None:
        super().__init__()
        self.dimension = int(widths[-1])
        self.layers = shared_layers((3, *widths), norm=norm)
        self.last = BatchNorm(self.dimension) if norm_last else nn.Identity()

    def forward(self, points: Tensor) -> Tensor:
        """(B, P, 3) -> (B, widths[-1])."""
        features: Tensor = self.last(self.layers(points).amax(dim=1))
        return features


class PointNet(nn.Module):
    """PointNet at its size in the paper released with MVTN: 64, 64-128-1024, maximum, 512-256-outputs.

    Args:
        outputs: Classes, or features for the viewpoint network.
        tnets: The two spatial transformers, of the points and of their first features.
        dropout: After each hidden layer of the head.
        norm_last: BatchNorm also on the outputs, as in the released code (which rectifies and drops them, too).

    References:
        As for `PointNetEncoder`.
    """

    def __init__(
        self, outputs: int = 40, *, tnets: bool = False, dropout: float = 0.0, norm_last: bool = False
    ) -> None:
        super().__init__()
        self.dimension = outputs
        self.input_transform = TNet(3) if tnets else None
        self.first = shared_layers((3, 64))
        self.feature_transform = TNet(64) if tnets else None
        self.second = shared_layers((64, 128, GLOBAL))
        self.head = classifier_head(GLOBAL, outputs, dropout=dropout, norm_last=norm_last)

    def forward(self, points: Tensor) -> Tensor:
        """(B, P, 3) -> (B, outputs)."""
        features, _ = self.describe(points)
        return self.head(features)

    def describe(self, points: Tensor) -> tuple[Tensor, Tensor | None]:
        """(B, P, 3) -> the cloud's features (B, 1024), and the transforms (B, 64, 64) of its points' features."""
        transform = None
        if self.input_transform is not None:
            points = points @ self.input_transform(points)
        features = self.first(points)
        if self.feature_transform is not None:
            transform = self.feature_transform(features)
            features = features @ transform
        return self.second(features).amax(dim=1), transform


class TNet(nn.Module):
    """A small PointNet that gives a linear map of the points' features; at first the identity.

    Args:
        size: K, of the features.
    """

    def __init__(self, size: int) -> None:
        super().__init__()
        self.size = size
        self.points = nn.Sequential(*shared_layers((size, 64, 128)), nn.Linear(128, GLOBAL))
        last = nn.Linear(256, size * size)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.head = nn.Sequential(*norm_layers(GLOBAL, 512), *norm_layers(512, 256), last)

    def forward(self, features: Tensor) -> Tensor:
        """(B, P, K) -> (B, K, K)."""
        change: Tensor = self.head(self.points(features).amax(dim=1))
        identity = torch.eye(self.size, device=change.device, dtype=change.dtype)
        return change.unflatten(-1, (self.size, self.size)) + identity


def shared_layers(widths: Sequence[int], *, norm: bool = True) -> nn.Sequential:
    """Layers that every point passes alike, (..., widths[0]) -> (..., widths[-1])."""
    layers = [norm_layers(inputs, outputs, norm=norm) for inputs, outputs in pairwise(widths)]
    return nn.Sequential(*(layer for group in layers for layer in group))


def classifier_head(inputs: int, outputs: int, *, dropout: float, norm_last: bool) -> nn.Sequential:
    """The head of PointNet: 512, 256, outputs."""
    return nn.Sequential(
        *norm_layers(inputs, 512, dropout=dropout),
        *norm_layers(512, 256, dropout=dropout),
        *norm_layers(256, outputs, None, norm=norm_last),
    )


def not_orthogonal(transform: Tensor) -> Tensor:
    """How far (B, K, K) maps are from keeping lengths: the mean of |I - A Aᵀ|², ()."""
    identity = torch.eye(transform.shape[-1], device=transform.device, dtype=transform.dtype)
    return (identity - transform @ transform.mT).square().sum(dim=(1, 2)).mean()
