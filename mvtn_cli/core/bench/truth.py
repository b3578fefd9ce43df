"""The gradient to the cameras without any cleverness: differences of finely sampled images.

A lattice of samples sees an edge that runs along its rows jump by a whole row at once, and furniture is made of such
edges. So the samples of a pixel are spread over several coarser lattices, shifted against each other by parts of a
sample: 8x8 samples on 16 lattices are 1,024 a pixel as 32x32 are, but meet a vertical edge in 128 places, not 32.

Points have no edges, and their discs are integrated over each sample: their truth is the average of a larger image, in
which discs cover and hide each other within a pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numba
import numpy as np
import psutil
from torch import Tensor

from mvtn_cli.console import Ticker
from mvtn_cli.core.bench.plan import TruthSetting
from mvtn_cli.core.bench.subjects import cameras_at
from mvtn_cli.core.render import Look, ShapeBatch, render
from mvtn_cli.core.render.mesh import MeshScene, camera_matrices

BYTES_A_SAMPLE = 34  # of the renderer's buffers, while a view is drawn
GOLDEN = 0.5 * (5**0.5 - 1)
Drawing = Callable[[np.ndarray, np.ndarray], np.ndarray]  # angles (N, 2) and shift (2,) to images (N, 3, H, W)


def true_gradient(
    batch: ShapeBatch,
    azimuth_deg: np.ndarray,
    elevation_deg: np.ndarray,
    look: Look,
    weights: Mapping[str, Tensor],
    setting: TruthSetting,
    ticker: Ticker,
) -> dict[str, np.ndarray]:
    """Central differences of <weights, image> over azimuth and elevation, mean over shifted lattices.

    The images are the renderer's own at many samples a pixel. They still move silhouettes to where they are between two
    samples; so far down this changes a pixel by less than the truth's uncertainty. Lattices of points are not shifted.

    Args:
        batch: One shape.
        azimuth_deg: (M,) float64.
        elevation_deg: (M,) float64.
        look: Its `supersample` does not matter.
        weights: Name to (M, 3, H, W).
        setting: Samples, lattices and step.
        ticker: Advances by one an image.

    Returns:
        Name to (M, 2) float64, per degree.
    """
    images_of = (_points_drawn if look.kind == "points" else _faces_drawn)(batch, look, setting)
    moved = [(m, axis, sign) for m in range(len(azimuth_deg)) for axis in (0, 1) for sign in (1, -1)]
    sums = {name: np.zeros((len(azimuth_deg), 2)) for name in weights}
    for shift in lattice_shifts(setting):
        for part in _parts(moved, views_at_once(look.image_size * setting.supersample)):
            angles = np.array([[azimuth_deg[m], elevation_deg[m]] for m, _, _ in part])
            for row, (_, axis, sign) in enumerate(part):
                angles[row, axis] += sign * setting.step_deg
            images = images_of(angles, shift)
            for name, weight in weights.items():
                for row, (m, axis, sign) in enumerate(part):
                    sums[name][m, axis] += sign * inner_product(images[row], weight[m].numpy())
            ticker.advance(len(part))
    return {name: total / (2 * setting.step_deg * setting.lattices) for name, total in sums.items()}


def _faces_drawn(batch: ShapeBatch, look: Look, setting: TruthSetting) -> Drawing:
    fov_deg = cameras_at(np.zeros(1), np.zeros(1)).fov_deg
    scene = MeshScene(batch, replace(look, supersample=setting.supersample), fov_deg)
    return lambda angles, shift: scene.images(shifted_matrices(angles, shift / scene.focal))[0]


def _points_drawn(batch: ShapeBatch, look: Look, setting: TruthSetting) -> Drawing:
    size, by = look.image_size, setting.supersample
    large = replace(look, image_size=size * by)

    def images(angles_deg: np.ndarray, _: np.ndarray) -> np.ndarray:
        drawn = render(batch, cameras_at(*angles_deg.T), large, gradient="none").rgb[0].numpy()
        return drawn.reshape(-1, 3, size, by, size, by).mean(axis=(3, 5), dtype=np.float64)

    return images


def lattice_shifts(setting: TruthSetting) -> np.ndarray:
    """Where each lattice lies, (lattices, 2) pixels, within half a sample of the plain one and around it."""
    k = np.arange(setting.lattices)
    cell = np.stack([(k + 0.5) / setting.lattices, (k * GOLDEN + 0.5) % 1], axis=-1) - 0.5
    return (cell - cell.mean(axis=0)) / setting.supersample


def shifted_matrices(angles_deg: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """[R|t] of cameras whose picture is shifted, (1, N, 3, 4) float64.

    Args:
        angles_deg: (N, 2) azimuth and elevation.
        shift: (2,) to the left and down, in focal lengths: a multiple of depth, added to x and y before the division.
    """
    cameras = cameras_at(*angles_deg.T)
    matrices = camera_matrices(cameras.azimuth_deg, cameras.elevation_deg, cameras.distance).numpy().copy()
    matrices[..., :2, :] += shift[:, None] * matrices[..., 2:, :]
    return matrices


def images_of_truth(num_views: int, setting: TruthSetting) -> int:
    """How many images `true_gradient` draws."""
    return 4 * num_views * setting.lattices


def views_at_once(side: int) -> int:
    """How many views of `side` samples squared fit into half the free memory; at most one a thread."""
    fitting = int(psutil.virtual_memory().available / 2 / (BYTES_A_SAMPLE * side * side))
    return max(1, min(numba.get_num_threads(), fitting))


def inner_product(a: np.ndarray, b: np.ndarray) -> float:
    """Sum of products in float64."""
    return float(np.dot(a.ravel().astype(np.float64), b.ravel().astype(np.float64)))


def _parts(items: list, size: int) -> Iterator[list]:
    for start in range(0, len(items), size):
        yield items[start : start + size]
