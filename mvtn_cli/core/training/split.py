"""Which shapes are trained on, and which choose the best epoch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mvtn_cli.errors import DataError


@dataclass(frozen=True)
class Indices:
    """Positions in `prepared.records`.

    Attributes:
        train: What the networks learn from.
        select: What the best epoch is chosen by; empty if nothing chooses.
        selected_by: Where those come from, in words for people.
    """

    train: list[int]
    select: list[int]
    selected_by: str


def stratified_split(
    indices: Sequence[int], labels: Sequence[int], fraction: float, seed: int
) -> tuple[list[int], list[int]]:
    """Split off a share of every class.

    A class gives `fraction` of its shapes, rounded, but at least one if it has two, and never its last one.

    Args:
        indices: Any distinct numbers.
        labels: The class of each.
        fraction: Share to split off, 0 to 1.
        seed: Which ones.

    Returns:
        (kept, split off), each in the order of `indices`.
    """
    if fraction <= 0.0:
        return list(indices), []
    random = np.random.default_rng((seed, 0x5EED))
    taken: set[int] = set()
    by_class = np.asarray(labels)
    for label in np.unique(by_class):
        members = np.flatnonzero(by_class == label)
        count = min(max(1, round(fraction * len(members))), len(members) - 1)
        taken.update(random.permutation(members)[:count].tolist())
    kept = [index for position, index in enumerate(indices) if position not in taken]
    return kept, [index for position, index in enumerate(indices) if position in taken]


def stratified_subset(indices: Sequence[int], labels: Sequence[int], limit: int, seed: int) -> list[int]:
    """Take `limit` of the indices, from each class as evenly as can be, in the given order."""
    random = np.random.default_rng((seed, 0x11417))
    by_class = np.asarray(labels)
    # the n-th shape of each class comes before any class's (n+1)-th
    turn = np.empty(len(by_class), dtype=np.int64)
    for label in np.unique(by_class):
        members = random.permutation(np.flatnonzero(by_class == label))
        turn[members] = np.arange(len(members))
    order = np.lexsort((random.permutation(len(by_class)), turn))
    taken = set(order[:limit].tolist())
    return [index for position, index in enumerate(indices) if position in taken]


def training_indices(config: Any, prepared: Any) -> Indices:
    """Decide what is trained on and what chooses the best epoch.

    The data set's own validation split is used if it has one; `--select test` holds nothing back.

    Args:
        config: A TrainConfig.
        prepared: A Prepared.

    Raises:
        DataError: There are fewer than two classes or shapes to train on, or none in a split that is asked for.
    """
    if len(prepared.classes) < 2:
        only = f"the single class {prepared.classes[0]}" if prepared.classes else "no classes"
        raise DataError(
            f"{prepared.spec} has {only}, so there is nothing to tell apart",
            hint="put the files of each class into a folder of its own: CLASS/file or CLASS/train/file",
            code="dataset.classes",
        )
    labels = [record.label for record in prepared.records]
    train, held_out = prepared.split("train"), prepared.split("val")
    if config.train_limit is not None:
        train = stratified_subset(train, [labels[i] for i in train], config.train_limit, config.seed)
    if config.select == "test":
        chosen = Indices(train, prepared.split("test"), "the test split")
        if not chosen.select:
            raise DataError(
                f"no shapes for split 'test' in {prepared.spec}",
                hint="choose the best epoch on a validation split: --select val",
                code="dataset.empty-split",
            )
    elif held_out:
        chosen = Indices(train, held_out, "the data set's validation split")
    else:
        kept, off = stratified_split(train, [labels[i] for i in train], config.val_fraction, config.seed)
        chosen = Indices(
            kept, off, f"{len(off)} shapes held out of train" if off else "nothing (the last epoch is kept)"
        )
    if len(chosen.train) < 2:
        raise DataError(
            f"{len(chosen.train)} shapes to train on in {prepared.spec}; at least 2 are needed",
            hint="give more shapes in split 'train', or a smaller --val-fraction",
            code="dataset.empty-split",
        )
    return chosen


def shown_indices(indices: Indices, labels: Sequence[int], count: int) -> list[int]:
    """A few fixed shapes whose views are kept for the report: one of each class in turn."""
    pool = indices.select or indices.train
    return stratified_subset(pool, [labels[i] for i in pool], count, seed=0)
