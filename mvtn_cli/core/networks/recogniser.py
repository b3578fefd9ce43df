"""The whole chain: points -> cameras -> pictures -> class."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from mvtn_cli.config import TrainConfig
from mvtn_cli.core.networks.build import build_network
from mvtn_cli.core.networks.heads import Answer
from mvtn_cli.core.networks.lighting import draw_lit
from mvtn_cli.core.networks.multiview import MultiViewNetwork, Stage
from mvtn_cli.core.networks.points import PointClassifier
from mvtn_cli.core.networks.rotationnet import RotationNet
from mvtn_cli.core.networks.run_files import is_run
from mvtn_cli.core.networks.selection import make_selector
from mvtn_cli.core.networks.settings import ClassifierSettings, SelectorSettings
from mvtn_cli.core.networks.viewpoint import Placement, ViewSelector
from mvtn_cli.core.render import Look, ShapeBatch, render
from mvtn_cli.core.render.tally import tally
from mvtn_cli.core.views import Cameras, camera_positions


@dataclass(frozen=True)
class Output:
    """What a `Recogniser` says about B shapes.

    Attributes:
        logits: (B, C).
        descriptor: (B, D), for retrieval.
        cameras: (B, M) cameras that the pictures were taken from, exploration included.
        images: (B, M, 3, H, W) pictures in [0, 1]; (B, 0, 3, H, W) from a network that looks at none.
        extra: What the loss needs besides.
    """

    logits: Tensor
    descriptor: Tensor
    cameras: Cameras
    images: Tensor
    extra: Mapping[str, Tensor] = field(default_factory=dict)


class Seen(NamedTuple):
    """Pictures that were taken before the networks are asked.

    Attributes:
        placement: (B, M) cameras.
        images: (B, M, 3, H, W) from them.
    """

    placement: Placement
    images: Tensor


class Recogniser(nn.Module):
    """Chooses the cameras of each shape, takes the pictures and classifies them.

    Args:
        selector: Where the cameras stand.
        network: Says the class, from pictures and the directions of their cameras, or from points.
        config: `encoder_points`, `gradient`, `fd_step` and `backbone_lr_scale` are used.
    """

    def __init__(
        self, selector: ViewSelector, network: MultiViewNetwork | PointClassifier, config: TrainConfig
    ) -> None:
        super().__init__()
        self.selector = selector
        self.network = network
        self.config = config

    @property
    def device(self) -> torch.device:
        """Where the networks are."""
        return self.selector.start_azimuth.device

    @property
    def uses_views(self) -> bool:
        """Whether pictures are taken at all."""
        return self.network.uses_views

    # From shapes to an answer, and from that to a loss

    def forward(
        self,
        batch: ShapeBatch,
        look: Look,
        *,
        explore_deg: float = 0.0,
        generator: torch.Generator | None = None,
        seen: Seen | None = None,
    ) -> Output:
        """Recognise B shapes; in training mode cameras and points have their random part, in evaluation none.

        Args:
            batch: B shapes.
            look: Of the pictures; learned lights take the place of its own.
            explore_deg: Noise on learned views in training.
            generator: Of everything random in this call, dropout and the sampling of View-GCN apart.
            seen: Their pictures, if there are some already; no others are taken then.
        """
        if seen is not None:
            return self.recognise(batch, look, seen.placement, generator, seen.images)
        return self.recognise(batch, look, self.place(batch, explore_deg=explore_deg, generator=generator), generator)

    def recognise(
        self,
        batch: ShapeBatch,
        look: Look,
        placement: Placement,
        generator: torch.Generator | None = None,
        images: Tensor | None = None,
    ) -> Output:
        """Recognise B shapes from given cameras, of pictures that there are or else are taken; else as `forward`."""
        cameras = placement.cameras
        if isinstance(self.network, PointClassifier):
            said = self.network(self._points(batch, generator))
            nothing = (len(batch), 0, 3, look.image_size, look.image_size)
            images = torch.zeros(nothing, device=said.logits.device)
            return Output(said.logits, said.descriptor, cameras, images, said.extra)
        images = self.take_pictures(batch, look, placement) if images is None else images.to(self.device)
        directions = camera_positions(cameras.azimuth_deg, cameras.elevation_deg, 1.0).to(images)
        points = self._points(batch, generator) if self.network.points is not None else None
        said = self.network(images, directions, points)
        return Output(said.logits, said.descriptor, cameras, images, said.extra)

    def losses(self, output: Answer, labels: Tensor, label_smoothing: float = 0.0) -> dict[str, Tensor]:
        """The terms of the loss of an output, by name; arguments as for `MultiViewHead.losses`."""
        return self.network.losses(output, labels, label_smoothing)

    def loss(self, output: Answer, labels: Tensor, label_smoothing: float = 0.0) -> Tensor:
        """Their sum, ()."""
        return self.network.loss(output, labels, label_smoothing)

    # Its parts

    def choose_cameras(
        self, batch: ShapeBatch, *, explore_deg: float = 0.0, generator: torch.Generator | None = None
    ) -> Cameras:
        """The cameras alone, without taking pictures; always float32, also under autocast."""
        return self.place(batch, explore_deg=explore_deg, generator=generator).cameras

    def place(
        self, batch: ShapeBatch, *, explore_deg: float = 0.0, generator: torch.Generator | None = None
    ) -> Placement:
        """Cameras and learned lights; in the stage "views" they are not taught."""
        points, wanted = batch.points, self.selector.encoder_points
        tally().count("point-encoder", len(batch) * (wanted == 0), len(batch))
        if wanted != 0:
            drawn = self.training and self.selector.learned
            points = points[:, self._subset(points.shape[1], wanted, generator, drawn=drawn)]
        placed = self.selector.place(
            points.to(self.device), explore_deg=explore_deg, generator=generator, training=self.training
        )
        if self.stage == "shapes":
            return placed
        return Placement(placed.cameras.detach(), None if placed.light is None else placed.light.detach())

    def take_pictures(self, batch: ShapeBatch, look: Look, placement: Placement) -> Tensor:
        """(B, M, 3, H, W) on the networks' device; points have no light."""

        def draw(cameras: Cameras, look: Look) -> Tensor:
            return render(batch, cameras, look, gradient=self.config.gradient, fd_step_deg=self.config.fd_step).rgb.to(
                self.device
            )

        if placement.light is None or look.kind == "points":
            return draw(placement.cameras, look)
        return draw_lit(draw, placement.cameras, look, placement.light)

    def for_drawing(self) -> Recogniser:
        """One with a copy of the selector on the CPU, which takes the same pictures in another thread."""
        return Recogniser(copy.deepcopy(self.selector).cpu(), self.network, self.config)

    def _points(self, batch: ShapeBatch, generator: torch.Generator | None) -> Tensor:
        """What a classifier sees of the points, (B, P, 3)."""
        kept = self._subset(batch.points.shape[1], None, generator, drawn=self.training)
        return batch.points[:, kept].to(self.device)

    def _subset(
        self, stored: int, wanted: int | None, generator: torch.Generator | None, *, drawn: bool
    ) -> Tensor | slice:
        """Stored points that an encoder sees: others in each training step, the first ones in evaluation."""
        count = min(wanted or self.config.encoder_points, stored)
        return torch.randperm(stored, generator=generator)[:count] if drawn else slice(count)

    # Its training

    @property
    def stage(self) -> Stage:
        """The stage of the training that it is in."""
        return self.network.stage if isinstance(self.network, MultiViewNetwork) else "shapes"

    @property
    def stages(self) -> tuple[Stage, ...]:
        """The stages that it is meant to be trained in, one after another; most have one, "shapes"."""
        two = isinstance(self.network, MultiViewNetwork) and self.network.view_classifier is not None
        return ("views", "shapes") if two else ("shapes",)

    def begin_stage(self, stage: Stage) -> None:
        """Enter a stage; a stage is no part of the state dict, and a network begins in "shapes".

        In "views" each picture is classified by itself and the cameras are not taught; the answers of that
        stage are no measure of the network.
        """
        if stage not in self.stages:
            raise ValueError(f"stage must be one of {self.stages}, got {stage!r}")
        if isinstance(self.network, MultiViewNetwork):
            self.network.stage = stage

    def viewpoint_parameters(self) -> list[nn.Parameter]:
        """Weights of the viewpoint network; none for views that are not learned."""
        return [weight for weight in self.selector.parameters() if weight.requires_grad]

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

    # What there is to say about it

    def facts(self) -> dict[str, Any]:
        """For a report: the network's name, its candidates where it has some, and how many weights there are."""
        settings, views = ClassifierSettings.of(self.config), SelectorSettings.of(self.config)
        parameters = {
            "classifier": sum(weight.numel() for weight in self.network.parameters()),
            "viewpoint network": sum(weight.numel() for weight in self.selector.parameters()),
        }
        facts: dict[str, Any] = {"network": settings.network, "parameters": parameters}
        if (head := self._rotation_net()) is not None:
            layout = None if views.starts_at_random else views.start_layout
            facts["candidates"] = {"count": len(head.candidates), "layout": layout}
        return facts

    def warnings(self) -> list[str]:
        """What a user should know before training, in sentences."""
        head = self._rotation_net()
        if head is None or len(head.candidates) > 1 or head.num_views == 1:
            return []
        return [
            f"no turn maps the views ({SelectorSettings.of(self.config).layout}, {head.num_views} of them) onto "
            "themselves, so RotationNet can't align shapes: try --layout circular, dodecahedral or icosahedral"
        ]

    def _rotation_net(self) -> RotationNet | None:
        head = self.network.head if isinstance(self.network, MultiViewNetwork) else None
        return head if isinstance(head, RotationNet) else None


def build_recogniser(config: TrainConfig, num_classes: int, *, read_weights: bool = True) -> Recogniser:
    """Build the networks of a training; their random weights depend on `config.seed` alone.

    Network and selector draw apart, so that trainings which differ in the selection of views alone start
    with the same classifier.

    Args:
        config: Of the training.
        num_classes: C.
        read_weights: False does not read (or download) `config.weights`, nor the run `config.views_from`: for
            a caller who loads a checkpoint next.

    Raises:
        MvtnError: As `build_network` and `make_selector`.
    """
    views_from = _views_from(config) if read_weights else None
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        network = build_network(config, num_classes, read_weights=read_weights)
        torch.manual_seed(config.seed + 1)
        selector = make_selector(config, views_from=views_from)
    return Recogniser(selector, network, config)


def _views_from(config: TrainConfig) -> Path | None:
    """The folder of the run that `--views-from` names, by its path or by its name in the folder of runs."""
    if config.views_from is None:
        return None
    named = Path(config.runs) / config.views_from
    return named if is_run(named) else Path(config.views_from)
