"""The network of a configuration that says the class."""

from __future__ import annotations

from typing import Any

from torch import nn

from mvtn_cli.core.networks.backbones import build_backbone
from mvtn_cli.core.networks.heads import MultiViewHead
from mvtn_cli.core.networks.multiview import MultiViewNetwork
from mvtn_cli.core.networks.mvcnn import MVCNN
from mvtn_cli.core.networks.points import PointBranch, PointClassifier
from mvtn_cli.core.networks.rotationnet import RotationNet
from mvtn_cli.core.networks.settings import ClassifierSettings, SelectorSettings
from mvtn_cli.core.networks.viewgcn import ViewGCN
from mvtn_cli.core.views import layout_symmetries, layouts
from mvtn_cli.errors import UsageError, choose_error
from mvtn_cli.network_config import NETWORKS, POINT_NETWORKS


def build_network(config: Any, num_classes: int, *, read_weights: bool = True) -> MultiViewNetwork | PointClassifier:
    """Build the classifier; its random weights come from torch's generator.

    Args:
        config: Anything with the fields of `ClassifierSettings` and `SelectorSettings`.
        num_classes: C.
        read_weights: False does not read (or download) the backbone's weights.

    Raises:
        MvtnError: As `build_backbone`; or a network that these views don't serve.
    """
    settings, views = ClassifierSettings.of(config), SelectorSettings.of(config)
    if settings.network not in NETWORKS:
        raise choose_error("network", settings.network, NETWORKS)
    if settings.network in POINT_NETWORKS:
        _check_points_alone(settings, views)
        return PointClassifier(settings.network, num_classes, tnets=settings.tnets)
    backbone, dimension = build_backbone(settings.backbone, str(settings.weights), read=read_weights)
    head = build_head(settings, views, dimension, num_classes)
    # what MVCNN alone needs is drawn first, so that it starts alike with and without the rest
    two_stages = settings.first_stage_epochs > 0
    return MultiViewNetwork(
        backbone,
        head,
        freeze_backbone=settings.freeze_backbone,
        view_classifier=nn.Linear(dimension, num_classes) if two_stages else None,
        points=PointBranch(settings.encoder, num_classes, tnets=settings.tnets) if settings.fuse else None,
    )


def build_head(
    settings: ClassifierSettings, views: SelectorSettings, dimension: int, num_classes: int
) -> MultiViewHead:
    """Build the part that joins the views' features, of width `dimension`."""
    match settings.network:
        case "rotationnet":
            return RotationNet(dimension, num_classes, candidates(views))
        case "viewgcn":
            return ViewGCN(dimension, num_classes, views.num_views, width=settings.graph_width)
        case _:
            return MVCNN(dimension, num_classes, pool=settings.pool)


def candidates(views: SelectorSettings) -> Any:
    """RotationNet's candidates, (G, M): of the layout that views start from; the identity alone where there is none."""
    if views.starts_at_random:
        return [list(range(views.num_views))]
    azimuth, elevation = layouts(views.start_layout, views.num_views, views.elevation, views.azimuth)
    return layout_symmetries(views.start_layout, azimuth, elevation).permutations


def _check_points_alone(settings: ClassifierSettings, views: SelectorSettings) -> None:
    if views.views.startswith("learned") or views.views == "transferred":
        raise UsageError(
            f"the network {settings.network} looks at points alone: it can't teach {views.views} views",
            hint="add --views fixed, or take --network mvcnn",
            code="network.points-alone",
        )
    if settings.fuse or settings.first_stage_epochs:
        raise UsageError(
            f"the network {settings.network} looks at points alone: there are no views to fuse or to train first",
            hint="leave --fuse and --first-stage-epochs out, or take --network mvcnn",
            code="network.points-alone",
        )
