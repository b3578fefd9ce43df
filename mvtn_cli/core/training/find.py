"""Going on is the same command again: which run a training command means."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

from mvtn_cli.config import TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.training.run import NOT_SETTINGS, Run
from mvtn_cli.errors import MvtnError, UsageError
from mvtn_cli.network_config import POINT_NETWORKS


def find_or_create_run(
    config: TrainConfig,
    prepared: Any,
    runs: Path,
    name: str | None,
    console: Console,
    *,
    reuse_finished: bool = False,
) -> Run:
    """Find the unfinished run of the same settings and data, or begin a new one.

    A finished run is left alone and a new one begun beside it, with -2, -3, … at its name.

    Args:
        config: The settings.
        prepared: The data set.
        runs: The folder of runs.
        name: What `--name` says; None for a name made from the settings.
        console: Where it is said what was found.
        reuse_finished: Give back a finished run of the same settings, too.

    Raises:
        UsageError: A run of this very name has other settings; each is named.
    """
    if name is None:
        for run in Run.all(runs):
            if not readable_differences(run, config, prepared) and not run.finished:
                return _continue(run, console)
    elif Run(runs / name).exists:
        _refuse_changes(Run(runs / name), config, prepared)
    for path in candidates(runs, name or default_name(config, prepared)):
        if not Run(path).exists:
            run = Run.create(path, config, prepared)
            console.note(f"run {run.label(runs)}")
            return run
        run = Run(path)
        if not readable_differences(run, config, prepared):
            if not run.finished:
                return _continue(run, console)
            if reuse_finished:
                console.note(f"run {run.label(runs)} is finished: taken as it is")
                return run
    raise AssertionError("the candidates never end")


def begun_batch_size(config: TrainConfig, prepared: Any) -> int | None:
    """The batch size of an unfinished run that differs in nothing else, so that it can be gone on with.

    Args:
        config: The settings; with a name, only the run of this name is looked at.
        prepared: The data set.
    """
    named = [Run(config.runs / config.name)] if config.name else Run.all(config.runs)
    for run in named:
        if run.exists and readable_differences(run, config, prepared).keys() <= {"batch_size"} and not run.finished:
            return run.config.batch_size
    return None


def differences(run: Run, config: TrainConfig, prepared: Any) -> dict[str, tuple[Any, Any]]:
    """Each setting that differs, with its old and its new value; the data count as one setting."""
    old, new = (c.model_dump(mode="json", exclude=set(NOT_SETTINGS)) for c in (run.config, config))
    changed = {key: (old[key], new[key]) for key in new if old[key] != new[key]}
    info = run.info
    if info["data_address"] != prepared.address:
        same_words = info["dataset"] == prepared.spec
        changed["dataset"] = (
            (f"{info['dataset']} as it was", "with other contents") if same_words else (info["dataset"], prepared.spec)
        )
    return changed


def default_name(config: TrainConfig, prepared: Any) -> str:
    """A name that tells runs apart, such as `shapes-learned-spherical-6v-s0` or `shapes-dgcnn-s0`."""
    words = [dataset_word(prepared.spec)]
    if config.network != "mvcnn":
        words.append(config.network)
    if config.network not in POINT_NETWORKS:
        words += [config.views, f"{config.num_views}v"]
    return "-".join([*words, f"s{config.seed}"])


def dataset_word(spec: str) -> str:
    """A short word for a data set: `shapes` for `builtin:shapes?train=9` and for `folder:/data/shapes`."""
    place = spec.split("?")[0].split(":", 1)[-1]
    name = unicodedata.normalize("NFC", Path(place).name).casefold()
    return "-".join(re.findall(r"[^\W_]+", name)) or "data"


def candidates(runs: Path, name: str) -> Iterator[Path]:
    """The folder of a name, then those of the name with -2, -3, … without end."""
    yield runs / name
    for number in count(2):
        yield runs / f"{name}-{number}"


def _continue(run: Run, console: Console) -> Run:
    console.note(f"going on with the unfinished run {run.path} ({len(run.metrics())} epochs done)")
    return run


def readable_differences(run: Run, config: TrainConfig, prepared: Any) -> dict[str, tuple[Any, Any]]:
    """The differences; a run that can't be read differs in everything."""
    try:
        return differences(run, config, prepared)
    except (MvtnError, KeyError):
        return {"config": ("unreadable", "")}


def _refuse_changes(run: Run, config: TrainConfig, prepared: Any) -> None:
    changed = differences(run, config, prepared)
    if changed:
        told = "; ".join(f"{key}: {_word(old)} → {_word(new)}" for key, (old, new) in changed.items())
        raise UsageError(
            f"run {run.name} was begun with other settings ({told})",
            hint=f"give the old settings to go on, or another --name; delete {run.path} to begin it anew",
            code="run.changed-settings",
        )


def _word(value: Any) -> str:
    return "auto" if value is None else str(value)
