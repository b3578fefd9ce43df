"""RotationNet: which picture was taken from where is part of the question."""

from __future__ import annotations

import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn
from torch.nn import functional

from mvtn_cli.core.networks.heads import Answer, HeadOutput, MultiViewHead


class RotationNet(MultiViewHead):
    """For each picture and each of M poses: is it this class, seen from this pose, or none (an incorrect view)?

    A shape may be turned by any rotation that maps the views onto themselves; each of these candidates assigns
    the M pictures to the M poses. A class's score under a candidate is the mean over the pictures of
    log p(class) - log p(incorrect) at the assigned poses, its logit the score of its best candidate. In training
    the best candidate of the true class is taken for right: its M (picture, pose) pairs get the label, all
    others "incorrect".

    Args:
        dimension: D, of the features.
        classes: Number of classes C.
        candidates: (G, M) permutations, row g naming the picture at each pose; see `layout_symmetries`.

    References:
        Kanezaki, Matsushita, Nishida. RotationNet: Joint Object Categorization and Pose Estimation Using
        Multiviews from Unsupervised Viewpoints. CVPR 2018, section 3.
    """

    learns_logits = False
    candidates: Tensor

    def __init__(self, dimension: int, classes: int, candidates: ArrayLike) -> None:
        super().__init__()
        table = torch.as_tensor(candidates, dtype=torch.int64)
        self.register_buffer("candidates", table, persistent=False)
        self.classifier = nn.Linear(dimension, table.shape[1] * (classes + 1))

    @property
    def num_views(self) -> int:
        """M."""
        return int(self.candidates.shape[1])

    def forward(self, features: Tensor, directions: Tensor | None = None) -> HeadOutput:
        """(B, M, D) -> logits (B, C), the mean feature (B, D), and all answers: (B, M pictures, M poses, C + 1)."""
        answers = self.classifier(features).unflatten(-1, (self.num_views, -1))
        logits = self.scores(answers).amax(dim=1)
        return HeadOutput(logits, features.mean(dim=1), {"answers": answers})

    def scores(self, answers: Tensor) -> Tensor:
        """Score of every candidate and class, (B, G, C), from the answers of all pictures.

        They are means, where the paper multiplies probabilities: the best is the same, and a softmax over them
        is no surer of itself for more views.
        """
        # the softmax's denominator cancels in log p(class) - log p(incorrect)
        odds = answers[..., :-1] - answers[..., -1:]
        poses = torch.arange(self.num_views, device=odds.device)
        return odds[:, self.candidates, poses].mean(dim=2)

    def losses(self, output: Answer, labels: Tensor, label_smoothing: float = 0.0) -> dict[str, Tensor]:
        answers = output.extra["answers"]
        targets = self.targets(answers, labels)
        loss = functional.cross_entropy(answers.flatten(0, 2), targets.flatten(), label_smoothing=label_smoothing)
        return {"views": loss}

    @torch.no_grad()
    def targets(self, answers: Tensor, labels: Tensor) -> Tensor:
        """What each answer should be, (B, M pictures, M poses): the label at the best candidate's pairs, else C."""
        shapes = torch.arange(len(labels), device=answers.device)
        best = self.scores(answers)[shapes, :, labels].argmax(dim=1)
        targets = torch.full(answers.shape[:3], answers.shape[-1] - 1, device=answers.device)
        poses = torch.arange(self.num_views, device=answers.device)
        targets[shapes[:, None], self.candidates[best], poses] = labels[:, None]
        return targets
