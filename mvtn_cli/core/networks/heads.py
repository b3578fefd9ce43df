"""What the networks for several views have in common: from the features of M views to a class."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from torch import Tensor, nn
from torch.nn import functional


class Answer(Protocol):
    """What a loss is made from: a `HeadOutput`, or the `Output` of the whole chain."""

    @property
    def logits(self) -> Tensor:
        """(B, C)."""

    @property
    def extra(self) -> Mapping[str, Tensor]:
        """What the loss needs besides."""


@dataclass(frozen=True)
class HeadOutput:
    """What a head says about B shapes.

    Attributes:
        logits: (B, C); the largest is the class, their softmax its probability.
        descriptor: (B, D), for retrieval.
        extra: What the head's loss needs besides, by name.
    """

    logits: Tensor
    descriptor: Tensor
    extra: Mapping[str, Tensor] = field(default_factory=dict)


class MultiViewHead(nn.Module):
    """Base of the heads.

    Attributes:
        learns_logits: Whether the loss is taken from `logits` themselves.
    """

    learns_logits = True

    def forward(self, features: Tensor, directions: Tensor) -> HeadOutput:
        """Classify B shapes.

        Args:
            features: (B, M, D) of the pictures.
            directions: (B, M, 3) unit vectors from the shape to the cameras that took them.
        """
        raise NotImplementedError

    def losses(self, output: Answer, labels: Tensor, label_smoothing: float = 0.0) -> dict[str, Tensor]:
        """The terms of the loss, by name; the loss is their sum.

        Args:
            output: Of `forward`.
            labels: (B,) int64.
            label_smoothing: Share of the target that is given to all classes.
        """
        return {"classes": functional.cross_entropy(output.logits, labels, label_smoothing=label_smoothing)}

    def loss(self, output: Answer, labels: Tensor, label_smoothing: float = 0.0) -> Tensor:
        """The sum of `losses`, ()."""
        first, *others = self.losses(output, labels, label_smoothing).values()
        return sum(others, start=first)


def cross_entropy_of_rows(logits: Tensor, labels: Tensor, label_smoothing: float) -> Tensor:
    """Mean over all rows (B, ..., C), each of which should say the shape's label (B,)."""
    rows = logits.flatten(1, -2)
    targets = labels[:, None].expand(rows.shape[:2])
    return functional.cross_entropy(rows.flatten(0, 1), targets.flatten(), label_smoothing=label_smoothing)
