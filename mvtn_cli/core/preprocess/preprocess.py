"""From a data set to stored shapes: what is there is left alone, what is missing is made."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import closing
from functools import partial

from mvtn_cli.config import PreprocessConfig
from mvtn_cli.console import Console
from mvtn_cli.core.datasets import Dataset, Item
from mvtn_cli.core.preprocess.last import remember_last
from mvtn_cli.core.preprocess.making import Outcome, make_all
from mvtn_cli.core.preprocess.mapping import Numbered, Spread, spread_of
from mvtn_cli.core.preprocess.memory import Memory
from mvtn_cli.core.preprocess.prepared import Prepared, Record
from mvtn_cli.core.preprocess.settings import Settings
from mvtn_cli.core.preprocess.summary import Summary, summarise
from mvtn_cli.core.store import Store, cache_root, digest
from mvtn_cli.errors import Interrupted


def preprocess(dataset: Dataset, config: PreprocessConfig, console: Console) -> tuple[Prepared, Summary]:
    """Read, validate, normalise, simplify, sample and store every shape of `dataset` that is not stored yet.

    Bad files do not stop the others: they are counted in the summary, and `config.on_bad` decides what the
    command answers. The data set is remembered as the last one preprocessed in this folder.

    Raises:
        Interrupted: Ctrl-C; what was done is kept.
        MvtnError: The store can't be written.
    """
    store, settings = Store(cache_root(config.cache)), Settings.of(config)
    prepared, summary = prepare(dataset, settings, store, console, workers=config.workers, scheduler=config.scheduler)
    remember_last(store, dataset.spec, settings)
    console.note(summary.headline())
    return prepared, summary


def prepare(
    dataset: Dataset,
    settings: Settings,
    store: Store,
    console: Console,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    remember: bool = True,
) -> tuple[Prepared, Summary]:
    """Like `preprocess`, without words about the result.

    Args:
        dataset: What to preprocess.
        settings: How.
        store: Where to.
        console: For progress and warnings.
        workers: Processes; None is one a core.
        scheduler: Of a Dask cluster that does the work instead, as `tcp://host:8786`.
        remember: Keep an index of the data set, so that the next run need not open its files.
    """
    start = time.perf_counter()
    memory = Memory(store, dataset, settings) if remember else None
    spread: Spread[Outcome] = spread_of(workers, scheduler, store.root, console)
    done: dict[int, Outcome] = {}
    try:
        _recall(dataset, memory, done)
        _make_missing(dataset, settings, store, console, spread, memory, done)
    except KeyboardInterrupt:
        raise Interrupted(
            f"{len(done)} of {len(dataset.items)} shapes are done", hint="the same command goes on from there"
        ) from None
    finally:
        if memory is not None:
            memory.save()
    summary = summarise(zip(dataset.items, _in_order(done), strict=True), time.perf_counter() - start)
    if summary.remade:
        console.warn(f"{summary.remade} stored shapes were damaged; they were made again")
    return _prepared(dataset, settings, store, console, done), summary


def _recall(dataset: Dataset, memory: Memory | None, done: dict[int, Outcome]) -> None:
    if memory is None:
        return
    for index, item in enumerate(dataset.items):
        if (outcome := memory.recall(item)) is not None:
            done[index] = outcome


def _make_missing(
    dataset: Dataset,
    settings: Settings,
    store: Store,
    console: Console,
    spread: Spread[Outcome],
    memory: Memory | None,
    done: dict[int, Outcome],
) -> None:
    todo: list[Numbered] = [(index, item) for index, item in enumerate(dataset.items) if index not in done]
    if not todo:
        return
    if memory is not None:
        for path in {item.path for _, item in todo if item.path is not None}:
            memory.stamp(path)  # before its content is read, so that a change in between is seen next time
    batches = spread(partial(make_all, store, settings=settings), todo)
    with console.progress("preprocess", total=len(todo)) as ticker, closing(batches):
        for outcomes in batches:
            for index, outcome in outcomes:
                done[index] = outcome
                if memory is not None:
                    memory.remember(dataset.items[index], outcome)
            ticker.advance(len(outcomes))


def _in_order(done: Mapping[int, Outcome]) -> list[Outcome]:
    return [done[index] for index in sorted(done)]


def _prepared(
    dataset: Dataset, settings: Settings, store: Store, console: Console, done: Mapping[int, Outcome]
) -> Prepared:
    kept = [(dataset.items[index], done[index]) for index in sorted(done) if done[index].state != "rejected"]
    records = tuple(_record(item, outcome) for item, outcome in kept)
    return Prepared(
        spec=dataset.spec,
        title=dataset.title,
        classes=dataset.classes,
        records=records,
        known_view=dataset.known_view,
        address=_address(dataset.classes, records),
        store=store,
        settings=settings,
        items=tuple(item for item, _ in kept),
        console=console,
    )


def _record(item: Item, outcome: Outcome) -> Record:
    azimuth = outcome.known_azimuth_deg
    return Record(
        name=item.name,
        label=item.label,
        split=item.split,
        address=outcome.address,
        source=item.source,
        known_azimuth_deg=float("nan") if azimuth is None else azimuth,
    )


def _address(classes: tuple[str, ...], records: tuple[Record, ...]) -> str:
    lines = [f"{record.name}\t{record.label}\t{record.split}\t{record.address}" for record in records]
    return digest("\n".join(classes), "\n".join(lines))
