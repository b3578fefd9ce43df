"""One benchmark by its name."""

from __future__ import annotations

from collections.abc import Sequence

from mvtn_cli.console import Console
from mvtn_cli.core.bench.complexity import measure_complexity
from mvtn_cli.core.bench.cost import measure_cost
from mvtn_cli.core.bench.gradient import measure_gradient
from mvtn_cli.core.bench.growth import measure_growth
from mvtn_cli.core.bench.image import measure_image
from mvtn_cli.core.bench.outcome import Outcome
from mvtn_cli.core.bench.plan import Plan
from mvtn_cli.core.bench.pose import measure_pose
from mvtn_cli.core.bench.retrieval import measure_retrieval
from mvtn_cli.core.bench.skips import extra_subjects, measure_skips
from mvtn_cli.core.bench.stiff import measure_stiff
from mvtn_cli.core.bench.subjects import Subject, builtin_subjects, icosphere
from mvtn_cli.core.render.warming import compile_renderer


def measure(
    what: str, meshes: Sequence[Subject], plan: Plan, console: Console, *, threads: int | None = None
) -> Outcome:
    """Measure one thing.

    Args:
        what: "gradient", "render", "pose", "image", "stiff", "skips", "retrieval", "complexity" or "growth".
        meshes: What the user named; the built-in ones where there are none.
        plan: Sizes.
        console: For progress.
        threads: Of the user's wish; `render` measures at 1 and at this many, 2 where there is no wish.

    Raises:
        ValueError: There is no such benchmark.
    """
    compile_renderer(console)
    if what == "retrieval":
        return measure_retrieval(console, queries=plan.queries, gallery=plan.gallery, dim=plan.dim, seed=plan.seed)
    if what == "growth":
        return measure_growth(plan, console, threads=threads)
    subjects = list(meshes) or builtin_subjects(plan.default_meshes)
    match what:
        case "gradient":
            return measure_gradient(subjects, plan, console)
        case "render":
            sphere = icosphere()
            reference = max(meshes, key=lambda subject: subject.faces) if meshes else sphere
            counts = sorted({1, threads or 2})
            return measure_cost([*subjects, sphere], reference, plan, console, counts)
        case "pose":
            return measure_pose(subjects, plan, console)
        case "image":
            return measure_image(subjects, plan, console)
        case "stiff":
            return measure_stiff(plan, console)
        case "skips":
            return measure_skips(subjects if meshes else [*subjects, *extra_subjects()], plan, console)
        case "complexity":
            return measure_complexity(subjects, plan, console)
        case _:
            raise ValueError(f"there is no benchmark {what!r}")
