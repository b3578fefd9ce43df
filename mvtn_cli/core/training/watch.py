"""What is watched while training: finite numbers, pictures with something in them, views that stay alive."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn
from torch.optim import Optimizer

from mvtn_cli.core.training.learner import parameters_of
from mvtn_cli.core.views import angle_between, view_spread, wrap_degrees
from mvtn_cli.errors import UsageError

FLAT = 1e-3  # standard deviation of the pixels of a picture in which nothing is seen
SATURATED = 0.95
SAME_DEG = 1.0


def gradient_is_finite(parameters: Iterable[nn.Parameter]) -> bool:
    """Whether the norm of all gradients is a finite number."""
    gradients = [p.grad for p in parameters if p.grad is not None]
    return not gradients or bool(torch.isfinite(torch.nn.utils.get_total_norm(gradients)))


def not_finite(loss: float, optimisers: dict[str, Optimizer]) -> str | None:
    """Name what is not finite in a step, or return None.

    Args:
        loss: Of the step; the gradients are looked at only if it is finite.
        optimisers: By the name of their network.
    """
    if not math.isfinite(loss):
        return "the loss"
    bad = [name for name, optimiser in optimisers.items() if not gradient_is_finite(parameters_of(optimiser))]
    return f"the gradient of the {' and the '.join(bad)}" if bad else None


def check_something_is_seen(images: Tensor, mean: Callable[[float], float] = float) -> None:
    """Refuse to train on pictures without content: the loss would stay at ln(classes) for ever.

    Args:
        images: (B, M, 3, H, W) in [0, 1], of the first batch.
        mean: From the mean over these images to that over the images of all processes.

    Raises:
        UsageError: The pixels of a picture differ by less than a thousandth, on average over the pictures.
    """
    spread = mean(float(images.flatten(3).std(dim=-1).mean()))
    if not spread >= FLAT:
        raise UsageError(
            f"nothing can be seen in the pictures of the first batch (their pixels vary by {spread:.1e})",
            hint="the shapes are as bright as the background or out of the picture: see `mvtn render-views`; "
            "try --look studio, another --distance or a larger --point-radius",
            code="train.nothing-seen",
        )


def check_views_can_learn(config: Any) -> None:
    """Refuse learned views that nothing would teach.

    Raises:
        UsageError: The pictures give the cameras no gradient, and that was not asked for.
    """
    if config.views.startswith("learned") and config.gradient == "none" and not config.allow_no_gradient:
        raise UsageError(
            f"{config.views} views can't learn with --gradient none: no gradient reaches the cameras",
            hint="use --gradient fd; for an ablation add --allow-no-gradient",
            code="train.no-gradient",
        )


def view_health(azimuth_deg: ArrayLike, elevation_deg: ArrayLike, known_azimuth_deg: ArrayLike) -> dict[str, Any]:
    """Numbers that tell how the cameras of N shapes are doing.

    Args:
        azimuth_deg: (N, M).
        elevation_deg: (N, M).
        known_azimuth_deg: (N,), NaN where no best view is known.

    Returns:
        `view_error_deg`: median azimuth error of each shape's nearest view to the known one, or None.
        `view_spread_deg`: how much the views differ between shapes; 0 if every shape gets the same ones.
        `view_apart_deg`: largest angle from the first view of a shape, mean over shapes; None for M = 1.
    """
    azimuth, elevation = np.asarray(azimuth_deg, np.float64), np.asarray(elevation_deg, np.float64)
    known = np.asarray(known_azimuth_deg, np.float64)
    # a camera that has crossed a pole stands on the other side
    seen_from = np.where(np.cos(np.deg2rad(elevation)) < 0, azimuth + 180.0, azimuth)
    errors = np.abs(wrap_degrees(seen_from - known[:, None])).min(axis=1)
    error = float(np.median(errors[~np.isnan(known)])) if (~np.isnan(known)).any() else None
    apart = None
    if azimuth.shape[1] > 1:
        others = angle_between(azimuth[:, :1], elevation[:, :1], azimuth[:, 1:], elevation[:, 1:])
        apart = float(others.max(axis=1).mean())
    spread = float(view_spread(azimuth, elevation, axis=0).mean())
    return {"view_error_deg": error, "view_spread_deg": spread, "view_apart_deg": apart}


def collapse(saturation: float, spread_deg: float, apart_deg: float | None) -> str | None:
    """Say in what way learned views have stopped to be useful, or return None.

    Learned offsets start at the same views for every shape, so a small spread alone is no collapse.

    Args:
        saturation: Share of outputs with |tanh| > 0.95, where there is no gradient left.
        spread_deg: `view_spread_deg`.
        apart_deg: `view_apart_deg`.
    """
    if apart_deg is not None and apart_deg < SAME_DEG:
        return f"all views of a shape look from the same side ({apart_deg:.1f}° apart)"
    if saturation > SATURATED and spread_deg < SAME_DEG:
        return f"all shapes get the same views, which can't move: {saturation:.0%} of the angles saturated"
    return None
