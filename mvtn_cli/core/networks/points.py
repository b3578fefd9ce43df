"""What looks at points instead of pictures: whole classifiers, and the branch that is added to the views."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor, nn

from mvtn_cli.core.networks.dgcnn import DGCNN
from mvtn_cli.core.networks.encoders import build_encoder
from mvtn_cli.core.networks.heads import Answer, HeadOutput, MultiViewHead
from mvtn_cli.core.networks.pointnet import PointNet, not_orthogonal
from mvtn_cli.errors import choose_error
from mvtn_cli.network_config import POINT_NETWORKS

ORTHOGONALITY = 1e-3  # weight of its term in the loss, as in PointNet's paper
DROPOUT = 0.5


class PointClassifier(MultiViewHead):
    """A baseline that sees the points alone; views play no part.

    Args:
        name: "pointnet" or "dgcnn".
        classes: Number of classes C.
        tnets: Spatial transformers, for "pointnet" alone.

    Raises:
        UsageError: Unknown name.
    """

    uses_views = False

    def __init__(self, name: str, classes: int, *, tnets: bool = False) -> None:
        super().__init__()
        if name not in POINT_NETWORKS:
            raise choose_error("point classifier", name, POINT_NETWORKS)
        self.backbone = nn.Identity()  # of pictures
        self.encoder: PointNet | DGCNN = (
            PointNet(classes, tnets=tnets, dropout=DROPOUT) if name == "pointnet" else DGCNN(classes, dropout=DROPOUT)
        )

    def forward(self, points: Tensor, directions: Tensor | None = None) -> HeadOutput:
        """(B, P, 3) -> logits (B, C), and what the last layer sees: (B, 256)."""
        features, transform = self.encoder.describe(points)
        hidden = self.encoder.head[:-1](features)
        extra = {} if transform is None else {"transform": transform}
        return HeadOutput(self.encoder.head[-1](hidden), hidden, extra)

    def losses(self, output: Answer, labels: Tensor, label_smoothing: float = 0.0) -> dict[str, Tensor]:
        terms = super().losses(output, labels, label_smoothing)
        if "transform" in output.extra:
            terms["transform"] = ORTHOGONALITY * not_orthogonal(output.extra["transform"])
        return terms


class PointBranch(nn.Module):
    """Late fusion: what an encoder of its own says about the points is added to what the views say.

    Adding the two logits is the same as one linear classifier on both descriptors side by side.

    Args:
        encoder: As for `build_encoder`.
        classes: Number of classes C.
        tnets: As for `build_encoder`.
    """

    def __init__(self, encoder: str, classes: int, *, tnets: bool = False) -> None:
        super().__init__()
        self.encoder = build_encoder(encoder, tnets=tnets)
        self.classifier = nn.Linear(int(self.encoder.dimension), classes)  # type: ignore[arg-type]

    def forward(self, views: HeadOutput, points: Tensor) -> HeadOutput:
        """Join with (B, P, 3) points: the descriptors side by side, the logits added."""
        features = self.encoder(points)
        logits = self.classifier(features)
        return replace(
            views,
            logits=views.logits + logits,
            descriptor=torch.cat([views.descriptor, features], dim=1),
            extra={**views.extra, "points": logits},
        )
