"""MVCNN: one picture network for all views, their features pooled, one linear classifier."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor, nn


class MVCNN(nn.Module):
    """Classify a shape from M pictures of it.

    Args:
        backbone: (N, 3, H, W) -> (N, D).
        dimension: D.
        classes: Number of classes C.
        pool: How the features of the views become one: their "max" (the paper's) or "mean".
        norm: LayerNorm in front of the classifier, as in the code released with MVTN.
        freeze_backbone: Leave the backbone's weights and BatchNorm statistics as they are. The gradient still
            passes through it to the pictures, and so to the cameras.

    References:
        Su, Maji, Kalogerakis, Learned-Miller. Multi-view Convolutional Neural Networks for 3D Shape
        Recognition. ICCV 2015.
    """

    def __init__(
        self,
        backbone: nn.Module,
        dimension: int,
        classes: int,
        *,
        pool: Literal["max", "mean"] = "max",
        norm: bool = False,
        freeze_backbone: bool = False,
    ) -> None:
        super().__init__()
        if pool not in ("max", "mean"):
            raise ValueError(f"pool must be 'max' or 'mean', got {pool!r}")
        # several times faster on CPUs for small and depth-wise convolutions
        self.backbone = backbone.to(memory_format=torch.channels_last)
        self.norm = nn.LayerNorm(dimension) if norm else nn.Identity()
        self.classifier = nn.Linear(dimension, classes)
        self.pool = pool
        self.frozen = freeze_backbone
        if freeze_backbone:
            self.backbone.requires_grad_(False)

    def train(self, mode: bool = True) -> MVCNN:
        super().train(mode)
        if self.frozen:
            self.backbone.eval()
        return self

    def forward(self, view_images: Tensor) -> tuple[Tensor, Tensor]:
        """(B, M, 3, H, W) pictures in [0, 1] -> logits (B, C), and what the classifier sees: (B, D)."""
        batch, views = view_images.shape[:2]
        pictures = view_images.flatten(0, 1).contiguous(memory_format=torch.channels_last)
        features = self.backbone(pictures).unflatten(0, (batch, views))
        pooled = features.amax(dim=1) if self.pool == "max" else features.mean(dim=1)
        descriptor = self.norm(pooled)
        return self.classifier(descriptor), descriptor
