"""Views that a network says, from the points of the shape.

Angles go into it as sines and cosines, never as degrees, and nothing that is constant passes through a
BatchNorm, which would cancel it (but for the regressor "reference", which is as it was released).
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from mvtn_cli.core.networks.pointnet import PointNetEncoder
from mvtn_cli.core.networks.regressors import SceneLayer, build_regressor, start_at_zero
from mvtn_cli.core.networks.viewpoint import ELEVATION_BOUND, Angles, Choice, ViewSelector, random_views
from mvtn_cli.core.views import wrap_degrees

# start angles are set through the inverse of tanh, which has none at ±1 and no slope near it
LARGEST_START = 0.9


class LearnedViews(ViewSelector):
    """What the learned selections share: encoder, regressor (`head`), and perhaps a layer for distance and light.

    Args:
        start: The layout (M,).
        distance, fov_deg: As in the base.
        outputs: Of the regressor for each view.
        angles: Numbers that tell the regressor where the cameras start.
        encoder: (B, P, 3) -> (B, D), with D as `dimension`; None for a small PointNet.
        regressor: As for `build_regressor`.
        hidden: Units of the small regressor.
        learn_distance: Largest factor by which a distance may change; 1 learns none.
        learn_light: Whether the light is learned.
    """

    learned = True
    encoder_points: int | None = None

    def __init__(
        self,
        start: Angles,
        distance: float = 2.2,
        fov_deg: float = 60.0,
        *,
        outputs: int,
        angles: int = 0,
        encoder: nn.Module | None = None,
        regressor: str = "small",
        hidden: int | None = None,
        learn_distance: float = 1.0,
        learn_light: bool = False,
    ) -> None:
        super().__init__(start, distance, fov_deg)
        self.encoder = encoder or PointNetEncoder()
        features = int(self.encoder.dimension)  # type: ignore[arg-type]
        self.head = build_regressor(regressor, features, angles, outputs, self.num_views, hidden=hidden)
        self.scene: SceneLayer | None = None
        if learn_distance > 1 or learn_light:  # drawn last, so that the other layers start alike with and without
            inputs = int(self.head[-1].in_features)  # type: ignore[arg-type]
            self.scene = SceneLayer(inputs, self.num_views, self.distance, learn_distance, light=learn_light)

    def _regress(self, inputs: Tensor) -> tuple[Tensor, Tensor | None, Tensor | None]:
        """Raw outputs (B, M, ·), then distance and light as a `Choice` takes them."""
        hidden = self.head[:-1](inputs)
        raw = self.head[-1](hidden).unflatten(-1, (self.num_views, -1))
        return raw, *(self.scene(hidden) if self.scene is not None else (None, None))


class DirectViews(LearnedViews):
    """The network says where each camera stands.

    Periodic form: azimuth = atan2 of two outputs, which has no dead ends; tanh form: 180° · tanh (the
    paper's). Elevation is 90° · tanh in both. M > 1 views would all start at about the same place and learn
    the same, so their biases spread them out over the layout; a single view starts as its random weights say.

    Args:
        periodic: The form.
        Others as in the base.
    """

    def __init__(
        self, start: Angles, distance: float = 2.2, fov_deg: float = 60.0, *, periodic: bool = True, **more: Any
    ) -> None:
        super().__init__(start, distance, fov_deg, outputs=3 if periodic else 2, **more)
        self.periodic = periodic
        if self.num_views > 1:
            self._start_at_layout(self.head[-1])

    @torch.no_grad()
    def _start_at_layout(self, last: nn.Module) -> None:
        assert isinstance(last, nn.Linear)
        elevation = torch.atanh((self.start_elevation / ELEVATION_BOUND).clamp(-LARGEST_START, LARGEST_START))
        if self.periodic:
            angle = torch.deg2rad(self.start_azimuth)
            bias = torch.stack([angle.sin(), angle.cos(), elevation], dim=-1)
        else:
            share = torch.as_tensor(wrap_degrees(self.start_azimuth.numpy()) / 180.0).float()
            bias = torch.stack([torch.atanh(share.clamp(-LARGEST_START, LARGEST_START)), elevation], dim=-1)
        last.weight.mul_(0.1)
        last.bias.copy_(bias.flatten())

    def choose(self, points: Tensor, training: bool, generator: torch.Generator | None) -> Choice:
        raw, distance, light = self._regress(self.encoder(points))
        if self.periodic:
            azimuth = SafeAngle.apply(raw[..., 0], raw[..., 1])
            return Choice(azimuth, ELEVATION_BOUND * self._tanh(raw[..., 2]), distance, light)
        squashed = self._tanh(raw)
        return Choice(180.0 * squashed[..., 0], ELEVATION_BOUND * squashed[..., 1], distance, light)


class OffsetViews(LearnedViews):
    """The network moves each camera away from its place in the layout: u = u0 + bound · tanh(G(u0, shape)).

    The bounds are 180°/M in azimuth and 90° in elevation (the paper's supplement and its code); a camera may
    cross the pole. The last layer starts at zero, so that training starts at the layout exactly.
    """

    def __init__(
        self,
        start: Angles,
        distance: float = 2.2,
        fov_deg: float = 60.0,
        *,
        regressor: str = "small",
        **more: Any,
    ) -> None:
        told = (2 if regressor == "reference" else 4) * len(start[0])
        super().__init__(start, distance, fov_deg, outputs=2, angles=told, regressor=regressor, **more)
        self.reference = regressor == "reference"
        start_at_zero(self.head[-1])

    def choose(self, points: Tensor, training: bool, generator: torch.Generator | None) -> Choice:
        azimuth, elevation = self.begin(points, training, generator)
        inputs = torch.cat([self.encoder(points), self._told(azimuth, elevation)], dim=-1)
        raw, distance, light = self._regress(inputs)
        squashed = self._tanh(raw)
        azimuth = azimuth + 180.0 / self.num_views * squashed[..., 0]
        return Choice(azimuth, elevation + ELEVATION_BOUND * squashed[..., 1], distance, light)

    def begin(self, points: Tensor, training: bool, generator: torch.Generator | None) -> Angles:
        """Where the cameras start, azimuth and elevation (B, M)."""
        shape = (len(points), self.num_views)
        return self.start_azimuth.expand(shape), self.start_elevation.expand(shape)

    def _told(self, azimuth: Tensor, elevation: Tensor) -> Tensor:
        """What the regressor sees of the start, (B, 4 M); for the reference one angles in [-1, 1], (B, 2 M)."""
        if self.reference:
            wrapped = torch.remainder(azimuth + 180.0, 360.0) - 180.0
            return torch.cat([wrapped / 180.0, elevation / 90.0], dim=-1)
        angles = torch.deg2rad(torch.cat([azimuth, elevation], dim=-1))
        return torch.cat([angles.sin(), angles.cos()], dim=-1)


class RandomOffsetViews(OffsetViews):
    """The same from random places, new ones for each shape and step; in evaluation the same ones each time.

    Here alone the start tells the regressor something.
    """

    def begin(self, points: Tensor, training: bool, generator: torch.Generator | None) -> Angles:
        return random_views(len(points), self.num_views, training, generator, points.device)


class SafeAngle(torch.autograd.Function):
    """Angle of the vector (y, x) in degrees, whose gradient stays finite where the vector is short.

    The true gradient grows as 1 / length; here the squared length gets EPSILON more, so that no output's
    gradient exceeds 1 / (2 · sqrt(EPSILON)) radians per unit, and it is zero, not NaN, at (0, 0).
    """

    EPSILON = 1e-4

    @staticmethod
    def forward(ctx, y: Tensor, x: Tensor) -> Tensor:
        ctx.save_for_backward(y, x)
        return torch.rad2deg(torch.atan2(y, x))

    @staticmethod
    def backward(ctx, upstream: Tensor) -> Angles:
        y, x = ctx.saved_tensors
        # divided twice by the length, as its square overflows for lengths above 1e19
        length = torch.hypot(torch.hypot(y, x), torch.full_like(x, SafeAngle.EPSILON**0.5))
        per_unit = torch.rad2deg(upstream) / length
        return per_unit * (x / length), -per_unit * (y / length)
