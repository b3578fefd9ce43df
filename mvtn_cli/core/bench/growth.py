"""`mvtn bench growth`: time and memory of whole commands on more and more shapes, and by what power they grow."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mvtn_cli.console import Console
from mvtn_cli.core.bench.growth_stages import Spent, run_stage
from mvtn_cli.core.bench.outcome import Outcome, Row
from mvtn_cli.core.bench.plan import Plan
from mvtn_cli.core.bench.remembered import Remembered

STAGES = ("preprocess", "train", "eval", "retrieve")
RANKING = "ranking"  # of retrieve: all queries against all of the gallery, and the measures
SMALLEST = 24  # shapes, two of each class: what a command needs for so few is what it needs to start
CLEAR = 0.25  # of the start: what is above it by less says nothing about growth


def measure_growth(plan: Plan, console: Console, *, threads: int | None = None) -> Outcome:
    """Run preprocess, one epoch of train, eval and retrieve on built-in shapes, each as a process of its own.

    Two thirds of the shapes are for training. What a stage needs to start is measured with `SMALLEST` shapes and told
    apart. Finished stages are kept in `plan.work`; the same call goes on from there.

    Args:
        plan: `sizes`, `work`, pixels, views and seed.
        console: For progress.
        threads: CPU threads of each process; None is one, so that its CPU time says what there is to do.

    Raises:
        MvtnError: A stage failed.
    """
    sizes = sorted({SMALLEST, *plan.sizes})
    settings = {"image_size": plan.image_size, "views": plan.num_views, "seed": plan.seed, "threads": threads or 1}
    known = Remembered(plan.work, settings)
    if not known.of(SMALLEST):  # compiles kernels and fills file caches: not for the table
        console.note("a first round on the smallest size warms up")
        _warm_up(plan.work / "warm-up", settings)
    with console.progress("stages", len(sizes) * len(STAGES)) as ticker:
        for size in sizes:
            for stage in _measure_size(size, known, settings, console):
                ticker.advance()
                ticker.note(f"{stage}, {size} shapes")
    rows = list(_rows(known, sizes))
    return Outcome(rows, _summary(rows), notes={"smallest": SMALLEST, "settings": settings, "work": str(plan.work)})


def _warm_up(folder: Path, settings: Mapping[str, int]) -> None:
    try:
        for stage in STAGES:
            run_stage(stage, SMALLEST, folder, settings)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _measure_size(size: int, known: Remembered, settings: Mapping[str, int], console: Console) -> Iterator[str]:
    """Measure what is missing of a size, and then delete its shapes and run."""
    done = known.of(size)
    folder = known.folder / str(size)
    for stage in STAGES:
        if stage not in done:
            console.note(f"{stage}: {size} shapes")
            known.add(size, stage, run_stage(stage, size, folder, settings))
        yield stage
    shutil.rmtree(folder, ignore_errors=True)


def _rows(known: Remembered, sizes: Sequence[int]) -> Iterator[Row]:
    """A row a stage and size, stage by stage; the ranking within `retrieve` has rows of its own, and no start."""
    start = known.of(sizes[0])
    for stage in STAGES:
        yield from (_row(stage, size, known.of(size)[stage], start[stage]) for size in sizes)
    for size in sizes:
        yield _row(RANKING, size, Spent(None, known.of(size)["retrieve"].ranking or 0.0, None), None)


def _row(stage: str, size: int, spent: Spent, start: Spent | None) -> Row:
    """One measurement, and how much of it is above the start."""
    above = _cost(spent) - _cost(start) if start is not None and size > SMALLEST else None
    return {
        "stage": stage,
        "shapes": size,
        "cpu_seconds": spent.cpu,
        "seconds": spent.wall,
        "peak_mib": spent.peak_mib,
        "above_start": above,
        "ms_per_shape": None if above is None else 1000 * above / (size - SMALLEST),
        "clear": above is not None and start is not None and above > CLEAR * _cost(start),
    }


def _cost(spent: Spent) -> float:
    """CPU seconds, which other work on the machine changes little; wall time where the system does not tell."""
    return spent.wall if spent.cpu is None else spent.cpu


def _summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Exponents: of time as it is, of time above the start, and of memory as it is."""
    found: dict[str, Any] = {}
    for stage in dict.fromkeys(row["stage"] for row in rows):
        own = [row for row in rows if row["stage"] == stage and row["shapes"] > SMALLEST]
        sizes = [row["shapes"] for row in own]
        words = "cpu_seconds" if own and own[0]["cpu_seconds"] is not None else "seconds"
        found[stage] = exponent(sizes, [row[words] for row in own])
        if stage == RANKING:
            continue
        clear = [row for row in own if row["clear"]]
        found[f"{stage}_above_start"] = exponent(
            [row["shapes"] - SMALLEST for row in clear], [row["above_start"] for row in clear]
        )
        if own and own[0]["peak_mib"] is not None:
            found[f"{stage}_memory"] = exponent(sizes, [row["peak_mib"] for row in own])
    return found


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float | None:
    """Slope of log(cost) over log(size), by least squares; None for fewer than two sizes or without cost."""
    if len(set(sizes)) < 2 or min(costs) <= 0:
        return None
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])
