"""Where the cameras of a shape stand: fixed, drawn, or said by a network that looks at the shape's points.

Every selector takes points (B, P, 3) and gives `Cameras` (B, M). Angles go into a network as sines and
cosines, never as degrees, and nothing that is constant passes through a BatchNorm, which would cancel it.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from mvtn_cli.config import TrainConfig
from mvtn_cli.core.networks.pointnet import PointNetEncoder
from mvtn_cli.core.views import Cameras, layouts, wrap_degrees

ELEVATION_BOUND = 90.0
EXPLORE_ELEVATION = 0.3  # noise in elevation, as a share of that in azimuth
SATURATED = 0.95
EVALUATION_SEED = 20211017  # of random views in evaluation, when no generator is given
# start angles are set through the inverse of tanh, which has none at ±1 and no slope near it
LARGEST_START = 0.9

Angles = tuple[Tensor, Tensor]


class ViewSelector(nn.Module):
    """Base of all selectors: views that stay where they start.

    Args:
        start: Azimuths and elevations (M,) in degrees.
        distance: Of all cameras, in shape radii.
        fov_deg: Of all cameras.
    """

    learned = False
    start_azimuth: Tensor
    start_elevation: Tensor

    def __init__(self, start: Angles, distance: float = 2.2, fov_deg: float = 60.0) -> None:
        super().__init__()
        self.distance = float(distance)
        self.fov_deg = float(fov_deg)
        self.register_buffer("start_azimuth", torch.as_tensor(start[0]).float(), persistent=False)
        self.register_buffer("start_elevation", torch.as_tensor(start[1]).float(), persistent=False)
        self._squashed: Tensor | None = None

    @property
    def num_views(self) -> int:
        """M."""
        return len(self.start_azimuth)

    @property
    def start(self) -> Angles:
        """Azimuths and elevations (M,) of the layout, float32 degrees."""
        return self.start_azimuth, self.start_elevation

    def forward(
        self,
        points: Tensor,
        *,
        explore_deg: float = 0.0,
        generator: torch.Generator | None = None,
        training: bool | None = None,
    ) -> Cameras:
        """Choose the cameras of B shapes.

        Args:
            points: (B, P, 3), normalised; only learned views look at them.
            explore_deg: Standard deviation of the noise on learned azimuths in training; 0.3 of it on
                elevations.
                It is added outside the graph: the gradient at the shifted place goes to the prediction.
            generator: Where all draws come from; None is torch's own.
            training: None takes the module's own mode.
        """
        training = self.training if training is None else training
        with torch.autocast(points.device.type, enabled=False):
            azimuth, elevation = self.choose(points.float(), training, generator)
            if self.learned and training and explore_deg > 0:
                noise = _normal((2, *azimuth.shape), generator, azimuth.device)
                azimuth = azimuth + explore_deg * noise[0]
                elevation = elevation + EXPLORE_ELEVATION * explore_deg * noise[1]
        return Cameras(azimuth, elevation, torch.full_like(azimuth, self.distance), self.fov_deg)

    def choose(self, points: Tensor, training: bool, generator: torch.Generator | None) -> Angles:
        """Azimuths and elevations (B, M) before exploration."""
        shape = (len(points), self.num_views)
        return self.start_azimuth.expand(shape), self.start_elevation.expand(shape)

    def saturation(self) -> float:
        """Share of the last call's tanh outputs beyond ±0.95, where hardly any gradient is left; else NaN."""
        if self._squashed is None:
            return float("nan")
        return float((self._squashed.abs() > SATURATED).float().mean())

    def _tanh(self, raw: Tensor) -> Tensor:
        squashed = torch.tanh(raw)
        self._squashed = squashed.detach()
        return squashed


class FixedViews(ViewSelector):
    """The layout itself."""


class JitteredViews(ViewSelector):
    """The layout, in training moved by uniform offsets within the bounds of the learned offsets.

    The honest control for learned views: moving cameras are an augmentation by themselves.
    """

    def choose(self, points: Tensor, training: bool, generator: torch.Generator | None) -> Angles:
        azimuth, elevation = super().choose(points, training, generator)
        if not training:
            return azimuth, elevation
        offset = 2 * _uniform((2, *azimuth.shape), generator, azimuth.device) - 1
        return azimuth + 180.0 / self.num_views * offset[0], elevation + ELEVATION_BOUND * offset[1]


class RandomViews(ViewSelector):
    """Uniform on the sphere, new ones for each shape and step; in evaluation the same ones each time."""

    def choose(self, points: Tensor, training: bool, generator: torch.Generator | None) -> Angles:
        if not training and generator is None:
            generator = torch.Generator().manual_seed(EVALUATION_SEED)
        drawn = 2 * _uniform((2, len(points), self.num_views), generator, points.device) - 1
        return 180.0 * drawn[0], torch.rad2deg(torch.asin(drawn[1]))


