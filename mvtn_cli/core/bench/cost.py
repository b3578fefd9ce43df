"""`mvtn bench render`: what images and their gradient cost beside the network that looks at them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from torch import Tensor

from mvtn_cli.console import Console
from mvtn_cli.core.bench.modes import DEFAULT_MODE, Mode, angle_gradient, stages
from mvtn_cli.core.bench.outcome import Outcome, Row
from mvtn_cli.core.bench.plan import Plan
from mvtn_cli.core.bench.subjects import DRAWN, Subject, builtin_subjects, look_at, spiral_cameras
from mvtn_cli.core.bench.timing import Timing, interleaved, most_threads, threads
from mvtn_cli.core.bench.weights import resnet_step, smooth_weights
from mvtn_cli.core.render import Look, pack, render

SETTINGS = (("smooth", 1), ("flat", 1), ("smooth", 2), ("points 0.015", 1))
YARDSTICK = "resnet18"
COLUMNS = (
    *("what", "mesh", "faces", "views", "shading", "supersample", "threads"),
    *("image", "forward", "backward", "seconds", "resnet", "ratio", "compile"),
)


@dataclass(frozen=True)
class Case:
    """One mesh, or its points, and one way to draw it."""

    subject: Subject
    shading: str
    supersample: int

    @property
    def name(self) -> str:
        """Unique within a benchmark."""
        return f"{self.subject.name}/{self.shading}/{self.supersample}"


def measure_cost(
    subjects: Sequence[Subject], reference: Subject, plan: Plan, console: Console, counts: Sequence[int]
) -> Outcome:
    """Time forward and backward of each mesh and setting against ResNet-18 on the same images.

    Args:
        subjects: The meshes.
        reference: The one of them that stands in the summary.
        plan: Sizes.
        console: For the progress.
        counts: Numbers of threads, in turn.
    """
    possible = [count for count in counts if count <= most_threads()]
    omitted = [
        {"what": f"{count} threads", "reason": f"this process may use {most_threads()}"}
        for count in counts
        if count not in possible
    ]
    cases = [Case(subject, *setting) for subject in subjects for setting in SETTINGS]
    rows: list[Row] = []
    with console.progress("timings", len(possible) * (len(subjects) + 1)) as ticker:
        for count in possible:
            with threads(count):
                for _, group in itertools.groupby(cases, key=lambda case: case.subject.name):
                    rows += _rows_of(list(group), plan, count)
                    ticker.advance()
                rows += _batch_rows(plan, count)
                ticker.advance()
    return Outcome(rows, _summary(rows, reference), omitted=tuple(omitted))


def backbone_ratio(subject: Subject, plan: Plan) -> float:
    """Forward and backward of the default mode over ResNet-18's on the same images, with the threads as they are."""
    row = _rows_of([Case(subject, "smooth", 1)], plan, 0)[0]
    return row["ratio"]


def _rows_of(cases: Sequence[Case], plan: Plan, count: int) -> list[Row]:
    """Time all settings of one mesh, and the network between them."""
    works: dict[str, Callable[[], object]] = {}
    for case in cases:
        pieces = _pieces(case, plan)
        works |= {f"{case.name}/{stage}": work for stage, work in pieces.items()}
    works[YARDSTICK] = resnet_step(_images(cases[0], plan), plan.seed)
    timings = interleaved(works, plan.repeats)
    return [_row(case, timings, plan, count) for case in cases]


def _pieces(case: Case, plan: Plan) -> dict[str, Callable[[], object]]:
    batch = pack([case.subject.shape])
    look = look_at([case.subject], plan, **DRAWN[case.shading])
    weights = smooth_weights(plan.num_views, plan.image_size, plan.seed)[None]
    return stages(batch, spiral_cameras(plan.num_views), look, Mode(DEFAULT_MODE, case.supersample), weights)


def _images(case: Case, plan: Plan) -> Tensor:
    look = look_at([case.subject], plan)
    return render(pack([case.subject.shape]), spiral_cameras(plan.num_views), look, gradient="none").rgb[0]


def _row(case: Case, timings: dict[str, Timing], plan: Plan, count: int) -> Row:
    image, forward, backward = (timings[f"{case.name}/{stage}"] for stage in ("image", "forward", "backward"))
    seconds, resnet = forward.median + backward.median, timings[YARDSTICK].median
    return {
        "what": "views",
        "mesh": case.subject.name,
        "faces": None if case.shading.startswith("points") else case.subject.faces,
        "views": plan.num_views,
        "shading": case.shading,
        "supersample": case.supersample,
        "threads": count,
        "image": image.median,
        "forward": forward.median,
        "backward": backward.median,
        "seconds": seconds,
        "resnet": resnet,
        "ratio": seconds / resnet,
        "compile": image.compiling + forward.compiling + backward.compiling,
    }


def _batch_rows(plan: Plan, count: int) -> list[Row]:
    """One packed call of different meshes against as many single calls."""
    subjects = builtin_subjects(plan.batch_shapes)
    timings = interleaved(_packed_and_single(subjects, plan), plan.repeats)
    single = timings["single calls"].median
    return [
        dict.fromkeys(COLUMNS)
        | {
            "what": name,
            "mesh": f"{len(subjects)} mixed",
            "faces": sum(subject.faces for subject in subjects),
            "views": plan.num_views * len(subjects),
            "shading": "smooth",
            "supersample": 1,
            "threads": count,
            "seconds": timing.median,
            "ratio": timing.median / single,
            "compile": timing.compiling,
        }
        for name, timing in timings.items()
    ]


def _packed_and_single(subjects: Sequence[Subject], plan: Plan) -> dict[str, Callable[[], object]]:
    look, mode, views = look_at(subjects, plan), Mode(DEFAULT_MODE), plan.num_views
    batch = pack([subject.shape for subject in subjects])
    weights = smooth_weights(views, plan.image_size, plan.seed).expand(len(subjects), -1, -1, -1, -1).contiguous()
    singles = [(pack([subject.shape]), _only(look, number)) for number, subject in enumerate(subjects)]

    def one_call() -> None:
        angle_gradient(batch, spiral_cameras(views, len(subjects)), look, mode, weights)

    def single_calls() -> None:
        for single, own_look in singles:
            angle_gradient(single, spiral_cameras(views), own_look, mode, weights[:1])

    return {"one call": one_call, "single calls": single_calls}


def _only(look: Look, number: int) -> Look:
    """The look of one shape of a batch."""
    lights, part = look.light_direction, slice(number, number + 1)
    return replace(look, colors=look.colors[part], light_direction=None if lights is None else lights[part])


def _summary(rows: Sequence[Row], reference: Subject) -> dict[str, Any]:
    """Ratio at the fewest threads, and how much faster the most are."""
    own = [row for row in rows if (row["mesh"], row["shading"], row["supersample"]) == (reference.name, "smooth", 1)]
    few, many = own[0], own[-1]
    return {
        "backbone_ratio": few["ratio"],
        "backbone_ratio_mesh": reference.name,
        "threads": few["threads"],
        "thread_speedup": few["seconds"] / many["seconds"] if many is not few else None,
    }
