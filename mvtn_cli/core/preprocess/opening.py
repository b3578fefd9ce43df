"""The door for everyone who needs stored shapes and does not care whether they are stored yet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mvtn_cli.config import PreprocessConfig
from mvtn_cli.console import Console
from mvtn_cli.core.datasets import open_dataset, unlabelled
from mvtn_cli.core.preprocess.last import recall_last
from mvtn_cli.core.preprocess.prepared import Prepared
from mvtn_cli.core.preprocess.preprocess import prepare
from mvtn_cli.core.preprocess.settings import Settings
from mvtn_cli.core.preprocess.summary import Summary
from mvtn_cli.core.store import Store, cache_root
from mvtn_cli.errors import DataError

DEFAULT_DATASET = "builtin:shapes"


def choose_dataset(spec: str | None, config: Any, console: Console) -> str:
    """Return `spec`, else what was preprocessed last in this folder, else `builtin:shapes`; says which."""
    if spec:
        return spec
    last = recall_last(Store(cache_root(getattr(config, "cache", None))))
    if last is not None:
        console.note(f"data set: {last[0]} (the last one preprocessed in this folder)")
        return last[0]
    console.note(f"data set: {DEFAULT_DATASET} (none was named, and none preprocessed in this folder)")
    return DEFAULT_DATASET


def open_prepared(spec: str | None, config: Any, console: Console, *, settings: Settings | None = None) -> Prepared:
    """Return a data set's stored shapes, preprocessing what is missing.

    Args:
        spec: As for `open_dataset`; None is what was preprocessed last in this folder, else `builtin:shapes`.
        config: Any command's config; its `cache`, `workers` and `scheduler` hold, and the settings of a preprocess
            config.
        console: For what was chosen, progress and warnings.
        settings: How to preprocess. By default as `config` says, else as this data set was preprocessed
            last in this folder, else as `mvtn preprocess` would.

    Raises:
        DataError: The data set can't be opened, or not one of its shapes can be used.
    """
    store = Store(cache_root(getattr(config, "cache", None)))
    dataset = open_dataset(choose_dataset(spec, config, console))
    settings = settings or _settings(store, dataset.spec, config)
    workers, scheduler = getattr(config, "workers", None), getattr(config, "scheduler", None)
    prepared, summary = prepare(dataset, settings, store, console, workers=workers, scheduler=scheduler)
    if summary.made:
        console.note(f"preprocessed {dataset.spec}: {summary.headline()}")
    if summary.rejected and summary.kept:
        count = f"{summary.rejected} of {len(dataset.items)} shapes"
        console.warn(f"{count} can't be used and are left out; mvtn preprocess {dataset.spec} lists them")
    if not summary.kept:
        raise _none_usable(dataset.spec, summary)
    return prepared


def prepare_files(
    paths: Sequence[Path | str], config: Any, console: Console, *, settings: Settings | None = None
) -> tuple[Prepared, Summary]:
    """Preprocess single files, which have no labels.

    Args:
        paths: Mesh or point files.
        config: Any command's config, as for `open_prepared`.
        console: For progress and warnings.
        settings: How to preprocess; by default as `config` says, else as `mvtn preprocess` would.

    Returns:
        The usable ones, and the summary with the findings of all.

    Raises:
        DataError: A file does not exist.
        UsageError: `paths` is empty.
    """
    store = Store(cache_root(getattr(config, "cache", None)))
    workers = getattr(config, "workers", None)
    chosen = settings or _settings(store, "", config)
    return prepare(unlabelled(paths), chosen, store, console, workers=workers, remember=False)


def _settings(store: Store, spec: str, config: Any) -> Settings:
    if isinstance(config, PreprocessConfig):
        return Settings.of(config)
    last = recall_last(store)
    return last[1] if last is not None and last[0] == spec else Settings.of(PreprocessConfig())


def _none_usable(spec: str, summary: Summary) -> DataError:
    first = next((found for found in summary.findings if found["fatal"]), None)
    reason = f"; the first, {first['file']}: {first['finding']}" if first else ""
    return DataError(
        f"none of the {summary.rejected} shapes of {spec} can be used{reason}",
        hint=f"mvtn preprocess {spec} lists them all",
        code="dataset.none-usable",
    )
