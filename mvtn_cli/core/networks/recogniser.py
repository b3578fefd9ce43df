"""The whole chain: points -> cameras -> pictures -> class."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from mvtn_cli.config import TrainConfig
from mvtn_cli.core.networks.backbones import build_backbone
from mvtn_cli.core.networks.mvcnn import MVCNN
from mvtn_cli.core.networks.viewpoint import ViewSelector, make_selector
from mvtn_cli.core.render import Look, ShapeBatch, render
from mvtn_cli.core.views import Cameras


@dataclass(frozen=True)
class Output:
    """What a `Recogniser` says about B shapes.

    Attributes:
        logits: (B, C).
        descriptor: (B, D), what the classifier saw.
        cameras: (B, M) cameras that the pictures were taken from, exploration included.
        images: (B, M, 3, H, W) pictures in [0, 1].
    """

    logits: Tensor
    descriptor: Tensor
    cameras: Cameras
    images: Tensor


class Recogniser(nn.Module):
    """Chooses the cameras of each shape, takes the pictures and classifies them.

    Args:
        selector: Where the cameras stand.
        network: (B, M, 3, H, W) -> (logits, descriptor).
        config: `encoder_points`, `gradient`, `fd_step` and `backbone_lr_scale` are used.
    """

    def __init__(self, selector: ViewSelector, network: MVCNN, config: TrainConfig) -> None:
        super().__init__()
        self.selector = selector
        self.network = network
        self.config = config

    @property
    def device(self) -> torch.device:
        """Where the networks are."""
        return self.selector.start_azimuth.device

    def forward(
        self,
        batch: ShapeBatch,
        look: Look,
        *,
        explore_deg: float = 0.0,
        generator: torch.Generator | None = None,
    ) -> Output:
        """Recognise B shapes; in training mode cameras and points have their random part, in evaluation none.

        Args:
            batch: B shapes.
            look: Of the pictures.
            explore_deg: Noise on learned views in training.
            generator: Of everything random in this call.
        """
        cameras = self.choose_cameras(batch, explore_deg=explore_deg, generator=generator)
        images = render(batch, cameras, look, gradient=self.config.gradient, fd_step_deg=self.config.fd_step).rgb.to(
            self.device
        )
        logits, descriptor = self.network(images)
        return Output(logits, descriptor, cameras, images)

    def choose_cameras(
        self, batch: ShapeBatch, *, explore_deg: float = 0.0, generator: torch.Generator | None = None
    ) -> Cameras:
        """The cameras alone, without taking pictures; always float32, also under autocast."""
        points = batch.points
        if self.selector.learned:
            points = points[:, self._subset(points.shape[1], generator)]
        return self.selector(
            points.to(self.device), explore_deg=explore_deg, generator=generator, training=self.training
        )

    def _subset(self, stored: int, generator: torch.Generator | None) -> Tensor | slice:
        """Stored points that the encoder sees: others in each training step, the first ones in evaluation."""
        count = min(self.config.encoder_points, stored)
        if not self.training:
            return slice(count)
        return torch.randperm(stored, generator=generator)[:count]

    def viewpoint_parameters(self) -> list[nn.Parameter]:
        """Weights of the viewpoint network; none for views that are not learned."""
        return list(self.selector.parameters())

    def network_parameters(self) -> list[dict[str, Any]]:
        """Groups for the classifier's optimiser: `name`, `params` and `lr_scale`, what to multiply --lr with.

        The backbone's group is left out if it is frozen.
        """
        backbone = [weight for weight in self.network.backbone.parameters() if weight.requires_grad]
        own = {id(weight) for weight in self.network.backbone.parameters()}
        head = [weight for weight in self.network.parameters() if id(weight) not in own]
        groups = [{"name": "head", "params": head, "lr_scale": 1.0}]
        if backbone:
            groups.append({"name": "backbone", "params": backbone, "lr_scale": self.config.backbone_lr_scale})
        return groups


def build_recogniser(config: TrainConfig, num_classes: int, *, read_weights: bool = True) -> Recogniser:
    """Build the networks of a training; their random weights depend on `config.seed` alone.

    Network and selector draw apart, so that trainings which differ in the selection of views alone start
    with the same classifier.

    Args:
        config: Of the training.
        num_classes: C.
        read_weights: False does not read (or download) `config.weights`: for a caller who loads a checkpoint
            next.

    Raises:
        MvtnError: As `build_backbone`.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        backbone, dimension = build_backbone(config.backbone, config.weights, read=read_weights)
        network = MVCNN(backbone, dimension, num_classes, pool=config.pool, freeze_backbone=config.freeze_backbone)
        torch.manual_seed(config.seed + 1)
        selector = make_selector(config)
    return Recogniser(selector, network, config)
