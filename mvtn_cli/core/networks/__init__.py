"""Picture networks, point encoders, view selectors, and the recogniser that they make up."""

from mvtn_cli.core.networks.backbones import backbone_names, build_backbone
from mvtn_cli.core.networks.build import build_network
from mvtn_cli.core.networks.class_views import class_mean_views
from mvtn_cli.core.networks.dgcnn import DGCNN
from mvtn_cli.core.networks.encoders import ENCODERS, build_encoder
from mvtn_cli.core.networks.heads import HeadOutput, MultiViewHead
from mvtn_cli.core.networks.multiview import MultiViewNetwork
from mvtn_cli.core.networks.mvcnn import MVCNN
from mvtn_cli.core.networks.pointnet import PointNet, PointNetEncoder
from mvtn_cli.core.networks.points import PointBranch, PointClassifier
from mvtn_cli.core.networks.recogniser import Output, Recogniser, build_recogniser
from mvtn_cli.core.networks.rotationnet import RotationNet
from mvtn_cli.core.networks.selection import make_selector
from mvtn_cli.core.networks.viewgcn import ViewGCN
from mvtn_cli.core.networks.viewpoint import ViewSelector

__all__ = [
    "DGCNN",
    "ENCODERS",
    "MVCNN",
    "HeadOutput",
    "MultiViewHead",
    "MultiViewNetwork",
    "Output",
    "PointBranch",
    "PointClassifier",
    "PointNet",
    "PointNetEncoder",
    "Recogniser",
    "RotationNet",
    "ViewGCN",
    "ViewSelector",
    "backbone_names",
    "build_backbone",
    "build_encoder",
    "build_network",
    "build_recogniser",
    "class_mean_views",
    "make_selector",
]
