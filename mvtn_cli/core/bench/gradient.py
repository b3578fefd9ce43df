"""`mvtn bench gradient`: how right the gradient to the cameras is, and what it costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from torch import Tensor

from mvtn_cli.console import Console, Ticker
from mvtn_cli.core.bench.cost import backbone_ratio
from mvtn_cli.core.bench.modes import DEFAULT_MODE, Mode, angle_gradient, modes_of
from mvtn_cli.core.bench.outcome import Outcome, Row
from mvtn_cli.core.bench.plan import Plan, TruthSetting
from mvtn_cli.core.bench.subjects import DRAWN, Subject, golden_spiral, light_words, look_at, spiral_cameras
from mvtn_cli.core.bench.timing import interleaved
from mvtn_cli.core.bench.truth import images_of_truth, true_gradient
from mvtn_cli.core.bench.vectors import cosine, mean_cosine, mean_of, relative_l2
from mvtn_cli.core.bench.weights import network_weights, smooth_weights, white_weights
from mvtn_cli.core.render import Look, ShapeBatch, pack, render

SMOOTH, SHARP = ("smooth",), ("white", "cnn")
NUMBERS = ("cosine", "G", "l2", "seconds", "truth_cosine", "truth_l2")


@dataclass(frozen=True)
class Scene:
    """One mesh, or its points, drawn in one way: what every mode is tried on."""

    subject: Subject
    drawn: str
    batch: ShapeBatch
    look: Look
    weights: dict[str, Tensor]


def measure_gradient(subjects: Sequence[Subject], plan: Plan, console: Console) -> Outcome:
    """Hold each gradient mode against the truth, on each mesh, in all ways to draw it, for three kinds of loss."""
    rows: list[Row] = []
    drawings = len(subjects) * sum(_drawings(drawn, plan) for drawn in DRAWN)
    with console.progress("images of the truth", drawings) as ticker:
        for subject in subjects:
            for drawn in DRAWN:
                ticker.note(f"{subject.name} {drawn}")
                rows += _rows_of(_scene(subject, drawn, plan), plan, ticker)
    means = mean_rows(rows)
    densest = max(subjects, key=lambda subject: subject.faces)
    ratio = backbone_ratio(densest, plan)
    summary = {**_summary(means), "backbone_ratio": ratio, "backbone_ratio_mesh": densest.name}
    notes = {
        "truth": {
            "smooth": [str(setting) for setting in plan.smooth_truth],
            "white, cnn": [str(setting) for setting in plan.sharp_truth],
            "points": "one lattice each",
            "uncertainty": "relative L2 of the second setting against the first",
        }
    }
    return Outcome(rows + means, summary, notes)


def _scene(subject: Subject, drawn: str, plan: Plan) -> Scene:
    batch = pack([subject.shape])
    look = look_at([subject], plan, **DRAWN[drawn])
    images = render(batch, spiral_cameras(plan.num_views), look, gradient="none").rgb[0]
    seed = plan.seed + 1000 * subject.number
    weights = {
        "smooth": smooth_weights(plan.num_views, plan.image_size, seed),
        "white": white_weights(plan.num_views, plan.image_size, seed + 1),
        "cnn": network_weights(images, plan.seed),
    }
    return Scene(subject, drawn, batch, look, weights)


def _rows_of(scene: Scene, plan: Plan, ticker: Ticker) -> list[Row]:
    truth, second = _truths(scene, plan, ticker)
    cameras = spiral_cameras(plan.num_views)
    found: dict[str, Tensor] = {}

    def trial(mode: Mode, weights: str) -> None:
        wanted = scene.weights[weights][None]
        found[f"{mode.name}/{weights}"] = angle_gradient(scene.batch, cameras, scene.look, mode, wanted)[0]

    modes = modes_of(scene.look)
    works = {f"{m.name}/{w}": lambda m=m, w=w: trial(m, w) for w in scene.weights for m in modes}
    timings = interleaved(works, plan.repeats)
    return [
        {
            "mesh": scene.subject.name,
            "faces": None if scene.look.kind == "points" else scene.subject.faces,
            "light": light_words(scene.subject),
            "shading": scene.drawn,
            "weights": weights,
            "mode": mode.name,
            **judged(found[key].numpy(), truth[weights]),
            "seconds": timings[key].median,
            "truth_cosine": mean_cosine(second[weights], truth[weights]),
            "truth_l2": relative_l2(second[weights], truth[weights]),
        }
        for weights in scene.weights
        for mode in modes
        for key in [f"{mode.name}/{weights}"]
    ]


def _truths(scene: Scene, plan: Plan, ticker: Ticker) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The truth by kind of weights, and the second one that tells its uncertainty."""
    both: list[dict[str, np.ndarray]] = []
    for number in (0, 1):
        merged: dict[str, np.ndarray] = {}
        for names, settings in _settings(scene.drawn, plan).items():
            weights = {name: scene.weights[name] for name in names}
            spiral = golden_spiral(plan.num_views)
            merged |= true_gradient(scene.batch, *spiral, scene.look, weights, settings[number], ticker)
        both.append(merged)
    return both[0], both[1]


def _settings(drawn: str, plan: Plan) -> dict[tuple[str, ...], tuple[TruthSetting, ...]]:
    """The two settings of the truth by kinds of weights; points have no edges, and one lattice does."""
    found: dict[tuple[str, ...], tuple[TruthSetting, ...]] = {SMOOTH: plan.smooth_truth, SHARP: plan.sharp_truth}
    if DRAWN[drawn].get("kind") != "points":
        return found
    return {names: tuple(replace(setting, lattices=1) for setting in pair) for names, pair in found.items()}


def _drawings(drawn: str, plan: Plan) -> int:
    """How many images the truth of one scene takes."""
    return sum(images_of_truth(plan.num_views, setting) for pair in _settings(drawn, plan).values() for setting in pair)


def judged(candidate: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """The three figures of a gradient (M, 2): mean cosine a view, cosine of all numbers at once, relative L2."""
    return {
        "cosine": mean_cosine(candidate, truth),
        "G": cosine(candidate, truth),
        "l2": relative_l2(candidate, truth),
    }


def mean_rows(rows: Sequence[Row]) -> list[Row]:
    """Means over the meshes, for each shading, kind of weights and mode, in the order of their first rows."""
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["shading"], row["weights"], row["mode"]), []).append(row)
    return [
        {
            "mesh": "mean",
            "faces": None,
            "light": None,
            "shading": shading,
            "weights": weights,
            "mode": mode,
            **{name: mean_of(row[name] for row in group) for name in NUMBERS},
        }
        for (shading, weights, mode), group in groups.items()
    ]


def _summary(means: Sequence[Row]) -> dict[str, Any]:
    """The figures of the default mode: smooth shading, smooth weights."""
    wanted = ("smooth", "smooth", DEFAULT_MODE)
    row = next(row for row in means if (row["shading"], row["weights"], row["mode"]) == wanted)
    return {"default_mode": DEFAULT_MODE, "cosine_mean": row["cosine"], "l2_mean": row["l2"]}
