"""Let runs recognise corrupted shapes, evaluation by evaluation."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

from mvtn_cli import __version__
from mvtn_cli.console import Console
from mvtn_cli.core.render.skips import active_skips
from mvtn_cli.core.render.view_keeper import seeing_version
from mvtn_cli.core.render.warming import compile_renderer
from mvtn_cli.core.robustness.cells import Cell, append_cell, read_cells
from mvtn_cli.core.robustness.corruption import Corruption
from mvtn_cli.core.robustness.evaluating import evaluate_here
from mvtn_cli.core.robustness.many_machines import evaluate_on_cluster
from mvtn_cli.core.store import digest
from mvtn_cli.core.training.device import choose_device
from mvtn_cli.core.training.run import NOT_SETTINGS, Run
from mvtn_cli.core.training.split import stratified_subset
from mvtn_cli.errors import DataError, UsageError
from mvtn_cli.robustness_config import RobustnessConfig

FORMAT = "1"  # of what is measured; another one measures everything anew


@dataclass(frozen=True)
class Measured:
    """A run and its evaluations.

    Attributes:
        run: The run.
        cells: One for each corruption of the plan, in its order.
    """

    run: Run
    cells: list[Cell]


def chosen_indices(prepared: Any, limit: int | None, seed: int) -> list[int]:
    """The labelled test shapes, or `limit` of them, as many of each class as can be.

    Raises:
        DataError: There are none.
    """
    records = prepared.records
    indices = [index for index in prepared.split("test") if records[index].label >= 0]
    if not indices:
        raise DataError(
            f"no labelled shapes for split 'test' in {prepared.spec}",
            hint="robustness is measured on test shapes; mvtn doctor DATASET counts them",
            code="dataset.empty-split",
        )
    if limit is None or limit >= len(indices):
        return indices
    return stratified_subset(indices, [records[index].label for index in indices], limit, seed)


def check_same_data(runs: Sequence[Run]) -> None:
    """Refuse runs that can't stand in one table.

    Raises:
        UsageError: They were trained on different data.
    """
    first = runs[0]
    for run in runs[1:]:
        if run.info["data_address"] != first.info["data_address"]:
            one, other = first.info["dataset"], run.info["dataset"]
            same = ", prepared in another way or with other contents" if one == other else ""
            raise UsageError(
                f"{first.path} was trained on {one} and {run.path} on {other}{same}, so that they share no test shapes",
                hint="name runs of one data set, or measure them one by one",
                code="robustness.other-data",
            )


def measure(
    runs: Sequence[Run],
    prepared: Any,
    indices: Sequence[int],
    plan: Sequence[Corruption],
    config: RobustnessConfig,
    console: Console,
) -> list[Measured]:
    """Evaluate every run under every corruption; what a run has been through before is taken as it is.

    Args:
        runs: Of one data set.
        prepared: Its shapes.
        indices: Which of them.
        plan: What is done to them.
        config: Checkpoint, device, batch size and seed; `scheduler` sends the evaluations to a cluster.
        console: For progress.

    Raises:
        DataError: A run has no such weights.
    """
    if config.scheduler is None:
        compile_renderer(console, choose_device(config.device))
    return [_measure_run(run, prepared, indices, plan, config, console) for run in runs]


def _measure_run(
    run: Run,
    prepared: Any,
    indices: Sequence[int],
    plan: Sequence[Corruption],
    config: RobustnessConfig,
    console: Console,
) -> Measured:
    common = _common_key(run, prepared, indices, config)
    keys = [digest(common, json.dumps(corruption.as_dict(), sort_keys=True)) for corruption in plan]
    finished = read_cells(run.path)
    missing = {key: corruption for key, corruption in zip(keys, plan, strict=True) if key not in finished}
    if len(missing) < len(plan):
        console.note(f"{run.path}: {len(plan) - len(missing)} of {len(plan)} evaluations were finished before")
    evaluate_all = evaluate_here if config.scheduler is None else evaluate_on_cluster
    with (
        console.progress(f"{run.name}", len(missing) * len(indices)) as ticker,
        closing(evaluate_all(run, prepared, indices, missing, config, console, ticker)) as cells,
    ):
        for key, cell in cells:
            finished[key] = {"key": key, **cell}
            append_cell(run.path, finished[key])
    return Measured(run, [finished[key] for key in keys])


def _common_key(run: Run, prepared: Any, indices: Sequence[int], config: RobustnessConfig) -> str:
    """Digest of all that an evaluation depends on beside the corruption."""
    settings = run.config
    parts = [FORMAT, __version__, seeing_version(), str(active_skips()), prepared.address]
    parts += [",".join(map(str, indices)), settings.model_dump_json(exclude=set(NOT_SETTINGS))]
    if settings.views == "random":
        parts += [str(config.seed), str(config.shapes_a_step(settings.batch_size))]
    return digest(*parts, run.require_weights(config.checkpoint).read_bytes())
