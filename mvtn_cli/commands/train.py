"""`mvtn train`: from stored shapes to a trained classifier, measured, with its report."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from mvtn_cli.commands.eval import measure
from mvtn_cli.commands.options import Call
from mvtn_cli.commands.sources import open_shapes
from mvtn_cli.config import TrainConfig, TrainOptions
from mvtn_cli.console import duration
from mvtn_cli.errors import DataError, ExitCode, MvtnError, UsageError

if TYPE_CHECKING:
    from mvtn_cli.core.preprocess import Prepared
    from mvtn_cli.core.training.run import Run

SCHEMA = "mvtn.train/1"


def train(options: TrainOptions, call: Call) -> ExitCode | None:
    """Train a multi-view classifier whose cameras learn where to stand, then measure it on the test shapes.

    Ctrl-C saves; the same command goes on. --compare trains several view selections on one budget. With torchrun or
    --devices several processes train together.

    Example: mvtn train builtin:shapes --num-views 4 --epochs 20
    """
    config = options.training()
    if call.dry_run:
        _plan(options, config, call)
        return None
    from mvtn_cli.core.training.launch import started_with_others

    together = started_with_others()
    if options.compare and (together or options.devices > 1):
        raise UsageError(
            "--compare trains with one process",
            hint="leave --devices out, or train each of the selections by itself: --views NAME --seed N",
            code="train.one-process",
        )
    if together:
        return _train_with_others(options, config, call)
    if options.devices > 1:
        from mvtn_cli.core.training.device import shared_device

        shared_device(config.device, options.devices)  # said once, before anything is begun
    prepared = open_shapes(config.dataset, config, call)
    if options.devices > 1:
        return _start_processes(options.devices, prepared, call)
    if options.batch_size is None:
        config = _sized(options, config, prepared, call)
    if options.compare:
        _compare(options, config, prepared, call)
        return None
    from mvtn_cli.core.training.loop import train as train_run

    _answer(train_run(config, prepared, call.console), prepared, config, call)
    return None


def _start_processes(count: int, prepared: Prepared, call: Call) -> ExitCode:
    """Let this command run in several processes; the first one answers."""
    from mvtn_cli.core.training.launch import run_together

    # What was chosen and prepared here need not be chosen and said again there.
    code = run_together(count, sys.argv[1:], {"MVTN_DATASET": prepared.spec})
    call.console.quiet = True  # what is left to say was said there
    return code


def _sized(
    options: TrainOptions, config: TrainConfig, prepared: Prepared, call: Call, *, here: int = 1, size: int = 1
) -> TrainConfig:
    """The same training with as many shapes a step as fit into memory; `here` and `size` count its processes."""
    from mvtn_cli.core.training.batch_size import common_batch_size
    from mvtn_cli.core.training.find import begun_batch_size

    if not options.compare and (begun := begun_batch_size(config, prepared)) is not None:
        return config.model_copy(update={"batch_size": begun})
    several = _each_selection(options, config)
    chosen = common_batch_size(several, prepared, call.console, here=here, size=size)
    return config.model_copy(update={"batch_size": chosen})


def _each_selection(options: TrainOptions, config: TrainConfig) -> list[TrainConfig]:
    """The trainings of a comparison, but for their seeds; else the only one."""
    return [config.model_copy(update={"views": name}) for name in options.selections()] or [config]


def _train_with_others(options: TrainOptions, config: TrainConfig, call: Call) -> ExitCode | None:
    """Train as one of several processes; the first one speaks, measures and answers."""
    os.environ.setdefault("TORCH_CPP_LOG_LEVEL", "ERROR")  # before torch is there: its warnings come once a process
    from mvtn_cli.core.training.device import use_threads
    from mvtn_cli.core.training.loop import train as train_run
    from mvtn_cli.core.training.team import Team, silent_console

    team = Team.join(config.device)
    if not team.first:
        call.console.quiet = True
        call = replace(call, console=silent_console())
    try:
        with team.watched():
            prepared = team.in_turn(lambda: open_shapes(config.dataset, config, call))
            if options.batch_size is None:
                chosen = partial(_sized, options, config, prepared, call, here=team.here, size=team.size)
                config = team.alone(chosen)
        run = train_run(config, prepared, call.console)
    except MvtnError as error:
        if team.is_told_elsewhere(error):
            return error.exit_code
        raise
    except KeyboardInterrupt:
        if not team.first:
            return ExitCode.INTERRUPTED
        raise
    if not team.first:
        return ExitCode.OK
    use_threads(config.threads or team.cores)  # the others leave now
    _answer(run, prepared, config, call)
    return None


def _answer(run: Run, prepared: Prepared, config: TrainConfig, call: Call) -> None:
    """Measure a finished run and say what there is now."""
    result = _measure_if_possible(run, prepared, config, call)
    document: dict[str, Any] = {
        "schema": SCHEMA,
        "run": str(run.path),
        "test": None,
        "report": None,
        "seconds": call.seconds,
    }
    lines = [f"run\t{run.path}"]
    if result:
        document |= {key: result[key] for key in ("report", "known_view")}
        document["test"] = {key: result[key] for key in ("count", "accuracy", "class_accuracy")}
        lines += [f"accuracy\t{result['accuracy']:.4f}", f"class_accuracy\t{result['class_accuracy']:.4f}"]
        lines += [f"report\t{result['report']}"]
    call.console.result(document, "\n".join(lines))
    then = f"open {result['report']}, or mvtn predict FILES" if result else "mvtn predict FILES"
    call.console.note(f"trained {run.path} in {duration(call.seconds)}; next: {then}")


def _measure_if_possible(run: Run, prepared: Prepared, config: TrainConfig, call: Call) -> dict[str, Any] | None:
    """Measure on the test split; a data set without one is trained all the same."""
    try:
        return measure(run, prepared, call, device=config.device, threads=config.threads)
    except DataError as error:
        if error.code != "dataset.empty-split":
            raise
        call.console.warn(f"not measured: {error.message}")
        return None


def _compare(options: TrainOptions, config: TrainConfig, prepared: Prepared, call: Call) -> None:
    from mvtn_cli.core.training.compare import compare

    table = compare(config, options.selections(), options.seeds, prepared, call.console)
    rows = [
        (entry["selection"], *(f"{100 * value:.1f}" for value in (entry["mean"], entry["sd"])))
        for entry in table["selections"]
    ]
    title = f"test accuracy, % over {options.seeds} seeds"
    call.console.table(title, ["views", "mean", "sd"], rows, stream="out")
    rows = [
        (f"{entry['b']} - {entry['a']}", *(f"{100 * entry[key]:+.1f}" for key in ("mean", "low", "high")))
        for entry in table["differences"]
    ]
    title = "paired differences, points, with their 95 % interval"
    call.console.table(title, ["difference", "mean", "low", "high"], rows, stream="out")
    call.console.result({"schema": "mvtn.compare/1", **table, "seconds": call.seconds})
    call.console.note(f"compared in {table['path']}, {duration(call.seconds)}; next: mvtn eval RUN")


def _plan(options: TrainOptions, config: TrainConfig, call: Call) -> None:
    """Say what would be trained on what. Nothing is written, so the shapes are counted and not opened."""
    from mvtn_cli.core.datasets import open_dataset
    from mvtn_cli.core.preprocess import choose_dataset

    dataset = open_dataset(choose_dataset(config.dataset, config, call.console))
    trainings = len(options.selections()) * options.seeds or 1
    shapes = min(dataset.count("train"), config.train_limit or dataset.count("train"))
    held_out = 0 if config.select == "test" or dataset.count("val") else round(config.val_fraction * shapes)
    batch_size = options.batch_size
    if batch_size is None:
        from mvtn_cli.core.training.batch_size import fitting_batch_size

        here, classes = options.devices, len(dataset.classes)
        batch_size = min(
            fitting_batch_size(one, classes, shapes - held_out, here=here, size=here)
            for one in _each_selection(options, config)
        )
        call.console.note(f"batch size {batch_size} (auto); an unfinished run goes on with the one that it has")
    plan = {
        "dataset": dataset.spec,
        "classes": len(dataset.classes),
        "train": shapes - held_out,
        "val": dataset.count("val") or held_out,
        "test": dataset.count("test"),
        "views": ",".join(options.selections()) or config.views,
        "num_views": config.num_views,
        "image_size": config.image_size,
        "backbone": config.backbone,
        "epochs": config.epochs,
        "batch_size": batch_size,
        "steps": config.epochs * -(-(shapes - held_out) // batch_size),
        "trainings": trainings,
        "runs": str(config.runs),
    }
    call.console.result(
        {"schema": SCHEMA, "dry_run": True, **plan},
        "\n".join(f"{key}\t{value}" for key, value in plan.items()),
    )
    call.console.note("nothing was written: this was a dry run")
