"""Let a recogniser choose cameras without taking pictures, or take pictures from cameras it did not choose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from mvtn_cli.console import Console
from mvtn_cli.core.networks.viewpoint import Placement
from mvtn_cli.core.render import Look
from mvtn_cli.core.training.randomness import evaluation_generator
from mvtn_cli.core.training.shapes import Shapes, alike_batches, load_batch
from mvtn_cli.core.views import Cameras, camera_rotations

if TYPE_CHECKING:
    from mvtn_cli.config import TrainConfig
    from mvtn_cli.core.networks.recogniser import Recogniser

Angles = tuple[NDArray[np.float64], NDArray[np.float64]]


@torch.no_grad()
def cameras_of(
    model: Recogniser,
    shapes: Shapes,
    indices: Sequence[int],
    settings: TrainConfig,
    *,
    batch_size: int,
    console: Console,
) -> Angles:
    """Azimuth and elevation, each (N, M), that a recogniser in evaluation mode chooses for N shapes."""
    azimuth, elevation = [], []
    with console.progress("choosing cameras", len(indices)) as ticker:
        for number, chunk in enumerate(alike_batches(shapes, indices, batch_size, settings.render)):
            batch, _ = load_batch(shapes, chunk, settings.render)
            cameras = model.choose_cameras(batch, generator=evaluation_generator(settings.seed, number))
            azimuth.append(cameras.azimuth_deg.double().cpu().numpy())
            elevation.append(cameras.elevation_deg.double().cpu().numpy())
            ticker.advance(len(chunk))
    return np.concatenate(azimuth), np.concatenate(elevation)


@torch.no_grad()
def recognise_from(
    model: Recogniser,
    shapes: Shapes,
    indices: Sequence[int],
    views: Mapping[str, Angles],
    settings: TrainConfig,
    *,
    batch_size: int,
    console: Console,
) -> dict[str, NDArray[np.float32]]:
    """What a recogniser in evaluation mode says of N shapes when it sees them from other sides.

    Args:
        model: Distance and light stay those that it chooses for each shape; see `moved`.
        shapes: The data set.
        indices: N of its records.
        views: Under each name azimuth and elevation, each (N, M), degrees.
        settings: Of the training.
        batch_size: Shapes at a time; no answer depends on it.
        console: For progress.

    Returns:
        Under each name logits (N, C).
    """
    logits: dict[str, list[NDArray[np.float32]]] = {name: [] for name in views}
    done = 0
    with console.progress("classifying from other views", len(indices)) as ticker:
        for number, chunk in enumerate(alike_batches(shapes, indices, batch_size, settings.render)):
            batch, kind = load_batch(shapes, chunk, settings.render)
            look = Look.evaluation(settings, len(batch), kind)
            own = model.place(batch, generator=evaluation_generator(settings.seed, number))
            rows = slice(done, done + len(chunk))
            for name, (azimuth, elevation) in views.items():
                placement = moved(own, torch.tensor(azimuth[rows]), torch.tensor(elevation[rows]))
                logits[name].append(model.recognise(batch, look, placement).logits.float().cpu().numpy())
            done += len(chunk)
            ticker.advance(len(chunk))
    return {name: np.concatenate(parts) for name, parts in logits.items()}


def moved(placement: Placement, azimuth_deg: Tensor, elevation_deg: Tensor) -> Placement:
    """The same cameras at other angles (B, M): their distance stays, and a learned light turns with its camera."""
    old = placement.cameras
    azimuth, elevation = azimuth_deg.to(old.azimuth_deg), elevation_deg.to(old.elevation_deg)
    light = placement.light
    if light is not None:
        before, after = (camera_rotations(a, e).to(light) for a, e in (
            (old.azimuth_deg, old.elevation_deg), (azimuth, elevation)
        ))  # fmt: skip
        light = torch.einsum("bmji,bmjk,bmk->bmi", after, before, light)
    return Placement(Cameras(azimuth, elevation, old.distance, old.fov_deg), light)
