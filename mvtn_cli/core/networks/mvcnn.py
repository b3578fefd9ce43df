"""MVCNN: the features of the views pooled, one linear classifier."""

from __future__ import annotations

from typing import Literal

from torch import Tensor, nn

from mvtn_cli.core.networks.heads import HeadOutput, MultiViewHead


class MVCNN(MultiViewHead):
    """Pool the features of all views and classify what comes out; where the cameras stand plays no part.

    Args:
        dimension: D, of the features.
        classes: Number of classes C.
        pool: How the features of the views become one: their "max" (the paper's) or "mean".
        norm: LayerNorm in front of the classifier, as in the code released with MVTN.

    References:
        Su, Maji, Kalogerakis, Learned-Miller. Multi-view Convolutional Neural Networks for 3D Shape
        Recognition. ICCV 2015.
    """

    def __init__(
        self, dimension: int, classes: int, *, pool: Literal["max", "mean"] = "max", norm: bool = False
    ) -> None:
        super().__init__()
        if pool not in ("max", "mean"):
            raise ValueError(f"pool must be 'max' or 'mean', got {pool!r}")
        self.norm = nn.LayerNorm(dimension) if norm else nn.Identity()
        self.classifier = nn.Linear(dimension, classes)
        self.pool = pool

    def forward(self, features: Tensor, directions: Tensor | None = None) -> HeadOutput:
        """(B, M, D) -> logits (B, C), and what the classifier sees: (B, D)."""
        pooled = features.amax(dim=1) if self.pool == "max" else features.mean(dim=1)
        descriptor = self.norm(pooled)
        return HeadOutput(self.classifier(descriptor), descriptor)
