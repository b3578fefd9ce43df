"""`mvtn bench stiff`: does anything that is not a number come out?"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from functools import partial

import numpy as np
import torch

from mvtn_cli.console import Console
from mvtn_cli.core.bench import stiff_shapes as made
from mvtn_cli.core.bench.modes import DEFAULT_MODE
from mvtn_cli.core.bench.outcome import Outcome, Row
from mvtn_cli.core.bench.plan import Plan
from mvtn_cli.core.bench.stiff_cases import Case, stiff_cases
from mvtn_cli.core.bench.stiff_checks import Seen
from mvtn_cli.core.bench.weights import smooth_weights
from mvtn_cli.core.render import Look, pack, render
from mvtn_cli.core.store import StoredShape
from mvtn_cli.core.views import Cameras
from mvtn_cli.errors import DataError

SHADINGS = ("smooth", "flat")
NOT_HERE = (
    {"what": "T13", "reason": "there is no soft mode whose sigma could go to zero"},
    {"what": "T11, 1xN", "reason": "images are square"},
)


def measure_stiff(plan: Plan, console: Console, cases: Iterable[Case] | None = None) -> Outcome:
    """Draw each case, forward and backward, meshes in both shadings, and judge what comes out."""
    listed = list(stiff_cases() if cases is None else cases)
    works = [
        (case, drawn) for case in listed for drawn in (("points",) if case.kind == "points" else ("smooth", "flat"))
    ]
    compiling = warm_up()
    rows = []
    with console.progress("stiff cases", len(works)) as ticker:
        for case, drawn in works:
            ticker.note(f"{case.code} {case.name}")
            rows.append(run_case(case, drawn, plan))
            ticker.advance()
    failed = [row for row in rows if row["problem"]]
    summary = {"cases": len(rows), "failed": len(failed), "non_finite": sum(row["non_finite"] for row in rows)}
    return Outcome(rows, summary, {"compile": compiling}, omitted=NOT_HERE)


def warm_up() -> float:
    """Draw something harmless of each kind, so that no case pays for compiling; returns the seconds."""
    easy = [Case("", "", made.box), Case("", "", partial(made.cloud, [[0.1, 0.2, 0.3]]), kind="points")]
    started = time.perf_counter()
    for case in easy:
        _draw(case, case.shape(), "smooth" if case.kind == "mesh" else "points", 8, 0)
    return time.perf_counter() - started


def run_case(case: Case, drawn: str, plan: Plan) -> Row:
    """One case as a row; whatever it runs into is a problem of that row.

    Args:
        case: The scene.
        drawn: "smooth", "flat" or "points".
        plan: For image size and seed.
    """
    shape = case.shape()
    row: Row = {
        "code": case.code,
        "case": case.name,
        "drawn": drawn,
        "faces": len(shape.faces) or len(shape.points),
        "views": len(case.azimuth),
        "image_size": case.size or plan.stiff_size,
        "image_finite": None,
        "gradient_finite": None,
        "non_finite": 0,
        "seconds": None,
        "problem": "",
    }
    try:
        seen, seconds = _draw(case, shape, drawn, row["image_size"], plan.seed)
    except DataError as error:
        return row | {"problem": "" if case.refused else error.message}
    except Exception as error:
        return row | {"problem": f"{type(error).__name__}: {' '.join(str(error).split())[:120]}"}
    return row | _judged(case, seen) | {"seconds": seconds}


def _judged(case: Case, seen: Seen) -> Row:
    kept = slice(1, None) if case.poisoned else slice(None)
    images, gradient = ~np.isfinite(seen.images), ~np.isfinite(seen.gradient[kept])
    non_finite = int(images.sum() + gradient.sum())
    problem = f"{non_finite} numbers are not finite" if non_finite else case.check(seen)
    return {
        "image_finite": not images.any(),
        "gradient_finite": not gradient.any(),
        "non_finite": non_finite,
        "problem": "drawn, though there is nothing to draw" if case.refused else problem,
    }


def _draw(case: Case, shape: StoredShape, drawn: str, size: int, seed: int) -> tuple[Seen, float]:
    batch, look = pack([shape]), _look(case, drawn, size)
    angles = [torch.tensor([values], dtype=torch.float64) for values in (case.azimuth, case.elevation, case.distance)]
    azimuth, elevation, distance = (angle.requires_grad_() for angle in angles)
    cameras = Cameras(azimuth, elevation, distance)
    one = smooth_weights(1, size, seed)  # the same for all views, some of which have to be alike
    weights = one.repeat(len(case.azimuth), 1, 1, 1)[None]
    if case.poisoned:
        weights[0, 0, 0, size // 2, size // 2] = torch.nan
    started = time.perf_counter()
    images = render(batch, cameras, look, gradient=DEFAULT_MODE).rgb
    images.backward(weights)
    seconds = time.perf_counter() - started
    gradient = torch.stack([_grad(angle)[0] for angle in angles], dim=-1)
    return Seen(shape, cameras.detach(), look, images.detach()[0].numpy(), gradient.numpy()), seconds


def _look(case: Case, drawn: str, size: int) -> Look:
    look = Look(size, case.kind, np.ones((1, 3), np.float32), supersample=1, point_radius=case.point_radius)
    return look if drawn == "points" else replace(look, shading=drawn)


def _grad(leaf: torch.Tensor) -> torch.Tensor:
    return torch.zeros_like(leaf) if leaf.grad is None else leaf.grad
