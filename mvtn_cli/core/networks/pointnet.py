"""Point encoders: from a point cloud to a feature vector."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor, nn


class PointNetEncoder(nn.Module):
    """The same small network for every point, then the maximum over the points.

    The order of the points does not matter, and copies of a point change nothing. It has no spatial
    transformers. By default it has no BatchNorm either, which would take away whatever is the same for all
    points and shapes.

    Args:
        widths: Of the layers; the last is the number of features. The paper's size is (64, 64, 64, 128,
            1024).
        norm: BatchNorm after each layer.

    References:
        Qi, Su, Mo, Guibas. PointNet: Deep Learning on Point Sets for 3D Classification and Segmentation.
        CVPR 2017.
    """

    def __init__(self, widths: Sequence[int] = (32, 64, 64), *, norm: bool = False) -> None:
        super().__init__()
        self.dimension = int(widths[-1])
        layers: list[nn.Module] = []
        for inputs, outputs in zip((3, *widths[:-1]), widths, strict=True):
            layers += [nn.Linear(inputs, outputs), *([_PointNorm(outputs)] if norm else []), nn.ReLU()]
        self.layers = nn.Sequential(*layers)

    def forward(self, points: Tensor) -> Tensor:
        """(B, P, 3) -> (B, widths[-1]), all >= 0."""
        features: Tensor = self.layers(points)
        return features.amax(dim=1)


class _PointNorm(nn.BatchNorm1d):
    """BatchNorm over all points of all shapes, for (B, P, C)."""

    def forward(self, input: Tensor) -> Tensor:  # noqa: A002  (the base class's name)
        return super().forward(input.flatten(0, 1)).view_as(input)
