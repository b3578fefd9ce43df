"""The last part of a viewpoint network: from features of a shape to numbers for each of its views."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn

from mvtn_cli.core.networks.layers import norm_layers
from mvtn_cli.errors import choose_error

REGRESSORS = ("small", "reference")
DROPOUT = 0.5


def build_regressor(
    name: str, features: int, angles: int, outputs: int, num_views: int, *, hidden: int | None = None
) -> nn.Sequential:
    """Build a regressor; its last layer is linear.

    Args:
        name: "small": one hidden layer. "reference": the released code's five layers with BatchNorm, ReLU and
            dropout, 14 M² + 303 M + 3440 weights for 40 features, 2 M angles and 2 outputs a view.
        features: b, of the point encoder.
        angles: Inputs besides.
        outputs: For each view.
        num_views: M.
        hidden: Units of "small"; None for 4 a view, at least 32.

    Raises:
        UsageError: Unknown name.
    """
    out = outputs * num_views
    match name:
        case "small":
            hidden = hidden or max(32, 4 * num_views)
            last = nn.Linear(hidden, out)
            return nn.Sequential(nn.Linear(features + angles, hidden), nn.ReLU(), last)
        case "reference":
            widths = (features + angles, features, features, 5 * num_views, out)
            layers = [norm_layers(i, o, dropout=DROPOUT) for i, o in pairwise(widths)]
            return nn.Sequential(*(layer for group in layers for layer in group), nn.Linear(out, out))
        case _:
            raise choose_error("regressor", name, REGRESSORS)


def start_at_zero(layer: nn.Module) -> None:
    """Let a linear layer give zeros, whatever comes in, until it has learned something."""
    assert isinstance(layer, nn.Linear)
    nn.init.zeros_(layer.weight)
    nn.init.zeros_(layer.bias)


class SceneLayer(nn.Module):
    """Distance and light of each view, learned from the same hidden features as its angles.

    The distance is base · factor^tanh(output), so within a factor of its plain value. The light is a place in
    front of the camera, given by two offsets to its right and up; a unit vector is made of it by `light_from`.
    Outputs start at zero: at the plain distance, and with the light at the camera.

    Args:
        inputs: Width of the hidden features.
        num_views: M.
        distance: The plain one.
        factor: 1 leaves the distance alone.
        light: Whether the light is learned.
    """

    def __init__(self, inputs: int, num_views: int, distance: float, factor: float, *, light: bool) -> None:
        super().__init__()
        self.base, self.factor, self.light = distance, factor, light
        self.each = (1 if factor > 1 else 0) + (2 if light else 0)
        self.layer = nn.Linear(inputs, self.each * num_views)
        start_at_zero(self.layer)

    def forward(self, hidden: Tensor) -> tuple[Tensor | None, Tensor | None]:
        """(B, inputs) -> distances (B, M) and offsets of the light (B, M, 2), each None if it is not learned."""
        raw = self.layer(hidden).unflatten(-1, (-1, self.each))
        distance = self.base * self.factor ** torch.tanh(raw[..., 0]) if self.factor > 1 else None
        return distance, raw[..., -2:] if self.light else None


def light_from(offset: Tensor, rotations: Tensor) -> Tensor:
    """The direction towards the light that stands beside a camera.

    Args:
        offset: (B, M, 2), to the camera's right and up, as tangents of the angle between camera and light.
        rotations: (B, M, 3, 3), world to camera; rows right, up, backward.

    Returns:
        (B, M, 3) unit vectors in the world, less than 90° from the camera's own direction.
    """
    right, up, backward = rotations.to(offset).unbind(dim=-2)
    towards = backward + offset[..., :1] * right + offset[..., 1:] * up
    return nn.functional.normalize(towards, dim=-1)
