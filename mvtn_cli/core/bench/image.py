"""`mvtn bench image`: how far a picture is from the true one, and what it costs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch

from mvtn_cli.console import Console, Ticker
from mvtn_cli.core.bench.outcome import Outcome, Row
from mvtn_cli.core.bench.plan import Plan
from mvtn_cli.core.bench.subjects import Subject, light_words, look_at, spiral_cameras
from mvtn_cli.core.bench.timing import interleaved
from mvtn_cli.core.bench.truth import views_at_once
from mvtn_cli.core.bench.vectors import mean_of, rmse
from mvtn_cli.core.render import Look, ShapeBatch, pack, render

SUPERSAMPLES = (1, 2, 4)
SHADINGS = ("smooth", "flat")


def measure_image(subjects: Sequence[Subject], plan: Plan, console: Console) -> Outcome:
    """Root mean square error of each number of samples, at the plan's image size and at half of it."""
    sizes = sorted({max(8, plan.image_size // 2), plan.image_size})
    rows: list[Row] = []
    drawings = len(subjects) * len(SHADINGS) * len(sizes) * plan.num_views * len(plan.image_truths)
    with console.progress("true images", drawings) as ticker:
        for subject in subjects:
            for shading in SHADINGS:
                for size in sizes:
                    look = look_at([subject], plan, image_size=size, shading=shading)
                    rows += _rows_of(subject, look, plan, ticker)
    means = _mean_rows(rows)
    summary = {
        f"rmse_{n}": mean_of(r["rmse"] for r in means if r["supersample"] == n and r["image_size"] == sizes[-1])
        for n in SUPERSAMPLES
    }
    notes = {"truth": [f"{n}x{n}" for n in plan.image_truths], "image_sizes": sizes}
    return Outcome(rows + means, summary, notes)


def true_images(batch: ShapeBatch, look: Look, num_views: int, supersample: int, ticker: Ticker) -> np.ndarray:
    """Images (M, 3, H, W) of one shape, few views at a time: `supersample` squared samples a pixel."""
    cameras, fine = spiral_cameras(num_views), replace(look, supersample=supersample)
    images, at_once = [], views_at_once(look.image_size * supersample)
    for start in range(0, num_views, at_once):
        views = cameras.select(views=slice(start, start + at_once))
        images.append(render(batch, views, fine, gradient="none").rgb[0])
        ticker.advance(len(images[-1]))
    return torch.cat(images).numpy()


def _rows_of(subject: Subject, look: Look, plan: Plan, ticker: Ticker) -> list[Row]:
    batch, cameras = pack([subject.shape]), spiral_cameras(plan.num_views)
    truth, second = (true_images(batch, look, plan.num_views, n, ticker) for n in plan.image_truths)
    found: dict[str, np.ndarray] = {}

    def work(n: int) -> Callable[[], None]:
        def draw() -> None:
            found[str(n)] = render(batch, cameras, replace(look, supersample=n), gradient="none").rgb[0].numpy()

        return draw

    timings = interleaved({str(n): work(n) for n in SUPERSAMPLES}, plan.repeats)
    return [
        {
            "mesh": subject.name,
            "faces": subject.faces,
            "light": light_words(subject),
            "shading": look.shading,
            "image_size": look.image_size,
            "supersample": n,
            "rmse": rmse(found[str(n)], truth),
            "seconds": timings[str(n)].median,
            "truth_rmse": rmse(second, truth),
        }
        for n in SUPERSAMPLES
    ]


def _mean_rows(rows: Sequence[Row]) -> list[Row]:
    groups: dict[tuple[str, int, int], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["shading"], row["image_size"], row["supersample"]), []).append(row)
    return [
        {
            **dict.fromkeys(rows[0]),
            "mesh": "mean",
            "shading": shading,
            "image_size": size,
            "supersample": n,
            **{name: mean_of(row[name] for row in group) for name in ("rmse", "seconds", "truth_rmse")},
        }
        for (shading, size, n), group in groups.items()
    ]
