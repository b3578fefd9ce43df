"""The selector of a configuration."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import torch

from mvtn_cli.core.networks.encoders import build_encoder
from mvtn_cli.core.networks.learned import DirectViews, OffsetViews, RandomOffsetViews
from mvtn_cli.core.networks.settings import SelectorSettings
from mvtn_cli.core.networks.transfer import TransferredViews
from mvtn_cli.core.networks.viewpoint import Angles, FixedViews, JitteredViews, RandomViews, ViewSelector
from mvtn_cli.core.views import layouts
from mvtn_cli.errors import UsageError, choose_error
from mvtn_cli.shared_config import SELECTIONS

NEAREST = 1.05  # radii from the centre that a learned distance keeps at least


def make_selector(config: Any, *, views_from: Path | None = None) -> ViewSelector:
    """The selector of a configuration; learned ones start from torch's generator.

    Args:
        config: Anything with the fields of `SelectorSettings`.
        views_from: For transferred views, the folder of the run that they come from; None leaves them to
            `load_state_dict`.

    Raises:
        UsageError: Unknown selection, or a setting that does not go with it.
        DataError: The other run can't be read.
    """
    settings = SelectorSettings.of(config)
    _check_scene(settings)
    place = _start(settings), settings.distance, settings.fov
    learn: dict[str, Any] = {
        "regressor": settings.regressor,
        "learn_distance": settings.learn_distance,
        "learn_light": settings.learn_light,
    }
    encoder = partial(build_encoder, settings.encoder, tnets=settings.tnets)
    match settings.views:
        case "fixed":
            return FixedViews(*place)
        case "jittered":
            return JitteredViews(*place)
        case "random":
            return RandomViews(*place)
        case "learned-direct":
            return DirectViews(*place, periodic=settings.angles == "periodic", encoder=encoder(), **learn)
        case "learned-circular" | "learned-spherical":
            return OffsetViews(*place, encoder=encoder(), **learn)
        case "learned-random":
            return RandomOffsetViews(*place, encoder=encoder(), **learn)
        case "transferred":
            selector = TransferredViews(*place, build=make_selector)
            if views_from is not None:
                selector.take(views_from)
            return selector
        case _:
            raise choose_error("views", settings.views, SELECTIONS)


def _start(settings: SelectorSettings) -> Angles:
    azimuth, elevation = layouts(settings.start_layout, settings.num_views, settings.elevation, settings.azimuth)
    return torch.from_numpy(azimuth), torch.from_numpy(elevation)


def _check_scene(settings: SelectorSettings) -> None:
    learns = settings.learn_distance > 1 or settings.learn_light
    if learns and not settings.views.startswith("learned"):
        raise UsageError(
            f"distance and light can be learned with learned views, not with {settings.views} ones",
            hint="add --views learned-spherical, or leave --learn-distance and --learn-light out",
            code="views.scene",
        )
    if settings.learn_distance > 1 and settings.distance / settings.learn_distance < NEAREST:
        raise UsageError(
            f"a distance of {settings.distance:g} radii, divided by up to {settings.learn_distance:g}, "
            "would let a camera into the shape",
            hint=f"use a --learn-distance below {settings.distance / NEAREST:.2f}",
            code="views.scene",
        )
