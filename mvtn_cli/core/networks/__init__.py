"""Picture networks, point encoders, view selectors, and the recogniser that they make up."""

from mvtn_cli.core.networks.backbones import backbone_names, build_backbone
from mvtn_cli.core.networks.mvcnn import MVCNN
from mvtn_cli.core.networks.pointnet import PointNetEncoder
from mvtn_cli.core.networks.recogniser import Output, Recogniser, build_recogniser
from mvtn_cli.core.networks.viewpoint import ViewSelector, make_selector

__all__ = [
    "MVCNN",
    "Output",
    "PointNetEncoder",
    "Recogniser",
    "ViewSelector",
    "backbone_names",
    "build_backbone",
    "build_recogniser",
    "make_selector",
]
