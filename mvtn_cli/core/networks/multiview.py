"""The classifier of pictures: one backbone for all views, a head, and what may be added to them."""

from __future__ import annotations

from typing import Any, Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from mvtn_cli.core.networks.heads import Answer, HeadOutput, MultiViewHead, cross_entropy_of_rows
from mvtn_cli.core.networks.points import PointBranch

Stage = Literal["views", "shapes"]


class MultiViewNetwork(nn.Module):
    """Classify a shape from M pictures of it.

    It may be trained in two stages (`stage`): in "views" every picture is classified by itself, by a linear
    layer that nothing else uses; in "shapes", which it starts in, the head does its work on the backbone that
    came out of that.

    Args:
        backbone: (N, 3, H, W) -> (N, D).
        head: (B, M, D) and directions (B, M, 3) -> logits.
        freeze_backbone: Leave the backbone's weights and BatchNorm statistics as they are. The gradient still
            passes through it to the pictures, and so to the cameras.
        view_classifier: (N, D) -> (N, C), for the stage "views"; None if there is none.
        points: Late fusion with a point encoder; None for pictures alone.
    """

    uses_views = True

    def __init__(
        self,
        backbone: nn.Module,
        head: MultiViewHead,
        *,
        freeze_backbone: bool = False,
        view_classifier: nn.Linear | None = None,
        points: PointBranch | None = None,
    ) -> None:
        super().__init__()
        # several times faster on CPUs for small and depth-wise convolutions
        self.backbone = backbone.to(memory_format=torch.channels_last)
        self.head = head
        self.view_classifier = view_classifier
        self.points = points
        self.stage: Stage = "shapes"
        self.frozen = freeze_backbone
        if freeze_backbone:
            self.backbone.requires_grad_(False)

    def train(self, mode: bool = True) -> MultiViewNetwork:
        super().train(mode)
        if self.frozen:
            self.backbone.eval()
        return self

    def forward(self, view_images: Tensor, directions: Tensor, points: Tensor | None = None) -> HeadOutput:
        """Classify B shapes.

        Args:
            view_images: (B, M, 3, H, W) in [0, 1].
            directions: (B, M, 3) unit vectors to their cameras.
            points: (B, P, 3), for late fusion.
        """
        pictures = view_images.flatten(0, 1).contiguous(memory_format=torch.channels_last)
        features = self.backbone(pictures).unflatten(0, view_images.shape[:2])
        if self.stage == "views":
            return self._each_view(features)
        output = self.head(features, directions)
        if self.points is None:
            return output
        if points is None:
            raise ValueError("late fusion needs the points of the shapes")
        return self.points(output, points)

    def _each_view(self, features: Tensor) -> HeadOutput:
        """Every picture by itself; a shape's logits are the mean log probabilities."""
        assert self.view_classifier is not None
        answers = self.view_classifier(features)
        return HeadOutput(answers.log_softmax(dim=-1).mean(dim=1), features.mean(dim=1), {"each view": answers})

    def losses(self, output: Answer, labels: Tensor, label_smoothing: float = 0.0) -> dict[str, Tensor]:
        """The terms of the loss, by name; the loss is their sum. Arguments as for `MultiViewHead.losses`."""
        if "each view" in output.extra:
            return {"each view": cross_entropy_of_rows(output.extra["each view"], labels, label_smoothing)}
        terms = self.head.losses(output, labels, label_smoothing)
        if self.points is not None and not self.head.learns_logits:
            # the head learns from its own terms; here the points learn to add what the views don't know
            added = output.extra["points"]
            logits = (output.logits - added).detach() + added
            terms["fused"] = functional.cross_entropy(logits, labels, label_smoothing=label_smoothing)
        return terms

    def loss(self, output: Answer, labels: Tensor, label_smoothing: float = 0.0) -> Tensor:
        """The sum of `losses`, ()."""
        first, *others = self.losses(output, labels, label_smoothing).values()
        return sum(others, start=first)

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *arguments: Any) -> None:
        # runs of version 0.1 knew no heads but MVCNN's, whose layers lay here
        for part in ("norm.", "classifier."):
            for name in [name for name in state_dict if name.startswith(prefix + part)]:
                state_dict[f"{prefix}head.{name.removeprefix(prefix)}"] = state_dict.pop(name)
        super()._load_from_state_dict(state_dict, prefix, *arguments)
