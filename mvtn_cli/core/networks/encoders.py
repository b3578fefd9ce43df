"""Point encoders by name."""

from __future__ import annotations

from torch import nn

from mvtn_cli.core.networks.dgcnn import DGCNN
from mvtn_cli.core.networks.pointnet import PointNet, PointNetEncoder
from mvtn_cli.errors import choose_error

ENCODERS = ("small", "pointnet", "dgcnn")
FEATURES = 40  # b, of the encoders at full size: what the released viewpoint network takes in


def build_encoder(name: str, *, tnets: bool = False) -> nn.Module:
    """Build an encoder, (B, P, 3) -> (B, D), whose D is its `dimension`.

    Args:
        name: "small" (32-64-64, no BatchNorm; D = 64), or "pointnet" or "dgcnn" at full size (D = 40).
        tnets: Spatial transformers, for "pointnet" alone.

    Raises:
        UsageError: Unknown name.
    """
    match name:
        case "small":
            return PointNetEncoder()
        case "pointnet":
            return PointNet(FEATURES, tnets=tnets, norm_last=True)
        case "dgcnn":
            return DGCNN(FEATURES)
        case _:
            raise choose_error("encoder", name, ENCODERS)
