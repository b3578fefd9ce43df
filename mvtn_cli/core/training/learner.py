"""What learns: the networks as the loop sees them, and their optimisers."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.optim import AdamW, Optimizer

from mvtn_cli.config import TrainConfig
from mvtn_cli.core.networks.recogniser import Recogniser, Seen
from mvtn_cli.core.render import Look, ShapeBatch

CLASSIFIER, VIEWPOINTS = "classifier", "viewpoint network"


class Learner(nn.Module):
    """From a batch to its loss: what Fabric wraps. Only tensors come out, as Fabric looks into all others.

    Args:
        recogniser: What learns.
        label_smoothing: As in the settings.
        mixed: Matrix products and convolutions in bfloat16, which has the range of float32: losses need no scaling.
            Cameras and pictures stay in float32.
    """

    def __init__(self, recogniser: Recogniser, label_smoothing: float, *, mixed: bool = False) -> None:
        super().__init__()
        self.recogniser = recogniser
        self.label_smoothing = label_smoothing
        self.mixed = mixed

    def forward(
        self, batch: ShapeBatch, look: Look, explore_deg: float, generator: torch.Generator, seen: Seen | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Give loss (), logits (B, C) and images (B, M, 3, H, W), none of points; only the loss has a gradient."""
        with torch.autocast(self.recogniser.device.type, torch.bfloat16, enabled=self.mixed):
            output = self.recogniser(batch, look, explore_deg=explore_deg, generator=generator, seen=seen)
            labels = batch.labels.to(output.logits.device)
            loss = self.recogniser.loss(output, labels, self.label_smoothing)
        return loss, output.logits.detach(), output.images.detach()


def build_optimisers(model: Recogniser, config: TrainConfig) -> dict[str, Optimizer]:
    """AdamW for the classifier and, for learned views, AdamW for the viewpoint network.

    Each group carries its highest learning rate as `peak`; the schedules set `lr` before each step.

    Returns:
        By the name of the network: `classifier`, and perhaps `viewpoint network`.
    """
    groups = [
        {"params": group["params"], "peak": config.lr * group["lr_scale"]} for group in model.network_parameters()
    ]
    optimisers: dict[str, Optimizer] = {CLASSIFIER: AdamW(groups, weight_decay=config.weight_decay)}
    if model.selector.learned:
        views = [{"params": model.viewpoint_parameters(), "peak": config.views_lr}]
        optimisers[VIEWPOINTS] = AdamW(views, weight_decay=config.weight_decay)
    return optimisers


def parameters_of(optimiser: Optimizer) -> list[nn.Parameter]:
    """All parameters that an optimiser moves."""
    return [parameter for group in optimiser.param_groups for parameter in group["params"]]


def copy_buffers(model: nn.Module) -> dict[str, Tensor]:
    """Copies of what a forward pass changes by itself: the statistics of BatchNorm."""
    return {name: buffer.clone() for name, buffer in model.named_buffers()}


def restore_buffers(model: nn.Module, copies: dict[str, Tensor]) -> None:
    """Undo what a forward pass did to them; NaN in one batch would stay in running statistics for ever."""
    with torch.no_grad():
        for name, buffer in model.named_buffers():
            buffer.copy_(copies[name])
