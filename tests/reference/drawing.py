"""Ask the fast renderer, in few words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from mvtn_cli.core.render import Look, render
from mvtn_cli.core.render.mesh import MeshScene, camera_matrices
from mvtn_cli.core.store import StoredShape
from mvtn_cli.core.views import Cameras
from reference.scenes import FOV, batch_of


def cameras(*views: tuple[float, float, float], count: int = 1, grad: bool = False) -> Cameras:
    """Return the same (azimuth, elevation, distance) views for each of `count` shapes."""
    columns = [torch.tensor(column, dtype=torch.float32).repeat(count, 1) for column in zip(*views, strict=True)]
    return Cameras(*(column.requires_grad_(grad) for column in columns), fov_deg=FOV)


def matrices(views: Cameras) -> np.ndarray:
    """Return [R | t] of every camera, (B, M, 3, 4) float64, as the renderer has them."""
    return camera_matrices(views.azimuth_deg, views.elevation_deg, views.distance).detach().numpy()


def image(shape: StoredShape, views: Cameras, look: Look) -> np.ndarray:
    """Return the (M, 3, H, W) images of one shape."""
    return render(batch_of(shape), views, look, gradient="none").rgb[0].numpy()


def gradients(shape: StoredShape, views: Cameras, look: Look, weights: np.ndarray, **how) -> np.ndarray:
    """Return (M, 3): d<weights, images> by azimuth, elevation (per degree) and distance.

    `weights` are (M, 3, H, W).
    """
    angles = (views.azimuth_deg, views.elevation_deg, views.distance)
    leaves = [field.detach().clone().requires_grad_() for field in angles]
    rgb = render(batch_of(shape), Cameras(*leaves, fov_deg=FOV), look, **how).rgb
    (rgb[0] * torch.as_tensor(weights, dtype=torch.float32)).sum().backward()
    return np.stack([leaf.grad[0].numpy() for leaf in leaves], -1).astype(np.float64)


@dataclass(frozen=True)
class Samples:
    """What the renderer found for one view before it made pixels of it.

    Attributes:
        ids: (H, W) face ids of the samples. colors: (3, H, W) at sample centres.
        links: (H, W, 2), whether the surface goes on smoothly to the right, downward.
        records: (N, 6): share of the step, slope, crossing in camera coordinates, part of the colour jump.
        where: N rows of (row, column, 0 right or 1 down).
        image: (3, h, w) float32.
    """

    ids: np.ndarray
    colors: np.ndarray
    links: np.ndarray
    records: np.ndarray
    where: list[tuple[int, int, int]]
    image: np.ndarray


def samples(shape: StoredShape, view: tuple[float, float, float], look: Look) -> Samples:
    """Draw one view and look inside."""
    scene = MeshScene(batch_of(shape), look, FOV)
    seen = scene.see(matrices(cameras(view)))
    images, painted = scene.paint(seen)
    ids, width, count = seen.ids[0], seen.ids.shape[2], seen.jumps[0]
    first, last, left, right = seen.boxes[0]
    colors, links = np.tile(np.array(look.background, np.float32), (*ids.shape, 1)), np.zeros((*ids.shape, 2), bool)
    inside = np.s_[first : last + 1, left : right + 1]
    colors[inside] = painted[0][inside]
    links[inside] = (seen.links[0][inside][..., None] & [1, 2]) > 0
    places = [(int(w >> 1) // width, int(w >> 1) % width, int(w & 1)) for w in seen.where[0, :count]]
    return Samples(ids, colors.transpose(2, 0, 1), links, seen.records[0, :count], places, images[0])


def hard_image(shape: StoredShape, view: tuple[float, float, float], look: Look) -> np.ndarray:
    """Return the plain mean of the samples, without antialiasing, (3, H, W) float64."""
    colors = samples(shape, view, look).colors.astype(np.float64)
    size, fine = look.image_size, look.supersample
    return colors.reshape(3, size, fine, size, fine).mean(axis=(2, 4))
