"""Several trainings in one folder, `NAME/WORD` each, which the same command goes on with."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mvtn_cli.config import TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.training.find import candidates, readable_differences
from mvtn_cli.core.training.fixed_views import with_kept_views
from mvtn_cli.core.training.launch import started_with_others
from mvtn_cli.core.training.loop import train
from mvtn_cli.core.training.predict import Predictions, load_model, predict
from mvtn_cli.core.training.run import Run
from mvtn_cli.errors import DataError, Interrupted, UsageError


def free_group(runs: Path, name: str, plan: Mapping[str, TrainConfig], prepared: Any) -> str:
    """A folder for trainings that were given no name: the first one that holds none of other settings.

    Args:
        runs: The folder of runs.
        name: The folder's name, if it is free; else with -2, -3, … behind it.
        plan: The settings of each training, by its name in the folder.
        prepared: The data set.
    """
    for path in candidates(runs, name):
        begun = [(Run(path / word), one) for word, one in plan.items()]
        if not any(run.exists and readable_differences(run, one, prepared) for run, one in begun):
            return path.name
    raise AssertionError("the candidates never end")


def train_one(config: TrainConfig, name: str, prepared: Any, console: Console) -> Run:
    """Train one of them, go on with it, or take it as it is if it is finished.

    Raises:
        Interrupted: As `train`.
    """
    try:
        return train(config, prepared, console, name=name, reuse_finished=True)
    except Interrupted as error:
        error.hint = "go on with the same command: finished runs are not repeated"
        raise


def check_one_process(what: str) -> None:
    """Refuse to train a group with several processes: each of them would do all of the rest.

    Raises:
        UsageError: This process is one of several.
    """
    if started_with_others():
        raise UsageError(
            f"{what} trains with one process",
            hint="start it without torchrun and --devices, or train one run after another with them",
            code="train.one-process",
        )


def check_can_be_tested(prepared: Any) -> None:
    """Say before hours of work that nothing could be measured after them.

    Raises:
        DataError: There are no test shapes.
    """
    if not prepared.split("test"):
        raise DataError(f"no shapes for split 'test' in {prepared.spec}", code="dataset.empty-split")


def predict_test(run: Run, prepared: Any, device: str, console: Console) -> Predictions:
    """What the best weights say of the test split."""
    model = load_model(run, "best", device)
    settings = run.config
    shapes = with_kept_views(prepared, settings, console, model.device)
    return predict(model, shapes, prepared.split("test"), settings, batch_size=settings.batch_size)
