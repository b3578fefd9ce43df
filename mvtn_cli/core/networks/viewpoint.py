"""Where the cameras of a shape stand: fixed, drawn, or (`learned.py`) said by a network that looks at its points.

Every selector takes points (B, P, 3) and gives `Cameras` (B, M).
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from mvtn_cli.core.networks.regressors import light_from
from mvtn_cli.core.views import Cameras, camera_rotations

ELEVATION_BOUND = 90.0
EXPLORE_ELEVATION = 0.3  # noise in elevation, as a share of that in azimuth
SATURATED = 0.95
EVALUATION_SEED = 20211017  # of random views in evaluation, when no generator is given

Angles = tuple[Tensor, Tensor]


class Choice(NamedTuple):
    """What a selector says of B x M views.

    Attributes:
        azimuth, elevation: (B, M) degrees.
        distance: (B, M), or None for the plain one.
        light: (B, M, 2) offsets of the light from the camera, as for `light_from`, or None for a plain light.
    """

    azimuth: Tensor
    elevation: Tensor
    distance: Tensor | None = None
    light: Tensor | None = None


class Placement(NamedTuple):
    """Cameras, and the light of each.

    Attributes:
        cameras: (B, M).
        light: (B, M, 3) unit vectors towards it in the world, or None where it is not learned.
    """

    cameras: Cameras
    light: Tensor | None


class ViewSelector(nn.Module):
    """Base of all selectors: views that stay where they start.

    Args:
        start: Azimuths and elevations (M,) in degrees.
        distance: Of all cameras, in shape radii.
        fov_deg: Of all cameras.

    Attributes:
        learned: Whether there is something to train.
        encoder_points: How many points it wants to see: as many as the settings say (None), or none (0).
    """

    learned = False
    encoder_points: int | None = 0
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
        """Choose the cameras of B shapes; arguments as for `place`."""
        return self.place(points, explore_deg=explore_deg, generator=generator, training=training).cameras

    def place(
        self,
        points: Tensor,
        *,
        explore_deg: float = 0.0,
        generator: torch.Generator | None = None,
        training: bool | None = None,
    ) -> Placement:
        """Choose the cameras of B shapes, and their light where that is learned.

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
            azimuth, elevation, distance, offset = self.choose(points.float(), training, generator)
            if self.learned and training and explore_deg > 0:
                noise = normal((2, *azimuth.shape), generator, azimuth.device)
                azimuth = azimuth + explore_deg * noise[0]
                elevation = elevation + EXPLORE_ELEVATION * explore_deg * noise[1]
            if distance is None:
                distance = torch.full_like(azimuth, self.distance)
            light = None if offset is None else light_from(offset, camera_rotations(azimuth, elevation))
        return Placement(Cameras(azimuth, elevation, distance, self.fov_deg), light)

    def choose(self, points: Tensor, training: bool, generator: torch.Generator | None) -> Choice:
        """Azimuths and elevations (B, M) before exploration."""
        shape = (len(points), self.num_views)
        return Choice(self.start_azimuth.expand(shape), self.start_elevation.expand(shape))

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

    def choose(self, points: Tensor, training: bool, generator: torch.Generator | None) -> Choice:
        azimuth, elevation, *_ = super().choose(points, training, generator)
        if not training:
            return Choice(azimuth, elevation)
        offset = 2 * uniform((2, *azimuth.shape), generator, azimuth.device) - 1
        return Choice(azimuth + 180.0 / self.num_views * offset[0], elevation + ELEVATION_BOUND * offset[1])


class RandomViews(ViewSelector):
    """Uniform on the sphere, new ones for each shape and step; in evaluation the same ones each time."""

    def choose(self, points: Tensor, training: bool, generator: torch.Generator | None) -> Choice:
        return Choice(*random_views(len(points), self.num_views, training, generator, points.device))


def random_views(
    shapes: int, views: int, training: bool, generator: torch.Generator | None, device: torch.device
) -> Angles:
    """Azimuths and elevations (B, M), uniform on the sphere; in evaluation from a seed of their own."""
    if not training and generator is None:
        generator = torch.Generator().manual_seed(EVALUATION_SEED)
    drawn = 2 * uniform((2, shapes, views), generator, device) - 1
    return 180.0 * drawn[0], torch.rad2deg(torch.asin(drawn[1]))


def normal(shape: tuple[int, ...], generator: torch.Generator | None, device: torch.device) -> Tensor:
    """Draws on the generator's device, so that a seed means the same numbers on every machine."""
    return torch.randn(shape, generator=generator, device=generator.device if generator else "cpu").to(device)


def uniform(shape: tuple[int, ...], generator: torch.Generator | None, device: torch.device) -> Tensor:
    """The same for numbers in [0, 1)."""
    return torch.rand(shape, generator=generator, device=generator.device if generator else "cpu").to(device)
