"""`mvtn bench pose`: does descent along the gradient find a camera again?"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from mvtn_cli.console import Console
from mvtn_cli.core.bench.modes import DEFAULT_MODE, Mode, all_modes, draw, wanting
from mvtn_cli.core.bench.outcome import Outcome, Row
from mvtn_cli.core.bench.plan import Plan
from mvtn_cli.core.bench.subjects import Subject, cameras_at, golden_spiral, light_words, look_at
from mvtn_cli.core.bench.weights import gaussian_matrix
from mvtn_cli.core.render import pack, render
from mvtn_cli.core.views import angle_between

BLUR = 6 / 224  # standard deviation of the blur of the loss, image sides
OFF_DEG = (8.0, 15.0)  # how far off a start is, in each angle
STEPS_DEG = (1.0, 0.03)  # first and last learning rate, along a cosine
WITHIN_DEG = 1.0


@dataclass(frozen=True)
class Recovery:
    """One descent of M cameras.

    Attributes:
        start_deg: (M,) how far each direction was off.
        error_deg: (M,) how far it ended.
        seconds: Of the whole descent.
    """

    start_deg: np.ndarray
    error_deg: np.ndarray
    seconds: float


def measure_pose(subjects: Sequence[Subject], plan: Plan, console: Console) -> Outcome:
    """Start 8 to 15 degrees off in both angles and descend a blurred squared error, in each mode."""
    rows, failures = [], []
    modes = [mode for mode in all_modes() if mode.supersample == 1]
    with console.progress("descents", len(subjects) * len(modes)) as ticker:
        for subject in subjects:
            for mode in modes:
                ticker.note(f"{subject.name} {mode.name}")
                found = recover(subject, mode, plan)
                rows.append(_row(subject, mode, found))
                failures += _failures(subject, mode, found)
                ticker.advance()
    totals = [_total([row for row in rows if row["mode"] == mode.name], mode) for mode in modes]
    return Outcome(rows + totals, _summary(totals), {"failures": failures})


def recover(subject: Subject, mode: Mode, plan: Plan) -> Recovery:
    """Descend from wrong angles to those of the picture, `plan.pose_steps` steps of Adam."""
    batch, look = pack([subject.shape]), look_at([subject], plan)
    azimuth, elevation = golden_spiral(plan.num_views)
    target = render(batch, cameras_at(azimuth, elevation), look, gradient="none").rgb
    off = offsets(plan.num_views, (plan.seed, subject.number))
    cameras = wanting(cameras_at(azimuth + off[:, 0], elevation + off[:, 1]))
    angles = [cameras.azimuth_deg, cameras.elevation_deg]
    adam = torch.optim.Adam(angles, lr=STEPS_DEG[0], betas=(0.9, 0.99))
    blur = blur_twice(plan.image_size)
    draw(batch, cameras, look, mode).backward(torch.zeros_like(target))  # compiles, if nothing has yet
    started = time.perf_counter()
    for step in range(plan.pose_steps):
        adam.param_groups[0]["lr"] = learning_rate(step, plan.pose_steps)
        adam.zero_grad()
        images = draw(batch, cameras, look, mode)
        images.backward(blurred_difference(images.detach(), target, blur))
        adam.step()
    seconds = time.perf_counter() - started
    end_azimuth, end_elevation = (angle.detach().numpy()[0] for angle in angles)
    start = angle_between(azimuth + off[:, 0], elevation + off[:, 1], azimuth, elevation)
    return Recovery(start, angle_between(end_azimuth, end_elevation, azimuth, elevation), seconds)


def offsets(count: int, seed: int | tuple[int, ...]) -> np.ndarray:
    """How far off each start is in azimuth and elevation, (count, 2) degrees of either sign."""
    random = np.random.default_rng(seed)
    return random.uniform(*OFF_DEG, (count, 2)) * random.choice([-1.0, 1.0], (count, 2))


def learning_rate(step: int, steps: int) -> float:
    """Degrees, along half a cosine from the first to the last."""
    first, last = STEPS_DEG
    return last + (first - last) * 0.5 * (1 + math.cos(math.pi * step / max(1, steps - 1)))


def blur_twice(size: int) -> Tensor:
    """The matrix of the loss's Gaussian blur and, after it, its transpose: what its gradient needs."""
    blur = gaussian_matrix(size, BLUR * size)
    return torch.from_numpy(blur.T @ blur).float()


def blurred_difference(images: Tensor, target: Tensor, blur: Tensor) -> Tensor:
    """dL/dI of L = Σ (G ∗ (I − I*))², of the images' shape; `blur` is that of `blur_twice`."""
    return 2 * (blur @ (images - target) @ blur)


def _row(subject: Subject, mode: Mode, found: Recovery) -> Row:
    return {
        "mesh": subject.name,
        "faces": subject.faces,
        "light": light_words(subject),
        "mode": mode.name,
        "within_1deg": int((found.error_deg <= WITHIN_DEG).sum()),
        "of": len(found.error_deg),
        "median_deg": float(np.median(found.error_deg)),
        "worst_deg": float(found.error_deg.max()),
        "seconds": found.seconds,
    }


def _failures(subject: Subject, mode: Mode, found: Recovery) -> list[dict[str, Any]]:
    pairs = enumerate(zip(found.start_deg, found.error_deg, strict=True))
    return [
        {"mesh": subject.name, "mode": mode.name, "view": view, "start_deg": float(start), "error_deg": float(error)}
        for view, (start, error) in pairs
        if not error <= WITHIN_DEG
    ]


def _total(rows: Sequence[Row], mode: Mode) -> Row:
    return {
        "mesh": "all",
        "faces": None,
        "light": None,
        "mode": mode.name,
        "within_1deg": sum(row["within_1deg"] for row in rows),
        "of": sum(row["of"] for row in rows),
        "median_deg": float(np.median([row["median_deg"] for row in rows])),
        "worst_deg": max(row["worst_deg"] for row in rows),
        "seconds": sum(row["seconds"] for row in rows),
    }


def _summary(totals: Sequence[Row]) -> dict[str, Any]:
    row = next(row for row in totals if row["mode"] == DEFAULT_MODE)
    return {"default_mode": DEFAULT_MODE, "within_1deg": row["within_1deg"], "of": row["of"]}