class DirectViews(ViewSelector):
    """The network says where each camera stands.

    Periodic form: azimuth = atan2 of two outputs, which has no dead ends; tanh form: 180° · tanh (the
    paper's). Elevation is 90° · tanh in both. M > 1 views would all start at about the same place and learn
    the same, so their biases spread them out over the layout; a single view starts as its random weights say.

    Args:
        start: The layout (M,).
        distance, fov_deg: As in the base.
        periodic: The form.
        widths: Of the point encoder.
        hidden: Units between features and angles.
    """

    learned = True

    def __init__(
        self,
        start: Angles,
        distance: float = 2.2,
        fov_deg: float = 60.0,
        *,
        periodic: bool = True,
        widths: tuple[int, ...] = (32, 64, 64),
        hidden: int | None = None,
    ) -> None:
        super().__init__(start, distance, fov_deg)
        self.periodic = periodic
        views, outputs = self.num_views, 3 if periodic else 2
        hidden = hidden or max(32, 4 * views)
        self.encoder = PointNetEncoder(widths)
        last = nn.Linear(hidden, outputs * views)
        self.head = nn.Sequential(nn.Linear(self.encoder.dimension, hidden), nn.ReLU(), last)
        if views > 1:
            self._start_at_layout(last)

    @torch.no_grad()
    def _start_at_layout(self, last: nn.Linear) -> None:
        elevation = torch.atanh((self.start_elevation / ELEVATION_BOUND).clamp(-LARGEST_START, LARGEST_START))
        if self.periodic:
            angle = torch.deg2rad(self.start_azimuth)
            bias = torch.stack([angle.sin(), angle.cos(), elevation], dim=-1)
        else:
            share = torch.as_tensor(wrap_degrees(self.start_azimuth.numpy()) / 180.0).float()
            bias = torch.stack([torch.atanh(share.clamp(-LARGEST_START, LARGEST_START)), elevation], dim=-1)
        last.weight.mul_(0.1)
        last.bias.copy_(bias.flatten())

    def choose(self, points: Tensor, training: bool, generator: torch.Generator | None) -> Angles:
        raw = self.head(self.encoder(points)).unflatten(-1, (self.num_views, -1))
        if self.periodic:
            azimuth = SafeAngle.apply(raw[..., 0], raw[..., 1])
            return azimuth, ELEVATION_BOUND * self._tanh(raw[..., 2])
        squashed = self._tanh(raw)
        return 180.0 * squashed[..., 0], ELEVATION_BOUND * squashed[..., 1]


class OffsetViews(ViewSelector):
    """The network moves each camera away from its place in the layout: u = u0 + bound · tanh(G(u0, shape)).

    The bounds are 180°/M in azimuth and 90° in elevation (the paper's supplement and its code); a camera may
    cross the pole. The last layer starts at zero, so that training starts at the layout exactly.

    Args:
        start: u0, the layout (M,).
        distance, fov_deg: As in the base.
        widths: Of the point encoder.
        hidden: Units between features and angles.
    """

    learned = True

    def __init__(
        self,
        start: Angles,
        distance: float = 2.2,
        fov_deg: float = 60.0,
        *,
        widths: tuple[int, ...] = (32, 64, 64),
        hidden: int | None = None,
    ) -> None:
        super().__init__(start, distance, fov_deg)
        views = self.num_views
        hidden = hidden or max(32, 4 * views)
        self.encoder = PointNetEncoder(widths)
        last = nn.Linear(hidden, 2 * views)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.head = nn.Sequential(nn.Linear(self.encoder.dimension + 4 * views, hidden), nn.ReLU(), last)

    def choose(self, points: Tensor, training: bool, generator: torch.Generator | None) -> Angles:
        angles = torch.deg2rad(torch.cat([self.start_azimuth, self.start_elevation]))
        where = torch.cat([angles.sin(), angles.cos()]).expand(len(points), -1)
        raw = self.head(torch.cat([self.encoder(points), where], dim=-1)).unflatten(-1, (self.num_views, 2))
        squashed = self._tanh(raw)
        azimuth = self.start_azimuth + 180.0 / self.num_views * squashed[..., 0]
        return azimuth, self.start_elevation + ELEVATION_BOUND * squashed[..., 1]


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


def make_selector(config: TrainConfig) -> ViewSelector:
    """The selector of `config.views`; learned ones start from torch's generator."""
    name = config.views
    layout = name.removeprefix("learned-") if name in ("learned-circular", "learned-spherical") else config.layout
    azimuth, elevation = layouts(layout, config.num_views, config.elevation, config.azimuth)
    start = torch.from_numpy(azimuth), torch.from_numpy(elevation)
    match name:
        case "fixed":
            return FixedViews(start, config.distance, config.fov)
        case "jittered":
            return JitteredViews(start, config.distance, config.fov)
        case "random":
            return RandomViews(start, config.distance, config.fov)
        case "learned-direct":
            return DirectViews(start, config.distance, config.fov, periodic=config.angles == "periodic")
        case "learned-circular" | "learned-spherical":
            return OffsetViews(start, config.distance, config.fov)


def _normal(shape: tuple[int, ...], generator: torch.Generator | None, device: torch.device) -> Tensor:
    """Draws on the generator's device, so that a seed means the same numbers on every machine."""
    return torch.randn(shape, generator=generator, device=generator.device if generator else "cpu").to(device)


def _uniform(shape: tuple[int, ...], generator: torch.Generator | None, device: torch.device) -> Tensor:
    return torch.rand(shape, generator=generator, device=generator.device if generator else "cpu").to(device)
