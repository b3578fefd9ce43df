"""Data sets that come with a list of what belongs to them: what of it is not there."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence, Set
from pathlib import Path

from mvtn_cli.core.datasets.dataset import SPLITS, Dataset, Missing
from mvtn_cli.core.datasets.layouts import where
from mvtn_cli.errors import DataError

TOLERATED = 0.25  # of all listed shapes: beyond it, the set was not unpacked whole
NAMED = 6  # parts in an error message


def absent_parts(absent: Mapping[str, Sequence[str]], present: Set[str]) -> tuple[Missing, ...]:
    """Return what is missing, part by part; `present` are the parts of which something is there."""
    return tuple(Missing(part, tuple(names), part not in present) for part, names in absent.items())


def share_words(counts: Counter[str]) -> str:
    """Say `9843 train, 2468 test`."""
    return ", ".join(f"{counts[split]} {split}" for split in SPLITS if counts[split])


def missing_words(missing: Sequence[Missing]) -> str:
    """Say how many listed shapes are not there; empty if all are."""
    count = sum(len(part.names) for part in missing)
    return f"; {count:,} listed shapes are not there" if count else ""


def refuse_missing(dataset: Dataset, word: str, root: Path) -> None:
    """Refuse a listed data set of which a whole part, a quarter of all shapes, or a split is missing.

    Args:
        dataset: As surveyed.
        word: Its kind, one of `LAYOUTS`.
        root: Its folder.

    Raises:
        DataError: Says what is missing and where people get it.
    """
    whole = [part for part in dataset.missing if part.whole]
    lost = sum(len(part.names) for part in dataset.missing)
    listed = lost + len(dataset.items)
    if whole:
        named = ", ".join(part.part for part in whole[:NAMED]) + (", …" if len(whole) > NAMED else "")
        shapes = sum(len(part.names) for part in whole)
        what = f"{named}: {shapes:,} of the {listed:,} listed shapes"
    elif lost > TOLERATED * listed:
        what = f"{lost:,} of the {listed:,} listed shapes, the first is {dataset.missing[0].names[0]}"
    else:
        return
    raise DataError(
        f"{root} lacks {what}",
        hint=f"{where(word)}; to go on without them: {_skipping(dataset.spec)}",
        code="dataset.missing-part",
    )


def refuse_empty_split(dataset: Dataset, word: str, root: Path) -> None:
    """Refuse a data set without training or without test shapes.

    Raises:
        DataError: Says which.
    """
    for split in ("train", "test"):
        if not dataset.count(split):
            raise DataError(
                f"no shapes for split '{split}' in {root}: {dataset.title}",
                hint=where(word),
                code="dataset.empty-split",
            )


def refuse_labels(dataset: Dataset) -> None:
    """Refuse labels that no class name belongs to.

    Raises:
        DataError: Names the first.
    """
    if not dataset.classes:
        return
    for item in dataset.items:
        if not 0 <= item.label < len(dataset.classes):
            raise DataError(
                f"{item.source}: label {item.label} is out of range for {len(dataset.classes)} class names",
                hint=f"mvtn doctor {dataset.spec} counts them all",
                code="dataset.label",
            )


def _skipping(spec: str) -> str:
    return f"{spec}{'&' if '?' in spec else '?'}missing=skip"
