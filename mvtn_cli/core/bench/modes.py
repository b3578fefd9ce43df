"""Which ways from image to camera there are to compare."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from mvtn_cli.core.render import GRADIENTS, Look, ShapeBatch, render
from mvtn_cli.core.views import Cameras

FD_STEP_DEG = 0.25
DEFAULT_MODE: str = inspect.signature(render).parameters["gradient"].default


@dataclass(frozen=True)
class Mode:
    """A gradient mode at so many samples a pixel in each direction."""

    gradient: str
    supersample: int = 1
    known_as: str = ""

    @property
    def name(self) -> str:
        """As rows and plots call it."""
        if self.known_as:
            return self.known_as
        return self.gradient if self.supersample == 1 else f"{self.gradient} ss{self.supersample}"


def all_modes() -> list[Mode]:
    """The default first, then all others that the renderer offers, then the default with 2x2 samples."""
    others = [name for name in GRADIENTS if name not in (DEFAULT_MODE, "none")]
    return [Mode(DEFAULT_MODE), *map(Mode, others), Mode(DEFAULT_MODE, 2)]


def modes_of(look: Look) -> list[Mode]:
    """All modes for faces; points have one gradient, the exact one of their image."""
    return [Mode(DEFAULT_MODE, known_as="exact")] if look.kind == "points" else all_modes()


def draw(batch: ShapeBatch, cameras: Cameras, look: Look, mode: Mode) -> Tensor:
    """Images (B, M, 3, H, W) that carry this mode's gradient."""
    seen = replace(look, supersample=mode.supersample)
    return render(batch, cameras, seen, gradient=mode.gradient, fd_step_deg=FD_STEP_DEG).rgb


def wanting(cameras: Cameras) -> Cameras:
    """The same cameras as leaves whose angles want a gradient."""
    azimuth, elevation = (
        angle.detach().clone().requires_grad_() for angle in (cameras.azimuth_deg, cameras.elevation_deg)
    )
    return replace(cameras, azimuth_deg=azimuth, elevation_deg=elevation)


def angle_gradient(batch: ShapeBatch, cameras: Cameras, look: Look, mode: Mode, weights: Tensor) -> Tensor:
    """d<weights, images> / d(azimuth, elevation), (B, M, 2) float64, per degree.

    Args:
        batch: B shapes.
        cameras: (B, M).
        look: Of the B shapes.
        mode: How.
        weights: (B, M, 3, H, W).
    """
    leaves = wanting(cameras)
    torch.autograd.backward(draw(batch, leaves, look, mode), weights)
    assert leaves.azimuth_deg.grad is not None and leaves.elevation_deg.grad is not None
    return torch.stack([leaves.azimuth_deg.grad, leaves.elevation_deg.grad], dim=-1).double()


def stages(
    batch: ShapeBatch, cameras: Cameras, look: Look, mode: Mode, weights: Tensor
) -> dict[str, Callable[[], object]]:
    """The pieces of a training step that can be timed one after another: call `backward` after each `forward` only."""
    leaves = wanting(cameras)
    drawn: list[Tensor] = []

    def forward() -> None:
        drawn[:] = [draw(batch, leaves, look, mode)]

    def backward() -> None:
        torch.autograd.backward(drawn[0], weights)

    def image() -> None:
        draw(batch, cameras.detach(), look, Mode("none", mode.supersample))

    return {"image": image, "forward": forward, "backward": backward}
