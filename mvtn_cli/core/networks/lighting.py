"""Pictures under a light that is learned: the renderer takes one as given, its gradient is made here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from mvtn_cli.core.render import Look
from mvtn_cli.core.views import Cameras

STEP = 0.02  # radians by which the light is turned to measure its gradient; pictures are smooth in it

Draw = Callable[[Cameras, Look], Tensor]


def draw_lit(draw: Draw, cameras: Cameras, look: Look, light: Tensor) -> Tensor:
    """Take every view under a light of its own.

    Args:
        draw: Takes (B, M') cameras' pictures, (B, M', 3, H, W), each shape under its `look.light_direction`.
        cameras: (B, M).
        look: Of the pictures.
        light: (B, M, 3) unit vectors; gets a gradient.

    Returns:
        (B, M, 3, H, W).
    """

    def under(light: Tensor, cameras: Cameras) -> Tensor:
        directions = light.detach().cpu().float().numpy()
        views = range(cameras.num_views)
        looks = [replace(look, light_direction=directions[:, m]) for m in views]
        return torch.cat([draw(cameras.select(views=[m]), looks[m]) for m in views], dim=1)

    rgb = under(light, cameras)
    still = cameras.detach()
    return LightGradient.apply(rgb, light, lambda turned: under(turned, still)) if light.requires_grad else rgb


class LightGradient(torch.autograd.Function):
    """Pictures as they are; in the backward pass the light gets the gradient that central differences show.

    Shading is smooth in the light, and a directional light casts no shadows here, so the differences are exact
    to the square of the step. Two directions square to the light are tried, each to both sides.
    """

    @staticmethod
    def forward(ctx, rgb: Tensor, light: Tensor, redraw: Callable[[Tensor], Tensor]) -> Tensor:
        ctx.save_for_backward(light)
        ctx.redraw = redraw
        return rgb.view_as(rgb)

    @staticmethod
    def backward(ctx, upstream: Tensor) -> tuple[Tensor, Tensor, None]:
        (light,) = ctx.saved_tensors
        gradient = torch.zeros_like(light)
        for tangent in _tangents(light):
            there, back = (
                ctx.redraw(torch.nn.functional.normalize(light + step * tangent, dim=-1)) for step in (STEP, -STEP)
            )
            slope = (upstream * (there - back)).sum(dim=(2, 3, 4)) / (2 * STEP)
            gradient += slope[..., None].to(light) * tangent
        return upstream, gradient, None


def _tangents(light: Tensor) -> tuple[Tensor, Tensor]:
    """Two unit vectors square to each light and to each other."""
    axis = torch.zeros_like(light)
    axis.scatter_(-1, light.abs().argmin(dim=-1, keepdim=True), 1.0)
    first = torch.nn.functional.normalize(torch.linalg.cross(light, axis), dim=-1)
    return first, torch.linalg.cross(light, first)
