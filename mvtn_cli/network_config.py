"""The networks of a training: which one says the class, and which one places the cameras."""

from __future__ import annotations

from typing import Any, Literal, Self, get_args

from pydantic import model_validator

from mvtn_cli.errors import UsageError
from mvtn_cli.fields import Config, option

Network = Literal["mvcnn", "rotationnet", "viewgcn", "pointnet", "dgcnn"]
NETWORKS: tuple[str, ...] = get_args(Network)
POINT_NETWORKS = ("pointnet", "dgcnn")  # these look at points alone
POINTS_OF_CLASSIFIERS = 1024  # as PointNet and DGCNN were published


class NetworkConfig(Config):
    """For trainings."""

    network: Network = option(
        "mvcnn",
        "What says the class; pointnet and dgcnn look at points alone",
        "Network",
    )
    backbone: str = option("tiny", "tiny (3 convolutions) or a torchvision classifier: resnet18", "Network")
    weights: str = option("none", "Of the backbone: none, imagenet, a .safetensors or .pth file, or a run", "Network")
    freeze_backbone: bool = option(False, "Train only what comes after the backbone", "Network")
    backbone_lr_scale: float = option(1.0, "Backbone's learning rate, times --lr", "Network", ge=0, le=10)
    pool: Literal["max", "mean"] = option("max", "How mvcnn makes one feature of the views'", "Network")
    graph_width: int | None = option(
        None, "Features of viewgcn's nodes; auto: the backbone's, at most 512", "Network", ge=8, le=4096
    )
    fuse: bool = option(False, "Late fusion: add what a point encoder of its own says", "Network")
    first_stage_epochs: int = option(
        0, "Of --epochs, those that train the backbone on single pictures first", "Network", ge=0
    )
    encoder: Literal["small", "pointnet", "dgcnn"] = option(
        "small", "Point encoder of the viewpoint network and of --fuse; small: a narrow PointNet", "Network"
    )
    tnets: bool = option(False, "PointNet's spatial transformers", "Network")
    regressor: Literal["small", "reference"] = option(
        "small", "From points to angles: small, or as the paper's code has it", "Network"
    )
    encoder_points: int = option(
        512, f"Points that a point network sees; {POINTS_OF_CLASSIFIERS} with pointnet and dgcnn", "Network",
        ge=8, le=100_000,
    )  # fmt: skip

    @model_validator(mode="before")
    @classmethod
    def _fill_from_network(cls, values: Any) -> Any:
        if not isinstance(values, dict) or values.get("network") not in POINT_NETWORKS:
            return values
        return {"views": "fixed", "encoder_points": POINTS_OF_CLASSIFIERS, **values}

    @model_validator(mode="after")
    def _check_stages(self) -> Self:
        epochs = getattr(self, "epochs", None)
        if epochs is not None and self.first_stage_epochs >= epochs:
            raise UsageError(
                f"--first-stage-epochs {self.first_stage_epochs} leaves none of --epochs {epochs} for whole shapes",
                hint="give more --epochs: they count both stages",
                code="train.stages",
            )
        return self
