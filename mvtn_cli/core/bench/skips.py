"""`mvtn bench skips`: what a scene does not need, what leaving it out saves, and whether it changes anything."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from mvtn_cli.console import Console
from mvtn_cli.core.bench.modes import DEFAULT_MODE, wanting
from mvtn_cli.core.bench.outcome import Outcome, Row
from mvtn_cli.core.bench.plan import Plan
from mvtn_cli.core.bench.subjects import Subject, icosphere, look_at, spiral_cameras, stored
from mvtn_cli.core.bench.timing import interleaved
from mvtn_cli.core.bench.weights import smooth_weights
from mvtn_cli.core.render import Look, ShapeBatch, pack, render
from mvtn_cli.core.render.skips import BITS, EVERYTHING, without
from mvtn_cli.core.render.tally import tally
from mvtn_cli.core.render.view_keeper import ViewKeeper, kept_batch
from mvtn_cli.core.shapes import Shape
from mvtn_cli.core.views import Cameras

CLOSE = 1.1  # radii: parts of the shape are outside of the picture
SKIPS = tuple(BITS)
THINGS = {
    "background": "samples",
    "shading-terms": "samples",
    "same-view": "views",
    "no-gradient": "views",
    "fixed-views": "views",
}


@dataclass(frozen=True)
class Stage:
    """One shape from some views, with the gradient that comes in: where a skip has something to leave out.

    Attributes:
        words: How it is called in the rows.
        batch, cameras, look: What `render` takes.
        weights: (1, M, 3, H, W), dL/dI; None: the cameras are fixed and take no gradient.
    """

    words: str
    batch: ShapeBatch
    cameras: Cameras
    look: Look
    weights: Tensor | None

    def step(self, skips: int) -> tuple[Tensor, Tensor]:
        """Images (1, M, 3, H, W) and their gradient (1, M, 2) to azimuth and elevation; 0 for fixed cameras."""
        if self.weights is None:
            rgb = render(self.batch, self.cameras, self.look, gradient="none", skips=skips).rgb
            return rgb, torch.zeros(*rgb.shape[:2], 2)
        leaves = wanting(self.cameras)
        rgb = render(self.batch, leaves, self.look, gradient=DEFAULT_MODE, skips=skips).rgb
        torch.autograd.backward(rgb, self.weights)
        assert leaves.azimuth_deg.grad is not None and leaves.elevation_deg.grad is not None
        return rgb.detach(), torch.stack([leaves.azimuth_deg.grad, leaves.elevation_deg.grad], dim=-1)


def measure_skips(subjects: Sequence[Subject], plan: Plan, console: Console) -> Outcome:
    """Draw each mesh forward and backward with everything left out that may be, and with one thing less.

    The summary counts the skips, and those of them that change no bit of any mesh.
    """
    rows: list[Row] = []
    with console.progress("skips", len(subjects) * len(SKIPS)) as ticker:
        for subject in subjects:
            for name in SKIPS:
                rows.append(_row(subject, name, plan))
                ticker.advance()
    changing = {row["skip"] for row in rows if not row["identical"]}
    return Outcome(rows, {"skips": len(SKIPS), "identical": len(SKIPS) - len(changing)})


def extra_subjects() -> list[Subject]:
    """A closed body, and a mesh of many layers: where `backface` and `occluded` have much to leave out."""
    return [icosphere(), layers()]


def layers(count: int = 11, side: int = 42) -> Subject:
    """Wavy sheets behind each other, 36,982 faces."""
    along = np.linspace(-0.7, 0.7, side)
    x, y = np.meshgrid(along, along)
    depth = np.linspace(0.6, -0.6, count)[:, None, None] + 0.03 * np.sin(9 * x) * np.cos(7 * y)
    vertices = np.stack([np.broadcast_to(x, depth.shape), np.broadcast_to(y, depth.shape), depth], -1).reshape(-1, 3)
    number = np.arange(len(vertices)).reshape(count, side, side)
    a, b, c, d = number[:, :-1, :-1], number[:, :-1, 1:], number[:, 1:, 1:], number[:, 1:, :-1]
    faces = np.stack([a, b, c, a, c, d], -1).reshape(-1, 3).astype(np.int32)
    shape = Shape(vertices=vertices, faces=faces, name="layers", source=f"{count} wavy sheets")
    return Subject("layers", shape.source, stored(shape), 2)


def stage_for(name: str, subject: Subject, plan: Plan) -> Stage:
    """The plan's views, so arranged that this skip has something to leave out."""
    views, half = plan.num_views, plan.num_views // 2
    cameras, words = spiral_cameras(views), f"{views} views"
    look = look_at([subject], plan)
    if name == "fixed-views":
        kept = kept_batch([subject.shape], [subject.name], ViewKeeper(None, Console(quiet=True)))
        stage = Stage(f"{words}, fixed, forward only", kept, cameras, look, None)
        stage.step(EVERYTHING)  # the first epoch
        return stage
    weights = smooth_weights(views, plan.image_size, plan.seed)[None]
    if name == "frustum":
        cameras, words = replace(cameras, distance=torch.full_like(cameras.distance, CLOSE)), f"{words}, close"
    elif name == "same-view" and half:
        places = np.arange(views) % (views - half)
        cameras, words = cameras.select(views=places.tolist()), f"{words}, {half} of them twice"
    elif name == "no-gradient":
        weights = weights.clone()
        weights[:, views - max(1, half) :] = 0
        words = f"{words}, {max(1, half)} without gradient"
    return Stage(words, pack([subject.shape]), cameras, look, weights)


def _row(subject: Subject, name: str, plan: Plan) -> Row:
    stage = stage_for(name, subject, plan)
    left_out, of = _counted(name, lambda: stage.step(EVERYTHING))
    found: dict[str, tuple[Tensor, Tensor]] = {}

    def work(key: str, skips: int) -> Callable[[], None]:
        def run() -> None:
            found[key] = stage.step(skips)

        return run

    timings = interleaved({"on": work("on", EVERYTHING), "off": work("off", without([name]))}, plan.repeats)
    on, off = timings["on"].median, timings["off"].median
    pixels = int((found["on"][0] != found["off"][0]).any(dim=2).sum())
    return {
        "mesh": subject.name,
        "faces": subject.faces,
        "scene": stage.words,
        "skip": name,
        "things": THINGS.get(name, "faces"),
        "left_out": left_out,
        "of": of,
        "share": left_out / of if left_out is not None and of else None,
        "seconds": on,
        "seconds_off": off,
        "ratio": on / off,
        "identical": all(map(torch.equal, found["on"], found["off"])),
        "pixels_differ": pixels,
    }


def _counted(name: str, work: Callable[[], object]) -> tuple[int | None, int | None]:
    """How much one call leaves out, and of how much; None for what is not counted."""
    before = Counter(tally().left_out), Counter(tally().of)
    work()
    of = tally().of[name] - before[1][name]
    return (tally().left_out[name] - before[0][name], of) if of else (None, None)
